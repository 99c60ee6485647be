"""The drive's modes of operation, profile position and cyclic position, and what it watches meanwhile.

The axis knows SI only, the bus counts: scales.py stands between. (IEC 61800-7-201 clauses 10, 14, 15.)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary, key
from schwung_sim.drives.frame import Frame
from schwung_sim.drives.power import Motor, PowerStage
from schwung_sim.drives.roles import Roles
from schwung_sim.drives.scales import Measured, Scales
from schwung_sim.drives.units import RPM, Units, si_unit

FOLLOWING_ERROR, BEYOND_LIMIT = 0x8611, 0x8612
NEGATIVE_SWITCH, POSITIVE_SWITCH, HOME_SWITCH = 1 << 0, 1 << 1, 1 << 2  # bits of 60FD
_NEW_SETPOINT, _AT_ONCE, _RELATIVE = 1 << 4, 1 << 5, 1 << 6
_LIMITS = NEGATIVE_SWITCH | POSITIVE_SWITCH
_TARGET_REACHED, _LIMIT_ACTIVE, _MODE_BIT, _FOLLOWING_ERROR = 1 << 10, 1 << 11, 1 << 12, 1 << 13
_WINDOW_OFF = 0xFFFFFFFF
UNTOLD_PERIOD_S = 1e-3
_OVERSHOOT_RAD = 0.1  # what a controller may overshoot a software limit by; further out is a fault
#: What a drive whose speed unit can be chosen takes in 60A9: revolutions per minute, 10^0 … 10^-3 (CiA 303-2).
_RPM_UNITS = (0x00B44700, 0xFFB44700, 0xFEB44700, 0xFDB44700)


class Axis(Measured, Motor, Protocol):
    """What the modes ask of the axis; SI, motor side."""

    def set_target(self, position_rad: float, over_s: float) -> None: ...

    def start_move(
        self, target_rad: float, speed: float, acceleration: float, deceleration: float
    ) -> None: ...

    def set_torque_offset(self, torque_nm: float) -> None: ...

    @property
    def demand_speed_rad_s(self) -> float: ...

    @property
    def target_reached(self) -> bool: ...

    @property
    def torque_limit_active(self) -> bool: ...


@dataclass(frozen=True)
class _Setpoint:
    target: int  # counts of the motor
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
        self.scales = Scales(dictionary, axis, roles)
        self.limits_from_zero = False  # 607D is not corrected by 607C
        self._at_limit = False  # a limit switch is active, or the drive's own reason not to follow is a limit
        self._switches = 0
        self._word = 0
        self._injected_nm = self._played_nm = 0.0
        self._reset()
        self.load()
        self._bind()

    def _bind(self) -> None:
        roles, write = self._roles, self._dictionary.writers
        self.scales.report(0x6061, lambda: self.mode)
        self.scales.report(0x60FD, lambda: self._switches)
        write[key(0x6060)] = self._write_mode
        write[roles.demand] = self._write_target
        write[key(0x60A9)] = self._write_speed_unit
        if roles.torque_added is not None:
            write[roles.torque_added.object] = self._write_injected
        if roles.host_played is not None:
            write[roles.host_played.object] = self._write_played
        for index, subindex in ((0x607D, 1), (0x607D, 2)):
            write[key(index, subindex)] = self._later
        for k in self.scales.objects:
            write[k] = partial(self._rescale, k)
        for index in (0x6065, 0x6066, 0x6067, 0x6068, 0x6080):
            write[key(index)] = self._later
        for subindex in (1, 2):
            write[key(0x60C2, subindex)] = self._later

    def _later(self, value: int) -> None:
        self._stale = True

    def load(self) -> None:
        """Take over what the dictionary holds."""
        number, value = self._dictionary.number, self._value
        self._stale = False
        self.mode = number(0x6060)
        self.scales.load()
        self._frame, self._unit_rad = self.scales.frame, self.scales.units.demand_rad
        # from the machine's home: corrected by 607C before targets are compared (CiA 402-2, software position limit)
        home = 0 if self._frame is None or self.limits_from_zero else self._frame.zero
        self._low, self._high = number(0x607D, 1) - home, number(0x607D, 2) - home
        window = value(0x6065)
        self._window_rad = math.inf if window == _WINDOW_OFF else window * abs(self._unit_rad)
        self._overshoot = round(_OVERSHOOT_RAD / abs(self._unit_rad))
        self._window_time_s = number(0x6066) * 1e-3
        self._position_window_rad = value(0x6067) * abs(self._unit_rad)
        self._reached_time_s = number(0x6068) * 1e-3
        self._top_speed_rad_s = value(0x6080) * RPM
        self.period_s = number(0x60C2, 1) * 10.0 ** min(max(number(0x60C2, 2), -9), 0)

    @property
    def units(self) -> Units:
        """SI per count, now."""
        return self.scales.units

    @property
    def setpoints(self) -> list[int]:
        """The objects that set-points come in: the demanded position first, then torques, which may share one."""
        torques = (self._roles.torque_added, self._roles.host_played)
        return list(dict.fromkeys([self._roles.demand, *(q.object for q in torques if q is not None)]))

    @property
    def follows_cycles(self) -> bool:
        """Cyclic set-points are followed now."""
        return self.mode == self._csp and self._power.enabled

    @property
    def sync_period_s(self) -> float:
        """What a SYNC lasts where 1006 does not say it: 60C2 only means something where setpoints are cyclic."""
        return self.period_s if self.mode == self._csp else UNTOLD_PERIOD_S

    def _value(self, index: int) -> float:
        """A value that may be a real number; never negative, never 0."""
        return max(abs(self._dictionary.real(key(index))), 1e-9)

    def deceleration(self, index: int) -> float:
        """Objects 6083…6085 in rad/s²; a drive that is told 0 brakes at one count."""
        return max(self._value(index), 1.0) * self.units.acceleration_rad_s2

    def _reset(self) -> None:
        self._active: _Setpoint | None = None
        self._queued: _Setpoint | None = None
        self._last_target: int | None = None
        self._acknowledged = self._limited = self._barred = False
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
        self._played_nm = value * self.scales.played_unit_nm
        self._axis.set_torque_offset(self._injected_nm + self._played_nm)

    def control(self, word: int) -> None:
        """Follow a controlword: first the state machine, then the bits that belong to the mode."""
        power = self._power
        if word == self._word and power.enabled:
            return  # nothing new, as in every cycle of a motion
        if power.local:
            return  # bit 9 of the statusword is 0: the controlword is not processed (CiA 402-2, statusword)
        was_enabled, was_halted = power.enabled, power.halted
        power.control(word)
        if was_halted and power.enabled:
            self._go_on()
        elif power.enabled != was_enabled and not power.halted:
            self._reset()
        if self.mode == self._pp:
            self._handshake(word, word & ~self._word)
        self._word = word

    def _go_on(self) -> None:
        """Follow again, from where the axis was held; a move was only interrupted."""
        self._last_target = None
        if self._active is not None and self._power.enabled:
            self._start(self._active)

    def _write_target(self, value: int) -> None:
        if self.mode == self._csp and self._power.enabled:
            self._follow(value)

    def _follow(self, value: int) -> None:
        frame = self._frame
        target = self._clamp(value if frame is None else frame.fold(value))
        last = self._last_target
        if last is None:
            last = self.scales.demand_counts()
        if frame is not None:
            target = frame.nearest(target, last)
        if self._switches and self._is_barred(target):
            self._last_target = None
            return
        most = self._top_speed_rad_s * self.period_s / abs(self._unit_rad)
        if abs(target - last) > most:
            target = last + round(math.copysign(most, target - last))
            self._limited = True
        self._last_target = target
        self._axis.set_target(target * self._unit_rad, self.period_s)

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
        speed = max(min(self._value(0x6081), self._value(0x607F)), 1.0) * abs(self.units.speed_rad_s)
        return _Setpoint(
            self._wanted(bool(word & _RELATIVE)),
            min(speed, self._top_speed_rad_s),
            self.deceleration(0x6083),
            self.deceleration(0x6084),
        )

    def _wanted(self, relative: bool) -> int:
        """Where a new set-point leads, in counts of the motor and within the software limits."""
        frame, near = self._frame or Frame(), self.scales.demand_counts()
        value = self.scales.by_key(self._roles.demand)
        if not relative:
            return frame.within(self._clamp(frame.fold(value)), near)
        base = self._queued or self._active
        wanted = (base.target if base else near) + value
        shown = frame.fold(wanted - frame.zero)
        return wanted + self._clamp(shown) - shown

    def _start(self, setpoint: _Setpoint) -> None:
        self._active, self._inside_since_s = setpoint, None
        if self._switches and self._is_barred(setpoint.target):
            return
        self._axis.start_move(
            setpoint.target * self._unit_rad,
            setpoint.speed_rad_s,
            setpoint.acceleration_rad_s2,
            setpoint.deceleration_rad_s2,
        )

    # -- What it does not follow ------------------------------------------------------------------

    def hold(self, reason: str, limit: bool = False) -> None:
        """Follow no more, though operation stays enabled: bit 12 goes, and with a `limit` bit 11 comes."""
        self._power.hold(reason)
        self._at_limit = limit

    def release(self, reason: str) -> None:
        """Follow again, where this was the only reason not to."""
        self._power.release(reason)
        self._at_limit = bool(self._switches & _LIMITS)
        self._go_on()

    def press(self, switches: int) -> None:
        """Limit and home switches, as 60FD has them: into an active limit switch the axis goes no further."""
        pressed, self._switches = switches & ~self._switches, switches
        self._at_limit = bool(switches & _LIMITS)
        speed = self._axis.demand_speed_rad_s / self._unit_rad
        ahead = POSITIVE_SWITCH if speed > 0 else NEGATIVE_SWITCH
        if pressed & ahead and speed and self._power.enabled:
            self._axis.quick_stop(self.deceleration(0x6085))
        self._barred = False

    def _is_barred(self, target: int) -> bool:
        """Whether an active limit switch is in the way there."""
        way = target - self.scales.demand_counts()
        self._barred = bool(self._switches & (POSITIVE_SWITCH if way > 0 else NEGATIVE_SWITCH) and way)
        return self._barred

    # -- Supervision ------------------------------------------------------------------------------

    def poll(self) -> None:
        """After each advance of the axis: following error, software limits, end of a move, end of a stop."""
        if self._stale:
            self.load()
        power, axis = self._power, self._axis
        if power.coming_to_rest:
            was_enabled = power.enabled
            power.poll()
            if power.enabled and not was_enabled:
                self._reset()  # the brake has opened
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
            if not self._low - slack <= self.scales.position() <= self._high + slack:
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
        elif abs(axis.position_rad - active.target * self._unit_rad) > self._position_window_rad:
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
        if self._limited or self._axis.torque_limit_active or self._at_limit:
            status |= _LIMIT_ACTIVE
        if self.mode == self._csp:
            if power.enabled and not self._barred:
                status |= _MODE_BIT  # the drive follows its command value
        elif self.mode == self._pp:
            if self._axis.standstill if power.halted else self._active is None:
                status |= _TARGET_REACHED
            if self._acknowledged:
                status |= _MODE_BIT
        if self._outside_since_s is not None:
            status |= _FOLLOWING_ERROR
        return status
