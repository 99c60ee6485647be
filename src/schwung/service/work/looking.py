"""Runs that look at a bus or a drive and leave it as it is, but for switching it off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schwung.api.comparing import compared, comparison_document, held_by_drive, known_profile
from schwung.api.comparing import dictionary_of as dictionary_for
from schwung.api.configurations import (
    Format,
    Skipped,
    dictionary_of,
    load_both,
    read_snapshot,
    save_configuration,
    select,
)
from schwung.api.drives import ENERGISED, Connection
from schwung.api.drives import doctor as examine
from schwung.api.drives import scan as scan_bus
from schwung.api.profiles import CanopenProfile, DeviceProfile
from schwung.errors import InputError
from schwung.service.families import require_family
from schwung.service.jobs import Task

if TYPE_CHECKING:
    from schwung.api.drives import Diagnosis

_NAMES: dict[Format, str] = {"dcf": "drive.dcf", "concise": "drive.bin", "backup": "drive.backup.json"}


def scan(task: Task) -> Mapping[str, Any]:
    """See ScanRequest."""
    asked, lane = task.request, task.lane
    assert lane is not None
    if asked.first > asked.last:
        raise InputError("first", f"{asked.first} is after last, {asked.last}", "Give the smaller one first.")
    task.phase(f"Asking nodes {asked.first} to {asked.last}")
    with lane.released():
        found = scan_bus(lane.entry.options, nodes=range(asked.first, asked.last + 1), progress=task.progress)
    return {"nodes": [asdict(node) for node in found]}


def doctor(task: Task) -> Mapping[str, Any]:
    """See DoctorRequest."""
    record, lane = task.drive_record, task.lane
    assert lane is not None
    eds = None if task.request.eds_file_id is None else task.store.file_path(task.request.eds_file_id)
    with lane.released():
        found = examine(
            lane.entry.options, node=record.node_id, profile=record.profile, eds=eds, progress=task.phase
        )
    return _diagnosis(found)


def _diagnosis(found: Diagnosis) -> dict[str, Any]:
    return {
        "can_start": found.can_start,
        "profile": found.profile,
        "identity": None if found.identity is None else asdict(found.identity),
        "way": None if found.way is None else asdict(found.way),
        "checks": [asdict(check) for check in found.checks],
        "capabilities": [asdict(capability) for capability in found.capabilities],
    }


def backup(task: Task) -> Mapping[str, Any]:
    """See BackupRequest."""
    record, form = task.drive_record, task.request.form
    found = task.connect()
    family, drive = canopen(found.profile), found.drive
    dictionary = dictionary_of(None, family, drive.identity, record.node_id)
    selection = select(dictionary, family)
    task.phase(f"Reading {len(selection.wanted)} parameters")
    snapshot = read_snapshot(drive.read, selection, task.progress)
    target: Path = task.folder / _NAMES[form]
    left_out = save_configuration(
        target, form, dictionary, snapshot.values, drive.identity, drive.describe(), drive.clock
    )
    skipped = [
        *snapshot.skipped,
        *(Skipped(v.parameter, "the format cannot hold its text") for v in left_out),
    ]
    return {
        "file": target.name,
        "parameters": len(snapshot.values) - len(left_out),
        "left_out": [{"object": s.parameter.label, "because": s.reason} for s in skipped],
    }


def diff(task: Task) -> Mapping[str, Any]:
    """See DiffRequest."""
    asked, store = task.request, task.store
    if (asked.drive_id is None) == (asked.second_file_id is None):
        raise InputError(
            "drive_id", "and second_file_id: exactly one is needed", "Name what to compare with."
        )
    if asked.profile is not None:
        require_family(asked.profile)
    record = task.drive_record if asked.drive_id is not None else None
    node = None if record is None else record.node_id
    family = known_profile(asked.profile, ())
    eds = None if asked.eds_file_id is None else store.file_path(asked.eds_file_id)
    paths = [
        store.file_path(one, check=True) for one in (asked.file_id, asked.second_file_id) if one is not None
    ]
    dictionary = dictionary_for(eds, family, node or 1)
    files = load_both(paths, node, dictionary)
    second = files[-1]
    if record is not None:
        found = task.connect()
        live = held_by_drive(
            Connection(found.drive, found.profile), files[0], eds, record.node_id, task.phase, task.progress
        )
        second, family, dictionary = live.configuration, live.family, live.dictionary
    # where they lie is nobody's business
    sides = replace(files[0], source=paths[0].name), replace(second, source=Path(second.source).name)
    return {"diff": comparison_document(sides, compared(sides, family, dictionary, node or 1))}


def canopen(profile: DeviceProfile) -> CanopenProfile:
    """The profile of a CANopen drive. Raises InputError for another one: nobody tells which registers are settings."""
    if not isinstance(profile, CanopenProfile):
        raise InputError(
            f"profile {profile.family}", "is not for CANopen: nobody tells which registers are settings",
            "This is for CANopen drives, whose EDS tells it.",
        )  # fmt: skip
    return profile


def secure(task: Task) -> Mapping[str, Any]:
    """See SecureRequest. What an interrupted run has left gets a note of how the drive was found.

    A drive of which nobody can tell whether it is on is switched off as one that is.
    """
    task.phase("Looking at the drive")
    drive = task.connect().drive
    found = drive.state().cia402
    if found.lower() in (*ENERGISED, "unknown"):
        task.phase("Stopping it, switching it off")
        drive.halt()
        drive.disable()
    left = drive.state().cia402
    for unsafe in task.store.unsettled(task.drive_record.id):
        task.store.note_found(unsafe.id, found)
    task.trail.add(task.run.who, "secured", task.drive_record.id, task.run.id, found=found, left=left)
    return {"found": found, "left": left}


def reset_fault(task: Task) -> Mapping[str, Any]:
    """See ResetFaultRequest."""
    drive = task.connect().drive
    task.phase("Acknowledging the fault")
    drive.reset_fault()
    return {"left": drive.state().cia402}
