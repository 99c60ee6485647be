"""DCFs that we write are read back without a difference by canopen, by dcfchk, and by ourselves."""

from __future__ import annotations

import random
import struct
import sys
import warnings
from pathlib import Path

import canopen
import dcf
import dcf.cli
import pytest
from real_eds import real_eds_files

from schwung.errors import InputError
from schwung.fieldbus.dcf import dcf_text, write_dcf
from schwung.fieldbus.drive import DriveIdentity, Parameter, ParameterValue
from schwung.fieldbus.eds import EdsFile, byte_size, integer_range, read_eds
from schwung.fieldbus.profile import CanopenProfile, list_profiles

NODE = 5
IDENTITY = DriveIdentity(NODE, 0x12345678, 0x402, 0x10002, 99, "drive")
_PROFILES = [profile.eds_path for profile in list_profiles() if isinstance(profile, CanopenProfile)]
_FILES = [*dict.fromkeys(_PROFILES), *real_eds_files()]
every_file = pytest.mark.parametrize("path", _FILES, ids=lambda path: f"{path.parent.name}/{path.stem}")


def _values(file: EdsFile, seed: int = 1) -> list[ParameterValue]:
    """A value for everything that can be written; PDO mappings as the file has them, since they name objects."""
    chance = random.Random(seed)
    values = []
    for variable in file.description.variables():
        if not variable.writable or 0x1600 <= variable.index < 0x1800 or 0x1A00 <= variable.index < 0x1C00:
            continue
        ends = integer_range(variable.type)
        if ends is not None:
            low = ends[0] if variable.low is None else variable.low
            high = ends[1] if variable.high is None else variable.high
            raw: int | float | str | bytes = chance.choice((low, high, chance.randint(low, high)))
        elif variable.type.startswith("REAL"):
            raw = struct.unpack("<f", struct.pack("<f", chance.uniform(-1e6, 1e6)))[0]
        elif variable.type in ("VISIBLE_STRING", "UNICODE_STRING"):
            raw = (
                "".join(chance.choices("abc XYZ-_;#()%$", k=9))
                .strip(" ;#")
                .replace(" ;", ";")
                .replace(" #", "#")
            )
        else:
            raw = chance.randbytes(chance.randint(1, 9))
        values.append(ParameterValue(file.parameter_of(variable), raw))
    return values


def _dcfchk(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tool as it is called; a warning of its is a difference."""
    monkeypatch.setattr(sys, "argv", ["dcfchk", "-p", "-n", str(NODE), str(path)])
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        dcf.cli.main()  # exits with 1 where it finds something


@every_file
def test_a_dcf_of_any_eds_is_read_back_without_differences(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = read_eds(path, NODE)
    values = _values(file)
    written = tmp_path / "drive.dcf"
    made = dcf_text(file, values, written.name, identity=IDENTITY, bit_rate=500_000)
    assert made.left_out == ()
    written.write_text(made.text, encoding="ascii")
    _dcfchk(written, monkeypatch)
    by_canopen = canopen.import_od(str(written), NODE)
    by_dcftools = dcf.Device.from_dcf(str(written), {"NODEID": NODE})
    again = read_eds(written, NODE)
    assert all("by the standard" in w.problem for w in again.warnings)
    for value in values:
        index, subindex, raw = value.parameter.index, value.parameter.subindex, value.raw
        entry = by_canopen.indices[index]
        theirs = entry.subindices[subindex] if hasattr(entry, "subindices") else entry
        other = by_dcftools[index][subindex]
        if isinstance(raw, float):
            size = byte_size(value.parameter.type) or 4
            bits = struct.pack(">f" if size == 4 else ">d", raw)
            assert (
                int(theirs.value_raw, 16).to_bytes(size, "big") == bits
            )  # canopen reads no REAL in this notation
            assert other.parse_value() == raw
        elif isinstance(raw, str):
            assert theirs.value == raw
            assert other.value.value == raw
        else:
            assert theirs.value == raw, value.parameter.label
            assert other.parse_value() == raw, value.parameter.label
        ours = again.variable(index, subindex)
        assert ours is not None
        assert ours.configured is not None
        assert ours.configured.raw == raw
    assert {(v.index, v.subindex) for v in again.description.variables()} == {
        (v.index, v.subindex) for v in file.description.variables()
    }
    for before in file.description.variables():
        after = again.variable(before.index, before.subindex)
        assert after is not None
        assert (after.type, after.access, after.mappable, after.flags, after.default) == (
            before.type, before.access, before.mappable, before.flags, before.default)  # fmt: skip
    assert (again.description.node_id, again.description.bit_rate) == (NODE, 500_000)


OWN = _PROFILES[0].parent.parent / "schwung-bench/schwung-bench.eds"


def test_what_an_earlier_user_configured_is_gone(tmp_path: Path) -> None:
    first = read_eds(OWN, NODE)
    parameter = first.parameter(0x6065)
    earlier = tmp_path / "earlier.dcf"
    earlier.write_text(dcf_text(first, [ParameterValue(parameter, 7)], "earlier.dcf").text)
    other = read_eds(earlier, NODE).parameter(0x6081)
    later = tmp_path / "later.dcf"
    later.write_text(dcf_text(read_eds(earlier, NODE), [ParameterValue(other, 9)], "later.dcf").text)
    held = {v.index: v.configured.raw for v in read_eds(later, NODE).description.variables() if v.configured}
    assert held == {0x6081: 9}


def test_a_value_that_the_format_cannot_hold_is_named_not_bent(tmp_path: Path) -> None:
    file = read_eds(OWN, NODE)
    name = Parameter(0x1008, 0, "VISIBLE_STRING", "Name")
    for text in ("with ; comment", " blank in front", "two\nlines", "µ", "# first"):
        made = dcf_text(file, [ParameterValue(name, text)], "x.dcf")
        assert [value.raw for value in made.left_out] == [text]
    assert dcf_text(file, [ParameterValue(name, "a;b#c  d")], "x.dcf").left_out == ()
    with pytest.raises(InputError, match="cannot hold"):
        write_dcf(OWN, NODE, [ParameterValue(name, "a ; b")], tmp_path / "x.dcf")
    assert not (tmp_path / "x.dcf").exists()


def test_limits_that_the_drive_itself_breaks_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = OWN.read_text().replace("DefaultValue=100000", "DefaultValue=100\nLowLimit=1\nHighLimit=1000", 1)
    eds = tmp_path / "narrow.eds"
    eds.write_text(text)
    file = read_eds(eds, NODE)
    narrow = next(v for v in file.description.variables() if v.high == 1000)
    made = dcf_text(file, [ParameterValue(file.parameter_of(narrow), 5000)], "wide.dcf")
    path = tmp_path / "wide.dcf"
    path.write_text(made.text)
    _dcfchk(path, monkeypatch)
    after = read_eds(path, NODE).variable(narrow.index, narrow.subindex)
    assert after is not None
    assert (after.high, after.configured and after.configured.raw) == (None, 5000)


def test_a_parameter_that_the_eds_lacks_is_refused() -> None:
    with pytest.raises(InputError, match="has no object 0x2999"):
        dcf_text(read_eds(OWN, NODE), [ParameterValue(Parameter(0x2999, 0, "UNSIGNED8", "x"), 1)], "x.dcf")
