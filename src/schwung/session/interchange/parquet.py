"""Parquet: one table of all runs, a column that counts them, units in the fields, the rest in the file's metadata."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from schwung.errors import InputError
from schwung.extras import require
from schwung.files import replace_file
from schwung.motion import Array
from schwung.session.hdf5 import FIELDS, unit_of
from schwung.session.interchange.described import describe, rebuild
from schwung.session.model import Session

METADATA = b"schwung-session"
_RUN = "run"


def library() -> tuple[Any, Any]:
    """pyarrow and its Parquet. Raises InputError where it is not installed."""
    require("Parquet", "logs", "pyarrow")
    import pyarrow  # noqa: PLC0415  (an extra, and slow to import)
    from pyarrow import parquet  # noqa: PLC0415  (likewise)

    return pyarrow, parquet


def write_parquet(session: Session, path: Path) -> None:
    """Write a session as one Parquet table, whole or not at all; a signal that a run lacks is null in its rows.

    Raises InputError where it cannot be written.
    """
    arrow, parquet = library()
    names = [name for name in FIELDS if any(name in run.datasets() for run in session.runs)]
    fields = [arrow.field(_RUN, arrow.int32())]
    columns = [
        arrow.array(
            np.repeat(np.arange(len(session.runs)), [len(run) for run in session.runs]), arrow.int32()
        )
    ]
    for name in names:
        fields.append(
            arrow.field(name, arrow.float64(), metadata={"unit": unit_of(name, session.axis, session.effort)})
        )
        parts = [
            arrow.nulls(len(run), arrow.float64())
            if (values := run.datasets().get(name)) is None
            else arrow.array(values)
            for run in session.runs
        ]
        columns.append(arrow.chunked_array(parts, arrow.float64()))
    schema = arrow.schema(fields, metadata={METADATA: describe(session).encode()})
    image = io.BytesIO()
    parquet.write_table(arrow.table(columns, schema=schema), image, compression="zstd")
    replace_file(path, image.getvalue())


def read_parquet_session(path: Path) -> Session | None:
    """The session that `write_parquet` wrote; None where the file is somebody else's. Raises InputError where it is no
    Parquet, or does not hold what it says."""
    table = read_arrow(path)
    told = (table.schema.metadata or {}).get(METADATA)
    if told is None:
        return None
    if _RUN not in table.column_names:
        raise InputError(str(path), 'has no column "run"', "Convert the session again.")
    run = np.asarray(table.column(_RUN))
    count = int(run.max()) + 1 if run.size else 0
    runs: list[dict[str, Array]] = []
    for number in range(count):
        own = table.filter(run == number)
        runs.append(
            {
                name: np.asarray(own.column(name), dtype=np.float64)
                for name in own.column_names
                if name != _RUN and own.column(name).null_count < max(1, own.num_rows)
            }
        )
    return rebuild(told, runs, str(path))


def read_arrow(path: Path) -> Any:
    """A Parquet file as pyarrow's table. Raises InputError where it is none."""
    arrow, parquet = library()
    try:
        return parquet.read_table(path)
    except (arrow.ArrowException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            str(path), f"is no Parquet that could be read ({reason})", "Export it again."
        ) from None
