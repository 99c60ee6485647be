"""What a drive has beyond CiA 402, at the objects that its profile names: torque limit, gains, generator, feed-forward.

Values that come in are turned into SI and given to the axis; where the EDS lacks an object, nothing is ever written.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from schwung_sim.drives.axis import (
    FEED_FORWARD_OFF,
    FEED_FORWARD_SCALAR,
    FEED_FORWARD_TABLE,
    GENERATOR_AT_MOTION,
    GENERATOR_OFF,
    GENERATOR_ON,
)
from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary, key
from schwung_sim.drives.operation import Axis
from schwung_sim.drives.roles import HarmonicRole, Roles, ScalarRole, Setting, TableRole
from schwung_sim.drives.setup import GAINS
from schwung_sim.drives.trace import TraceBuffer, TracingAxis
from schwung_sim.drives.units import Units, torque_unit

CONTROL_RATE_HZ = 8000
CONTROL_PERIOD_US = 125

#: what only the bench's own drive has: object, setting, SI per count
OWN_FAMILY = "schwung-bench"
_OWN = ((key(0x2000), "speed_filter_s", 1e-6), (key(0x2400, 5), "rotor_inertia_kgm2", 1e-9))
_HARMONIC_POINTS, _HARMONIC_TURNS = 32, 5  # a series becomes a table of so many points a turn, around 0

Change = tuple[int, float]  # an object that is just being written, and its new value


class BenchAxis(Axis, TracingAxis, Protocol):
    """The whole of what the drive asks of its axis (drives/axis.py fulfils it)."""

    def advance(self, duration_s: float) -> None: ...


class VendorObjects:
    """Keeps the axis as the vendor's objects and 6072 say. `units` gives what counts are worth now."""

    def __init__(
        self, dictionary: ObjectDictionary, axis: BenchAxis, roles: Roles, units: Callable[[], Units]
    ) -> None:
        self._dictionary, self._axis, self._roles, self._units = dictionary, axis, roles, units
        self._weakened = False
        self._scaled = [
            *((part.object, GAINS[name], part.scale) for name, part in roles.gains.items() if name in GAINS),
            *(_OWN if roles.family == OWN_FAMILY else ()),
        ]
        self._trace = TraceBuffer(dictionary, axis, roles.trace, units) if roles.trace is not None else None
        write = dictionary.writers
        for k, name, scale in self._scaled:
            write[k] = self._setter(name, scale)
        write[key(0x6072)] = self._write_torque_limit
        for k in set(self._generator_objects()):
            write[k] = self._writer(k, self._apply_generator)
        for k in set(self._inertia_objects()):
            write[k] = self._writer(k, self._apply_inertia)
        for k in (key(0x607C), key(0x607E)):
            write[k] = self._and_inertia(write[k])

    def load(self) -> None:
        """Give the axis everything that the dictionary holds."""
        self._axis.configure(**{name: self._value(k) * scale for k, name, scale in self._scaled})
        self._apply_generator()
        self._apply_inertia()
        self._weakened = False
        self._write_torque_limit(self._dictionary.number(0x6072), always=True)
        self._axis.stop_trace()

    def weaken(self) -> None:
        """The bench's own: no torque until the next reset: the axis is left behind."""
        self._weakened = True
        self._axis.configure(torque_limit_nm=0.0)

    @property
    def volatile(self) -> set[int]:
        """Objects that command, and are never stored."""
        roles = self._roles
        found = {part.control.object for part in (roles.generator, roles.trace) if part is not None}
        offsets = {q.object for q in (roles.torque_added, roles.host_played) if q is not None}
        return found | offsets | {roles.demand}

    def _value(self, k: int, changed: Change | None = None) -> float:
        """What an object holds, or will hold when the write that is under way is over; 0 where there is none."""
        if changed is not None and changed[0] == k:
            return changed[1]
        return self._dictionary.real(k)

    def _number(self, k: int) -> int:
        return int(self._value(k))

    def _setter(self, name: str, scale: float) -> Callable[[float], None]:
        return lambda value: self._axis.configure(**{name: value * scale})

    @staticmethod
    def _writer(k: int, apply: Callable[[Change], None]) -> Callable[[float], None]:
        return lambda value: apply((k, value))

    def _and_inertia(self, write: Callable[[Any], None]) -> Callable[[float], None]:
        def both(value: float) -> None:
            write(value)
            self._apply_inertia()

        return both

    def _write_torque_limit(self, per_mille: float, always: bool = False) -> None:
        if not self._weakened and (always or per_mille != self._dictionary.number(0x6072)):
            self._axis.configure(torque_limit_nm=per_mille * self._units().rated_torque_nm / 1000)

    # -- Generator --------------------------------------------------------------------------------

    def _generator_objects(self) -> Iterator[int]:
        generator = self._roles.generator
        if generator is not None:
            yield from (generator.amplitude.object, generator.frequency.object, generator.control.object)
            if generator.phase is not None:
                yield generator.phase.object

    def _apply_generator(self, changed: Change | None = None) -> None:
        generator = self._roles.generator
        if generator is None:
            return
        command, phase = self._value(generator.control.object, changed), generator.phase
        states = {"on": GENERATOR_ON, "at_motion": GENERATOR_AT_MOTION}
        asked = [state for name, state in states.items() if generator.control.values.get(name) == command]
        commanded = changed is None or changed[0] == generator.control.object
        if changed is not None and commanded and not asked and command != generator.control.values["off"]:
            raise AbortError(Code.INVALID_VALUE)
        settings: dict[str, Any] = {
            "generator_amplitude_nm": self._value(generator.amplitude.object, changed)
            * torque_unit(generator.amplitude, self._number),
            "generator_frequency_hz": self._value(generator.frequency.object, changed)
            * generator.frequency.scale,
            "generator_phase_rad": 0.0 if phase is None else self._value(phase.object, changed) * phase.scale,
        }
        if commanded:
            settings["generator_control"] = asked[0] if asked else GENERATOR_OFF
        self._axis.configure(**settings)

    # -- Feed-forward -----------------------------------------------------------------------------

    def _inertia_objects(self) -> Iterator[int]:
        table, scalar, series = self._roles.table, self._roles.scalar, self._roles.harmonics
        for part in (table, scalar, series):
            if part is not None and part.enable is not None:
                yield part.enable.object
        if table is not None:
            yield from (table.start, table.step, *(table.values + n for n in range(1, table.points + 1)))
            if table.count is not None:
                yield table.count
        if scalar is not None:
            yield scalar.object
        if series is not None:
            yield series.offset.object
            yield from (
                first + n for first in (series.amplitudes, series.phases) for n in range(1, series.orders + 1)
            )

    def _apply_inertia(self, changed: Change | None = None) -> None:
        """The feed-forward that is switched on; one without a switch works where it holds anything."""
        table, scalar, series = self._roles.table, self._roles.scalar, self._roles.harmonics
        mode, settings = FEED_FORWARD_OFF, dict[str, Any]()
        if scalar is not None:
            settings["scalar_inertia_kgm2"] = held = self._scalar(scalar, changed)
            mode = FEED_FORWARD_SCALAR if self._enabled(scalar.enable, held != 0.0, changed) else mode
        if series is not None:
            found = self._series(series, changed)
            if self._enabled(series.enable, any(found["table_inertia_kgm2"]), changed):
                mode, settings = FEED_FORWARD_TABLE, settings | found
        if table is not None:
            found = self._table(table, changed)
            if mode != FEED_FORWARD_TABLE:
                settings |= found
            if self._enabled(table.enable, bool(found["table_inertia_kgm2"]), changed):
                mode = FEED_FORWARD_TABLE
        if any(part is not None for part in (table, scalar, series)):
            self._axis.configure(**self._on_motor(settings), feed_forward_mode=mode)

    def _on_motor(self, settings: dict[str, Any]) -> dict[str, Any]:
        """A table over the user's angle, turned by 607E and counted from 607C, as one over the motor's."""
        units, values = self._units(), settings.get("table_inertia_kgm2", ())
        if not values or (units.direction > 0 and units.zero == 0):
            return settings
        start, zero = settings["table_start_rad"], units.zero * units.demand_rad
        if units.direction > 0:
            return settings | {"table_start_rad": zero + start}
        end = start + (len(values) - 1) * settings["table_step_rad"]
        return settings | {"table_start_rad": zero - end, "table_inertia_kgm2": values[::-1]}

    def _enabled(self, switch: Setting | None, otherwise: bool, changed: Change | None) -> bool:
        return otherwise if switch is None else self._value(switch.object, changed) == switch.value

    def _scalar(self, scalar: ScalarRole, changed: Change | None) -> float:
        scale = scalar.scale_kgm2 * (1.0 if scalar.per is None else self._value(scalar.per))
        inertia = self._value(scalar.object, changed) * scale
        return inertia - (self._axis.settings.rotor_inertia_kgm2 if scalar.total and inertia else 0.0)

    def _table(self, table: TableRole, changed: Change | None) -> dict[str, Any]:
        used = table.points if table.count is None else int(self._value(table.count, changed))
        values = [self._value(table.values + n, changed) * table.scale_kgm2 for n in range(1, used + 1)]
        return {
            "table_start_rad": self._value(table.start, changed) * table.angle_scale_rad,
            "table_step_rad": self._value(table.step, changed) * table.angle_scale_rad,
            "table_inertia_kgm2": tuple(values),
        }

    def _series(self, series: HarmonicRole, changed: Change | None) -> dict[str, Any]:
        step = 2 * math.pi / _HARMONIC_POINTS
        start = -(_HARMONIC_TURNS // 2) * 2 * math.pi
        mean = self._value(series.offset.object, changed) * series.offset.scale
        orders = [
            (
                n,
                self._value(series.amplitudes + n, changed) * series.amplitude_scale_kgm2,
                self._value(series.phases + n, changed) * series.phase_scale_rad,
            )
            for n in range(1, series.orders + 1)
        ]
        angles = (start + i * step for i in range(_HARMONIC_TURNS * _HARMONIC_POINTS + 1))
        values = tuple(mean + sum(a * math.cos(n * x - phase) for n, a, phase in orders) for x in angles)
        return {"table_start_rad": start, "table_step_rad": step, "table_inertia_kgm2": values}
