"""Device profiles and EDS files: what is read, and how each defect is named."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError

from schwung.errors import InputError
from schwung.fieldbus import eds
from schwung.fieldbus.drive import Parameter
from schwung.fieldbus.profile import (
    CanopenProfile,
    ObjectRef,
    Ref,
    list_profiles,
    load_canopen_profile,
    load_profile,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the bench profile that a test may spoil."""
    source = load_profile("schwung-bench").folder
    return Path(shutil.copytree(source, tmp_path / "drive"))


def spoil(folder: Path, old: str, new: str) -> Path:
    file = folder / "profile.toml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    return file


def test_every_packaged_profile_loads_with_an_eds_that_has_its_objects() -> None:
    profiles = {profile.family: profile for profile in list_profiles()}
    assert {"schwung-bench", "generic-cia402"} <= set(profiles)
    for profile in profiles.values():
        if not isinstance(profile, CanopenProfile):
            continue
        dictionary = eds.load_dictionary(profile.eds_path, 5)
        for pdo in profile.pdo:
            for ref in pdo.entries:
                assert eds.find_parameter(dictionary, ref.index, ref.subindex) is not None, (
                    profile.family,
                    str(ref),
                )


def test_bench_profile_is_read_as_it_is_written() -> None:
    profile = load_profile("schwung-bench")
    assert profile.identity is not None
    assert (profile.identity.vendor_id, profile.identity.product_code) == (0x53574E47, 0x402)
    assert profile.quantities.position.demand == ObjectRef(index=0x607A, subindex=0)
    assert [str(e) for e in profile.rpdos[0].entries] == ["6040:00", "607A:00", "60B2:00"]
    assert profile.export.table is not None
    assert profile.export.table.values.index == 0x2300
    assert profile.control.speed_integral_time is not None
    assert profile.control.speed_integral_time.scale == 1e-6


def test_generic_profile_accepts_anybody_and_exports_nothing() -> None:
    profile = load_profile("generic-cia402")
    assert profile.identity is None
    assert profile.export.table is None
    assert profile.export.scalar is None
    vendor_specific = [i for i in eds.load_dictionary(profile.eds_path, 1).indices if 0x2000 <= i < 0x6000]
    assert vendor_specific == []


def test_a_profile_loads_by_folder_and_by_file(folder: Path) -> None:
    assert load_profile(folder).family == load_profile(folder / "profile.toml").family == "schwung-bench"


def test_a_profile_extends_another_table_by_table(tmp_path: Path) -> None:
    file = tmp_path / "profile.toml"
    file.write_text(
        'extends = "schwung-bench"\nfamily = "mine"\n[identity]\nproduct_code = 7\n'
        '[quantities.speed]\nunit = "literal"\nscale = 0.5\n',
        encoding="utf-8",
    )
    mine, base = load_profile(file), load_profile("schwung-bench")
    assert isinstance(mine, CanopenProfile)
    assert isinstance(base, CanopenProfile)
    assert mine.identity is not None
    assert (mine.identity.vendor_id, mine.identity.product_code) == (0x53574E47, 7)
    assert mine.eds_path == base.eds_path
    assert mine.quantities.speed is not None
    assert (str(mine.quantities.speed.object), mine.quantities.speed.scale) == ("606C:00", 0.5)
    assert mine.model_copy(update={
        "family": base.family, "identity": base.identity, "quantities": base.quantities
    }) == base  # fmt: skip


def test_a_profile_may_extend_one_beside_it_and_not_for_ever(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_text('extends = "schwung-bench"\nname = "Site"\n', encoding="utf-8")
    (tmp_path / "axis.toml").write_text('extends = "site.toml"\nfamily = "axis"\n', encoding="utf-8")
    (tmp_path / "round.toml").write_text('extends = "round.toml"\n', encoding="utf-8")
    assert (load_profile(tmp_path / "axis.toml").name, load_profile(tmp_path / "axis.toml").family) == (
        "Site",
        "axis",
    )
    with pytest.raises(InputError, match="extends"):
        load_profile(tmp_path / "round.toml")
    (tmp_path / "lost.toml").write_text('extends = "no-such-family"\n', encoding="utf-8")
    with pytest.raises(InputError, match="no-such-family"):
        load_profile(tmp_path / "lost.toml")


def test_a_modbus_family_is_refused_where_canopen_is_wanted() -> None:
    with pytest.raises(InputError, match="schwung-bench-modbus"):
        load_canopen_profile("schwung-bench-modbus")


@pytest.mark.parametrize(
    ("text", "index", "space"),
    [("6064:00", 0x6064, "object"), ("@7706:INTEGER32", 7706, "register"), ("2300", 0x2300, "object")],
)
def test_objects_and_registers_are_written_each_in_its_way(text: str, index: int, space: str) -> None:
    ref = TypeAdapter(Ref).validate_python(text)
    assert (ref.index, ref.space) == (index, space)
    assert str(ref) == text.partition(":I")[0] + (":00" if text == "2300" else "")


def test_a_profile_cannot_be_changed() -> None:
    profile = load_profile("schwung-bench")
    with pytest.raises(ValidationError):
        profile.quantities.torque.rated_torque_scale = 1.0  # what is tested


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("version = 1", "version = 2", "version"),
        ('object = "6064:00"', 'object = "position"', "quantities.position.object"),
        ('unit = "encoder"', 'unit = "turns"', "quantities.position.unit"),
        ('unit = "encoder"', 'unit = "literal"', "scale"),
        ("csp = 8", "csv = 9", "modes"),
        ("points = 64", "points = 0", "export.table.points"),
        ("scale_kgm2 = 1e-7", "scale_kgm2 = -1.0", "scale_kgm2"),
        ("counter = true", "contour = true", "sync.contour"),
        ('entries = ["606C:00"]', 'entries = ["6062:00"]', "606C:00"),
        ('entries = ["6040:00", "607A:00", "60B2:00"]', 'entries = ["6040:00", "607A:00"]', "60B2:00"),
        ('entries = ["606C:00"]', 'entries = ["606C:00", "606C:00"]', "twice"),
        ('eds = "schwung-bench.eds"', 'eds = "nowhere.eds"', "nowhere.eds"),
        ("[identity]", "[identity", "TOML"),
        ('trace = "sim', 'tracer = "sim', 'no part "tracer"'),
        ('"harmonic feed-forward" =', '"harmonics" =', "cannot.harmonics"),
        ('object = "6064:00"', 'object = "@6064:INTEGER32"', "is a register"),
        ('object = "6064:00"', 'object = "0064:00"', "begin at 1000"),
        ('layout = "rows"', 'layout = "columns"', "trace"),
        ('demand = "607A:00"', "", "demand is missing"),
    ],
)
def test_each_defect_is_named_with_file_and_remedy(folder: Path, old: str, new: str, named: str) -> None:
    file = spoil(folder, old, new)
    with pytest.raises(InputError) as raised:
        load_profile(folder)
    assert str(file) in str(raised.value)
    assert named in str(raised.value)
    assert raised.value.remedy


def test_an_unknown_family_is_told_the_known_ones() -> None:
    with pytest.raises(InputError, match="schwung-bench"):
        load_profile("no-such-drive")


@pytest.mark.parametrize(
    "content", [b"", b"[1000\n", b"[1000]\nObjectType=seven\n", b"[1000sub1]\nParameterName=x\n"]
)
def test_a_broken_eds_is_an_input_error(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "broken.eds"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"broken\.eds"):
        eds.load_dictionary(file, 1)


def test_an_eds_in_a_windows_code_page_is_read(tmp_path: Path) -> None:
    file = tmp_path / "windows.eds"
    file.write_bytes(
        b"[6041]\nParameterName=Status \x94 word\nObjectType=0x7\nDataType=0x0006\nAccessType=ro\n"
    )
    found = eds.find_parameter(eds.load_dictionary(file, 1), 0x6041, 0)
    assert found is not None
    assert (found.type, found.name) == ("UNSIGNED16", "Status ” word")


@pytest.mark.parametrize(
    ("type_name", "raw", "data"),
    [
        ("INTEGER8", -1, b"\xff"),
        ("UNSIGNED16", 0x1234, b"\x34\x12"),
        ("INTEGER32", -2, b"\xfe\xff\xff\xff"),
        ("UNSIGNED24", 0x010203, b"\x03\x02\x01"),
        ("REAL32", 0.5, b"\x00\x00\x00\x3f"),
        ("VISIBLE_STRING", "drive", b"drive"),
        ("DOMAIN", b"\x00\x01", b"\x00\x01"),
    ],
)
def test_types_are_coded_as_cia_301_has_them(
    type_name: str, raw: int | float | str | bytes, data: bytes
) -> None:
    parameter = Parameter(0x2000, 0, type_name)
    assert eds.encode(parameter, raw) == data
    assert eds.decode(parameter, data) == raw


def test_a_value_out_of_its_type_is_refused_and_excess_bytes_are_cut() -> None:
    parameter = Parameter(0x6060, 0, "INTEGER8", "Modes of operation")
    for raw in (128, 1.5, "eight"):
        with pytest.raises(InputError, match="0x6060:00"):
            eds.encode(parameter, raw)
    assert eds.decode(parameter, b"\xff\xaa\xaa\xaa") == -1  # four bytes for one, as some drives answer
    with pytest.raises(InputError, match="0 bytes"):
        eds.decode(parameter, b"")
