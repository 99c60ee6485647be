"""The parameter journal: what a command changes in a drive is on disk before it is changed.

The file (`*.backup.json`, see docs/files.md) is rewritten as a whole and synced before every write to the drive, so
that after a crash or a power loss `schwung restore FILE` finds the old value of everything that was touched.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from schwung.clock import Clock
from schwung.errors import DriveError, InputError, ParameterError, RefusedError
from schwung.fieldbus.drive import DriveIdentity, Parameter, ParameterValue, RawValue
from schwung.files import replace_file

FORMAT, VERSION = "schwung-backup", 1


class ParameterAccess(Protocol):
    """The part of a drive that the journal needs."""

    clock: Clock

    @property
    def identity(self) -> DriveIdentity: ...

    def read(self, parameter: Parameter) -> ParameterValue: ...

    def write(self, values: Sequence[ParameterValue]) -> None: ...

    def passed_through(self, values: Sequence[ParameterValue]) -> list[Parameter]: ...

    def disable(self) -> None: ...

    def store(self) -> None: ...


@dataclass(frozen=True)
class Change:
    """One parameter, before and after."""

    parameter: Parameter
    old: RawValue
    new: RawValue
    when: str

    @property
    def before(self) -> ParameterValue:
        """The value to put back."""
        return ParameterValue(self.parameter, self.old)


@dataclass(frozen=True)
class Backup:
    """A backup file as read: which drive, on which bus, what was changed, and whether it was put back."""

    drive: Mapping[str, Any]
    changes: tuple[Change, ...]
    restored: str | None  # when, ISO 8601
    stored: bool = False  # the new values are in the drive's memory, too (1010)


def _date(clock: Clock) -> str:
    return datetime.fromtimestamp(clock.date(), UTC).isoformat(timespec="milliseconds")


def _raw_to_json(raw: RawValue) -> Any:
    return {"hex": raw.hex()} if isinstance(raw, bytes) else raw


def _raw_from_json(value: Any) -> RawValue:
    if isinstance(value, dict):
        return bytes.fromhex(value["hex"])
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"{value!r} is not a raw value")
    return value


def _change_to_json(change: Change) -> dict[str, Any]:
    parameter = change.parameter
    where: dict[str, Any] = {"index": f"0x{parameter.index:04X}", "subindex": parameter.subindex}
    return {
        **({"register": parameter.index} if parameter.space == "register" else where),
        "type": parameter.type,
        "name": parameter.name,
        "old": _raw_to_json(change.old),
        "new": _raw_to_json(change.new),
        "when": change.when,
    }


def _change_from_json(entry: Mapping[str, Any]) -> Change:
    type_name, name = str(entry["type"]), str(entry.get("name", ""))
    if "register" in entry:
        parameter = Parameter(int(entry["register"]), 0, type_name, name, "register")
    else:
        parameter = Parameter(int(entry["index"], 16), int(entry["subindex"]), type_name, name)
    return Change(parameter, _raw_from_json(entry["old"]), _raw_from_json(entry["new"]), str(entry["when"]))


class ParameterJournal:
    """Changes parameters of one drive, remembering what was there before.

    `drive_record` is what `schwung restore` needs to find the drive again: `Drive.describe()`.
    """

    def __init__(self, drive: ParameterAccess, path: Path, drive_record: Mapping[str, Any]) -> None:
        self._drive = drive
        self.path = path
        self._record = dict(drive_record)
        self._changes: list[Change] = []
        self._restored: str | None = None
        self._stored = False
        if path.exists() and read_backup(path).restored is None:
            raise RefusedError(
                str(path),
                "holds parameters of an earlier run that were not put back",
                f"Run `schwung restore {path}` first, or move the file away.",
            )

    @property
    def changes(self) -> tuple[Change, ...]:
        """Everything changed so far, in order, without what was only passed through."""
        return tuple(change for change in self._changes if change.old != change.new)

    def change(self, values: Iterable[ParameterValue]) -> None:
        """Read the old values, put them on disk, then write the new ones. Equal values are left alone.

        What the drive passes through on the way is put on disk, too: who cuts it short leaves that behind.
        """
        writing = self.remember(values)
        if writing:
            self._drive.write(writing)

    def remember(self, values: Iterable[ParameterValue]) -> list[ParameterValue]:
        """Read the old values and put them on disk; returns what differs, for the caller to write."""
        planned = []
        for value in values:
            old = self._drive.read(value.parameter).raw
            if old != value.raw:
                planned.append(Change(value.parameter, old, value.raw, _date(self._drive.clock)))
        writing = [ParameterValue(change.parameter, change.new) for change in planned]
        for parameter in self._drive.passed_through(writing):
            old = self._drive.read(parameter).raw
            planned.append(Change(parameter, old, old, _date(self._drive.clock)))
        if planned:
            self._changes += planned
            self._save()
        return writing

    def restore(self) -> None:
        """Put back what was there before the first change of each parameter; the file then says so.

        Raises ParameterError for the first that the drive does not take; all others are put back.
        """
        if self._changes and self._restored is None:
            refused = _write_what_is_taken(self._drive, first_values(self._changes))
            if refused:
                raise refused[0].error
            self._restored = _date(self._drive.clock)
            self._save()

    def keep(self, *, stored: bool) -> None:
        """The changes were the purpose (an export): the file stays as the way back.

        stored: they go into the drive's memory, so that putting them back has to end there, too.
        """
        self._stored = stored
        self._save()

    def _save(self) -> None:
        _save(self.path, self._record, self._changes, self._restored, self._stored)


def write_backup(
    path: Path, drive_record: Mapping[str, Any], values: Iterable[ParameterValue], clock: Clock
) -> None:
    """Keep values of a drive that nobody is about to change, in the same file: what `schwung restore` puts back."""
    now = _date(clock)
    _save(path, drive_record, [Change(v.parameter, v.raw, v.raw, now) for v in values], None, False)


def _save(
    path: Path, record: Mapping[str, Any], changes: Sequence[Change], restored: str | None, stored: bool
) -> None:
    document = {
        "format": FORMAT,
        "version": VERSION,
        "drive": dict(record),
        "restored": restored,
        "stored": stored,
        "changes": [_change_to_json(change) for change in changes],
    }
    replace_file(path, json.dumps(document, indent=2))


def first_values(changes: Iterable[Change]) -> list[ParameterValue]:
    """The value of each parameter before its first change, latest-changed parameter first."""
    first: dict[tuple[str, int, int], ParameterValue] = {}
    for change in changes:
        parameter = change.parameter
        first.setdefault((parameter.space, parameter.index, parameter.subindex), change.before)
    return list(reversed(first.values()))


def read_backup(path: Path) -> Backup:
    """Read a backup file.

    Raises InputError naming the file and the place in it where it is not one.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(str(path), "does not exist", "Give the *.backup.json of the run.") from error
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(str(path), f"is not readable JSON ({error})", "Give a *.backup.json.") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(f"{path}: format", f'is not "{FORMAT}"', "Give a *.backup.json.")
    if document.get("version") != VERSION:
        raise InputError(
            f"{path}: version", f"is {document.get('version')!r}", f"This Schwung reads {VERSION}."
        )
    drive = document.get("drive") or {}
    if not isinstance(document.get("changes"), list) or not isinstance(drive, dict):
        raise InputError(f"{path}: changes", "is no list, or drive no object", "Give a *.backup.json.")
    changes = []
    for number, entry in enumerate(document["changes"]):
        try:
            changes.append(_change_from_json(entry))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: changes[{number}]", f"is damaged ({error})") from error
    return Backup(drive, tuple(changes), document.get("restored"), bool(document.get("stored")))


def restore_backup(drive: ParameterAccess, path: Path, force: bool = False) -> tuple[ParameterValue, ...]:
    """Write the old values of a backup file to the drive that it was taken from, and mark the file as restored.

    The power stage is switched off first, after standstill. Where the new values had been stored in the drive's memory,
    the old ones are stored over them. Returns what was written.

    Raises RefusedError where the drive is another one (1018 differs), unless forced. A value that the drive refuses
    does not keep the others from being put back: DriveError names it afterwards, and the file does not count as
    restored.
    """
    backup = read_backup(path)
    was, now = backup.drive.get("identity") or {}, drive.identity
    for key in ("vendor_id", "product_code", "serial"):
        if key in was and was[key] != getattr(now, key) and not force:
            raise RefusedError(
                str(path),
                f"was taken from a drive with {key} {was[key]:#x}, this one has {getattr(now, key):#x}",
                "Connect the right drive, or insist with --force.",
            )
    values = _to_write(drive, backup.changes)
    drive.disable()  # a drive that stopped by itself may still hold the axis
    refused = _write_what_is_taken(drive, values)
    if refused:
        raise DriveError(
            str(path),
            f"{len(values) - len(refused)} of {len(values)} parameters are put back, but not "
            + "; ".join(str(one.error) for one in refused),
            "Mend the cause or set these by hand; running restore again does no harm.",
        )
    if backup.stored:
        drive.store()
    document = json.loads(path.read_text(encoding="utf-8"))
    document["restored"] = _date(drive.clock)
    replace_file(path, json.dumps(document, indent=2))
    return tuple(values)


def _to_write(drive: ParameterAccess, changes: Sequence[Change]) -> list[ParameterValue]:
    """What has to be put back. What nobody meant to change is left alone where it is as it was."""
    meant = {change.parameter for change in changes if change.old != change.new}
    return [v for v in first_values(changes) if v.parameter in meant or not _holds(drive, v)]


def _holds(drive: ParameterAccess, value: ParameterValue) -> bool:
    try:
        return drive.read(value.parameter).raw == value.raw
    except ParameterError:
        return False


@dataclass(frozen=True)
class _Refused:
    value: ParameterValue
    error: ParameterError


def _write_what_is_taken(drive: ParameterAccess, values: Sequence[ParameterValue]) -> list[_Refused]:
    """Write all values but those that the drive refuses, also when all others are back: a target may lie outside the
    window that is put back after it.

    Raises ParameterError where the drive does not answer any more, or an error names none of the parameters.
    """
    refused = _written(drive, values)
    if refused and len(refused) < len(values):
        refused = _written(drive, [one.value for one in refused])
    return refused


def _written(drive: ParameterAccess, values: Sequence[ParameterValue]) -> list[_Refused]:
    """Write values, leaving out one by one what the drive refuses."""
    left, refused = list(values), list[_Refused]()
    while left:
        try:
            drive.write(left)
            break
        except ParameterError as error:
            taken = [value for value in left if value.parameter.label not in error.place]
            if len(taken) == len(left):
                raise
            for value in taken[:1]:
                drive.read(value.parameter)  # a drive that is gone is not asked for each of them
            refused += [_Refused(value, error) for value in left if value not in taken]
            left = taken
    return refused
