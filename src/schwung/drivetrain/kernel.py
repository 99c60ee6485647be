"""The compiled inside of the simulation: plant equations, Runge-Kutta steps, and the drive's cascade.

Plain numbers and arrays only; `simulation.py` is the way in. This is the lean machine without learned terms;
`learned.py` has those. Compiled code is cached on disk: the first call on a computer takes some seconds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schwung.compiled import compiled
from schwung.motion import Array


class Curve(NamedTuple):
    """A piecewise cubic over the load angle, constant outside: knots (m,), coefficients (4, m − 1)."""

    knots: Array
    coefficients: Array  # highest power first, as in scipy's PPoly


class Plant(NamedTuple):
    """Everything that the equations of motion need; SI."""

    rotor_inertia: float
    motor_friction: float
    load_friction: float
    stiffness: float  # 0 with `rigid`
    damping: float
    rigid: bool
    inertia: Curve
    load_torque: Curve


class Cascade(NamedTuple):
    """The drive's controller; SI."""

    position_gain: float
    speed_gain: float
    integral_time: float
    peak_torque: float
    period: float
    substeps: int  # Runge-Kutta steps of the plant in one period


class Inputs(NamedTuple):
    """What reaches the drive, per tick, (n,): angle wanted (rad), and what is added to speed and torque."""

    position: Array
    speed_forward: Array
    torque_forward: Array
    torque_added: Array


class State(NamedTuple):
    """Motor and load: angle (rad) and speed (rad/s)."""

    motor_angle: float
    motor_speed: float
    load_angle: float
    load_speed: float


@compiled
def _piece(curve: Curve, angle: float) -> int:
    """Index of the piece that holds the angle, which lies within the knots."""
    low, high = 0, curve.knots.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if angle < curve.knots[middle]:
            high = middle
        else:
            low = middle
    return low


@compiled
def value_and_slope(curve: Curve, angle: float) -> tuple[float, float]:
    """The curve and its derivative at one angle (rad)."""
    inside = min(max(angle, curve.knots[0]), curve.knots[-1])
    i = _piece(curve, inside)
    u = inside - curve.knots[i]
    a, b, c, d = (
        curve.coefficients[0, i],
        curve.coefficients[1, i],
        curve.coefficients[2, i],
        curve.coefficients[3, i],
    )
    slope = (3.0 * a * u + 2.0 * b) * u + c if inside == angle else 0.0
    return ((a * u + b) * u + c) * u + d, slope


@compiled
def _rates(plant: Plant, state: State, torque: float) -> State:
    """Time derivative of the state: method.md (1), (A7)."""
    inertia, inertia_slope = value_and_slope(plant.inertia, state.load_angle)
    load, _ = value_and_slope(plant.load_torque, state.load_angle)
    load -= plant.load_friction * state.load_speed + 0.5 * inertia_slope * state.load_speed**2
    motor = torque - plant.motor_friction * state.motor_speed
    if plant.rigid:
        acceleration = (motor + load) / (plant.rotor_inertia + inertia)
        return State(state.motor_speed, acceleration, state.load_speed, acceleration)
    coupling = plant.damping * (state.motor_speed - state.load_speed) + plant.stiffness * (
        state.motor_angle - state.load_angle
    )
    return State(
        state.motor_speed,
        (motor - coupling) / plant.rotor_inertia,
        state.load_speed,
        (load + coupling) / inertia,
    )


@compiled
def _moved(state: State, rates: State, by: float) -> State:
    return State(
        state.motor_angle + by * rates.motor_angle,
        state.motor_speed + by * rates.motor_speed,
        state.load_angle + by * rates.load_angle,
        state.load_speed + by * rates.load_speed,
    )


@compiled
def advance(plant: Plant, state: State, torque: float, duration: float, substeps: int) -> State:
    """The state after `duration` (s) under a constant motor torque (N·m): classical Runge-Kutta."""
    step = duration / substeps
    for _ in range(substeps):
        k1 = _rates(plant, state, torque)
        k2 = _rates(plant, _moved(state, k1, step / 2), torque)
        k3 = _rates(plant, _moved(state, k2, step / 2), torque)
        k4 = _rates(plant, _moved(state, k3, step), torque)
        state = _moved(state, k1, step / 6)
        state = _moved(state, k2, step / 3)
        state = _moved(state, k3, step / 3)
        state = _moved(state, k4, step / 6)
    return state


@compiled
def command(
    cascade: Cascade, inputs: Inputs, tick: int, angle: float, speed: float, integral: float
) -> tuple[float, float, float]:
    """The drive's torque (N·m) at a tick from what it reads: clipped, as wanted, and its integrator's next."""
    error = cascade.position_gain * (inputs.position[tick] - angle)
    error += inputs.speed_forward[tick] - speed
    wanted = cascade.speed_gain * error + integral + inputs.torque_forward[tick] + inputs.torque_added[tick]
    torque = min(max(wanted, -cascade.peak_torque), cascade.peak_torque)
    if torque == wanted or error * wanted < 0.0:  # anti-windup: at the limit it may only unwind
        integral += cascade.speed_gain * error * cascade.period / cascade.integral_time
    return torque, wanted, integral


@compiled
def run(
    plant: Plant, cascade: Cascade, inputs: Inputs, state: State, held_torque: float
) -> tuple[Array, Array]:
    """Closed loop over n ticks of the drive, whose integrator starts with `held_torque` (N·m).

    At each tick the drive reads angle and speed and sets the torque that acts until the next one. Gives
    states (n, 4) as read at the ticks and torques (n, 2): as set, and as it was before clipping.
    """
    n = inputs.position.size
    states, torques = np.empty((n, 4)), np.empty((n, 2))
    integral = held_torque
    for i in range(n):
        torque, wanted, integral = command(cascade, inputs, i, state.motor_angle, state.motor_speed, integral)
        states[i, 0], states[i, 1] = state.motor_angle, state.motor_speed
        states[i, 2], states[i, 3] = state.load_angle, state.load_speed
        torques[i, 0], torques[i, 1] = torque, wanted
        state = advance(plant, state, torque, cascade.period, cascade.substeps)
    return states, torques
