"""The whole configuration of every CANopen drive is kept in a file, compared and put back; the doctor looks at each."""

from __future__ import annotations

import random
import sys
import warnings
from pathlib import Path
from typing import get_args

import dcf.cli
import pytest
from conformance_rooms import NODE, CanopenRoom, Room

from schwung.commissioning.backup import plan_restore, read_snapshot, write_plan
from schwung.commissioning.compare import Configuration, compare, from_drive
from schwung.commissioning.configuration_files import (
    Format,
    for_this_drive,
    load_configuration,
    save_configuration,
)
from schwung.commissioning.doctor import examine_drive
from schwung.commissioning.doctor_canopen import dictionary_checks
from schwung.commissioning.journal import ParameterJournal, restore_backup
from schwung.errors import SdoError
from schwung.fieldbus.canopen.pdo import is_pdo_object
from schwung.fieldbus.configuration import select
from schwung.fieldbus.drive import ParameterValue
from schwung.fieldbus.eds import EdsFile, integer_range, read_eds
from schwung.fieldbus.si import SiScales

CHANGED = 6
_LEFT_ALONE = (0x1016, 0x1017, 0x1005, 0x1006, 0x1019, 0x100C, 0x100D, 0x1014, 0x2F00)


def _dictionary(room: CanopenRoom) -> EdsFile:
    return read_eds(room.case.eds or room.profile.eds_path, NODE)


def _other_values(room: CanopenRoom, file: EdsFile, held: tuple[ParameterValue, ...]) -> list[ParameterValue]:
    """A few parameters with other values that the drive takes, and as it was again."""
    found: list[ParameterValue] = []
    for value in random.Random(room.case.id).sample(held, len(held)):
        parameter, raw = value.parameter, value.raw
        ends = integer_range(parameter.type)
        variable = file.variable(parameter.index, parameter.subindex)
        plain = ends is not None and isinstance(raw, int) and variable is not None
        if not plain or is_pdo_object(parameter) or parameter.index in _LEFT_ALONE:
            continue
        high = variable.high if variable.high is not None else ends[1]
        other = ParameterValue(parameter, raw + 1 if raw < high else raw - 1)
        try:
            room.drive.write([other])
            takes = room.drive.read(parameter) == other
            room.drive.write([value])
        except SdoError:
            continue
        if takes and room.drive.read(parameter) == value:
            found.append(other)
        if len(found) == CHANGED:
            break
    return found


FILES: dict[Format, str] = {"dcf": "a.dcf", "concise": "a.bin", "backup": "a.backup.json"}


def test_a_configuration_is_kept_and_put_back_in_every_format(
    canopen_room: CanopenRoom, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room, file = canopen_room, _dictionary(canopen_room)
    held = read_snapshot(room.drive.read, select(file, room.profile)).values
    assert held
    assert set(FILES) == set(get_args(Format))
    saved = {form: _saved(room, file, held, form, tmp_path / name) for form, name in FILES.items()}
    monkeypatch.setattr(sys, "argv", ["dcfchk", "-n", str(NODE), str(tmp_path / FILES["dcf"])])
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        dcf.cli.main()
    others = _other_values(room, file, held)
    assert others, "this drive takes no other value for anything"
    before = room.held()
    for form, kept in saved.items():
        room.drive.write(others)
        changed = from_drive("drive", read_snapshot(room.drive.read, select(file, room.profile)).values, NODE)
        differing = {
            (d.parameter.index, d.parameter.subindex)
            for d in compare(kept, changed, SiScales({})).differences
        }
        assert differing == {(v.parameter.index, v.parameter.subindex) for v in others}, form
        if form == "backup":
            restore_backup(room.drive, tmp_path / FILES[form])
        else:
            fitted = for_this_drive(kept, file, room.profile, room.drive.identity, False)
            journal = ParameterJournal(room.drive, tmp_path / f"{form}.backup.json", room.drive.describe())
            written = write_plan(room.drive, plan_restore(room.drive, fitted.values), journal)
            assert written.refused == (), form
            assert {c.parameter for c in written.changes} == {v.parameter for v in others}, form
        assert room.held() == before, form
    assert read_snapshot(room.drive.read, select(file, room.profile)).values == held


def _saved(
    room: CanopenRoom, file: EdsFile, held: tuple[ParameterValue, ...], form: Format, path: Path
) -> Configuration:
    """Saved and read again: all that the drive holds."""
    drive = room.drive
    left_out = save_configuration(path, form, file, held, drive.identity, drive.describe(), drive.clock)
    assert left_out == (), form
    kept = load_configuration(path, NODE, file)
    assert compare(kept, from_drive("drive", held, NODE), SiScales({})).differences == (), form
    return kept


def test_the_doctor_says_of_each_drive_what_is_missing_and_how_to_mend_it(room: Room) -> None:
    found = examine_drive(room.drive, room.profile, lambda _: None)
    names = {check.name: check for check in found.checks}
    assert (names["state"].severity == "ok") == (room.drive.state().cia402 != "unknown")
    assert names["units"].severity == "ok"
    assert all(check.text and check.remedy for check in found.checks if check.severity in ("stop", "warning"))
    missing = {name for name in ("torque", "torque injection", "generator") if not room.offers(name)}
    injects = not {"torque injection", "generator"} <= missing
    assert found.can_start == (
        room.mode is not None and injects and "torque" not in missing and _samples(room)
    )


def _samples(room: Room) -> bool:
    return room.offers("sampling by SYNC") or room.offers("trace buffer")


def test_the_eds_of_each_drive_is_found_to_be_its_own(canopen_room: CanopenRoom) -> None:
    found = list(dictionary_checks(canopen_room.drive, _dictionary(canopen_room), canopen_room.profile))
    assert {check.name: check.severity for check in found}["EDS"] == "ok"
