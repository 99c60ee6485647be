"""The drive's modes of operation, profile position and cyclic position, and what it watches meanwhile.

Here counts and per mille become rad and N·m: the axis knows SI only. (IEC 61800-7-201 clauses 10, 14, 15.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary, key
from schwung_sim.drives.eds import REALS
from schwung_sim.drives.power import Motor, PowerStage
from schwung_sim.drives.roles import Roles
from schwung_sim.drives.units import ENCODER_COUNTS, RPM, read_units, si_unit, torque_unit

FOLLOWING_ERROR, BEYOND_LIMIT = 0x8611, 0x8612
_NEW_SETPOINT, _AT_ONCE, _RELATIVE = 1 << 4, 1 << 5, 1 << 6
_TARGET_REACHED, _LIMIT_ACTIVE, _MODE_BIT, _FOLLOWING_ERROR = 1 << 10, 1 << 11, 1 << 12, 1 << 13
_WINDOW_OFF = 0xFFFFFFFF
#: A drive whose position unit is coarser than this many counts a turn has a finer encoder below it.
FINE_TURN = 2**16
UNTOLD_PERIOD_S = 1e-3
_OVERSHOOT_RAD = 0.1  # what a controller may overshoot a software limit by; further out is a fault
#: What a drive whose speed unit can be chosen takes in 60A9: revolutions per minute, 10^0 … 10^-3 (CiA 303-2).
_RPM_UNITS = (0x00B44700, 0xFFB44700, 0xFEB44700, 0xFDB44700)


class Axis(Motor, Protocol):
    """What the modes ask of the axis; SI, motor side."""

    def set_target(self, position_rad: float, over_s: float) -> None: ...

    def start_move(
        self, target_rad: float, speed: float, acceleration: float, deceleration: float
    ) -> None: ...

    def set_torque_offset(self, torque_nm: float) -> None: ...

    def configure(self, **changes: Any) -> None: ...

    @property
    def position_counts(self) -> int: ...

    @property
    def position_rad(self) -> float: ...

    @property
    def torque_nm(self) -> float: ...

    @property
    def torque_demand_nm(self) -> float: ...

    @property
    def demand_rad(self) -> float: ...

    @property
    def following_error_rad(self) -> float: ...

    @property
    def target_reached(self) -> bool: ...

    @property
    def torque_limit_active(self) -> bool: ...


@dataclass(frozen=True)
class _Setpoint:
    target: int  # counts
    speed_rad_s: float
    acceleration_rad_s2: float
    deceleration_rad_s2: float


class Operation:
    """Modes, setpoints and supervision. `fault` is called with an error code when supervision trips."""

    def __init__(
        self,
        dictionary: ObjectDictionary,
        axis: Axis,
        power: PowerStage,
        fault: Callable[[int], None],
        roles: Roles,
    ) -> None:
        self._dictionary, self._axis, self._power, self._fault = dictionary, axis, power, fault
        self._roles = roles
        self._pp, self._csp = roles.modes.get("pp"), roles.modes.get("csp")
        self._word = self._encoder = 0
        self._injected_nm = self._played_nm = 0.0
        self._reset()
        self.load()
        self._bind()

    def _bind(self) -> None:
        axis, roles, write = self._axis, self._roles, self._dictionary.writers
        self._report(0x6061, lambda: self.mode)
        for index in (0x6062, 0x60FC):
            self._report(index, lambda: axis.demand_rad / self.units.position_rad)
        self._report(0x606C, lambda: axis.speed_rad_s / self.units.speed_rad_s)
        self._report(0x6074, lambda: axis.torque_demand_nm * self._per_mille)
        self._report(0x6077, lambda: axis.torque_nm * self._per_mille)
        self._report(0x60F4, lambda: axis.following_error_rad / self.units.position_rad)
        self._report(roles.position.object >> 8, self._counts, roles.position.object & 0xFF)
        for quantity, value in (
            (roles.speed, lambda: axis.speed_rad_s / self.units.speed_rad_s),
            (roles.torque, lambda: axis.torque_nm / self.units.torque_nm),
        ):
            if quantity is not None:
                self._report(quantity.object >> 8, value, quantity.object & 0xFF)
        if roles.position.object != key(0x6064):
            self._report(0x6064, self._counts)
        write[key(0x6060)] = self._write_mode
        write[roles.demand] = self._write_target
        write[key(0x60A9)] = self._write_speed_unit
        if roles.torque_added is not None:
            write[roles.torque_added.object] = self._write_injected
        if roles.host_played is not None:
            write[roles.host_played.object] = self._write_played
        for index, subindex in ((0x607D, 1), (0x607D, 2)):
            write[key(index, subindex)] = self._later
        for k in self._unit_objects():
            write[k] = partial(self._rescale, k)
        for index in (0x6065, 0x6066, 0x6067, 0x6068, 0x6080):
            write[key(index)] = self._later
        for subindex in (1, 2):
            write[key(0x60C2, subindex)] = self._later

    def _unit_objects(self) -> set[int]:
        roles = self._roles
        torques = (roles.torque, roles.torque_added, roles.host_played)
        found = {q.rated for q in torques if q is not None} | {key(0x60AA)}
        found |= {key(index, n) for index in (0x608F, 0x6091, 0x6092) for n in (1, 2)}
        return found | ({roles.position.resolution} if roles.position.resolution is not None else set())

    def _report(self, index: int, value: Callable[[], float], subindex: int = 0) -> None:
        """Show a live quantity, where the EDS has the object, as its type holds it."""
        entry = self._dictionary.entries.get(key(index, subindex))
        if entry is None or entry.size is None:
            return
        low, high = entry.span
        if entry.data_type in REALS:
            self._dictionary.readers[entry.key] = value
        else:
            self._dictionary.readers[entry.key] = lambda: int(min(max(round(value()), low), high))

    def _later(self, value: int) -> None:
        self._stale = True

    def load(self) -> None:
        """Take over what the dictionary holds."""
        number, value = self._dictionary.number, self._value
        self._stale = False
        self.mode = number(0x6060)
        units = self.units = read_units(self._roles, self._by_key)
        self._per_mille = 1000 / units.rated_torque_nm
        self._played_unit_nm = torque_unit(self._roles.host_played, self._by_key)
        turn, before = units.counts_per_turn, self._encoder
        fine = turn >= FINE_TURN and abs(turn - round(turn)) < 1e-6
        self._direct = fine and units.position_rad > 0  # a position count is one of the encoder
        self._encoder = round(turn) if fine else ENCODER_COUNTS
        if self._encoder != before:
            self._axis.configure(encoder_counts=self._encoder)
        self._low, self._high = number(0x607D, 1), number(0x607D, 2)
        window = value(0x6065)
        self._window_rad = math.inf if window == _WINDOW_OFF else window * abs(units.position_rad)
        self._overshoot = round(_OVERSHOOT_RAD / abs(units.position_rad))
        self._window_time_s = number(0x6066) * 1e-3
        self._position_window = value(0x6067)
        self._reached_time_s = number(0x6068) * 1e-3
        self._top_speed_rad_s = value(0x6080) * RPM
        self.period_s = number(0x60C2, 1) * 10.0 ** min(max(number(0x60C2, 2), -9), 0)

    @property
    def sync_period_s(self) -> float:
        """What a SYNC lasts where 1006 does not say it: 60C2 only means something where setpoints are cyclic."""
        return self.period_s if self.mode == self._csp else UNTOLD_PERIOD_S

    def _value(self, index: int) -> float:
        """A value that may be a real number; never negative, never 0."""
        return max(abs(self._dictionary.real(key(index))), 1e-9)

    def _by_key(self, k: int) -> int:
        return int(self._dictionary.real(k))

    def _counts(self) -> float:
        """The position as it is reported."""
        return (
            self._axis.position_counts if self._direct else self._axis.position_rad / self.units.position_rad
        )

    def deceleration(self, index: int) -> float:
        """Objects 6083…6085 in rad/s²; a drive that is told 0 brakes at one count."""
        return max(self._value(index), 1.0) * self.units.acceleration_rad_s2

    def _reset(self) -> None:
        self._active: _Setpoint | None = None
        self._queued: _Setpoint | None = None
        self._last_target: int | None = None
        self._acknowledged = self._limited = False
        self._outside_since_s: float | None = None
        self._inside_since_s: float | None = None

    # -- Modes ------------------------------------------------------------------------------------

    def _write_mode(self, value: int) -> None:
        if value != 0 and value not in self._roles.modes.values():
            raise AbortError(Code.INVALID_VALUE)
        if value != self.mode:
            self.mode = value
            self._reset()

    def _write_speed_unit(self, value: int) -> None:
        if si_unit(value, self.units.position_rad) is None:
            raise AbortError(Code.INVALID_VALUE)
        self._rescale(key(0x60A9), value)

    def _rescale(self, k: int, value: int) -> None:
        """Something that units are made of."""
        if self._power.energised:
            raise AbortError(Code.DEVICE_STATE)
        self._dictionary.values[k] = value
        self.load()

    def _write_injected(self, value: float) -> None:
        self._injected_nm = value * self.units.torque_added_nm
        self._axis.set_torque_offset(self._injected_nm + self._played_nm)

    def _write_played(self, value: float) -> None:
        self._played_nm = value * self._played_unit_nm
        self._axis.set_torque_offset(self._injected_nm + self._played_nm)

    def control(self, word: int) -> None:
        """Follow a controlword: first the state machine, then the bits that belong to the mode."""
        power = self._power
        if word == self._word and power.enabled:
            return  # nothing new, as in every cycle of a motion
        was_enabled, was_halted = power.enabled, power.halted
        power.control(word)
        if was_halted and power.enabled:
            self._last_target = None
            if self._active is not None:
                self._start(self._active)  # a halt only interrupts
        elif power.enabled != was_enabled and not power.halted:
            self._reset()
        if self.mode == self._pp:
            self._handshake(word, word & ~self._word)
        self._word = word

    def _write_target(self, value: int) -> None:
        if self.mode == self._csp and self._power.enabled:
            self._follow(value)

    def _follow(self, value: int) -> None:
        target = self._clamp(value)
        if self._stale:
            self.load()
        last = self._last_target
        if last is None:
            last = round(self._axis.demand_rad / self.units.position_rad)
        most = self._top_speed_rad_s * self.period_s / abs(self.units.position_rad)
        if abs(target - last) > most:
            target = last + round(math.copysign(most, target - last))
            self._limited = True
        self._last_target = target
        self._axis.set_target(target * self.units.position_rad, self.period_s)

    def _clamp(self, target: int) -> int:
        if self._stale:
            self.load()
        inside = min(max(target, self._low), self._high) if self._low < self._high else target
        self._limited = inside != target
        return inside

    def _handshake(self, word: int, rising: int) -> None:
        if rising & _NEW_SETPOINT and self._power.enabled:
            at_once = bool(word & _AT_ONCE)
            if at_once or self._active is None:
                self._queued = None
                self._start(self._setpoint(word))
                self._acknowledged = True
            elif self._queued is None:
                self._queued = self._setpoint(word)
                self._acknowledged = True
        if not word & _NEW_SETPOINT and self._queued is None:
            self._acknowledged = False

    def _setpoint(self, word: int) -> _Setpoint:
        target = self._by_key(self._roles.demand)
        if word & _RELATIVE:
            base = self._queued or self._active
            target += base.target if base else round(self._axis.demand_rad / self.units.position_rad)
        speed = max(min(self._value(0x6081), self._value(0x607F)), 1.0) * abs(self.units.speed_rad_s)
        return _Setpoint(
            self._clamp(target),
            min(speed, self._top_speed_rad_s),
            self.deceleration(0x6083),
            self.deceleration(0x6084),
        )

    def _start(self, setpoint: _Setpoint) -> None:
        self._active, self._inside_since_s = setpoint, None
        self._axis.start_move(
            setpoint.target * self.units.position_rad,
            setpoint.speed_rad_s,
            setpoint.acceleration_rad_s2,
            setpoint.deceleration_rad_s2,
        )

    # -- Supervision ------------------------------------------------------------------------------

    def poll(self) -> None:
        """After each advance of the axis: following error, software limits, end of a move, end of a stop."""
        if self._stale:
            self.load()
        power, axis = self._power, self._axis
        if power.coming_to_rest:
            power.poll()
        if not power.energised:
            self._outside_since_s = None
            return
        if abs(axis.following_error_rad) <= self._window_rad:
            self._outside_since_s = None
        elif self._outside_since_s is None:
            self._outside_since_s = axis.time_s
        elif axis.time_s - self._outside_since_s >= self._window_time_s:
            self._fault(FOLLOWING_ERROR)
        if self._low < self._high:
            slack = self._overshoot
            if not self._low - slack <= self._counts() <= self._high + slack:
                self._fault(BEYOND_LIMIT)
        if self.mode == self._pp and self._active is not None and power.enabled:
            self._poll_move(self._active)

    def _poll_move(self, active: _Setpoint) -> None:
        axis = self._axis
        if not axis.target_reached:
            return
        if self._queued is not None:
            queued, self._queued = self._queued, None
            self._start(queued)
            if not self._word & _NEW_SETPOINT:
                self._acknowledged = False
        elif abs(self._counts() - active.target) > self._position_window:
            self._inside_since_s = None
        elif self._inside_since_s is None:
            self._inside_since_s = axis.time_s
        elif axis.time_s - self._inside_since_s >= self._reached_time_s:
            self._active = None

    @property
    def status(self) -> int:
        """The statusword (6041)."""
        power = self._power
        status = power.status
        if self._limited or self._axis.torque_limit_active:
            status |= _LIMIT_ACTIVE
        if self.mode == self._csp:
            if power.enabled:
                status |= _MODE_BIT  # the drive follows its command value
        elif self.mode == self._pp:
            if self._axis.standstill if power.halted else self._active is None:
                status |= _TARGET_REACHED
            if self._acknowledged:
                status |= _MODE_BIT
        if self._outside_since_s is not None:
            status |= _FOLLOWING_ERROR
        return status
