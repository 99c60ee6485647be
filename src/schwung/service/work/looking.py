"""Runs that look at a bus or a drive and leave it as it is, but for switching it off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from schwung.commissioning.backup import read_snapshot
from schwung.commissioning.configuration_files import Format, save_configuration
from schwung.commissioning.doctor import Diagnosis, examine_connected
from schwung.commissioning.doctor_canopen import examine
from schwung.errors import InputError
from schwung.fieldbus.configuration import Skipped, dictionary_of, select
from schwung.fieldbus.connecting import is_modbus
from schwung.fieldbus.connecting import scan as scan_bus
from schwung.fieldbus.drive import ENERGISED
from schwung.fieldbus.profile import CanopenProfile, DeviceProfile
from schwung.service.jobs import Task

_NAMES: dict[Format, str] = {"dcf": "drive.dcf", "concise": "drive.bin", "backup": "drive.backup.json"}


def scan(task: Task) -> Mapping[str, Any]:
    """See ScanRequest."""
    asked, lane = task.request, task.lane
    assert lane is not None
    if asked.first > asked.last:
        raise InputError("first", f"{asked.first} is after last, {asked.last}", "Give the smaller one first.")
    task.phase(f"Asking nodes {asked.first} to {asked.last}")
    with lane.released():
        found = scan_bus(lane.entry.options, range(asked.first, asked.last + 1), task.progress)
    return {"nodes": [asdict(node) for node in found]}


def doctor(task: Task) -> Mapping[str, Any]:
    """See DoctorRequest."""
    record, lane = task.drive_record, task.lane
    assert lane is not None
    options, nowhere = lane.entry.options, task.folder
    with lane.released():
        if is_modbus(options):
            found = examine_connected(options, record.node_id, record.profile, nowhere, task.phase)
        else:
            found = examine(options, record.node_id, record.profile, None, nowhere, task.phase)
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


def canopen(profile: DeviceProfile) -> CanopenProfile:
    """The profile of a CANopen drive. Raises InputError for another one: nobody tells which registers are settings."""
    if not isinstance(profile, CanopenProfile):
        raise InputError(
            f"profile {profile.family}", "is not for CANopen: nobody tells which registers are settings",
            "This is for CANopen drives, whose EDS tells it.",
        )  # fmt: skip
    return profile


def secure(task: Task) -> Mapping[str, Any]:
    """See SecureRequest. What an interrupted run has left gets a note of how the drive was found."""
    task.phase("Looking at the drive")
    drive = task.connect().drive
    found = drive.state().cia402
    if found.lower() in ENERGISED:
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
