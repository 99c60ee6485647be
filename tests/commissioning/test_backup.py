"""A whole configuration: what is read, what is left out and why, and how it is written back."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schwung.clock import SteppedClock
from schwung.commissioning.backup import plan_restore, read_snapshot, write_plan
from schwung.commissioning.compare import Configuration, compare
from schwung.commissioning.configuration_files import (
    for_this_drive,
    load_both,
    load_configuration,
    save_configuration,
)
from schwung.commissioning.journal import ParameterJournal, read_backup
from schwung.errors import InputError, NodeLostError, RefusedError, SdoError
from schwung.fieldbus.configuration import mapped_live, select
from schwung.fieldbus.drive import DriveIdentity, Parameter, ParameterValue, RawValue
from schwung.fieldbus.eds import encode, read_eds
from schwung.fieldbus.profile import load_canopen_profile
from schwung.fieldbus.si import SiScales, si_scales

NODE = 5
PROFILE = load_canopen_profile("schwung-bench")
EDS = read_eds(PROFILE.eds_path, NODE)
CLOCK = SteppedClock()
IDENTITY = DriveIdentity(NODE, 0x53574E47, 0x402, 0x10000, 7, "paper drive")


class _Abort(Exception):
    def __init__(self, code: int) -> None:
        self.code = code


def refusal(parameter: Parameter, words: str = "value out of range", code: int = 0x06090030) -> SdoError:
    """What the driver raises where the drive refuses."""
    error = SdoError(f"node {NODE}, {parameter.label}", words)
    error.__cause__ = _Abort(code)
    return error


class PaperDrive:
    """A dictionary with rules: what it refuses now, what it takes only beside something else, what it forgets."""

    def __init__(self) -> None:
        self.identity, self.clock = IDENTITY, CLOCK
        self.held: dict[tuple[int, int], RawValue] = {
            (v.index, v.subindex): v.default.raw for v in EDS.description.variables() if v.default is not None
        }
        self.refused: set[tuple[int, int]] = set()
        self.hidden: set[tuple[int, int]] = set()
        self.forgets: set[tuple[int, int]] = set()
        self.needs: dict[tuple[int, int], tuple[int, int, RawValue]] = {}
        self.log: list[str] = []
        self.dead = False

    def read(self, parameter: Parameter) -> ParameterValue:
        key = parameter.index, parameter.subindex
        if self.dead:
            raise SdoError(f"node {NODE}, {parameter.label}", "no answer to read it")
        if key in self.hidden:
            raise refusal(parameter, "object does not exist", 0x06020000)
        return ParameterValue(parameter, self.held.get(key, 0))

    def write(self, values: Sequence[ParameterValue]) -> None:
        for value in values:
            key = value.parameter.index, value.parameter.subindex
            self.log.append(f"{key[0]:04X}:{key[1]:02X}={value.raw}")
            needed = self.needs.get(key)
            if key in self.refused or (needed is not None and self.held.get(needed[:2]) != needed[2]):
                raise refusal(value.parameter)
            if key not in self.forgets:
                self.held[key] = value.raw

    def passed_through(self, values: Sequence[ParameterValue]) -> list[Parameter]:
        return []

    def disable(self) -> None:
        self.log.append("disable")

    def store(self) -> None:
        self.log.append("store")


@pytest.fixture
def drive() -> PaperDrive:
    return PaperDrive()


def _value(index: int, subindex: int, raw: RawValue) -> ParameterValue:
    return ParameterValue(EDS.parameter(index, subindex), raw)


# ── reading ──────────────────────────────────────────────────────────────────────────────────────────────────────


def test_every_object_of_the_eds_is_read_or_left_out_with_a_reason(drive: PaperDrive) -> None:
    chosen = select(EDS, PROFILE)
    snapshot = read_snapshot(drive.read, chosen)
    read = {(v.parameter.index, v.parameter.subindex) for v in snapshot.values}
    left = {(s.parameter.index, s.parameter.subindex): s.reason for s in snapshot.skipped}
    writable = {(v.index, v.subindex) for v in EDS.description.variables() if v.writable and v.readable}
    assert read | left.keys() == writable
    assert not read & left.keys()
    assert all(left.values())
    for index, subindex, word in (
        (0x1003, 0, "clears"), (0x1010, 1, "command"), (0x1011, 1, "command"), (0x6040, 0, "controlword"),
        (0x607A, 0, "live"), (0x60B2, 0, "live"), (0x2100, 4, "generator"), (0x2200, 3, "trace"),
    ):  # fmt: skip
        assert word in left[index, subindex]
    assert {(0x6065, 0), (0x1800, 1), (0x1A00, 1), (0x1016, 1), (0x2300, 64), (0x2400, 1)} <= read


def test_what_an_rpdo_writes_is_live_and_left_out(drive: PaperDrive) -> None:
    drive.held |= {(0x1400, 1): 0x205, (0x1600, 0): 2, (0x1600, 1): 0x60400010, (0x1600, 2): 0x60810020}
    snapshot = read_snapshot(drive.read, select(EDS, PROFILE))
    assert [s.reason for s in snapshot.skipped if s.parameter.index == 0x6081] == ["live: RPDO 1 writes it"]
    drive.held[0x1400, 1] = 0x80000205
    assert any(v.parameter.index == 0x6081 for v in read_snapshot(drive.read, select(EDS, PROFILE)).values)


def test_a_mapping_that_is_switched_off_makes_nothing_live() -> None:
    values = [_value(0x1400, 1, 0x80000205), _value(0x1600, 0, 1), _value(0x1600, 1, 0x60810020)]
    assert mapped_live(values) == {}


def test_what_the_drive_does_not_show_is_left_out_and_a_dead_drive_is_not(drive: PaperDrive) -> None:
    drive.hidden.add((0x6065, 0))
    snapshot = read_snapshot(drive.read, select(EDS, PROFILE))
    assert [s.reason for s in snapshot.skipped if s.parameter.index == 0x6065] == ["object does not exist"]
    drive.dead = True
    with pytest.raises(SdoError, match="no answer"):
        read_snapshot(drive.read, select(EDS, PROFILE))


def test_flags_of_the_eds_are_heeded(tmp_path: Path) -> None:
    text = PROFILE.eds_path.read_text()
    at = text.index("PDOMapping", text.index("[6065]"))
    eds = tmp_path / "flags.eds"
    eds.write_text(f"{text[:at]}ObjFlags=1\n{text[at:]}")
    left = {s.parameter.index: s.reason for s in select(read_eds(eds, NODE)).skipped}
    assert "ObjFlags" in left[0x6065]


# ── files ────────────────────────────────────────────────────────────────────────────────────────────────────────


def _everything(drive: PaperDrive) -> tuple[ParameterValue, ...]:
    return read_snapshot(drive.read, select(EDS, PROFILE)).values


@pytest.mark.parametrize(
    ("form", "name"), [("dcf", "a.dcf"), ("concise", "a.bin"), ("backup", "a.backup.json")]
)
def test_what_is_kept_in_a_file_is_read_from_it(
    drive: PaperDrive, tmp_path: Path, form: str, name: str
) -> None:
    values = _everything(drive)
    record = {"identity": vars(IDENTITY), "bus": {"bit_rate": 500000, "bit_rate_known": True}}
    assert save_configuration(tmp_path / name, form, EDS, values, IDENTITY, record, CLOCK) == ()  # type: ignore[arg-type]
    loaded = load_configuration(tmp_path / name, None, EDS)
    assert loaded.kind == form
    held = {(v.parameter.index, v.parameter.subindex): (v.raw, v.parameter.type) for v in loaded.values}
    for value in values:
        key = value.parameter.index, value.parameter.subindex
        assert held[key] == (value.raw, value.parameter.type)
    comparison = compare(loaded, Configuration("drive", "drive", values), SiScales({}))
    assert (comparison.differences, comparison.only_second, comparison.equal) == ((), (), len(values))
    if form != "concise":
        assert loaded.identity["product_code"] == 0x402
        assert loaded.node_id == NODE


def test_a_backup_file_without_changes_can_be_put_back(drive: PaperDrive, tmp_path: Path) -> None:
    path = tmp_path / "a.backup.json"
    save_configuration(
        path, "backup", EDS, [_value(0x6065, 0, 5)], IDENTITY, {"identity": vars(IDENTITY)}, CLOCK
    )
    backup = read_backup(path)
    assert [(c.old, c.new) for c in backup.changes] == [(5, 5)]
    assert backup.restored is None


def test_an_eds_beside_a_dcf_is_read_for_its_node(tmp_path: Path, drive: PaperDrive) -> None:
    path = tmp_path / "a.dcf"
    save_configuration(path, "dcf", EDS, _everything(drive), IDENTITY, {}, CLOCK)
    dcf, eds = load_both([path, PROFILE.eds_path], None)
    assert compare(dcf, eds, SiScales({})).differences == ()
    other = load_configuration(PROFILE.eds_path, 9)
    assert {d.parameter.index for d in compare(dcf, other, SiScales({})).differences} >= {
        0x1014,
        0x1400,
        0x1800,
    }


@pytest.mark.parametrize("content", [b"", b"hello", b"[FileInfo]\nFileName=x\n", b"\1\0\0\0", b"[1]"])
def test_a_file_that_holds_no_configuration_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"none of the files|empty"):
        load_configuration(path, None)
    with pytest.raises(InputError, match="does not exist"):
        load_configuration(tmp_path / "none.dcf", None)


# ── comparing ────────────────────────────────────────────────────────────────────────────────────────────────────


def test_values_differ_by_their_bytes_and_are_told_in_si() -> None:
    told = {(0x608F, 1): 1 << 20, (0x608F, 2): 1, (0x60A9, 0): 0xFDB44700, (0x6076, 0): 70000}
    scales = si_scales(PROFILE, lambda index, subindex: told.get((index, subindex)))
    untyped = Parameter(0x6065, 0, "UNSIGNED32")
    first = Configuration("a", "concise", (ParameterValue(untyped, 1 << 20), _value(0x6072, 0, 1000)))
    second = Configuration(
        "b", "dcf", (_value(0x6065, 0, 1 << 19), _value(0x6072, 0, 1000), _value(0x6060, 0, 8))
    )
    found = compare(first, second, scales)
    (difference,) = found.differences
    assert (difference.parameter.name, difference.first, difference.second) == (
        "Following error window", 1 << 20, 1 << 19)  # fmt: skip
    assert difference.first_si is not None
    assert difference.first_si.value == pytest.approx(6.283185307)
    assert str(difference.second_si) == "3.14159 rad"
    assert found.equal == 1
    assert [d.parameter.index for d in found.only_second] == [0x6060]
    assert str(scales.si(_value(0x6072, 0, 1000))) == "70 N·m"
    assert str(scales.si(_value(0x1017, 0, 250))) == "0.25 s"
    assert str(scales.si(_value(0x2400, 1, 60000))) == "60 1/s"
    assert scales.si(_value(0x6065, 0, 0xFFFFFFFF)) is None  # off, and no number of turns
    assert scales.si(_value(0x6060, 0, 8)) is None


def test_identifiers_of_two_nodes_are_equal_where_only_the_node_differs() -> None:
    def axis(node: int, *raw: int) -> Configuration:
        keys = ((0x1014, 0), (0x1800, 1), (0x1800, 2))
        return Configuration("x", "dcf", tuple(_value(*k, r) for k, r in zip(keys, raw, strict=True)), node)

    assert compare(axis(3, 0x83, 0x40000183, 1), axis(4, 0x84, 0x40000184, 1), SiScales({})).equal == 3
    found = compare(axis(3, 0x83, 0x183, 1), axis(4, 0x85, 0x284, 2), SiScales({})).differences
    assert [d.parameter.index for d in found] == [0x1014, 0x1800, 0x1800]


def test_negative_values_of_untyped_files_are_equal() -> None:
    untyped = Parameter(0x6060, 0, "UNSIGNED8")
    first = Configuration("a", "concise", (ParameterValue(untyped, 0xFD),))
    assert compare(first, Configuration("b", "dcf", (_value(0x6060, 0, -3),)), SiScales({})).equal == 1


# ── writing ──────────────────────────────────────────────────────────────────────────────────────────────────────


def _write(drive: PaperDrive, values: list[ParameterValue], folder: Path):
    journal = ParameterJournal(drive, folder / "restore.backup.json", {"identity": vars(IDENTITY)})
    return write_plan(drive, plan_restore(drive, values), journal)


def test_only_what_differs_is_written_with_the_power_stage_off_and_a_way_back(
    drive: PaperDrive, tmp_path: Path
) -> None:
    seen: list[int] = []
    write = drive.write

    def spying(values: Sequence[ParameterValue]) -> None:
        seen.append(len(json.loads((tmp_path / "restore.backup.json").read_text())["changes"]))
        write(values)

    drive.write = spying  # type: ignore[method-assign]  # a spy
    same = drive.held[0x6081, 0]
    written = _write(drive, [_value(0x6081, 0, same), _value(0x6065, 0, 77), _value(0x6060, 0, 1)], tmp_path)
    assert drive.log == ["disable", "6065:00=77", "6060:00=1"]
    assert seen == [2, 2]  # both old values were on disk before the first write
    assert (written.refused, written.equal) == ((), 1)
    assert [c.old for c in read_backup(tmp_path / "restore.backup.json").changes] == [100000, 0]


def test_a_value_that_is_taken_only_beside_another_is_tried_again(drive: PaperDrive, tmp_path: Path) -> None:
    drive.needs[0x6065, 0] = (0x6081, 0, 9)
    written = _write(drive, [_value(0x6065, 0, 77), _value(0x6081, 0, 9)], tmp_path)
    assert written.refused == ()
    assert drive.held[0x6065, 0] == 77


def test_what_is_refused_for_good_is_named_and_the_rest_is_written(drive: PaperDrive, tmp_path: Path) -> None:
    drive.refused.add((0x6065, 0))
    written = _write(drive, [_value(0x6065, 0, 77), _value(0x6081, 0, 9)], tmp_path)
    assert [(r.value.parameter.index, r.reason) for r in written.refused] == [(0x6065, "value out of range")]
    assert drive.held[0x6081, 0] == 9


def test_a_value_that_its_type_cannot_hold_is_named_and_the_rest_is_written(
    drive: PaperDrive, tmp_path: Path
) -> None:
    write = drive.write

    def encoding(values: Sequence[ParameterValue]) -> None:
        for value in values:
            encode(value.parameter, value.raw)  # as the driver does before anything goes out
        write(values)

    drive.write = encoding  # type: ignore[method-assign]  # as strict as the real one
    (refused,) = _write(drive, [_value(0x6060, 0, 300), _value(0x6081, 0, 9)], tmp_path).refused
    assert refused.value.parameter.index == 0x6060
    assert drive.held[0x6081, 0] == 9


def test_a_drive_that_says_yes_and_does_no_is_found_out(drive: PaperDrive, tmp_path: Path) -> None:
    drive.forgets.add((0x6065, 0))
    (refused,) = _write(drive, [_value(0x6065, 0, 77)], tmp_path).refused
    assert "reads 100000" in refused.reason


def test_pdos_go_together_and_heartbeats_last(drive: PaperDrive, tmp_path: Path) -> None:
    values = [
        _value(0x1016, 1, 0x7F012C), _value(0x1017, 0, 100), _value(0x1800, 1, 0x185), _value(0x1A00, 1, 0x60640020),
        _value(0x6065, 0, 77), _value(0x1006, 0, 2000),
    ]  # fmt: skip
    _write(drive, values, tmp_path)
    assert [entry[:4] for entry in drive.log[1:]] == ["1006", "6065", "1800", "1A00", "1016", "1017"]


def test_a_drive_that_falls_silent_stops_the_writing(drive: PaperDrive, tmp_path: Path) -> None:
    def silent(values: Sequence[ParameterValue]) -> None:
        raise NodeLostError(f"node {NODE}", "no heartbeat")

    drive.write = silent  # type: ignore[method-assign]  # it dies here
    with pytest.raises(NodeLostError):
        _write(drive, [_value(0x6065, 0, 77)], tmp_path)
    assert (tmp_path / "restore.backup.json").exists()


# ── is it this drive's? ──────────────────────────────────────────────────────────────────────────────────────────


def _configuration(*values: ParameterValue, **more: object) -> Configuration:
    return Configuration("a.dcf", "dcf", values, **more)  # type: ignore[arg-type]


def test_a_configuration_of_another_drive_or_node_is_refused_unless_forced() -> None:
    value = _value(0x6065, 0, 77)
    other = _configuration(value, identity={"vendor_id": 1, "product_code": 0x402})
    moved = _configuration(value, node_id=NODE + 1)
    for wanted, words in ((other, "vendor_id"), (moved, "identifiers would collide")):
        with pytest.raises(RefusedError, match=words):
            for_this_drive(wanted, EDS, PROFILE, IDENTITY, False)
        assert for_this_drive(wanted, EDS, PROFILE, IDENTITY, True).values == (value,)
    with pytest.raises(InputError, match="defaults only"):
        for_this_drive(Configuration("x.eds", "eds", (value,)), EDS, PROFILE, IDENTITY, False)


def test_commands_live_values_and_strangers_are_left_out_of_what_is_written() -> None:
    stranger = ParameterValue(Parameter(0x3999, 0, "UNSIGNED8", "x"), 1)
    wanted = _configuration(
        _value(0x6040, 0, 15), _value(0x1018, 1, 1), stranger, _value(0x6065, 0, 77), _value(0x6081, 0, 5),
        _value(0x1400, 1, 0x205), _value(0x1600, 0, 1), _value(0x1600, 1, 0x60810020),
    )  # fmt: skip
    fitted = for_this_drive(wanted, EDS, PROFILE, IDENTITY, False)
    left = {item.parameter.index: item.reason for item in fitted.skipped}
    assert {v.parameter.index for v in fitted.values} == {0x6065, 0x1400, 0x1600}
    assert "controlword" in left[0x6040]
    assert "ro" in left[0x1018]
    assert "not in the EDS" in left[0x3999]
    assert "RPDO 1" in left[0x6081]


_KEYS = st.sampled_from(
    ["changes", "drive", "identity", "index", "subindex", "type", "old", "new", "when", "node_id", "hex"]
)
_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_KEYS, inner, max_size=6),
    max_leaves=12,
)


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=200) | _JSON.map(lambda d: json.dumps(d).encode()) | st.dictionaries(
    st.sampled_from(["changes", "drive", "restored", "stored"]), _JSON, max_size=4
).map(lambda d: json.dumps({"format": "schwung-backup", "version": 1, **d}).encode()))  # fmt: skip
def test_any_file_is_read_or_refused(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.any"
        path.write_bytes(content)
        try:
            found = load_configuration(path, None)
        except InputError as refusal:
            told = str(refusal)
        else:
            told = found.words
    assert str(path) in told
