"""What a report shows: of a session on disk, of a commissioning just made; and the files that hold it."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schwung.api.moving import Commissioned, Exported
from schwung.commissioning import Change, Check, contrast_of, following_error, read_backup
from schwung.drivetrain import InertiaTable, Machine, deviation, read_inertia_csv
from schwung.errors import SchwungError
from schwung.estimation import Estimate
from schwung.estimation.reach import reach_of
from schwung.fieldbus.drive import RawValue
from schwung.files import json_text, replace_file
from schwung.report.bode import BodeContent, angle_rows, parameter_rows, write_bode_report
from schwung.report.content import ChangeRow, FollowingError, ReportContent, SyncRow
from schwung.report.html import write_report as write_page
from schwung.report.pictures import save_figures
from schwung.session import Run, Session, read_session
from schwung.session.gains import with_recorded_gains

__all__ = [
    "BodeContent",
    "Standard",
    "angle_rows",
    "content_of",
    "deviation",
    "parameter_rows",
    "save_figures",
    "standard_of",
    "write_bode_report",
    "write_page",
    "write_report",
    "write_results",
]


@dataclass(frozen=True)
class Standard:
    """What a curve is held against, and what that is called."""

    table: InertiaTable | None = None
    label: str = "believed"


def standard_of(machine: Machine, reference: Path | None) -> Standard:
    """The given table, else the believed one where the machine file has one. Raises InputError for a bad file."""
    if reference is not None:
        return Standard(read_inertia_csv(reference), reference.stem.replace("_", " "))
    believed = machine.load_inertia
    return Standard(believed if isinstance(believed, InertiaTable) else None, "believed")


def write_report(
    path: str | os.PathLike[str],
    session: Session,
    machine: Machine,
    estimate: Estimate,
    *,
    reference: InertiaTable | None = None,
    reference_label: str = "reference",
) -> Path:
    """Write the report of an estimate: one HTML file with its pictures, which fetches nothing.

    Args:
        path: the file; folders are made.
        session: as `read_session` gives it; arrays (n,), rad, rad/s, N·m.
        machine: the belief.
        estimate: as `estimate` gives it.
        reference: a table (rad, kg·m²) that the curve is held against, e.g. from CAD.
        reference_label: what that is called.

    Returns the path. Raises InputError where it cannot be written.

    >>> session, machine = schwung.read_session(session_file), schwung.example_machine()
    >>> schwung.write_report(folder / "report.html", session, machine, schwung.estimate(session, machine)).name
    'report.html'
    """
    standard = Standard(reference, reference_label)
    return write_page(content_of(session, machine, estimate, standard), Path(path))


def write_results(
    done: Commissioned, standard: Standard | None = None, exported: Exported | None = None
) -> dict[str, Any]:
    """What a commissioning leaves for people and for machines: report.html and estimate.json in its folder.

    Returns the document of estimate.json: plan, checks, estimate, and how far it is off the `standard`.
    Raises InputError where they cannot be written.
    """
    folder, against = done.folder, standard or Standard()
    off = deviation(done.estimate.table, against.table)
    former = deviation(done.contrast.table, against.table) if done.contrast else None
    names = {
        "session": "session.h5",
        "inertia": "inertia.csv",
        "machine": "measured.toml",
        "report": "report.html",
    }
    document = done.prepared.to_json() | {
        "estimate": done.estimate.to_json(),
        "reach": done.reach and done.reach.to_json(),
        "reference": against.label if off else None,
        "rmse_kgm2": off.rmse_kgm2 if off else None,
        "max_error_kgm2": off.max_kgm2 if off else None,
        "former_rmse_kgm2": former.rmse_kgm2 if former else None,
        "files": {key: str(folder / name) for key, name in names.items()},
    }
    if exported is not None:
        document["export"] = exported.to_json()
    write_page(content_of_commissioned(done, against, exported), folder / "report.html")
    replace_file(folder / "estimate.json", json_text(document))
    return document


def content_of_commissioned(
    done: Commissioned, standard: Standard, exported: Exported | None = None
) -> ReportContent:
    """Everything that the report shows of a commissioning."""
    prepared, plan = done.prepared, done.prepared.plan
    rows = [change_row(change, "put back") for change in done.changes]
    if exported is not None:
        rows += [change_row(change, "exported, read back equal") for change in exported.changes]
    before, after = (exported.before, exported.after) if exported is not None else (None, None)
    return ReportContent(
        title=f"{prepared.machine.name}: load inertia over angle",
        session=done.session,
        machine=prepared.machine,
        estimate=done.estimate,
        reach=done.reach,
        contrast=done.contrast,
        reference=standard.table,
        reference_label=standard.label,
        preflight=prepared.checks,
        changes=rows,
        following_error=following(before, after) if before is not None and after is not None else None,
        sync=[
            SyncRow(f"run {number:04d}", t.producer, t.period_s, t.rms_s, t.p99_s, t.max_s)
            for number, t in enumerate(done.recorded.timing)
        ],
        settings={
            "speed taken from": prepared.preflight.speed_source,
            "motions made again because of lost samples": str(done.recorded.retries),
        },
        notes=[*plan.reasons, *done.estimate.notes],
    )


def content_of(
    session: Session, machine: Machine, estimate: Estimate, standard: Standard, folder: Path | None = None
) -> ReportContent:
    """Everything that a report can show of a recorded session, and of what commissioning left beside it."""
    machine = with_recorded_gains(machine, session)
    left = {} if folder is None else _left_in(folder, session)
    notes = () if folder is None else explanation_note(folder)
    return ReportContent(
        title=f"{machine.name}: load inertia over angle",
        session=session,
        machine=machine,
        estimate=estimate,
        reach=reach_of(session, machine, estimate),
        contrast=contrast_of(session, machine) if estimate.method != "former" else None,
        reference=standard.table,
        reference_label=standard.label,
        sync=_sync_rows(session),
        notes=(*estimate.notes, *notes),
        **left,
    )


def _left_in(folder: Path, session: Session) -> dict[str, Any]:
    """What commissioning left beside the session: checks, changed parameters, the verification."""
    return {
        "preflight": _preflight(folder / "estimate.json"),
        "changes": [
            *_changes(folder / "setup.backup.json", "not put back"),
            *_changes(folder / "export.backup.json", "exported"),
        ],
        "following_error": _verification(session, folder / "verification.h5"),
    }


def explanation_note(folder: Path) -> tuple[str, ...]:
    """Where an explanation of the session lies beside it, and its verdict; nothing where there is none."""
    for place in (folder, folder / "explanation"):
        try:
            found = json.loads((place / "explanation.json").read_text(encoding="utf-8"))
            if found["format"] == "schwung-explanation":
                told = ", ".join([str(found["verdict"]).replace("_", " "), *_headline(found)])
                return (f"Explanation: {told} (see {place / 'explanation.html'}).",)
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return ()


def _headline(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Of an explanation; those of version 1 have none."""
    return (str(document["headline"]),) if "headline" in document else ()


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
