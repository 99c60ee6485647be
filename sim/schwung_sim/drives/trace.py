"""The drive's recorder at the objects that its profile names, in the rates, types and layout that it has there."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from schwung_sim.drives.axis import TRACE_ARMED, TRACE_FULL, TRACE_IDLE, TRACE_RUNNING, AxisSettings, Trace
from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary
from schwung_sim.drives.roles import Column, TraceRole
from schwung_sim.drives.units import Units
from schwung_sim.plants.two_mass import TICK_S

_TYPES = {
    "INTEGER8": "<i1", "INTEGER16": "<i2", "INTEGER32": "<i4", "INTEGER64": "<i8",
    "UNSIGNED8": "<u1", "UNSIGNED16": "<u2", "UNSIGNED32": "<u4", "UNSIGNED64": "<u8",
    "REAL32": "<f4", "REAL64": "<f8",
}  # fmt: skip


class TracingAxis(Protocol):
    """What a recorder asks of the axis (drives/axis.py fulfils it)."""

    settings: AxisSettings

    def arm_trace(self, divider: int, length: int, at_once: bool = False) -> None: ...

    def stop_trace(self) -> None: ...

    @property
    def trace(self) -> Trace: ...

    @property
    def trace_status(self) -> int: ...


class TraceBuffer:
    """Arms and stops the axis' trace, tells how far it is, and gives its samples out."""

    def __init__(
        self, dictionary: ObjectDictionary, axis: TracingAxis, role: TraceRole, units: Callable[[], Units]
    ) -> None:
        self._dictionary, self._axis, self._role, self._units = dictionary, axis, role, units
        self._period_s, self._length = TICK_S, 0  # of what was armed last
        dictionary.writers[role.control.object] = self._control
        dictionary.readers[role.status] = self._status
        if role.data is not None:
            dictionary.readers[role.data] = self._rows
        for column in role.columns:
            if column.data is not None:
                dictionary.readers[column.data] = self._column_reader(column)

    def _value(self, k: int) -> float:
        return self._dictionary.real(k)

    def _control(self, value: int) -> None:
        commands = self._role.control.values
        if value == commands["arm"]:
            self._arm()
        elif value == commands.get("stop", 0):
            self._axis.stop_trace()
        else:
            raise AbortError(Code.INVALID_VALUE)  # running and full are the drive's to say

    def _arm(self) -> None:
        role = self._role
        period = 1.0 / role.base_rate_hz
        if role.divider is not None:
            period *= max(self._value(role.divider), 1.0)
        elif role.period is not None:
            period = self._value(role.period.object) * role.period.scale or period
        wanted = role.max_samples if role.length is None else int(self._value(role.length))
        self._period_s, self._length = period, min(max(wanted, 1), role.max_samples)
        divider = round(period / TICK_S)
        if divider >= 1 and math.isclose(divider * TICK_S, period, rel_tol=1e-9):
            self._axis.arm_trace(divider, self._length, role.trigger == "immediate")
        else:  # not a multiple of the controller's tick: record every tick, and interpolate afterwards
            ticks = math.ceil((self._length - 1) * period / TICK_S) + 2
            self._axis.arm_trace(1, ticks, role.trigger == "immediate")

    def _status(self) -> int:
        states, present = self._role.states, self._axis.trace_status
        idle = next(n for n in range(4) if n not in states.values())
        if self._role.status == self._role.control.object:
            idle = self._role.control.values.get("stop", idle)
        told = {
            TRACE_IDLE: idle,
            TRACE_ARMED: states.get("armed", idle),
            TRACE_RUNNING: states.get("running", states.get("armed", idle)),
            TRACE_FULL: states["full"],
        }
        return told[present]

    def _samples(self, column: Column) -> NDArray[Any]:
        """One column as its type holds it, (n,): nothing where its selector asks for something else."""
        trace, units = self._axis.trace, self._units()
        count_rad = 2 * math.pi / self._axis.settings.encoder_counts
        values, scale = {
            "position": (
                trace.position_counts * count_rad - units.zero * units.position_rad,
                units.position_rad,
            ),
            "speed": (trace.speed_rad_s, units.speed_rad_s),
            "torque": (trace.torque_nm, units.torque_nm),
            "torque_added": (trace.torque_added_nm, units.torque_added_nm),
            "position_demand": (trace.demand_rad - units.zero * units.demand_rad, units.demand_rad),
        }[column.quantity]
        if values.size and not math.isclose(trace.sample_time_s, self._period_s, rel_tol=1e-9):
            rows = int((values.size - 1) * trace.sample_time_s / self._period_s + 1e-9) + 1
            instants = np.arange(min(rows, self._length)) * self._period_s
            values = np.interp(instants, np.arange(values.size) * trace.sample_time_s, values)
        if column.selector is not None and self._value(column.selector) != column.selection:
            values = np.zeros_like(values)
        counts = values / (scale if column.scale is None else column.scale)
        kind = np.dtype(_TYPES[column.type])
        if kind.kind != "f":
            limits = np.iinfo(kind)
            counts = np.clip(np.rint(counts), limits.min, limits.max)
        stored: NDArray[Any] = counts.astype(kind)
        return stored

    def _rows(self) -> bytes:
        columns = [self._samples(column) for column in self._role.columns]
        rows = np.zeros(columns[0].size, [(str(n), column.dtype) for n, column in enumerate(columns)])
        for n, column in enumerate(columns):
            rows[str(n)] = column
        return rows.tobytes()

    def _column_reader(self, column: Column) -> Callable[[], bytes]:
        return lambda: self._samples(column).tobytes()
