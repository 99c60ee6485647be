"""The drive's modes of operation, profile position and cyclic position, and what it watches meanwhile.

Here counts and per mille become rad and N·m: the axis knows SI only. (IEC 61800-7-201 clauses 10, 14, 15.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary, key
from schwung_sim.drives.power import Motor, PowerStage

PP, CSP = 1, 8
FOLLOWING_ERROR, BEYOND_LIMIT = 0x8611, 0x8612
RPM = 2 * math.pi / 60
_NEW_SETPOINT, _AT_ONCE, _RELATIVE = 1 << 4, 1 << 5, 1 << 6
_TARGET_REACHED, _LIMIT_ACTIVE, _MODE_BIT, _FOLLOWING_ERROR = 1 << 10, 1 << 11, 1 << 12, 1 << 13
_WINDOW_OFF = 0xFFFFFFFF
_OVERSHOOT_RAD = 0.1  # what a controller may overshoot a software limit by; further out is a fault
#: 60A9 in revolutions per minute, with the prefixes 10^0 … 10^-3 (CiA 303-2)
_RPM_UNITS = {0x00B44700: 1.0, 0xFFB44700: 1e-1, 0xFEB44700: 1e-2, 0xFDB44700: 1e-3}
_INT32, _INT16 = 1 << 31, 1 << 15


class Axis(Motor, Protocol):
    """What the modes ask of the axis; SI, motor side."""

    def set_target(self, position_rad: float, over_s: float) -> None: ...

    def start_move(
        self, target_rad: float, speed: float, acceleration: float, deceleration: float
    ) -> None: ...

    def set_torque_offset(self, torque_nm: float) -> None: ...

    @property
    def position_counts(self) -> int: ...

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
        self, dictionary: ObjectDictionary, axis: Axis, power: PowerStage, fault: Callable[[int], None]
    ) -> None:
        self._dictionary, self._axis, self._power, self._fault = dictionary, axis, power, fault
        self.counts_per_rad = dictionary.number(0x608F, 1) / dictionary.number(0x608F, 2) / (2 * math.pi)
        self.rated_torque_nm = dictionary.number(0x6076) * 1e-3
        self._word = 0
        self._reset()
        self._bind()
        self.load()

    def _bind(self) -> None:
        axis, read, write = self._axis, self._dictionary.readers, self._dictionary.writers
        per_nm = 1000 / self.rated_torque_nm

        def torque() -> int:
            return _clip(round(axis.torque_nm * per_nm), _INT16)

        def demand() -> int:
            return _clip(round(axis.demand_rad * self.counts_per_rad), _INT32)

        read[key(0x6061)] = lambda: self.mode
        read[key(0x6062)] = read[key(0x60FC)] = demand
        read[key(0x6064)] = lambda: axis.position_counts
        read[key(0x606C)] = lambda: _clip(round(axis.speed_rad_s / self.speed_unit_rad_s), _INT32)
        read[key(0x6074)] = lambda: _clip(round(axis.torque_demand_nm * per_nm), _INT16)
        read[key(0x6077)] = torque
        read[key(0x60F4)] = lambda: _clip(round(axis.following_error_rad * self.counts_per_rad), _INT32)
        write[key(0x6060)] = self._write_mode
        write[key(0x607A)] = self._write_target
        write[key(0x60A9)] = self._write_speed_unit
        write[key(0x60B2)] = lambda value: axis.set_torque_offset(value / per_nm)
        for index, subindex in ((0x607D, 1), (0x607D, 2)):
            write[key(index, subindex)] = self._later
        for index in (0x6065, 0x6066, 0x6067, 0x6068, 0x6080):
            write[key(index)] = self._later
        for subindex in (1, 2):
            write[key(0x60C2, subindex)] = self._later

    def _later(self, value: int) -> None:
        self._stale = True

    def load(self) -> None:
        """Take over what the dictionary holds."""
        number = self._dictionary.number
        self._stale = False
        self.mode = number(0x6060)
        self.speed_unit_rad_s = _RPM_UNITS.get(number(0x60A9), 1e-3) * RPM
        self._low, self._high = number(0x607D, 1), number(0x607D, 2)
        self._window_rad = number(0x6065) / self.counts_per_rad if number(0x6065) != _WINDOW_OFF else math.inf
        self._overshoot = round(_OVERSHOOT_RAD * self.counts_per_rad)
        self._window_time_s = number(0x6066) * 1e-3
        self._position_window = number(0x6067)
        self._reached_time_s = number(0x6068) * 1e-3
        self._top_speed_rad_s = number(0x6080) * RPM
        self.period_s = number(0x60C2, 1) * 10.0 ** number(0x60C2, 2)

    def deceleration(self, index: int) -> float:
        """Objects 6083…6085 in rad/s²; never more than 6085 allows to be written, never 0."""
        return self._dictionary.number(index) * self.speed_unit_rad_s

    def _reset(self) -> None:
        self._active: _Setpoint | None = None
        self._queued: _Setpoint | None = None
        self._last_target: int | None = None
        self._acknowledged = self._limited = False
        self._outside_since_s: float | None = None
        self._inside_since_s: float | None = None

    # -- Modes ------------------------------------------------------------------------------------

    def _write_mode(self, value: int) -> None:
        if value not in (0, PP, CSP):
            raise AbortError(Code.INVALID_VALUE)
        if value != self.mode:
            self.mode = value
            self._reset()

    def _write_speed_unit(self, value: int) -> None:
        if value not in _RPM_UNITS:
            raise AbortError(Code.INVALID_VALUE)
        if self._power.energised:
            raise AbortError(Code.DEVICE_STATE)
        self.speed_unit_rad_s = _RPM_UNITS[value] * RPM

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
        if self.mode == PP:
            self._handshake(word, word & ~self._word)
        self._word = word

    def _write_target(self, value: int) -> None:
        if self.mode == CSP and self._power.enabled:
            self._follow(value)

    def _follow(self, value: int) -> None:
        target = self._clamp(value)
        if self._stale:
            self.load()
        last = self._last_target
        if last is None:
            last = round(self._axis.demand_rad * self.counts_per_rad)
        most = self._top_speed_rad_s * self.period_s * self.counts_per_rad
        if abs(target - last) > most:
            target = last + round(math.copysign(most, target - last))
            self._limited = True
        self._last_target = target
        self._axis.set_target(target / self.counts_per_rad, self.period_s)

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
        number = self._dictionary.number
        target = number(0x607A)
        if word & _RELATIVE:
            base = self._queued or self._active
            target += base.target if base else round(self._axis.demand_rad * self.counts_per_rad)
        speed = min(number(0x6081), number(0x607F)) * self.speed_unit_rad_s
        return _Setpoint(
            self._clamp(target),
            min(speed, self._top_speed_rad_s),
            self.deceleration(0x6083),
            self.deceleration(0x6084),
        )

    def _start(self, setpoint: _Setpoint) -> None:
        self._active, self._inside_since_s = setpoint, None
        self._axis.start_move(
            setpoint.target / self.counts_per_rad,
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
            if not self._low - slack <= axis.position_counts <= self._high + slack:
                self._fault(BEYOND_LIMIT)
        if self.mode == PP and self._active is not None and power.enabled:
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
        elif abs(axis.position_counts - active.target) > self._position_window:
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
        if self.mode == CSP:
            if power.enabled:
                status |= _MODE_BIT  # the drive follows its command value
        elif self.mode == PP:
            if self._axis.standstill if power.halted else self._active is None:
                status |= _TARGET_REACHED
            if self._acknowledged:
                status |= _MODE_BIT
        if self._outside_since_s is not None:
            status |= _FOLLOWING_ERROR
        return status


def _clip(value: int, half_range: int) -> int:
    return min(max(value, -half_range), half_range - 1)
