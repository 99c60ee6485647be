"""TwinCAT Scope's CSV export: a header of `key, value` rows, then groups of columns, each behind its own time column.

The key of a header row stands again at the start of every group, which is how groups are told apart:

    Name              Pos   Vel   Name              Torque
    SampleTime[ms]    1     1     SampleTime[ms]    5
    0                 0,1   0     0                 2,5
    1                 0,2   10    5                 2,6

Times are ms since the start of the export, or file times (100 ns since 1601) with "full timestamp". Source: Beckhoff
TE13xx documentation, "Export in csv"; the timelines All, None and For each sample time are understood.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.imports.table import Column, Table

_STARTS = ("Starttime of export", "StartRecord", "StartTime")
_KEYS = ("Name", "SymbolName", "SampleTime[ms]", "Unit", "Data-Type")
_FILE_TIME = 1e15  # no time in ms since the start is so large
_TICK_S = 1e-7


class ReadColumn(Protocol):
    """Column k (n,) of the samples; with `base` whole numbers count from the first one."""

    def __call__(self, k: int, base: bool = False) -> Array: ...


def is_scope_header(header: Sequence[Sequence[str]]) -> bool:
    """Whether these lines (cells of each) are what TwinCAT Scope writes above the samples."""
    keys = {row[0] for row in header if row}
    return "Name" in keys and bool(keys & {*_STARTS, "SampleTime[ms]", "SymbolName", "File"})


def scope_table(
    path: Path, header: Sequence[Sequence[str]], read: ReadColumn, columns: int, first_line: int
) -> Table:
    """The channels of an export, each with its time base (s). Raises InputError where header and samples disagree."""
    rows: dict[str, Sequence[str]] = {}
    for row in header:
        if row and row[0] in _KEYS:
            rows[row[0]] = row  # the file's own name comes first, the channels' names later
    names = _trimmed(rows["Name"])
    groups = [k for k, cell in enumerate(names) if cell == "Name"]
    with_times = columns >= len(names)
    if not with_times and columns < len(names) - len(groups):
        raise InputError(str(path), f"its header names {len(names) - len(groups)} channels, its lines hold {columns}",
                         "Export it again from TwinCAT Scope.")  # fmt: skip
    found: list[Column] = []
    for group, start in enumerate(groups):
        end = groups[group + 1] if group + 1 < len(groups) else len(names)
        time = _time(read, start) if with_times else None
        for k in range(start + 1, end):
            values = read(k if with_times else k - group - 1)
            filled = ~np.isnan(values) if time is None else ~np.isnan(values) & ~np.isnan(time)
            filled = _to_last(filled)
            period = _cell(rows, "SampleTime[ms]", k)
            own = (
                time[filled]
                if time is not None
                else _counted(int(filled.sum()), period, f"{path}: {names[k]}")
            )
            symbol, unit = _cell(rows, "SymbolName", k), _cell(rows, "Unit", k)
            found.append(
                Column(names[k], values[filled], "" if unit == "(None)" else unit,
                       (symbol,) if symbol else (), own, first_line)
            )  # fmt: skip
    return Table(path, tuple(found), created=_created(header), described="TwinCAT Scope")


def _trimmed(row: Sequence[str]) -> Sequence[str]:
    """A row of names without the empty cells that a separator at the line's end leaves."""
    last = max((k for k, cell in enumerate(row) if cell), default=0)
    return row[: last + 1]


def _to_last(filled: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True up to the last sample: an empty cell between samples stays, to be found and named."""
    there = np.flatnonzero(filled)
    whole = np.zeros_like(filled)
    whole[: there[-1] + 1 if there.size else 0] = True
    return whole


def _cell(rows: dict[str, Sequence[str]], key: str, k: int) -> str:
    row = rows.get(key, ())
    return row[k] if k < len(row) else ""


def _time(read: ReadColumn, k: int) -> Array:
    """A time column in s."""
    time = read(k)
    first = time[~np.isnan(time)][:1]
    if first.size and first[0] > _FILE_TIME:
        return read(k, base=True) * _TICK_S
    return np.asarray(time * 1e-3)


def _counted(samples: int, period: str, place: str) -> Array:
    try:
        step = float(period.replace(",", ".")) * 1e-3
    except ValueError:
        raise InputError(place, "has neither a time column nor a SampleTime[ms]",
                         "Export it with timelines.") from None  # fmt: skip
    return np.asarray(np.arange(samples) * step, dtype=np.float64)


def _created(header: Sequence[Sequence[str]]) -> str | None:
    """When the recording began, ISO 8601, from its file time."""
    for row in header:
        if len(row) > 1 and row[0] in _STARTS and row[1].isdigit():
            try:
                moment = datetime(1601, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(row[1]) // 10)
            except OverflowError:
                return None
            return moment.isoformat(timespec="milliseconds")
    return None
