"""The drive's trace buffer by SDO: arm, wait until it is full, read it out by block transfer, decode."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Literal

import numpy as np

from schwung.errors import DriveError, InputError
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung.fieldbus.profile import ObjectRef, Trace, TraceColumn, TracedQuantity
from schwung.fieldbus.tracing import Columns, TraceRequest, column_scale, trace_settings
from schwung.fieldbus.units import Scales
from schwung.motion import Array

Lookup = Callable[[int, int], Parameter | None]
Progress = Literal["idle", "armed", "running", "full"]

#: numpy's name of each type that a column can have, little-endian (CiA 301 clause 7.1.4).
TYPES = {
    "INTEGER8": "<i1", "INTEGER16": "<i2", "INTEGER32": "<i4", "INTEGER64": "<i8", "UNSIGNED8": "<u1",
    "UNSIGNED16": "<u2", "UNSIGNED32": "<u4", "UNSIGNED64": "<u8", "REAL32": "<f4", "REAL64": "<f8",
}  # fmt: skip


class TraceBuffer:
    """One drive's recorder, as [trace] of its profile describes it. Raises InputError where the EDS lacks an object
    or a column has a type that nobody knows."""

    def __init__(self, sdo: SdoChannel, trace: Trace, lookup: Lookup) -> None:
        self._sdo, self._trace, self._lookup = sdo, trace, lookup
        self._place = f"node {sdo.node_id}, trace"
        for column in trace.columns:
            if column.type not in TYPES:
                raise InputError("profile, [trace]", f'no column can be of type "{column.type}"',
                                 f"Use {', '.join(TYPES)}.")  # fmt: skip
        if trace.trigger != "motion_start":
            raise InputError(
                "profile, [trace]", "a trace that does not start with the motion cannot be aligned with it",
                "Sample by SYNC.",
            )  # fmt: skip
        self._control = self._parameter(trace.control.object)
        self._status = self._parameter(trace.status.object)

    def settings(self, request: TraceRequest) -> list[ParameterValue]:
        """What must be in the drive's objects for such a trace."""
        return [
            ParameterValue(self._parameter(ref), value) for ref, value in trace_settings(self._trace, request)
        ]

    def arm(self) -> None:
        """Make it wait for the motion. Raises SdoError where the drive refuses."""
        self._sdo.write(ParameterValue(self._control, self._trace.control.arm))

    def stop(self) -> None:
        """End it, where it can be ended; what was recorded stays. Never raises."""
        if self._trace.control.stop is not None:
            with contextlib.suppress(DriveError):
                self._sdo.write(ParameterValue(self._control, self._trace.control.stop))

    def progress(self) -> Progress:
        """How far it is. Raises SdoError."""
        raw = self._sdo.read(self._status).raw
        status = self._trace.status
        known: tuple[tuple[int | None, Progress], ...] = (
            (status.full, "full"),
            (status.running, "running"),
            (status.armed, "armed"),
        )
        value = int(raw) & status.mask if isinstance(raw, int) else None
        return next((name for code, name in known if code is not None and code == value), "idle")

    def read(self, scales: Scales) -> Columns:
        """All rows that it holds, SI, by quantity; a column whose unit nobody knows is left out. Raises SdoError."""
        trace = self._trace
        if trace.data is not None:
            record = np.dtype([(str(i), TYPES[column.type]) for i, column in enumerate(trace.columns)])
            data = self._upload(trace.data)
            rows = np.frombuffer(data[: len(data) // record.itemsize * record.itemsize], record)
            raw = [rows[str(i)] for i in range(len(trace.columns))]
        else:
            raw = [
                np.frombuffer(data[: len(data) // size * size], TYPES[column.type])
                for column in trace.columns
                if column.data is not None
                for data, size in [(self._upload(column.data), np.dtype(TYPES[column.type]).itemsize)]
            ]
        columns: dict[TracedQuantity, Array] = {}
        for column, values in zip(trace.columns, raw, strict=True):
            scale = _scale(column, scales)
            if np.isfinite(scale):
                columns[column.quantity] = values.astype(float) * scale
        return columns

    def _upload(self, ref: ObjectRef) -> bytes:
        return self._sdo.upload(self._parameter(ref), block=True)

    def _parameter(self, ref: ObjectRef) -> Parameter:
        found = self._lookup(ref.index, ref.subindex)
        if found is None:
            raise InputError(self._place, f"the EDS lacks {ref}", "Use the EDS of this drive family.")
        return found


def _scale(column: TraceColumn, scales: Scales) -> float:
    return column.scale if column.scale is not None else column_scale(column.quantity, scales)
