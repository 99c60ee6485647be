"""Runs that write into a drive: an inertia table, or a configuration that was kept; and the proposals before them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schwung.api.computing import load_machine, read_inertia, read_session
from schwung.api.configurations import (
    ExportChoice,
    ParameterJournal,
    ParameterValue,
    RawValue,
    Worth,
    export_table,
    export_values,
    first_values,
    fitting_dictionary,
    for_this_drive,
    load_configuration,
    plan_restore,
    read_backup,
    require_power_off,
    restore_backup,
    worth_of,
    write_plan,
)
from schwung.api.drives import Drive
from schwung.api.stages import (
    Prepared,
    following_error_rms,
    prepare,
    rechecked,
    repeat_reference,
    wishes_of,
)
from schwung.api.values import InertiaTable, Machine
from schwung.errors import DriveError, InputError, RefusedError
from schwung.service.jobs import Task
from schwung.service.work.looking import canopen
from schwung.service.work.moving import plan_document

_FILES = (".dcf", ".bin", ".json")


@dataclass(frozen=True, eq=False)
class ExportProposed:
    """What will be written, over what, and the motion that shows the effect."""

    table: InertiaTable
    choice: ExportChoice
    rows: tuple[tuple[ParameterValue, RawValue], ...]  # new value, and what the drive held
    machine: Machine
    estimate_id: str
    store: bool
    verify: Prepared | None


def propose_export(task: Task) -> Mapping[str, Any]:
    """See ProposeExportRequest."""
    asked, store = task.request, task.store
    estimate = store.estimate(asked.estimate_id)
    if estimate.verdict == "unusable":
        raise RefusedError("export", "an unusable table does not go into a drive", "Measure again.")
    if (asked.form == "at") != (asked.at_rad is not None):
        raise InputError("at_rad", 'belongs to form "at", and to no other', "Give both or neither.")
    folder = store.run_folder(estimate.run_id)
    table, machine = read_inertia(folder / "inertia.csv"), load_machine(folder / "measured.toml")
    choice = ExportChoice(asked.form, asked.at_rad)
    task.phase("Reading what the drive holds")
    found = task.connect()
    drive = found.drive
    values = export_values(
        drive.parameter,
        found.profile,
        table,
        choice,
        read=drive.read,
        motor_inertia_kgm2=machine.motor.inertia_kgm2,
    )
    rows = tuple((value, drive.read(value.parameter).raw) for value in values)
    prepared = None
    if asked.verify:
        assert estimate.session_id is not None
        session = read_session(store.session_path(estimate.session_id))
        prepared = prepare(drive, found.profile, machine, wishes_of(session))
    document = {
        "drive": task.drive_record.name,
        "form": asked.form,
        "at_rad": asked.at_rad,
        "store": asked.store,
        "changes": [
            changed(value.parameter.label, old, value.raw, worth_of(found.profile, value.parameter))
            for value, old in rows
        ],
        "motion": None if prepared is None else plan_document(prepared),
        "can_start": prepared is None or not prepared.preflight.stops,
    }
    content = ExportProposed(table, choice, rows, machine, estimate.id, asked.store, prepared)
    return task.proposals.add("export", task.drive_record.id, document, content).to_json()


def export(task: Task) -> Mapping[str, Any]:
    """See ExportRequest."""
    made = task.proposals.take(task.request.proposal_id, "export", task.request.digest)
    proposed: ExportProposed = made.content
    found = task.connect()
    drive, verify = found.drive, proposed.verify
    _require_unchanged(drive, proposed.rows)
    before = after = None
    if verify is not None:
        verify = rechecked(drive, verify)
        verify.preflight.require()
        before = repeat_reference(drive, verify, task.folder, "before", task)
    task.phase(f"Writing {len(proposed.rows)} parameters")
    exported = export_table(
        drive, found.profile, proposed.table, proposed.choice, backup_path=task.folder / "export.backup.json",
        store=proposed.store, motor_inertia_kgm2=proposed.machine.motor.inertia_kgm2,
    )  # fmt: skip
    if verify is not None:
        after = repeat_reference(drive, verify, task.folder, "after", task)
    changes = [
        changed(c.parameter.label, c.old, c.new, worth_of(found.profile, c.parameter))
        for c in exported.changes
    ]
    rms = {
        "following_error_rms_before_rad": following_error_rms(before) if before is not None else None,
        "following_error_rms_after_rad": following_error_rms(after) if after is not None else None,
    }
    document = {"changes": changes, "stored": exported.stored, "form": proposed.choice.form, **rms}
    kept = task.store.add_export(task.run, proposed.estimate_id, document)
    task.trail.add(
        task.run.who, "written", task.run.drive_id, task.run.id, changes=changes, stored=exported.stored
    )
    return {"export_id": kept.id, "digest": made.digest, **document}


def _require_unchanged(drive: Drive, rows: Sequence[tuple[ParameterValue, RawValue]]) -> None:
    for value, old in rows:
        held = drive.read(value.parameter).raw
        if held != old:
            raise RefusedError(
                value.parameter.label,
                f"held {old!r} when the change was shown, and {held!r} now",
                "Look again.",
            )


@dataclass(frozen=True, eq=False)
class RestoreProposed:
    """What will be put back."""

    path: Path
    force: bool
    store: bool
    unsafe_id: str | None
    rows: tuple[tuple[ParameterValue, RawValue], ...]
    wanted: tuple[ParameterValue, ...]


def propose_restore(task: Task) -> Mapping[str, Any]:
    """See ProposeRestoreRequest."""
    asked, record = task.request, task.drive_record
    path = _chosen(task)
    task.phase("Comparing with the drive")
    found = task.connect()
    drive = found.drive
    left: list[dict[str, Any]] = []
    if path.suffix == ".json":
        wanted = tuple(first_values(read_backup(path).changes))
    else:
        family = canopen(found.profile)
        configuration = load_configuration(path, record.node_id)
        dictionary = fitting_dictionary(configuration, None, family, drive.identity, record.node_id)
        fitted = for_this_drive(configuration, dictionary, family, drive.identity, asked.force)
        wanted = tuple(fitted.values)
        left = [{"object": s.parameter.label, "because": s.reason} for s in fitted.skipped]
    plan = plan_restore(drive, wanted, task.progress)
    left += [{"object": s.parameter.label, "because": s.reason} for s in plan.absent]
    rows = tuple((new, now.raw) for now, new in plan.changes)
    document = {
        "drive": record.name,
        "file": path.name,
        "changes": [changed(value.parameter.label, old, value.raw) for value, old in rows],
        "equal": plan.equal,
        "left_out": left,
        "store": asked.store,
        "can_start": True,
    }
    content = RestoreProposed(path, asked.force, asked.store, asked.unsafe_id, rows, wanted)
    return task.proposals.add("restore", record.id, document, content).to_json()


def restore(task: Task) -> Mapping[str, Any]:
    """See RestoreRequest. The power stage is switched off first; the present values are kept as the way back."""
    made = task.proposals.take(task.request.proposal_id, "restore", task.request.digest)
    proposed: RestoreProposed = made.content
    drive = task.connect().drive
    _require_unchanged(drive, proposed.rows)
    task.phase(f"Writing {len(proposed.rows)} parameters")
    changes = [changed(value.parameter.label, old, value.raw) for value, old in proposed.rows]
    if proposed.path.suffix == ".json":
        restore_backup(drive, proposed.path, proposed.force)
        if proposed.unsafe_id is not None:
            task.store.settle(proposed.unsafe_id, "restored", task.run.who)
    else:
        _configure(task, drive, proposed)
    task.trail.add(
        task.run.who, "put back", task.run.drive_id, task.run.id, changes=changes, stored=proposed.store
    )
    return {"changes": changes, "digest": made.digest, "file": proposed.path.name}


def _configure(task: Task, drive: Drive, proposed: RestoreProposed) -> None:
    require_power_off(drive, drive.parameter(0x6041))
    journal = ParameterJournal(drive, task.folder / "restore.backup.json", drive.describe())
    written = write_plan(drive, plan_restore(drive, proposed.wanted), journal, task.progress)
    journal.keep(stored=proposed.store and not written.refused)
    if written.refused:
        first, count = written.refused[0], len(written.refused)
        raise DriveError(
            first.value.parameter.label, f"{first.reason}; {count} parameters were not taken",
            "Nothing was stored; the run's restore.backup.json is the way back.",
        )  # fmt: skip
    if proposed.store:
        drive.store()


def _chosen(task: Task) -> Path:
    """The file that is meant. Raises InputError where it is none, or another drive's."""
    asked, store = task.request, task.store
    if (asked.unsafe_id is None) == (asked.file_id is None):
        raise InputError("unsafe_id", "and file_id: exactly one is needed", "Give what shall be put back.")
    if asked.unsafe_id is not None:
        for unsafe in store.unsettled(asked.drive_id):
            if unsafe.id == asked.unsafe_id:
                return store.run_folder(unsafe.run_id) / unsafe.backup
        raise InputError("unsafe_id", "is not left in this drive", "List the drive: GET /api/drives/ID.")
    file = store.file(asked.file_id)
    if not file.name.endswith(_FILES) or (file.name.endswith(".json") and "backup" not in file.name):
        raise InputError(
            f"file {file.name}", "holds no configuration", "Give a backup, a DCF or a concise DCF."
        )
    return store.file_path(file.id, check=True)


def changed(label: str, old: RawValue, new: RawValue, worth: Worth | None = None) -> dict[str, Any]:
    """One line of a diff: raw values, and where it is known what a count is worth, the SI values and their unit."""
    told: dict[str, Any] = {"object": label, "old": _told(old), "new": _told(new)}
    if worth is not None and isinstance(old, int | float) and isinstance(new, int | float):
        told |= {"old_si": old * worth.scale, "new_si": new * worth.scale, "unit": worth.unit}
    return told


def _told(raw: RawValue) -> Any:
    return {"hex": raw.hex()} if isinstance(raw, bytes) else raw
