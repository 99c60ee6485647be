"""From a session on disk to what a report shows of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from schwung.commissioning import Change, Check, contrast_of, following_error, read_backup
from schwung.drivetrain import InertiaTable, Machine, read_inertia_csv
from schwung.errors import InputError, SchwungError
from schwung.estimation import Estimate
from schwung.estimation.reach import reach_of
from schwung.fieldbus.drive import RawValue
from schwung.report import ChangeRow, FollowingError, ReportContent, SyncRow
from schwung.session import Run, Session, read_session


@dataclass(frozen=True)
class Standard:
    """What a curve is held against, and what that is called."""

    table: InertiaTable | None
    label: str


@contextmanager
def in_file(path: Path) -> Iterator[None]:
    """Errors about a session name its file."""
    try:
        yield
    except InputError as error:
        if error.place != "session":
            raise
        raise InputError(str(path), error.problem, error.remedy) from error


def standard_of(machine: Machine, reference: Path | None) -> Standard:
    """The given table, else the believed one where the machine file has one. Raises InputError for a bad file."""
    if reference is not None:
        return Standard(read_inertia_csv(reference), reference.stem.replace("_", " "))
    believed = machine.load_inertia
    return Standard(believed if isinstance(believed, InertiaTable) else None, "believed")


def content_of(
    session: Session, machine: Machine, estimate: Estimate, standard: Standard, folder: Path
) -> ReportContent:
    """Everything that a report can show of a recorded session and of what commissioning left beside it."""
    return ReportContent(
        title=f"{machine.name}: load inertia over angle",
        session=session,
        machine=machine,
        estimate=estimate,
        reach=reach_of(session, machine, estimate),
        contrast=contrast_of(session, machine) if estimate.method != "former" else None,
        reference=standard.table,
        reference_label=standard.label,
        preflight=_preflight(folder / "estimate.json"),
        changes=[
            *_changes(folder / "setup.backup.json", "not put back"),
            *_changes(folder / "export.backup.json", "exported"),
        ],
        following_error=_verification(session, folder / "verification.h5"),
        sync=_sync_rows(session),
        notes=(*estimate.notes, *explanation_note(folder)),
    )


def explanation_note(folder: Path) -> tuple[str, ...]:
    """Where an explanation of the session lies beside it, and its verdict; nothing where there is none."""
    for place in (folder, folder / "explanation"):
        try:
            found = json.loads((place / "explanation.json").read_text(encoding="utf-8"))
            if found["format"] == "schwung-explanation":
                verdict = str(found["verdict"]).replace("_", " ")
                return (
                    f"What the believed machine leaves out is {verdict}: see {place / 'explanation.html'}.",
                )
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return ()


def change_row(change: Change, remark: str) -> ChangeRow:
    """Raw values as people write them: communication objects in hexadecimal."""

    def text(raw: RawValue) -> str:
        return f"0x{raw:X}" if change.parameter.index < 0x2000 and isinstance(raw, int) else str(raw)

    return ChangeRow(change.parameter.label, text(change.old), text(change.new), remark)


def following(before: Run, after: Run) -> FollowingError | None:
    """The same motion before and after an export; None where a recording has no demand."""
    first, second = following_error(before), following_error(after)
    if first is None or second is None:
        return None
    return FollowingError(before.time_s, first, after.time_s, second)


def _changes(path: Path, remark: str) -> list[ChangeRow]:
    """What a backup beside the session tells; a file that does not belong there tells nothing."""
    try:
        backup = read_backup(path)
    except SchwungError:
        return []
    return [change_row(change, "put back" if backup.restored else remark) for change in backup.changes]


def _verification(session: Session, path: Path) -> FollowingError | None:
    try:
        after = read_session(path).runs
    except SchwungError:
        return None
    return following(session.runs[0], after[0]) if after else None


def _preflight(path: Path) -> list[Check]:
    """The checks as commissioning wrote them; none where the file is another command's."""
    try:
        return [Check(**check) for check in json.loads(path.read_text(encoding="utf-8"))["preflight"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _sync_rows(session: Session) -> list[SyncRow]:
    rows = []
    for number, run in enumerate(session.runs):
        timing = run.extra.get("sync_timing")
        if isinstance(timing, dict) and "producer" in timing:
            period, rms, p99, largest = (
                float(timing.get(key, 0.0)) for key in ("period_s", "rms_s", "p99_s", "max_s")
            )
            rows.append(SyncRow(f"run {number:04d}", str(timing["producer"]), period, rms, p99, largest))
    return rows
