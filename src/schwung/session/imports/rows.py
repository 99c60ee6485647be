"""Rows of a recording that are not as they should be: empty cells, stamps that come twice, angles that jump."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.imports.signals import unwrap
from schwung.session.imports.table import Column


def whole(column: Column, path: Path) -> Array:
    """A column that is finite throughout. Raises InputError, naming the line, where it is not."""
    values = np.asarray(column.values, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(values))
    if values.size == 0:
        raise InputError(f"{path}: {column.name}", "holds no samples", "Choose another column.")
    if bad.size:
        at = int(bad[0])
        where = f"line {column.first_line + at}" if column.first_line is not None else f"sample {at}"
        what = "is empty" if np.isnan(values[at]) else f"is {values[at]}"
        raise InputError(f"{path}: {column.name}, {where}", f"{what} ({bad.size} such samples)",
                         "Cut the recording before it; missing samples are not made up.")  # fmt: skip
    return values


def unwrap_angles(signals: dict[str, Array], notes: list[str]) -> None:
    """Undo jumps of a whole turn in positions, in place; the demand stays within half a turn of the position."""
    for name in ("position", "position_demand"):
        if name not in signals:
            continue
        found = unwrap(signals[name])
        if found.wraps:
            signals[name] = found.position
            notes.append(
                f"{name} jumped by a whole turn {found.wraps} times (first at sample {found.first}): unwrapped"
            )
    position, demand = signals["position"], signals.get("position_demand")
    if demand is not None and demand.size == position.size:  # each was within a turn of its own
        apart = float(np.median(demand - position))
        signals["position_demand"] = demand - 2 * np.pi * np.rint(apart / (2 * np.pi))


def without_gaps(
    signals: Mapping[str, Array], times: Mapping[str, Array], path: Path, notes: list[str]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Signals and stamps without rows in which either is missing, and without stamps that come twice: resampling
    takes such rows for lost ones. Raises InputError where hardly any is left."""
    kept: dict[str, Array] = {}
    stamps: dict[str, Array] = {}
    empty = twice = 0
    for name, values in signals.items():
        size = min(values.size, times[name].size)  # empty cells at the end were cut off
        value, time = values[:size], times[name][:size]
        whole = np.isfinite(value) & np.isfinite(time)
        value, time = value[whole], time[whole]
        new = np.concatenate(([True], np.diff(time) != 0)) if time.size else whole[:0]
        empty, twice = max(empty, size - int(whole.sum())), max(twice, int(np.count_nonzero(~new)))
        kept[name], stamps[name] = value[new], time[new]
        if kept[name].size < max(2, size // 2):
            raise InputError(
                f"{path}: {name}", f"is empty in {empty} of {size} rows", "Choose another column."
            )
    if empty:
        notes.append(
            f"{empty} rows with an empty cell count as lost: short gaps are bridged by the resampling"
        )
    if twice:
        notes.append(f"{twice} rows with the stamp of the row before are dropped")
    return kept, stamps
