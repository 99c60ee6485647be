"""The torque that a belief needs for the motion that was recorded.

The measured motion of the motor is prescribed, and the load hangs on it:

    J_l(θ_l) dω_l/dt = C − b_l ω_l − ½ J_l'(θ_l) ω_l² + T_l(θ_l, t)        C = k (θ_m − θ_l) + b (ω_m − ω_l)
    needed = J_r α_m + b_r ω_m + C − friction and disturbances of the motor

Unlike a simulation driven by torque this cannot drift, needs no controller, and what is wrong with one torque shows in
that torque. A rigid belief is the same with θ_l = θ_m.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from schwung.drivetrain.compiled import compiled
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.kernel import Curve, value_and_slope
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.physics import Effects, coupling_torque, load_torque, motor_torque
from schwung.motion import Array

#: Highest |eigenvalue| × Runge-Kutta step of the load on its spring.
_STEP = 0.5
#: Steps per sample where the coupling has play: contact is sudden.
_CONTACT_SUBSTEPS = 4
_MAX_SUBSTEPS = 12


class Belief(NamedTuple):
    """The machine as the equations take it; SI."""

    rotor_inertia: float
    motor_friction: float
    load_friction: float
    stiffness: float
    damping: float
    rigid: bool
    inertia: Curve
    load_torque: Curve


class Motion(NamedTuple):
    """The motor's motion on a uniform grid, (n,) each."""

    angle: Array
    speed: Array
    acceleration: Array
    motion_time: Array
    step: float


def believed(machine: Machine) -> Belief:
    """The machine file as equations; an unknown load of a rigid machine is none at all, its inertia the motor's."""
    load, coupling = machine.load, machine.coupling
    inertia = machine.load_inertia if machine.load_inertia is not None or coupling is not None else 0.0
    table = load.torque_table
    return Belief(
        rotor_inertia=machine.motor.inertia_kgm2,
        motor_friction=machine.motor.viscous_friction_nms,
        load_friction=load.viscous_friction_nms,
        stiffness=coupling.stiffness_nm_rad if coupling else 0.0,
        damping=coupling.damping_nms if coupling else 0.0,
        rigid=coupling is None,
        inertia=_curve(inertia.position_rad, inertia.inertia_kgm2)
        if isinstance(inertia, InertiaTable)
        else _constant(float(inertia or 0.0)),
        load_torque=_curve(table.position_rad, table.load_torque_nm)
        if table is not None
        else _constant(load.torque_nm or 0.0),
    )


def _curve(position: Array, values: Array) -> Curve:
    pieces = PchipInterpolator(position, values)
    return Curve(np.ascontiguousarray(pieces.x, float), np.ascontiguousarray(pieces.c, float))


def _constant(value: float) -> Curve:
    return _curve(np.array([0.0, 1.0]), np.array([value, value]))


def substeps(belief: Belief, e: Effects, step_s: float) -> int:
    """Runge-Kutta steps of the load per sample."""
    if belief.rigid and e.third_inertia_kgm2 <= 0:
        return 1
    knots = belief.inertia.knots
    lightest = min(
        float(np.min(belief.inertia.coefficients[3])), value_and_slope(belief.inertia, knots[-1])[0]
    )
    lightest = max(e.inertia_scale * lightest + e.inertia_delta_kgm2, 0.02 * lightest, 1e-12)
    k = e.stiffness_nm_rad if e.stiffness_nm_rad > 0 else belief.stiffness
    b = e.damping_nms if e.damping_nms >= 0 else belief.damping
    fastest = 0.0 if belief.rigid else max(np.sqrt(2 * k / lightest), b / lightest)
    if e.third_inertia_kgm2 > 0:
        third = min(e.third_inertia_kgm2, lightest)
        fastest = max(
            fastest, np.sqrt(2 * (k + e.third_stiffness_nm_rad) / third), e.third_damping_nms / third
        )
    needed = int(np.ceil(step_s * fastest / _STEP))
    if e.gap_rad > 0:
        needed = max(needed, _CONTACT_SUBSTEPS)
    return min(max(needed, 1), _MAX_SUBSTEPS)


@compiled
def _inertia(belief: Belief, e: Effects, angle: float) -> tuple[float, float]:
    """J_l and dJ_l/dθ with what the terms change."""
    value, slope = value_and_slope(belief.inertia, angle + e.inertia_shift_rad)
    return e.inertia_scale * value + e.inertia_delta_kgm2, e.inertia_scale * slope


@compiled
def _load_rates(
    belief: Belief, e: Effects, k: float, b: float, motor: tuple[float, float], time: float, state: Array
) -> tuple[float, float]:
    """Accelerations of load and third mass; state: load angle, load speed, third angle, third speed."""
    angle, speed = state[0], state[1]
    torque = coupling_torque(e, k, b, motor[0] - angle, motor[1] - speed)
    inertia, slope = _inertia(belief, e, angle)
    given, _ = value_and_slope(belief.load_torque, angle)
    torque += given + load_torque(e, angle, time) - belief.load_friction * speed - 0.5 * slope * speed * speed
    third = 0.0
    if e.third_inertia_kgm2 > 0.0:
        passed = e.third_stiffness_nm_rad * (angle - state[2]) + e.third_damping_nms * (speed - state[3])
        torque -= passed
        third = passed / e.third_inertia_kgm2
    return torque / inertia, third


@compiled
def _between(motion: Motion, i: int, u: float) -> tuple[float, float]:
    """Angle and speed of the motor within the i-th interval, u = 0…1: cubic Hermite each."""
    h = motion.step
    a, b = u * u * (3.0 - 2.0 * u), u * (1.0 - u)
    angle = motion.angle[i] + a * (motion.angle[i + 1] - motion.angle[i])
    angle += h * b * ((1.0 - u) * motion.speed[i] - u * motion.speed[i + 1])
    speed = motion.speed[i] + a * (motion.speed[i + 1] - motion.speed[i])
    speed += h * b * ((1.0 - u) * motion.acceleration[i] - u * motion.acceleration[i + 1])
    return angle, speed


@compiled
def coupling_needed(belief: Belief, e: Effects, motion: Motion, steps: int) -> Array:
    """Torque that the load takes from the motor over the prescribed motion (N·m), (n,)."""
    n = motion.angle.size
    k = e.stiffness_nm_rad if e.stiffness_nm_rad > 0.0 else belief.stiffness
    b = e.damping_nms if e.damping_nms >= 0.0 else belief.damping
    result = np.empty(n)
    state, trial = np.empty(4), np.empty(4)
    inertia, slope = _inertia(belief, e, motion.angle[0])
    given, _ = value_and_slope(belief.load_torque, motion.angle[0])
    speed = motion.speed[0]
    first = (inertia + e.third_inertia_kgm2) * motion.acceleration[0] + 0.5 * slope * speed * speed
    first += belief.load_friction * speed - given - load_torque(e, motion.angle[0], motion.motion_time[0])
    state[0] = motion.angle[0]
    if not belief.rigid:
        state[0] -= first / k
        if e.gap_rad > 0.0:
            state[0] -= 0.5 * e.gap_rad * np.sign(first)
    state[1] = state[3] = speed
    state[2] = state[0]
    if e.third_inertia_kgm2 > 0.0:
        state[2] -= e.third_inertia_kgm2 * motion.acceleration[0] / e.third_stiffness_nm_rad
    h = motion.step / steps
    for i in range(n):
        if belief.rigid:
            state[0], state[1] = motion.angle[i], motion.speed[i]
            inertia, slope = _inertia(belief, e, state[0])
            given, _ = value_and_slope(belief.load_torque, state[0])
            torque = inertia * motion.acceleration[i] + 0.5 * slope * state[1] ** 2
            torque += (
                belief.load_friction * state[1] - given - load_torque(e, state[0], motion.motion_time[i])
            )
            if e.third_inertia_kgm2 > 0.0:
                torque += e.third_stiffness_nm_rad * (state[0] - state[2])
                torque += e.third_damping_nms * (state[1] - state[3])
            result[i] = torque
        else:
            result[i] = coupling_torque(e, k, b, motion.angle[i] - state[0], motion.speed[i] - state[1])
        if i == n - 1 or (belief.rigid and e.third_inertia_kgm2 <= 0.0):
            continue
        for s in range(steps):
            time = motion.motion_time[i] + s * h
            start = _between(motion, i, s / steps)
            middle = _between(motion, i, (s + 0.5) / steps)
            end = _between(motion, i, (s + 1.0) / steps)
            if belief.rigid:
                _third_step(e, state, start, middle, end, h)
                continue
            a1, c1 = _load_rates(belief, e, k, b, start, time, state)
            _ahead(state, trial, state[1], a1, state[3], c1, h / 2)
            v2, w2 = trial[1], trial[3]
            a2, c2 = _load_rates(belief, e, k, b, middle, time + h / 2, trial)
            _ahead(state, trial, v2, a2, w2, c2, h / 2)
            v3, w3 = trial[1], trial[3]
            a3, c3 = _load_rates(belief, e, k, b, middle, time + h / 2, trial)
            _ahead(state, trial, v3, a3, w3, c3, h)
            v4, w4 = trial[1], trial[3]
            a4, c4 = _load_rates(belief, e, k, b, end, time + h, trial)
            state[0] += h / 6 * (state[1] + 2 * v2 + 2 * v3 + v4)
            state[2] += h / 6 * (state[3] + 2 * w2 + 2 * w3 + w4)
            state[1] += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
            state[3] += h / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
    return result


@compiled
def _ahead(state: Array, trial: Array, v: float, a: float, w: float, c: float, h: float) -> None:
    """`trial` becomes the state moved for h (s) at the given rates."""
    trial[0], trial[1] = state[0] + h * v, state[1] + h * a
    trial[2], trial[3] = state[2] + h * w, state[3] + h * c


@compiled
def _third_step(
    e: Effects,
    state: Array,
    start: tuple[float, float],
    middle: tuple[float, float],
    end: tuple[float, float],
    h: float,
) -> None:
    """The third mass on a prescribed load, one Runge-Kutta step."""
    k, b, m = e.third_stiffness_nm_rad, e.third_damping_nms, e.third_inertia_kgm2
    x, v = state[2], state[3]
    a1 = (k * (start[0] - x) + b * (start[1] - v)) / m
    v2 = v + h / 2 * a1
    a2 = (k * (middle[0] - x - h / 2 * v) + b * (middle[1] - v2)) / m
    v3 = v + h / 2 * a2
    a3 = (k * (middle[0] - x - h / 2 * v2) + b * (middle[1] - v3)) / m
    v4 = v + h * a3
    a4 = (k * (end[0] - x - h * v3) + b * (end[1] - v4)) / m
    state[2] = x + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
    state[3] = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


@compiled
def motor_helped(
    e: Effects, motion: Motion, time: Array, phase: float, share: float, smoothing: float
) -> Array:
    """What friction (negative) and disturbances add to the motor's torque along the motion (N·m), (n,)."""
    result = np.empty(motion.angle.size)
    for i in range(result.size):
        result[i] = motor_torque(e, motion.angle[i], motion.speed[i], time[i], phase, share, smoothing)
    return result


def uncentred(motion: Motion, amplitude_rad: float, phase_rad: float) -> Motion:
    """The true motion where the encoder reports θ + A sin(θ + phase), to first order in A."""
    if amplitude_rad == 0:
        return motion
    at = motion.angle + phase_rad
    bend = 1 - amplitude_rad * np.cos(at)
    return motion._replace(
        angle=motion.angle - amplitude_rad * np.sin(at),
        speed=motion.speed * bend,
        acceleration=motion.acceleration * bend + amplitude_rad * np.sin(at) * motion.speed**2,
    )
