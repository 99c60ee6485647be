"""What a motion of the motor does to the machine: loads by a second integrator, torque by inverse dynamics, merits.

Independent of the optimiser's own equations: `drivetrain`'s compiled terms, dry friction as sharp as in its simulation,
play and a third mass included, Runge-Kutta of fourth order. The motor is taken to follow; the closed loop is
`drivetrain.simulate`'s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.compiled import compiled
from schwung.drivetrain import Machine, learned, physics, plant
from schwung.drivetrain.kernel import value_and_slope
from schwung.motion import Array, Demand, Motion

#: Samples per second of what is judged, at the least; the integrator's steps are twice as long.
RATE_HZ = 32_000.0
#: Step times the fastest thing that the load does behind a motor that stands, at the most (Runge-Kutta: stable to 2.8).
_STEP = 0.5
#: After the stroke the machine is watched for so many time constants of its vibration, at the least TAIL_S.
_DECAYS, TAIL_S = 6.0, 0.1


@dataclass(frozen=True, eq=False)
class Followed:
    """A motion and what it does; arrays (n,) at even instants, the stroke from 0 to `duration_s`, then rest."""

    time_s: Array
    duration_s: float
    position_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array  # as the drive reports it
    load_position_rad: Array
    load_speed_rad_s: Array


@dataclass(frozen=True)
class Merits:
    """What a motion costs, from its start until everything is at rest."""

    copper_n2m2s: float  # ∫T² dt beyond what holding at the end takes
    rms_torque_nm: float  # over the duration
    peak_torque_nm: float
    mechanical_j: float  # ∫max(Tω, 0) dt: what is put in, with nothing got back
    drawn_j: float | None  # with regeneration; None without [motor.electrical]
    drawn_one_way_j: float | None  # without
    peak_speed_rad_s: float
    residual_rad: float  # largest swing of the load about its rest, after the end

    def to_json(self) -> dict[str, float | None]:
        """By name."""
        return dict(vars(self))


@compiled
def _directed_load(machine: learned.Learned, angle: float, speed: float) -> float:
    """What acts on the load by the direction in which it moves (N·m)."""
    ahead = float(np.tanh(speed / machine.smoothing))
    torque = -machine.effects.load_coulomb_nm * ahead
    if machine.curves.any:
        torque += learned.sided(machine.curves.load_position, angle, ahead)
    return torque


@compiled
def _follow(
    machine: learned.Learned, angle: Array, speed: Array, acceleration: Array, load: Array, step: float
) -> Array:
    """Motor torque and load states (n, 3) for a motor motion sampled twice per step (2n − 1 values each)."""
    body, e = machine.plant, machine.effects
    n = (angle.size + 1) // 2
    found = np.empty((n, 3))
    x = load.copy()  # load angle and speed, third angle and speed
    k = np.empty((4, 4))
    for i in range(n):
        at = 2 * i
        inertia, slope = value_and_slope(body.inertia, x[0] if not body.rigid else angle[at])
        if body.rigid:
            x[0], x[1] = angle[at], speed[at]
            ratio = 1.0
            shaft = inertia * acceleration[at] + 0.5 * slope * x[1] ** 2 + body.load_friction * x[1]
            shaft -= value_and_slope(body.load_torque, x[0])[0] + value_and_slope(machine.load_table, x[0])[0]
            shaft -= physics.load_torque(e, x[0], x[1], 0.5 * step * at) + _directed_load(machine, x[0], x[1])
        else:
            turned, ratio = physics.driven(e, angle[at])
            shaft = physics.coupling_torque(
                e,
                physics.stiffness_at(e, body.stiffness, angle[at]),
                body.damping,
                turned - x[0],
                ratio * speed[at] - x[1],
            )
        time = 0.5 * step * at
        other = physics.motor_torque(
            e, angle[at], speed[at], time, e.periodic_phase_rad, machine.share, machine.smoothing
        )
        ahead = float(np.tanh(speed[at] / machine.smoothing))
        other -= e.presliding_nm * ahead  # as if it slid at once: a stroke is long beside its distance
        if machine.curves.any:
            other += learned.sided(machine.curves.position, angle[at], ahead)
            other += learned.sided(machine.curves.speed, abs(speed[at]), ahead)
            other += learned.sided(machine.curves.run, machine.share, ahead)
        torque = (
            body.rotor_inertia * acceleration[at] + body.motor_friction * speed[at] + ratio * shaft - other
        )
        found[i, 0], found[i, 1], found[i, 2] = torque / e.torque_gain, x[0], x[1]
        if i == n - 1 or body.rigid:
            continue
        for stage in range(4):
            later = (0, 1, 1, 2)[stage]
            share = 0.5 * later * step
            y = x + share * k[stage - 1] if stage else x.copy()
            inertia, slope = value_and_slope(body.inertia, y[0])
            turned, ratio = physics.driven(e, angle[at + later])
            on_load = physics.coupling_torque(
                e,
                physics.stiffness_at(e, body.stiffness, angle[at + later]),
                body.damping,
                turned - y[0],
                ratio * speed[at + later] - y[1],
            )
            on_load += (
                value_and_slope(body.load_torque, y[0])[0] + value_and_slope(machine.load_table, y[0])[0]
            )
            on_load += physics.load_torque(e, y[0], y[1], time + share) + _directed_load(machine, y[0], y[1])
            on_load -= body.load_friction * y[1] + 0.5 * slope * y[1] ** 2
            k[stage, 2], k[stage, 3] = y[3], 0.0
            if e.third_inertia_kgm2 > 0.0:
                passed = physics.third_torque(e, y[0] - y[2], y[1] - y[3], y[1])
                on_load -= passed
                k[stage, 3] = passed / e.third_inertia_kgm2
            k[stage, 0], k[stage, 1] = y[1], on_load / inertia
        x = x + step / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])
    return found


def rate_hz(machine: Machine) -> float:
    """Samples per second that a machine wants."""
    body = plant.plant_of(machine, None)
    if body.rigid:
        return RATE_HZ
    lightest = float(np.min(body.inertia.coefficients[3]))
    fastest = max(np.sqrt(body.stiffness / lightest), body.damping / lightest)
    return max(RATE_HZ, 2 * float(fastest) / _STEP)


def follow(machine: Machine, motion: Motion, start_rad: float) -> Followed:
    """The first stroke of a motion from a motor angle (rad), and a rest behind it that is long enough.

    Raises InputError for a machine that cannot be simulated.
    """
    alone = motion.model_copy(update={"start_time_s": 0.0, "returns": False})
    count = _samples(machine, motion.duration_s)
    return follow_demand(
        machine, alone.demand(np.arange(count) / rate_hz(machine)), motion.duration_s, start_rad
    )


def sampled(machine: Machine, duration_s: float) -> Array:
    """Instants at which `follow_demand` wants a motion that takes so long (s), (n,)."""
    return np.arange(_samples(machine, duration_s)) / rate_hz(machine)


def follow_demand(machine: Machine, demand: Demand, duration_s: float, start_rad: float) -> Followed:
    """As `follow`, of a motion given at `sampled` instants."""
    body = plant.plant_of(machine, None)
    rate = rate_hz(machine)
    time = np.arange(demand.position_rad.size) / rate
    known = plant.learned_of(machine, body, time, demand, 1.0)
    rest, _ = plant.learned_rest(known, start_rad)
    load = np.array([rest.load_angle, 0.0, rest.third_angle, 0.0])
    angle = start_rad + demand.position_rad
    found = _follow(known, angle, demand.speed_rad_s, demand.acceleration_rad_s2, load, 2 / rate)
    return Followed(
        time_s=time[::2],
        duration_s=duration_s,
        position_rad=angle[::2],
        speed_rad_s=demand.speed_rad_s[::2],
        acceleration_rad_s2=demand.acceleration_rad_s2[::2],
        torque_nm=found[:, 0],
        load_position_rad=found[:, 1],
        load_speed_rad_s=found[:, 2],
    )


def _samples(machine: Machine, duration_s: float) -> int:
    return 2 * int(np.ceil((duration_s + tail_s(machine)) * rate_hz(machine) / 2)) + 1


def tail_s(machine: Machine) -> float:
    """How long a swing of the load takes to be over behind a motor that stands (s)."""
    body = plant.plant_of(machine, None)
    if body.rigid or body.damping <= 0:
        return TAIL_S
    heaviest = float(np.max(body.inertia.coefficients[3]))
    return min(max(TAIL_S, _DECAYS * 2 * heaviest / body.damping), 2.0)


def merits_of(machine: Machine, followed: Followed) -> Merits:
    """What a motion costs. Torque that holds the axis at its end counts for the duration only."""
    torque, speed, step = followed.torque_nm, followed.speed_rad_s, followed.time_s[1]
    moving = followed.time_s <= followed.duration_s
    beyond = np.where(moving, torque**2, torque**2 - torque[-1] ** 2)
    copper = float(np.sum(beyond)) * step
    power, drawn, one_way = torque * speed, None, None
    electrical = machine.motor.electrical
    if electrical is not None:
        lost = electrical.copper_w_nm2 * beyond + electrical.iron_loss_nms * speed**2
        drawn = float(np.sum(power + lost)) * step
        one_way = float(np.sum(np.maximum(power + lost, 0.0))) * step
    after = followed.load_position_rad[~moving]
    return Merits(
        copper_n2m2s=copper,
        rms_torque_nm=float(np.sqrt(max(copper, 0.0) / followed.duration_s)),
        peak_torque_nm=float(np.max(np.abs(torque))),
        mechanical_j=float(np.sum(np.maximum(power, 0.0))) * step,
        drawn_j=drawn,
        drawn_one_way_j=one_way,
        peak_speed_rad_s=float(np.max(np.abs(speed))),
        residual_rad=float(np.max(np.abs(after - followed.load_position_rad[-1]))),
    )
