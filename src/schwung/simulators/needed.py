"""The torque that a machine needs for a prescribed motion of its motor.

The load hangs on the motor:

    J_l(θ_l) dω_l/dt = C − b_l ω_l − ½ J_l'(θ_l) ω_l² + T_l(θ_l)        C = k (θ_m − θ_l) + b (ω_m − ω_l)
    needed = J_r α_m + b_r ω_m + C

Unlike a simulation driven by torque this cannot drift and needs no controller. A rigid machine is the same with
θ_l = θ_m. A fit asks this some thousand times: small functions are put where they are called, the piece of the
inertia's curve is sought from the one before, and kernels take plain tuples, whose types numba knows at a glance.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from scipy.interpolate import PchipInterpolator

from schwung.compiled import compiled, inlined
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.kernel import Curve, value_and_slope
from schwung.drivetrain.machine import Machine
from schwung.motion import Array

#: Highest |eigenvalue| × Runge-Kutta step of the load on its spring.
_STEP = 0.15
_MAX_SUBSTEPS = 16
_STABLE = 2.5  # beyond 2.78 times the eigenvalue's inverse a step of fourth order grows without bounds
#: A bare 0 is a type of its own to numba, which would compile anew everything that it is given to.
_FIRST = cast(int, np.int64(0))


_Plain = tuple[Any, ...]  # a TwoMasses or MotorMotion as a plain tuple


class TwoMasses(NamedTuple):
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


class MotorMotion(NamedTuple):
    """The motor's motion on a uniform grid, (n,) each: rad, rad/s, rad/s²; and the time between samples (s)."""

    angle: Array
    speed: Array
    acceleration: Array
    step: float


def two_masses(machine: Machine) -> TwoMasses:
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
    return TwoMasses(
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


def _curve(position: Array, values: Array) -> Curve:
    pieces = PchipInterpolator(position, values)
    return Curve(np.ascontiguousarray(pieces.x, float), np.ascontiguousarray(pieces.c, float))


def _constant(value: float) -> Curve:
    return _curve(np.array([0.0, 1.0]), np.array([value, value]))


def substeps(of: TwoMasses, step_s: float) -> int:
    """Runge-Kutta steps of the load per sample."""
    if of.rigid:
        return 1
    return min(max(int(np.ceil(step_s * _fastest(of) / _STEP)), 1), _MAX_SUBSTEPS)


def can_follow(of: TwoMasses, step_s: float) -> bool:
    """Whether Runge-Kutta steps as fine as there are follow what hangs on the motor: else they say nothing of it."""
    return of.rigid or step_s * _fastest(of) < _STABLE * _MAX_SUBSTEPS


def _fastest(of: TwoMasses) -> float:
    """Highest |eigenvalue| of what hangs on the motor (1/s), at the lightest load."""
    last = value_and_slope(Curve(of.inertia_knots, of.inertia_coefficients), of.inertia_knots[-1])[0]
    lightest = max(min(float(of.inertia_coefficients[3].min()), last), 1e-12)
    return float(max(np.sqrt(2 * of.stiffness / lightest), of.damping / lightest))


def needed(of: TwoMasses, motion: MotorMotion) -> Array:
    """Torque on the motor over the prescribed motion (N·m), (n,)."""
    return of.rotor_inertia * motion.acceleration + of.motor_friction * motion.speed + taken(of, motion)


def taken(of: TwoMasses, motion: MotorMotion) -> Array:
    """Torque that the load takes from the motor over the prescribed motion (N·m), (n,)."""
    # strided arrays are another type to numba: each kernel would be compiled a second time
    moved = (*map(np.ascontiguousarray, motion[:3]), motion.step)
    return _carried(tuple(of), moved) if of.rigid else _hung(tuple(of), moved, substeps(of, motion.step))


@inlined
def _inertia(of: TwoMasses, angle: float, piece: int) -> tuple[float, float, int]:
    """J_l, dJ_l/dθ, and the piece of the curve that holds the angle, sought from the given one."""
    knots, c = of.inertia_knots, of.inertia_coefficients
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
def _acting(of: TwoMasses, angle: float) -> float:
    """Torque that acts on the load from outside (N·m), without friction."""
    return value_and_slope(Curve(of.torque_knots, of.torque_coefficients), angle)[0]


@inlined
def _acceleration(
    of: TwoMasses, motor_angle: float, motor_speed: float, angle: float, speed: float, piece: int
) -> tuple[float, int]:
    """Of the load (rad/s²), and the inertia's piece."""
    inertia, slope, piece = _inertia(of, angle, piece)
    torque = of.stiffness * (motor_angle - angle) + of.damping * (motor_speed - speed) + _acting(of, angle)
    torque -= (of.load_friction + 0.5 * slope * speed) * speed
    return torque / inertia, piece


@compiled
def _halves(motion: MotorMotion, steps: int) -> tuple[Array, Array]:
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
def _moving_along(of: TwoMasses, motion: MotorMotion, i: int, piece: int) -> tuple[float, int]:
    """Torque (N·m) that a load takes which moves as the motor does at the i-th sample; the inertia's piece."""
    angle, speed = motion.angle[i], motion.speed[i]
    inertia, slope, piece = _inertia(of, angle, piece)
    torque = inertia * motion.acceleration[i] + (of.load_friction + 0.5 * slope * speed) * speed
    return torque - _acting(of, angle), piece


@compiled
def _carried(masses: _Plain, moved: _Plain) -> Array:
    """What a load takes that is one with the motor (N·m), (n,)."""
    of, motion = TwoMasses(*masses), MotorMotion(*moved)
    result = np.empty(motion.angle.size)
    piece = _FIRST
    for i in range(result.size):
        result[i], piece = _moving_along(of, motion, i, piece)
    return result


@compiled
def _hung(masses: _Plain, moved: _Plain, steps: int) -> Array:
    """The coupling's torque (N·m) with the load on its spring, (n,): classical Runge-Kutta.

    At first the spring is wound up by what the load takes, and the load moves with the motor.
    """
    of, motion = TwoMasses(*masses), MotorMotion(*moved)
    angles, speeds = _halves(motion, steps)
    first, piece = _moving_along(of, motion, _FIRST, _FIRST)
    angle, speed = motion.angle[0] - first / of.stiffness, motion.speed[0]
    n, h = motion.angle.size, motion.step / steps
    result = np.empty(n)
    for i in range(n):
        result[i] = of.stiffness * (motion.angle[i] - angle) + of.damping * (motion.speed[i] - speed)
        for s in range(steps if i < n - 1 else 0):
            at = 2 * (i * steps + s)
            a1, piece = _acceleration(of, angles[at], speeds[at], angle, speed, piece)
            v2 = speed + h / 2 * a1
            a2, piece = _acceleration(of, angles[at + 1], speeds[at + 1], angle + h / 2 * speed, v2, piece)
            v3 = speed + h / 2 * a2
            a3, piece = _acceleration(of, angles[at + 1], speeds[at + 1], angle + h / 2 * v2, v3, piece)
            v4 = speed + h * a3
            a4, piece = _acceleration(of, angles[at + 2], speeds[at + 2], angle + h * v3, v4, piece)
            angle += h / 6 * (speed + 2 * v2 + 2 * v3 + v4)
            speed += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return result
