"""Signals in MDF and Parquet files of other programs: named columns with units, each on its own time."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from schwung.errors import InputError
from schwung.session.imports.table import Column, Table
from schwung.session.interchange import mdf, parquet

_UNIT_KEYS = (b"unit", b"units")
_FLOATS = "fiub"


def read_mdf(path: Path) -> Table:
    """Every numeric signal of an MDF file (3 or 4); where groups have channels of one name, `group.name`, else the
    name. Raises InputError where it is no MDF, or holds no signals."""
    with mdf.opened(path) as file:
        if mdf.told_by(file) is not None:
            raise _session_already(path)
        found = [
            (_group_name(file, group), channel.name, signal)
            for group in range(len(file.groups))
            for index, channel in enumerate(file.groups[group].channels)
            if index != file.masters_db.get(group) and (signal := _signal(file, group, index)) is not None
        ]
        created = file.start_time.isoformat(timespec="seconds") if file.start_time else None
    often = Counter(name for _, name, _ in found)
    columns = tuple(
        Column(
            name if often[name] == 1 else f"{group}.{name}",
            values,
            unit,
            () if often[name] == 1 else (name,),
            time,
        )
        for group, name, (values, time, unit) in found
    )
    if not columns:
        raise InputError(
            str(path), "holds no signals of numbers", "Give the file with the samples, or --eds, or --dbc."
        )
    return Table(path, columns, created=created, described="MDF")


def _session_already(path: Path) -> InputError:
    return InputError(
        str(path), "is a session of Schwung's already", f"Use schwung convert {path.name} session.h5."
    )


def _group_name(file: Any, group: int) -> str:
    return str(getattr(file.groups[group].channel_group, "acq_name", "") or f"group {group}")


def _signal(file: Any, group: int, index: int) -> tuple[Any, Any, str] | None:
    """Samples, stamps (s) and unit; NaN where the file says that a sample is not valid. None for what is no number."""
    signal = file.get(group=group, index=index, ignore_invalidation_bits=True)
    samples = signal.samples
    if samples.ndim != 1 or samples.dtype.kind not in _FLOATS or samples.size == 0:
        return None
    values = np.asarray(samples, dtype=np.float64)
    invalid = getattr(signal, "invalidation_bits", None)
    if invalid is not None:
        values = np.where(np.asarray(invalid, dtype=bool), np.nan, values)
    return values, np.asarray(signal.timestamps, dtype=np.float64), str(signal.unit or "")


def read_parquet(path: Path) -> Table:
    """Every numeric column of a Parquet file; stamps of date and time are seconds since the first. Raises InputError
    where it is none."""
    table = parquet.read_arrow(path)
    if parquet.METADATA in (table.schema.metadata or {}):
        raise _session_already(path)
    columns: list[Column] = []
    for field, column in zip(table.schema, table.columns, strict=True):
        values = np.asarray(column)
        if values.dtype.kind == "M":
            values = (values - values[0]) / np.timedelta64(1, "s")
        if values.dtype.kind not in _FLOATS:
            continue
        told = field.metadata or {}
        unit = next((told[key].decode() for key in _UNIT_KEYS if key in told), "")
        columns.append(Column(field.name, values.astype(np.float64), unit))
    if not columns:
        raise InputError(str(path), "holds no columns of numbers", "Give the file with the samples.")
    return Table(path, tuple(columns), described="Parquet")
