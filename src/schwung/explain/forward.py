"""The torque that a belief needs for the motion that was recorded.

The measured motion of the motor is prescribed, and the load hangs on it:

    J_l(θ_l) dω_l/dt = C − b_l ω_l − ½ J_l'(θ_l) ω_l² + T_l(θ_l, t)        C = k (θ_m − θ_l) + b (ω_m − ω_l)
    needed = J_r α_m + b_r ω_m + C − friction and disturbances of the motor

Unlike a simulation driven by torque this cannot drift, needs no controller, and what is wrong with one torque shows in
that torque. A rigid belief is the same with θ_l = θ_m.

This is where an explanation spends its time: small functions are put where they are called, so that the state stays in
registers; the piece of the inertia's curve is sought from the one before, to which the load is always close; and the
ways in take plain tuples, whose types numba knows at a glance (named ones cost it up to 50 µs each, every time).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from schwung.compiled import compiled, inlined
from schwung.drivetrain.effects import Effects
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.kernel import Curve, value_and_slope
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.physics import coupling_torque, load_torque, motor_torque, third_torque
from schwung.explain.spectrum import Spectrum
from schwung.motion import Array

#: Highest |eigenvalue| × Runge-Kutta step of the load on its spring.
_STEP = 0.15
#: Steps per sample where the coupling has play: contact is sudden.
_CONTACT_SUBSTEPS = 8
_MAX_SUBSTEPS = 16
_STABLE = 2.5  # beyond 2.78 times the eigenvalue's inverse a step of fourth order grows without bounds
_PAD = 64.0  # samples by which the ends are prolonged
_NEWTON = 3  # steps from a reported angle to the true one
_FINER = 6  # pieces of a table's curve per piece of the table
#: A bare 0 is a type of its own to numba, which would compile anew everything that it is given to.
_FIRST = cast(int, np.int64(0))


_Plain = tuple[Any, ...]  # a Belief, Effects or Motion as a plain tuple


class Belief(NamedTuple):
    """The machine as the equations take it; SI."""

    rotor_inertia: float
    motor_friction: float
    load_friction: float
    stiffness: float
    damping: float
    rigid: bool
    inertia_knots: Array  # as of a Curve, (m,)
    inertia_coefficients: Array  # (4, m − 1)
    torque_knots: Array
    torque_coefficients: Array


class Motion(NamedTuple):
    """The motor's motion on a uniform grid, (n,) each."""

    angle: Array
    speed: Array
    acceleration: Array
    motion_time: Array
    step: float


class Hanging(NamedTuple):
    """Load, and a third mass behind it: angle (rad) and speed (rad/s); or the rates of these."""

    angle: float
    speed: float
    third_angle: float
    third_speed: float


def believed(machine: Machine) -> Belief:
    """The machine file as equations; an unknown load of a rigid machine is none at all, its inertia the motor's."""
    load, coupling = machine.load, machine.coupling
    inertia = machine.load_inertia if machine.load_inertia is not None or coupling is not None else 0.0
    table = load.torque_table
    shape = (
        _curve(inertia.position_rad, inertia.inertia_kgm2)
        if isinstance(inertia, InertiaTable)
        else _constant(float(inertia or 0.0))
    )
    given = (
        _curve(table.position_rad, table.load_torque_nm)
        if table is not None
        else _constant(load.torque_nm or 0.0)
    )
    return Belief(
        rotor_inertia=machine.motor.inertia_kgm2,
        motor_friction=machine.motor.viscous_friction_nms,
        load_friction=load.viscous_friction_nms,
        stiffness=coupling.stiffness_nm_rad if coupling else 0.0,
        damping=coupling.damping_nms if coupling else 0.0,
        rigid=coupling is None,
        inertia_knots=shape.knots,
        inertia_coefficients=shape.coefficients,
        torque_knots=given.knots,
        torque_coefficients=given.coefficients,
    )


def with_load_torque(belief: Belief, angle_rad: Array, torque_nm: Array) -> Belief:
    """The belief with a torque on the load (N·m), a cubic spline through points (m,), beside its own."""
    fine = np.linspace(angle_rad[0], angle_rad[-1], _FINER * (angle_rad.size - 1) + 1)
    own = Curve(belief.torque_knots, belief.torque_coefficients)
    values = CubicSpline(angle_rad, torque_nm)(fine) + [value_and_slope(own, angle)[0] for angle in fine]
    curve = _curve(fine, values)
    return belief._replace(torque_knots=curve.knots, torque_coefficients=curve.coefficients)


def _curve(position: Array, values: Array) -> Curve:
    pieces = PchipInterpolator(position, values)
    return Curve(np.ascontiguousarray(pieces.x, float), np.ascontiguousarray(pieces.c, float))


def _constant(value: float) -> Curve:
    return _curve(np.array([0.0, 1.0]), np.array([value, value]))


def _changed(belief: Belief, e: Effects) -> Belief:
    """The belief with the terms' coupling and load inertia, J_l(θ) = scale · believed J_l(θ + shift) + delta."""
    coefficients = e.inertia_scale * belief.inertia_coefficients
    coefficients[3] += e.inertia_delta_kgm2
    return belief._replace(
        stiffness=float(e.stiffness_nm_rad if e.stiffness_nm_rad > 0 else belief.stiffness),
        damping=float(e.damping_nms if e.damping_nms >= 0 else belief.damping),
        inertia_knots=belief.inertia_knots - e.inertia_shift_rad,
        inertia_coefficients=coefficients,
    )


def substeps(belief: Belief, e: Effects, step_s: float) -> int:
    """Runge-Kutta steps of the load per sample."""
    if belief.rigid and e.third_inertia_kgm2 <= 0:
        return 1
    needed = int(np.ceil(step_s * _fastest(belief, e) / _STEP))
    if e.gap_rad > 0:
        needed = max(needed, _CONTACT_SUBSTEPS)
    return min(max(needed, 1), _MAX_SUBSTEPS)


def can_follow(belief: Belief, e: Effects, step_s: float) -> bool:
    """Whether Runge-Kutta steps as fine as there are follow what hangs on the motor: else they say nothing of it."""
    return step_s * _fastest(belief, e) < _STABLE * _MAX_SUBSTEPS


def _fastest(belief: Belief, e: Effects) -> float:
    """Highest |eigenvalue| of what hangs on the motor (1/s), at the lightest load."""
    last = value_and_slope(
        Curve(belief.inertia_knots, belief.inertia_coefficients), belief.inertia_knots[-1]
    )[0]
    lightest = min(float(belief.inertia_coefficients[3].min()), last)
    lightest = max(e.inertia_scale * lightest + e.inertia_delta_kgm2, 0.02 * lightest, 1e-12)
    k = e.stiffness_nm_rad if e.stiffness_nm_rad > 0 else belief.stiffness
    b = e.damping_nms if e.damping_nms >= 0 else belief.damping
    fastest = 0.0 if belief.rigid else float(max(np.sqrt(2 * k / lightest), b / lightest))
    if e.third_inertia_kgm2 > 0:
        third = min(e.third_inertia_kgm2, lightest)
        swing = float(np.sqrt(2 * (k + e.third_stiffness_nm_rad) / third))
        fastest = max(fastest, swing, e.third_damping_nms / third)
    return fastest


def coupling_needed(
    belief: Belief, e: Effects, motion: Motion, begun: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """Torque that the load takes from the motor over the prescribed motion (N·m), (n,).

    `begun`: angle (rad) and speed (rad/s) by which a load on a spring is ahead at first of one that moves as the motor.
    """
    steps = substeps(belief, e, motion.step)
    load, terms = tuple(_changed(belief, e)), tuple(map(float, e))
    # strided arrays are another type to numba: each kernel would be compiled a second time
    moved = (*map(np.ascontiguousarray, motion[:4]), motion.step)
    if not belief.rigid:
        torque = _hung(load, terms, moved, steps, (float(begun[0]), float(begun[1])))
        return _sharpened(torque, steps) if e.gap_rad > 0 else torque
    torque = _carried(load, terms, moved)
    return torque + _third_carried(terms, moved, steps) if e.third_inertia_kgm2 > 0 else torque


def _sharpened(evened: Array, steps: int) -> Array:
    """Values (n,) that were evened out over their neighbours, so many steps apart, with the gain of that taken back."""
    spectrum = _spectrum(evened.size)
    turn = np.pi * spectrum.frequency_hz[1:]
    return spectrum.apply(evened, np.r_[1.0, (steps * np.sin(turn / steps) / np.sin(turn)) ** 2])


@lru_cache
def _spectrum(samples: int) -> Spectrum:
    return Spectrum(samples, 1.0, _PAD)


@inlined
def _inertia(belief: Belief, angle: float, piece: int) -> tuple[float, float, int]:
    """J_l, dJ_l/dθ, and the piece of the curve that holds the angle, sought from the given one."""
    knots, c = belief.inertia_knots, belief.inertia_coefficients
    last = knots.size - 1
    inside = min(max(angle, knots[0]), knots[last])
    while piece < last - 1 and inside >= knots[piece + 1]:
        piece += 1
    while inside < knots[piece]:
        piece -= 1
    u = inside - knots[piece]
    value = ((c[0, piece] * u + c[1, piece]) * u + c[2, piece]) * u + c[3, piece]
    slope = (3.0 * c[0, piece] * u + 2.0 * c[1, piece]) * u + c[2, piece] if inside == angle else 0.0
    return value, slope, piece


@inlined
def _acting(belief: Belief, e: Effects, angle: float, time: float) -> float:
    """Torque that acts on the load from outside (N·m), without friction."""
    given = Curve(belief.torque_knots, belief.torque_coefficients)
    return value_and_slope(given, angle)[0] + load_torque(e, angle, time)


@inlined
def _rates(
    belief: Belief,
    e: Effects,
    motor_angle: float,
    motor_speed: float,
    time: float,
    state: Hanging,
    piece: int,
) -> tuple[Hanging, int]:
    """Time derivative of what hangs on the motor, and the inertia's piece."""
    angle, speed = state.angle, state.speed
    inertia, slope, piece = _inertia(belief, angle, piece)
    torque = coupling_torque(e, belief.stiffness, belief.damping, motor_angle - angle, motor_speed - speed)
    torque += _acting(belief, e, angle, time)
    torque -= (belief.load_friction + 0.5 * slope * speed) * speed
    third = 0.0
    if e.third_inertia_kgm2 > 0.0:
        passed = third_torque(e, angle - state.third_angle, speed - state.third_speed)
        torque -= passed
        third = passed / e.third_inertia_kgm2
    return Hanging(speed, torque / inertia, state.third_speed, third), piece


@inlined
def _moved(state: Hanging, rates: Hanging, by: float) -> Hanging:
    return Hanging(
        state.angle + by * rates.angle,
        state.speed + by * rates.speed,
        state.third_angle + by * rates.third_angle,
        state.third_speed + by * rates.third_speed,
    )


@compiled
def _halves(motion: Motion, steps: int) -> tuple[Array, Array]:
    """Angle and speed of the motor at every half step, (2·steps·(n − 1) + 1,) each: cubic Hermite."""
    n, parts, h = motion.angle.size, 2 * steps, motion.step
    angle, speed = np.empty(parts * (n - 1) + 1), np.empty(parts * (n - 1) + 1)
    for part in range(parts):
        u = part / parts
        a, b = u * u * (3.0 - 2.0 * u), h * u * (1.0 - u)
        left, right = b * (1.0 - u), b * u
        for i in range(n - 1):
            at = parts * i + part
            angle[at] = motion.angle[i] + a * (motion.angle[i + 1] - motion.angle[i])
            angle[at] += left * motion.speed[i] - right * motion.speed[i + 1]
            speed[at] = motion.speed[i] + a * (motion.speed[i + 1] - motion.speed[i])
            speed[at] += left * motion.acceleration[i] - right * motion.acceleration[i + 1]
    angle[-1], speed[-1] = motion.angle[-1], motion.speed[-1]
    return angle, speed


@inlined
def _taken(belief: Belief, e: Effects, motion: Motion, i: int, piece: int) -> tuple[float, int]:
    """Torque (N·m) that a load takes which moves as the motor does at the i-th sample; the inertia's piece."""
    angle, speed = motion.angle[i], motion.speed[i]
    inertia, slope, piece = _inertia(belief, angle, piece)
    torque = inertia * motion.acceleration[i] + (belief.load_friction + 0.5 * slope * speed) * speed
    torque -= _acting(belief, e, angle, motion.motion_time[i])
    return torque, piece


@compiled
def _wound_up(belief: Belief, e: Effects, motion: Motion) -> Hanging:
    """Where load and third mass are at first: wound up by what they take, moving with the motor."""
    third = e.third_inertia_kgm2 * motion.acceleration[0]
    first = _taken(belief, e, motion, _FIRST, _FIRST)[0] + third
    angle = motion.angle[0] - first / belief.stiffness
    if e.gap_rad > 0.0:
        angle -= 0.5 * e.gap_rad * np.sign(first)
    behind = third / e.third_stiffness_nm_rad if e.third_inertia_kgm2 > 0.0 else 0.0
    return Hanging(angle, motion.speed[0], angle - behind, motion.speed[0])


@compiled
def _hung(load: _Plain, terms: _Plain, moved: _Plain, steps: int, begun: _Plain) -> Array:
    """The coupling's torque (N·m) with the load on its spring, (n,): classical Runge-Kutta.

    With play it leaps at every impact, which samples would take for something slow: it is evened out over the
    neighbouring samples, with triangular weights.
    """
    belief, e, motion = Belief(*load), Effects(*terms), Motion(*moved)
    angles, speeds = _halves(motion, steps)
    state, piece = _moved(_wound_up(belief, e, motion), Hanging(begun[0], begun[1], 0.0, 0.0), 1.0), _FIRST
    n, h = motion.angle.size, motion.step / steps
    result = np.zeros(n)
    for i in range(n):
        twist, twist_speed = motion.angle[i] - state.angle, motion.speed[i] - state.speed
        torque = coupling_torque(e, belief.stiffness, belief.damping, twist, twist_speed)
        if e.gap_rad <= 0.0 or i == 0 or i == n - 1:
            result[i] = torque
        for s in range(steps if i < n - 1 else 0):
            at, time = 2 * (i * steps + s), motion.motion_time[i] + s * h
            if e.gap_rad > 0.0:
                twist, twist_speed = angles[at] - state.angle, speeds[at] - state.speed
                torque = coupling_torque(e, belief.stiffness, belief.damping, twist, twist_speed) / steps
                result[i] += torque * (1.0 - s / steps) if i > 0 else 0.0
                result[i + 1] += torque * s / steps if i < n - 2 else 0.0
            k1, piece = _rates(belief, e, angles[at], speeds[at], time, state, piece)
            at, time = at + 1, time + h / 2
            k2, piece = _rates(belief, e, angles[at], speeds[at], time, _moved(state, k1, h / 2), piece)
            k3, piece = _rates(belief, e, angles[at], speeds[at], time, _moved(state, k2, h / 2), piece)
            at, time = at + 1, time + h / 2
            k4, piece = _rates(belief, e, angles[at], speeds[at], time, _moved(state, k3, h), piece)
            state = _moved(_moved(state, k1, h / 6), k2, h / 3)
            state = _moved(_moved(state, k3, h / 3), k4, h / 6)
    return result


@compiled
def _carried(load: _Plain, terms: _Plain, moved: _Plain) -> Array:
    """What a load takes that is one with the motor (N·m), (n,)."""
    belief, e, motion = Belief(*load), Effects(*terms), Motion(*moved)
    result = np.empty(motion.angle.size)
    piece = _FIRST
    for i in range(result.size):
        result[i], piece = _taken(belief, e, motion, i, piece)
    return result


@compiled
def _third_carried(terms: _Plain, moved: _Plain, steps: int) -> Array:
    """What a third mass takes behind a load that is one with the motor (N·m), (n,): classical Runge-Kutta."""
    e, motion = Effects(*terms), Motion(*moved)
    angles, speeds = _halves(motion, steps)
    n, h, m = motion.angle.size, motion.step / steps, e.third_inertia_kgm2
    x, v = motion.angle[0] - m * motion.acceleration[0] / e.third_stiffness_nm_rad, motion.speed[0]
    result = np.empty(n)
    for i in range(n):
        result[i] = third_torque(e, motion.angle[i] - x, motion.speed[i] - v)
        for s in range(steps if i < n - 1 else 0):
            at = 2 * (i * steps + s)
            a1 = third_torque(e, angles[at] - x, speeds[at] - v) / m
            v2 = v + h / 2 * a1
            a2 = third_torque(e, angles[at + 1] - x - h / 2 * v, speeds[at + 1] - v2) / m
            v3 = v + h / 2 * a2
            a3 = third_torque(e, angles[at + 1] - x - h / 2 * v2, speeds[at + 1] - v3) / m
            v4 = v + h * a3
            a4 = third_torque(e, angles[at + 2] - x - h * v3, speeds[at + 2] - v4) / m
            x += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return result


def motor_helped(
    e: Effects, motion: Motion, time: Array, phase: float, share: float, smoothing: float
) -> Array:
    """What friction (negative) and disturbances add to the motor's torque along the motion (N·m), (n,)."""
    angle, speed, at = map(np.ascontiguousarray, (motion.angle, motion.speed, time))  # as above
    return _helped(tuple(map(float, e)), angle, speed, at, float(phase), float(share), float(smoothing))


@compiled
def _helped(
    terms: _Plain, angle: Array, speed: Array, time: Array, phase: float, share: float, smoothing: float
) -> Array:
    e = Effects(*terms)
    result = np.empty(angle.size)
    for i in range(result.size):
        result[i] = motor_torque(e, angle[i], speed[i], time[i], phase, share, smoothing)
    return result


def uncentred(motion: Motion, amplitude_rad: float, phase_rad: float) -> Motion:
    """The true motion where the encoder reports θ + A sin(θ + phase)."""
    if amplitude_rad == 0:
        return motion
    angle = motion.angle
    for _ in range(_NEWTON):
        off = angle + amplitude_rad * np.sin(angle + phase_rad) - motion.angle
        angle = angle - off / (1 + amplitude_rad * np.cos(angle + phase_rad))
    stretch = 1 + amplitude_rad * np.cos(angle + phase_rad)  # reported over true speed
    speed = motion.speed / stretch
    bend = amplitude_rad * np.sin(angle + phase_rad) * speed**2
    return motion._replace(angle=angle, speed=speed, acceleration=(motion.acceleration + bend) / stretch)
