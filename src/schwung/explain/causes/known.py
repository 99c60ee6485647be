"""The belief's own [[physics]] in the equations of motion: a name is then a change of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from schwung.compiled import compiled
from schwung.drivetrain.effects import Effects, effects_of
from schwung.drivetrain.fade import heated
from schwung.drivetrain.hysteresis import left_of, yielded
from schwung.drivetrain.inertia import LoadTorqueTable
from schwung.drivetrain.machine import Coupling, Load, Machine
from schwung.drivetrain.physics import driven, dry_friction, encoder_off, load_torque, smooth_torque
from schwung.drivetrain.presliding import bent
from schwung.drivetrain.residual import (
    Residual,
    inertia_added,
    inertia_points,
    load_torque_table,
    residuals_of,
)
from schwung.drivetrain.residual_plane import ON_LOAD as LOADED
from schwung.drivetrain.residual_plane import Plane, planes_of
from schwung.explain.causes.along import Along, Beyond
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.late import acceleration_bent, beyond_bent, lagging
from schwung.explain.causes.present import (
    Member,
    besides_of,
    carried_by,
    changed,
    drives_of,
    eases_of,
    filter_of,
    further_of,
    gap_of,
    held_late_of,
    passes_of,
    pushes_of,
)
from schwung.explain.causes.third_mass import stiffened, third_mass
from schwung.innovations.effect import Effect
from schwung.innovations.values import FurtherMass
from schwung.motion import Array

#: A load that is none, over the motor's inertia: steps are worked out over its logarithm.
_NONE = 1e-6


@dataclass(frozen=True, eq=False)
class Known:
    """The machine with what of its physics belongs to shaft and inertia, the rest as torques along a run."""

    machine: Machine
    effects: Effects
    table: LoadTorqueTable | None
    nothing: bool = False  # is known
    curves: tuple[Residual, ...] = ()
    planes: tuple[Plane, ...] = ()
    phases_rad: tuple[float, ...] = ()  # of the known periodic disturbance, each run's own; empty: the file's

    def effect(self, along: Along) -> Effect:
        """One column: all that is known, and what is known of the reporting."""
        if self.nothing:
            none = np.zeros((along.speed.size, 1))
            return Effect(none, none, none, none)
        return run_by_run(self._in_run)(along)

    def _in_run(self, along: Along) -> Effect:
        e = self.effects
        if along.number < len(self.phases_rad):  # of a run that is yet to come, the file's is as good as any
            e = e._replace(periodic_phase_rad=self.phases_rad[along.number])
        on_motor, on_load = _torques(
            e, along.angle, along.load_angle, along.speed, along.load_speed, along.direction, along.time_s,
            along.motion_time_s, along.share,
        )  # fmt: skip
        if self.table is not None:
            on_load = on_load + self.table.at(along.load_angle)
        if e.presliding_nm > 0:
            at_rest = on_motor[0] + on_load[0] + self.machine.load_torque_at(along.load_angle[:1])[0]
            on_motor = on_motor - self._bristles(along, along.resting_nm + at_rest)
        torque = along.run.drive.whole_nm
        true = _driving(e, torque)
        if np.isfinite(e.torque_limit_nm):
            true = true + along.run.drive.asked(partial(_cut, e), along.beyond.filter_s)
        if e.torque_lag_s > 0:
            changes = _slope(e, torque) * along.torque_rate
            true = true - e.torque_lag_s * lagging(along, changes, e.torque_lag_s)
        true = _faded(e, true, along)
        true = true * (1 + e.ripple_share * np.sin(e.ripple_order * along.angle + e.ripple_phase_rad))
        on_motor = on_motor + true - torque + e.torque_filter_s * along.reported_rate
        if e.carried_share:
            on_motor = on_motor - e.carried_share * np.abs(along.carried) * along.direction
        if e.load_coulomb_nm:
            on_load = on_load - e.load_coulomb_nm * along.load_direction
        if e.third_inertia_kgm2 > 0 and (self.further.rate == 0 or along.beyond.gap_rad > 0):
            on_load = on_load - _further_mass(e, along)
        unnamed = self._unnamed(along)
        on_motor, on_load = on_motor + unnamed[0], on_load + unnamed[1]
        coupled = self.bending(along)
        if self._drives:
            there = along.present.coupling
            assert there is not None
            further, faster = self.driven(along)
            if along.beyond.gap_rad == 0:  # else that is the filter's, where it touches
                coupled = coupled + there.stiffness_nm_rad * further + there.damping_nms * faster
            on_motor = on_motor - _driven(e, along.angle)[1] * along.carried
        position, speed = _reported(e, along.angle, along.speed)
        if e.speed_delay_s > 0:
            half = e.speed_delay_s / 2
            speed = (
                speed - e.speed_delay_s * acceleration_bent(along, half) + beyond_bent(along, 2 * half, half)
            )
        return Effect(*(part[:, None] for part in (on_motor - coupled, on_load + coupled, position, speed)))

    def beyond(self, members: Sequence[Member]) -> Beyond:
        """What is known, and the members'."""
        return Beyond(
            gap_rad=gap_of(self.effects.gap_rad, members),
            filter_s=filter_of(self.effects.torque_filter_s, members),
            held_late=held_late_of(members),
            further=further_of(self.further, self.effects.gap_rad, members),
            drives=drives_of(self.driven, members),
            besides=besides_of(self.bending, members),
            eases=eases_of(self.tangent if self.bends else None, members),
            passes=passes_of(self.passing, members),
            pushes=pushes_of(self.effect, members),
        )

    def carried(self, members: Sequence[Member]) -> Member | None:
        """The one whose further mass is a state of the filter's."""
        return carried_by(self.further, self.effects.gap_rad, members)

    def swings(self, members: Sequence[Member]) -> bool:
        """Whether a further mass is known, or a member is one, that is no state of the filter's."""
        carried, gap_rad = self.carried(members), gap_of(self.effects.gap_rad, members)
        others = (m for m in members if m.candidate.swings and m is not carried)
        known = self.effects.third_inertia_kgm2 > 0 and (self.further.rate == 0 or gap_rad > 0)
        return known or any(bool(np.any(m.coefficients)) for m in others)

    @property
    def further(self) -> FurtherMass:
        """The known mass behind the load, where it swings by the same laws all along."""
        e = self.effects
        return _behind(e) if e.third_inertia_kgm2 > 0 and e.third_speed_share == 0.0 else FurtherMass()

    def driven(self, along: Along) -> tuple[Array, Array]:
        """How much further than the motor turns the coupling is driven (rad), and how much faster (rad/s), (n,)."""
        if not self._drives:
            return np.zeros_like(along.speed), np.zeros_like(along.speed)
        further, faster = _driven(self.effects, along.angle)
        return further, faster * along.speed

    def bending(self, along: Along) -> Array:
        """What the coupling carries beside what a spring and a damper do (N·m), (n,)."""
        return np.zeros_like(along.speed) if self.nothing else run_by_run(self._bending)(along)

    def _bending(self, along: Along) -> Array:
        e = self.effects
        coupled = e.cubic_nm_rad3 * along.wound**3
        if e.hysteresis_nm > 0:
            held = yielded(along.wound, self._yields_over, e.hysteresis_exponent)
            coupled = coupled + e.hysteresis_nm * along.contact[:, 0] * held
        if e.stiffness_share != 0.0 and self.machine.coupling is not None:
            share = e.stiffness_share * np.sin(e.stiffness_order * along.angle + e.stiffness_phase_rad)
            coupled = coupled + share * self.machine.coupling.stiffness_nm_rad * along.wound
        coupled = coupled + sum(
            (along.contact[:, 0] * one.at(along.wound, along.direction) for one in self.bent), 0.0
        )
        return np.asarray(coupled)

    def passing(self, along: Along) -> Array:
        """How much more torque the motor gives for one more that it is asked for, (n,)."""
        return np.ones_like(along.speed) if self.nothing else run_by_run(self._passing)(along)

    def _passing(self, along: Along) -> Array:
        e, asked = self.effects, along.torque
        rippling = 1 + e.ripple_share * np.sin(e.ripple_order * along.angle + e.ripple_phase_rad)
        return np.asarray(_slope(e, asked) * _left(e, _driving(e, asked), along) * rippling)

    @property
    def _drives(self) -> bool:
        """Whether the transmission is off."""
        e = self.effects
        return bool(e.kinematic_rad or e.kinematic_second_rad) and self.machine.coupling is not None

    @property
    def bends(self) -> bool:
        """Whether the coupling is stiffer here than there."""
        e = self.effects
        bent = (e.cubic_nm_rad3, e.stiffness_share, e.hysteresis_nm)
        return self.machine.coupling is not None and (bool(self.bent) or any(one != 0.0 for one in bent))

    @property
    def bent(self) -> list[Residual]:
        """Known curves over the coupling's wind-up."""
        return [curve for curve in self.curves if curve.over == "wind_up"]

    def tangent(self, along: Along) -> Array:
        """How much stiffer a coupling that bends is along a run, and how much more it damps, (n, 2)."""
        return run_by_run(self._stiffer)(along)

    def _stiffer(self, along: Along) -> Array:
        e, found = self.effects, 3 * self.effects.cubic_nm_rad3 * along.wound**2
        if e.hysteresis_nm > 0:
            share = yielded(along.wound, self._yields_over, e.hysteresis_exponent)
            left = left_of(share, along.winding, e.hysteresis_exponent)
            found = found + e.hysteresis_stiffness_nm_rad * left
        if self.machine.coupling is not None:
            waves = e.stiffness_share * np.sin(e.stiffness_order * along.angle + e.stiffness_phase_rad)
            found = found + waves * self.machine.coupling.stiffness_nm_rad
        found = found + sum((one.slope(along.wound) for one in self.bent), 0.0)
        return np.stack([along.contact[:, 0] * found, 0 * found], 1)

    @property
    def _yields_over(self) -> float:
        return self.effects.hysteresis_nm / self.effects.hysteresis_stiffness_nm_rad

    def _unnamed(self, along: Along) -> tuple[Array, Array]:
        """What the known curves and planes do, on motor and load (N·m), (n,) each."""
        on_motor, on_load = np.zeros_like(along.speed), np.zeros_like(along.speed)
        for curve in (one for one in self.curves if one.over != "wind_up"):
            on = on_load if curve.over in ON_LOAD else on_motor
            on += curve.at(*_where(curve, along))
        for plane in self.planes:
            on = on_load if plane.over in LOADED else on_motor
            on += plane.at(*_places(plane, along))
        return on_motor, on_load

    def _bristles(self, along: Along, held_nm: float) -> Array:
        """Torque of the known friction that is a spring before it slides (N·m), (n,); `held_nm`: at rest."""
        e = self.effects
        first = float(np.clip(held_nm / e.presliding_nm, -1.0, 1.0))
        return e.presliding_nm * bent(along.angle, e.presliding_nm / e.presliding_stiffness_nm_rad, first)

    def dry(self, along: Along) -> Array:
        """The known dry friction, by its average over both ways (N·m), (n,)."""
        level = _dry_level(self.effects, along.angle, along.speed, along.share + 0.0 * along.speed)
        level = level * along.direction + self.effects.load_coulomb_nm * along.load_direction
        directed = [curve for curve in self.curves if curve.over not in ("run", "wind_up", *ON_LOAD)]
        return np.asarray(level - sum((c.at(*_where(c, along)) for c in directed), 0.0 * level))


def _driving(e: Effects, asked: Array) -> Array:
    """What a motor gives of the torque that it is asked for, but for its limit."""
    drop = e.torque_drop * (np.abs(asked) / e.torque_drop_at_nm) ** e.torque_drop_order
    return np.asarray((e.torque_gain - drop) * asked)


def _slope(e: Effects, asked: Array) -> Array:
    """How much more of that it gives, its limit counted, for a torque more that it is asked for."""
    drop = e.torque_drop * (np.abs(asked) / e.torque_drop_at_nm) ** e.torque_drop_order
    slope = e.torque_gain - (1 + e.torque_drop_order) * drop
    return np.where(np.abs(_driving(e, asked)) < e.torque_limit_nm, slope, 0.0)


def _faded(e: Effects, given: Array, along: Along) -> Array:
    """What the motor's heat leaves of that."""
    return given if e.torque_fade == 0.0 else np.asarray(given * _left(e, given, along))


def _left(e: Effects, given: Array, along: Along) -> Array:
    """The share of a torque that the motor's heat leaves."""
    if e.torque_fade == 0.0:
        return np.ones_like(given)
    heat = heated(given, e.torque_fade_at_nm, e.torque_fade_s, along.run.step_s, e.torque_fade_start)
    return np.asarray(1 - np.minimum(e.torque_fade * heat, 1.0))


def _cut(e: Effects, asked: Array) -> Array:
    """And what the limit takes of that."""
    given = _driving(e, asked)
    return np.clip(given, -e.torque_limit_nm, e.torque_limit_nm) - given


def _behind(e: Effects) -> FurtherMass:
    rate = float(np.sqrt(e.third_stiffness_nm_rad / e.third_inertia_kgm2))
    return FurtherMass(e.third_inertia_kgm2, rate, e.third_damping_nms / (2 * rate * e.third_inertia_kgm2))


def _further_mass(e: Effects, along: Along) -> Array:
    """What the known mass behind the load takes (N·m), (n,)."""
    inertia, rate, ratio = _behind(e)
    if e.third_speed_share != 0.0:
        square = rate**2 + e.third_speed_share * along.load_speed**2
        found = stiffened(along.load_acceleration, square, ratio * rate, along.run.step_s)
        return inertia * found
    return inertia * third_mass(along.load_acceleration, rate, ratio, along.run.step_s)


#: Curves that act on the load; the others on the motor.
ON_LOAD = ("load_position", "acceleration", "time_in_motion")


def _places(plane: Plane, along: Along) -> tuple[Array, Array]:
    """The plane's coordinates along a run."""
    if plane.over in LOADED:
        return along.load_angle, along.load_speed
    if plane.over == ("position", "torque"):
        return along.angle, along.torque
    return along.torque, along.motion_time_s


def _where(curve: Residual, along: Along) -> tuple[Array, Array]:
    """The curve's coordinate along a run, and the direction of motion."""
    if curve.over == "load_position":
        return along.load_angle, along.load_direction
    if curve.over == "run":
        return np.full_like(along.speed, along.share), along.direction
    if curve.over in ("speed", "torque"):
        return np.abs(along.speed if curve.over == "speed" else along.torque), along.direction
    if curve.over == "acceleration":
        return along.load_acceleration, along.direction
    return (along.angle if curve.over == "position" else along.motion_time_s), along.direction


@compiled
def _torques(
    e: Effects,
    angle: Array,
    load_angle: Array,
    speed: Array,
    load_speed: Array,
    direction: Array,
    time: Array,
    motion_time: Array,
    share: float,
) -> tuple[Array, Array]:
    on_motor, on_load = np.empty_like(angle), np.empty_like(angle)
    for i in range(angle.size):
        rubbing = dry_friction(e, angle[i], np.copysign(speed[i], direction[i]), share) * direction[i]
        on_motor[i] = smooth_torque(e, angle[i], speed[i], time[i], e.periodic_phase_rad, share) - rubbing
        on_load[i] = load_torque(e, load_angle[i], load_speed[i], motion_time[i])
    return on_motor, on_load


@compiled
def _dry_level(e: Effects, angle: Array, speed: Array, share: Array) -> Array:
    level = np.empty_like(angle)
    for i in range(angle.size):
        fast = max(abs(speed[i]), 1e-300)
        one, other = dry_friction(e, angle[i], fast, share[i]), dry_friction(e, angle[i], -fast, share[i])
        level[i] = (one + other) / 2
    return level


@compiled
def _reported(e: Effects, angle: Array, speed: Array) -> tuple[Array, Array]:
    """What the encoder reports too much of both."""
    off, faster = np.empty_like(angle), np.empty_like(angle)
    for i in range(angle.size):
        off[i], share = encoder_off(e, angle[i])
        faster[i] = share * speed[i]
    return off, faster


@compiled
def _driven(e: Effects, angle: Array) -> tuple[Array, Array]:
    """How much further the coupling is driven, and how much that is by each radian more."""
    further, faster = np.empty_like(angle), np.empty_like(angle)
    for i in range(angle.size):
        turned, ratio = driven(e, angle[i])
        further[i], faster[i] = turned - angle[i], ratio - 1.0
    return further, faster


def known(machine: Machine, low_rad: float, high_rad: float) -> Known:
    """Take the belief's terms apart, for angles between these.

    An unknown load of a rigid machine is none at all, its inertia the motor's. Raises InputError where another's is.
    """
    e = effects_of(machine.physics)
    if machine.load_inertia is None and machine.coupling is None:
        none = machine.load.model_copy(update={"inertia_kgm2": _NONE * machine.motor.inertia_kgm2})
        machine = machine.model_copy(update={"load": none})
    coupling, load, motor = machine.coupling, machine.load, machine.motor
    if e.rotor_inertia_kgm2 > 0:
        motor = motor.model_copy(update={"inertia_kgm2": e.rotor_inertia_kgm2})
    if coupling is not None:
        coupling = Coupling(
            stiffness_nm_rad=e.stiffness_nm_rad or coupling.stiffness_nm_rad,
            damping_nms=e.damping_nms if e.damping_nms >= 0 else coupling.damping_nms,
        )
    added = bool(inertia_points(machine.physics).size)
    if added or (e.inertia_delta_kgm2, e.inertia_scale, e.inertia_shift_rad) != (0.0, 1.0, 0.0):
        believed = machine

        def law(angle: Array) -> Array:
            same = believed.load_inertia_at(angle + e.inertia_shift_rad)
            return e.inertia_scale * same + e.inertia_delta_kgm2 + inertia_added(believed.physics, angle)

        load = Load(
            viscous_friction_nms=load.viscous_friction_nms,
            inertia_table=changed(law, low_rad, high_rad),
            torque_nm=load.torque_nm,
            torque_table=load.torque_table,
        )
    plain = machine.model_copy(update={"motor": motor, "coupling": coupling, "load": load, "physics": ()})
    curves = tuple(residuals_of(machine.physics).values())
    planes = tuple(planes_of(machine.physics).values())
    return Known(plain, e, load_torque_table(machine.physics), not machine.physics, curves, planes)
