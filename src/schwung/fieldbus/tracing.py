"""What a drive's trace buffer is asked for, and what its rows say: the same whatever the bus."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.fieldbus.drive import Recording, Setpoints, Sine, SyncTiming
from schwung.fieldbus.profile import ObjectRef, Trace, TracedQuantity
from schwung.fieldbus.units import Scales
from schwung.motion import Array

#: A rate that is asked for is met to this share, or refused.
SAME_RATE = 1e-6
Columns = Mapping[TracedQuantity, Array]


@dataclass(frozen=True)
class TraceRequest:
    """How a trace shall be recorded."""

    rate_hz: float
    divider: int  # of the undivided rate
    rows: int

    def over(self, duration_s: float) -> TraceRequest:
        """The same, for so long a trace."""
        return TraceRequest(self.rate_hz, self.divider, rows_of(duration_s, self.rate_hz))


def rows_of(duration_s: float, rate_hz: float) -> int:
    """Samples of a trace that begins at its first one."""
    return max(2, math.floor(duration_s * rate_hz + 1e-6) + 1)


def trace_request(trace: Trace, duration_s: float, wanted_hz: float | None = None) -> TraceRequest:
    """The rate wanted, or the highest at which the buffer holds so long a trace.

    Raises InputError for a rate that the drive cannot make, or at which its buffer is too short.
    """
    base = trace.base_rate_hz
    divides = trace.divider is not None or trace.period is not None
    most = max(trace.max_samples - 1, 1) / duration_s if duration_s > 0 else math.inf
    if wanted_hz is None:
        divider = max(1, math.ceil(base / most - 1e-9)) if divides else 1
    else:
        divider = max(1, round(base / wanted_hz))
        if abs(base / divider - wanted_hz) > SAME_RATE * wanted_hz or (divider > 1 and not divides):
            near = {base / max(1, d) for d in (divider - 1, divider, divider + 1)} if divides else {base}
            raise InputError(
                "trace rate",
                f"{wanted_hz:g} Hz is not what the drive can make of {base:g} Hz",
                f"Take {', '.join(f'{rate:.6g}' for rate in sorted(near))} Hz.",
            )
    if base / divider > most * (1 + 1e-9):
        raise InputError(
            "trace",
            f"holds {trace.max_samples} samples, {trace.max_samples / base * divider:.3g} s of {duration_s:.3g} s",
            "Take a slower rate (--trace-rate) or a shorter motion." if divides else "Take a shorter motion.",
        )
    return TraceRequest(base / divider, divider, rows_of(duration_s, base / divider))


def motion_index(position_counts: NDArray[np.int64], setpoints: Setpoints) -> int:
    """The last setpoint before the motion starts: by the moves, or else where the demand leaves rest."""
    if setpoints.moves:
        return setpoints.moves[0].at_index
    moved = np.flatnonzero(position_counts != position_counts[0])
    if not moved.size:
        raise InputError("setpoints", "do not move, so nothing starts the trace", "Sample by SYNC.")
    return int(moved[0]) - 1


def column_scale(quantity: TracedQuantity, scales: Scales) -> float:
    """SI per count as [quantities] has it; an added torque that is not exchanged counts as the torque does."""
    if quantity in ("position", "position_demand"):
        return scales.position_rad
    if quantity == "speed":
        return scales.speed_rad_s
    added = scales.torque_added_nm
    return added if quantity == "torque_added" and math.isfinite(added) else scales.torque_nm


def sine_torque(sine: Sine, time_s: Array) -> Array:
    """What the generator adds, t counted from its start (s), (n,)."""
    return np.asarray(
        sine.amplitude_nm * np.sin(2 * np.pi * sine.frequency_hz * time_s + sine.phase_rad), dtype=float
    )


def recording_of(
    columns: Columns,
    request: TraceRequest,
    start_s: float,
    timing: SyncTiming,
    torque_added_nm: Array | None = None,
    notes: tuple[str, ...] = (),
) -> Recording:
    """Rows as they came, SI; those that did not come are NaN and count as lost.

    `torque_added_nm`: what was in force up to each row, where that is known otherwise than by the trace, (rows,).
    """
    rows = request.rows
    came = min((values.size for values in columns.values()), default=0)

    def column(name: TracedQuantity) -> Array:
        found = np.full(rows, np.nan)
        if name in columns:
            found[: min(came, rows)] = columns[name][: min(came, rows)]
        return found

    added = column("torque_added") if torque_added_nm is None else torque_added_nm
    if came < rows:
        notes = (*notes, f"the trace holds {came} of {rows} samples")
    return Recording(
        sample_rate_hz=request.rate_hz,
        sync_count=np.arange(rows),
        receive_time_s=np.full(rows, np.nan),
        statusword=np.full(rows, -1, dtype=np.int64),
        position_rad=column("position"),
        speed_rad_s=column("speed"),
        torque_nm=column("torque"),
        position_demand_rad=column("position_demand"),
        torque_added_nm=added,
        lost=np.arange(min(came, rows), rows),
        timing=timing,
        notes=notes,
        start_s=start_s,
        sampling="trace",
    )


def trace_settings(trace: Trace, request: TraceRequest) -> list[tuple[ObjectRef, int]]:
    """What must be in the drive for such a trace: objects or registers, and their counts."""
    wanted: list[tuple[ObjectRef, int]] = []
    if trace.divider is not None:
        wanted.append((trace.divider, request.divider))
    if trace.period is not None:
        wanted.append((trace.period.object, round(1 / request.rate_hz / trace.period.scale)))
    if trace.length is not None:
        wanted.append((trace.length, request.rows))
    for column in trace.columns:
        if column.selector is not None and column.selection is not None:
            wanted.append((column.selector, column.selection))
    return wanted
