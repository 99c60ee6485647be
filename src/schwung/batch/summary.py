"""An archive in a table: one row per session, for people, for a spreadsheet (CSV) and for machines (JSON)."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from schwung.batch.archive import Item, Kind
from schwung.batch.work import Outcome
from schwung.drivetrain import InertiaTable
from schwung.files import json_text, replace_file

#: Of a row, what a table of each kind shows; the names are those of the CSV file and of the JSON.
COLUMNS: Mapping[Kind, tuple[str, ...]] = {
    "estimate": (
        "file", "created", "machine", "verdict", "inertia_min_kgm2", "inertia_mean_kgm2", "inertia_max_kgm2",
        "miv_kgm2", "deviation_kgm2", "drift", "code_version", "error",
    ),
    "explain": (
        "file", "created", "machine", "verdict", "physics", "rmse_before_nm", "rmse_after_nm", "code_version", "error",
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Row:
    """One session; None where there is no such figure. On a linear axis kg and N stand in the same columns."""

    file: Path
    created: str = ""
    axis: str = "rotary"
    machine: str = ""
    verdict: str = ""
    inertia_min_kgm2: float | None = None
    inertia_mean_kgm2: float | None = None
    inertia_max_kgm2: float | None = None
    miv_kgm2: float | None = None  # maximum inertia variation per period
    deviation_kgm2: float | None = None  # from the curve in the machine file, RMS
    drift: float | None = None  # mean change since this machine's oldest usable session, relative to its mean
    physics: str = ""  # what the belief left out, the weightiest first
    rmse_before_nm: float | None = None  # on the runs kept aside
    rmse_after_nm: float | None = None
    code_version: str = ""
    error: str = ""  # one sentence; then there is no result
    curve: InertiaTable | None = None

    def cells(self, columns: Sequence[str]) -> tuple[object, ...]:
        """The values of some columns."""
        return tuple(getattr(self, name) for name in columns)


def when(row: Row) -> datetime:
    """The date of a session; one without a time zone is taken as UTC. A failure has none: the earliest."""
    try:
        date = datetime.fromisoformat(row.created)
    except ValueError:
        return datetime.min.replace(tzinfo=UTC)
    return date if date.tzinfo else date.replace(tzinfo=UTC)


def rows_of(outcomes: Mapping[Item, Outcome]) -> tuple[Row, ...]:
    """The oldest session first, failures behind; each curve's drift is told against its machine's first."""
    rows = sorted((_row(item.session, outcome) for item, outcome in outcomes.items()), key=_order)
    first: dict[str, InertiaTable] = {}
    drifted = []
    for row in rows:
        if row.curve is not None and row.verdict != "unusable":
            first.setdefault(row.machine, row.curve)
        drifted.append(replace(row, drift=_drift(row.curve, first.get(row.machine))))
    return tuple(drifted)


def _order(row: Row) -> tuple[bool, datetime, str]:
    return bool(row.error), when(row), str(row.file)


def _row(file: Path, outcome: Outcome) -> Row:
    row = Row(file, outcome.created, outcome.axis, outcome.machine_name, code_version=outcome.code_version)
    if outcome.error is not None:
        return replace(row, error=outcome.error)
    document = outcome.document
    if "trust" not in document:  # explained
        proof = document["proof"] or {}
        named = [one["physics"] for one in document["names"] if one["in_file"]]
        curves = [
            f"unnamed over {one['coordinate'].replace(', ', ' and ')}"
            for one in document["unnamed"]
            if one["in_file"]
        ]
        return replace(
            row,
            verdict=document["verdict"],
            physics=", ".join(dict.fromkeys([*named, *curves])),
            rmse_before_nm=proof.get("before_nm"),
            rmse_after_nm=proof.get("after_nm"),
        )
    curve = _curve(document["table"])
    inertia = curve.inertia_kgm2
    return replace(
        row,
        verdict=document["trust"]["verdict"],
        inertia_min_kgm2=float(inertia.min()),
        inertia_mean_kgm2=float(inertia.mean()),
        inertia_max_kgm2=float(inertia.max()),
        miv_kgm2=document["trust"]["miv_kgm2"],
        deviation_kgm2=outcome.deviation_kgm2,
        curve=curve,
    )


def _curve(table: Mapping[str, Any]) -> InertiaTable:
    std = table["std_kgm2"]
    return InertiaTable(
        np.asarray(table["position_rad"], dtype=float),
        np.asarray(table["inertia_kgm2"], dtype=float),
        None if std is None else np.asarray(std, dtype=float),
    )


def _drift(curve: InertiaTable | None, first: InertiaTable | None) -> float | None:
    """Mean change over the angles that both have, over the first one's mean there; None where there are none."""
    if curve is None or first is None:
        return None
    low = max(curve.position_rad[0], first.position_rad[0])
    high = min(curve.position_rad[-1], first.position_rad[-1])
    if not low < high:
        return None
    angle = np.linspace(low, high, 200)
    former = first.at(angle)
    return float(np.mean(curve.at(angle) - former) / np.mean(former))


def write_summary(rows: Iterable[Row], kind: Kind, folder: Path) -> None:
    """Write summary.csv and summary.json. Raises InputError where that fails."""
    rows, columns = tuple(rows), COLUMNS[kind]
    text = io.StringIO()
    sheet = csv.writer(text, lineterminator="\n")
    sheet.writerow(columns)
    sheet.writerows([["" if cell is None else cell for cell in row.cells(columns)] for row in rows])
    replace_file(folder / "summary.csv", text.getvalue())
    replace_file(folder / "summary.json", json_text(document_of(rows, kind)))


def document_of(rows: Iterable[Row], kind: Kind) -> dict[str, Any]:
    """The summary as JSON has it."""
    columns = COLUMNS[kind]
    return {
        "format": "schwung-batch",
        "version": 1,
        "kind": kind,
        "sessions": [
            {
                name: str(cell) if isinstance(cell, Path) else cell
                for name, cell in zip(columns, row.cells(columns), strict=True)
            }
            for row in rows
        ],
    }
