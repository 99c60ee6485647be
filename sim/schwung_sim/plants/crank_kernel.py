"""One control tick of the slider-crank as compiled code: MuJoCo's steps, and around them what MuJoCo does not model."""

from __future__ import annotations

from typing import Any, NamedTuple

from schwung_sim.compiled import compiled
from schwung_sim.plants.effects import (
    coupling_torque,
    dry_friction,
    load_disturbance,
    motor_disturbance,
    sliding_direction,
    speed_friction,
    true_torque,
)
from schwung_sim.plants.native import call_step
from schwung_sim.plants.profile import Array, Samples

MOTOR, CRANK = 0, 1  # degrees of freedom


class CrankKernel(NamedTuple):
    """A slider-crank as compiled code sees it; the arrays are MuJoCo's own memory."""

    addresses: tuple[int, int, int]  # of mj_step, of model and data
    steps: int  # of MuJoCo in a tick
    parameters: Any
    state: Any
    load_torque: Samples
    shift_rad: float
    angle: Array
    speed: Array
    torque: Array
    twist_speed: Array  # (1,) of the coupling, at the step before


@compiled
def _outside(ps: Any, ss: Any, load_torque: Any, command_nm: float, at: Any) -> Any:
    """What MuJoCo does not model: torque on motor and crank, sliding direction, level of dry friction."""
    p, s = ps[0], ss[0]
    motor, motor_speed, angle, twist_speed = at
    h = p.substep_s
    torque = true_torque(p, s, command_nm, h)
    torque += motor_disturbance(p, s.time_s + 0.5 * h, motor) + speed_friction(p, motor_speed)
    load = load_disturbance(p, load_torque, s.motion_time_s + 0.5 * h, angle)
    shaft = coupling_torque(p, motor - angle, twist_speed)
    direction = sliding_direction(p, s, motor, motor_speed, torque - shaft)
    friction = dry_friction(p, s, motor, motor_speed, direction)
    torque = 0.0 if direction == 0.0 else torque - shaft - direction * friction  # held: in balance
    load += shaft
    s.time_s += h
    if s.motion_time_s >= 0.0:
        s.motion_time_s += h
    return torque, load, direction, friction


@compiled
def crank_tick(kernel: Any, command_nm: float) -> None:
    """One control tick with the commanded torque held.

    In semi-implicit Euler, speeds stand half a step before the angles. The coupling's damper takes the twist's speed
    half a step on, by its latest change: half a step late, it would be an inertia of −b h/2 between motor and crank.
    """
    q, v, shift, before = kernel.angle, kernel.speed, kernel.shift_rad, kernel.twist_speed
    step, model, data = kernel.addresses
    for _ in range(kernel.steps):
        held, twist_speed = q[MOTOR], v[MOTOR] - v[CRANK]
        at = (held - shift, v[MOTOR], q[CRANK] - shift, twist_speed + 0.5 * (twist_speed - before[0]))
        before[0] = twist_speed
        motor, load, direction, friction = _outside(
            kernel.parameters, kernel.state, kernel.load_torque, command_nm, at
        )
        kernel.torque[MOTOR], kernel.torque[CRANK] = motor, load
        call_step(step, model, data)
        if direction == 0.0:
            q[MOTOR], v[MOTOR] = held, 0.0
        elif friction > 0.0 and v[MOTOR] * direction < 0.0:
            v[MOTOR] = 0.0  # dry friction stops a shaft, it never turns it back


@compiled
def one_tick(kernel: Any, command_nm: float) -> None:
    """`crank_tick` for Python."""
    crank_tick(kernel, command_nm)
