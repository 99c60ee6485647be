"""From a session on disk to what a report shows of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from schwung.commissioning import contrast_of
from schwung.drivetrain import InertiaTable, Machine, read_inertia_csv
from schwung.errors import InputError
from schwung.estimation import Estimate
from schwung.report import ReportContent, SyncRow
from schwung.session import Session


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


def content_of(session: Session, machine: Machine, estimate: Estimate, standard: Standard) -> ReportContent:
    """Everything that a report can show of a recorded session alone."""
    return ReportContent(
        title=f"{machine.name}: load inertia over angle",
        session=session,
        machine=machine,
        estimate=estimate,
        contrast=contrast_of(session, machine) if estimate.method != "former" else None,
        reference=standard.table,
        reference_label=standard.label,
        sync=_sync_rows(session),
        settings=_settings(session),
        notes=estimate.notes,
    )


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


def _settings(session: Session) -> dict[str, str]:
    drive = session.drive or {}
    rows: dict[str, str] = {}
    for part in ("identity", "settings"):
        content = drive.get(part)
        if isinstance(content, dict):
            rows |= {str(key): str(value) for key, value in content.items()}
    return rows
