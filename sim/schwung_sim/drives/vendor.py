"""The drive's own objects: filter, sine generator, trace, inertia table, gains (the EDS names the units)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from schwung_sim.drives.axis import TRACE_ARMED, TRACE_IDLE, AxisSettings, Trace
from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary, key
from schwung_sim.drives.operation import Axis

CONTROL_RATE_HZ = 8000
CONTROL_PERIOD_US = 125
TABLE_POINTS = 64
_TRACE_ROW = np.dtype([("position", "<i4"), ("speed", "<i4"), ("torque", "<i2")])

#: (object, setting of the axis, SI per count)
_SCALED = (
    (key(0x2000), "speed_filter_s", 1e-6),
    (key(0x2100, 2), "generator_frequency_hz", 1e-3),
    (key(0x2100, 3), "generator_phase_rad", 1e-3),
    (key(0x2301, 1), "table_start_rad", 1e-6),
    (key(0x2301, 2), "table_step_rad", 1e-6),
    (key(0x2302, 2), "scalar_inertia_kgm2", 1e-7),
    (key(0x2400, 1), "position_gain_1_s", 1e-3),
    (key(0x2400, 2), "speed_gain_nms_rad", 1e-3),
    (key(0x2400, 3), "speed_integral_time_s", 1e-6),
    (key(0x2400, 4), "speed_feed_forward", 1e-3),
    (key(0x2400, 5), "rotor_inertia_kgm2", 1e-9),
)


class BenchAxis(Axis, Protocol):
    """The whole of what the drive asks of its axis (drives/axis.py fulfils it)."""

    settings: AxisSettings

    def advance(self, duration_s: float) -> None: ...

    def configure(self, **changes: Any) -> None: ...

    def arm_trace(self, divider: int, length: int) -> None: ...

    def stop_trace(self) -> None: ...

    @property
    def trace(self) -> Trace: ...

    @property
    def trace_status(self) -> int: ...


class VendorObjects:
    """Keeps the axis as objects 2000…2400 and 6072 say. `speed_unit` gives rad/s per count of 606C."""

    def __init__(
        self,
        dictionary: ObjectDictionary,
        axis: BenchAxis,
        rated_torque_nm: float,
        speed_unit: Callable[[], float],
    ) -> None:
        self._dictionary, self._axis, self._speed_unit = dictionary, axis, speed_unit
        self._per_mille_nm = rated_torque_nm * 1e-3
        self._weakened = False
        write, read = dictionary.writers, dictionary.readers
        for k, name, scale in (
            *_SCALED,
            (key(0x2100, 1), "generator_amplitude_nm", self._per_mille_nm),
            (key(0x2100, 4), "generator_control", 1),
            (key(0x2302, 1), "feed_forward_mode", 1),
        ):
            write[k] = self._setter(name, scale)
        write[key(0x6072)] = self._write_torque_limit
        for point in range(1, TABLE_POINTS + 1):
            write[key(0x2300, point)] = self._point_setter(point)
        write[key(0x2301, 3)] = self._configure_table
        write[key(0x2200, 3)] = self._write_trace_control
        read[key(0x2200, 3)] = lambda: axis.trace_status
        read[key(0x2200, 4)] = self._trace_data

    def load(self) -> None:
        """Give the axis everything that the dictionary holds."""
        value = self._dictionary.number
        settings: dict[str, float] = {name: value(k >> 8, k & 0xFF) * scale for k, name, scale in _SCALED}
        self._axis.configure(
            **settings,
            generator_amplitude_nm=value(0x2100, 1) * self._per_mille_nm,
            generator_control=value(0x2100, 4),
            feed_forward_mode=value(0x2302, 1),
            encoder_counts=value(0x608F, 1) // value(0x608F, 2),
        )
        self._configure_table(value(0x2301, 3))
        self._weakened = False
        self._write_torque_limit(value(0x6072), always=True)
        self._axis.stop_trace()

    def weaken(self) -> None:
        """The bench's own: no torque until the next reset: the axis is left behind."""
        self._weakened = True
        self._axis.configure(torque_limit_nm=0.0)

    def _setter(self, name: str, scale: float) -> Callable[[int], None]:
        return lambda value: self._axis.configure(**{name: value * scale if scale != 1 else value})

    def _point_setter(self, point: int) -> Callable[[int], None]:
        def write(value: int) -> None:
            used = self._dictionary.number(0x2301, 3)
            if point <= used:
                self._configure_table(used, {point: value})

        return write

    def _configure_table(self, used: int, changed: dict[int, int] | None = None) -> None:
        held = {n: self._dictionary.number(0x2300, n) for n in range(1, used + 1)} | (changed or {})
        self._axis.configure(table_inertia_kgm2=tuple(counts * 1e-7 for counts in held.values()))

    def _write_torque_limit(self, per_mille: int, always: bool = False) -> None:
        if not self._weakened and (always or per_mille != self._dictionary.number(0x6072)):
            self._axis.configure(torque_limit_nm=per_mille * self._per_mille_nm)

    def _write_trace_control(self, value: int) -> None:
        if value == TRACE_IDLE:
            self._axis.stop_trace()
        elif value == TRACE_ARMED:
            self._axis.arm_trace(self._dictionary.number(0x2200, 1), self._dictionary.number(0x2200, 2))
        else:
            raise AbortError(Code.INVALID_VALUE)  # running and full are the drive's to say

    def _trace_data(self) -> bytes:
        trace = self._axis.trace
        rows = np.zeros(trace.position_counts.size, _TRACE_ROW)
        rows["position"] = trace.position_counts
        rows["speed"] = np.rint(trace.speed_rad_s / self._speed_unit())
        rows["torque"] = np.rint(trace.torque_nm / self._per_mille_nm)
        return rows.tobytes()
