"""Inverse dynamics at one instant: what a motor motion takes, given how the loads hang on it. Numbers or symbols.

Angles are in shares of the distance, times in shares of the duration, wind-up in what the torque limit winds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.optimise.model import Model
from schwung.optimise.values import Objective, Task


@dataclass(frozen=True, eq=False)
class Scales:
    """What 1 stands for in the programme."""

    torque_nm: float
    twist_rad: float
    twist_speed_rad_s: float
    merits: Mapping[Objective, float]  # of the fifth-order polynomial, each in its own unit


def motor_within(first: Any, last: Any, step: float, at: float) -> tuple[Any, Any, Any]:
    """Share of the stroke and its derivatives at a share `at` of an interval, its acceleration being straight."""
    t, rise = at * step, (last[2] - first[2]) / step
    share = first[0] + first[1] * t + first[2] * t**2 / 2 + rise * t**3 / 6
    return share, first[1] + first[2] * t + rise * t**2 / 2, first[2] + rise * t


@dataclass(frozen=True, eq=False)
class Instant:
    """Everything at one instant, of every load where it is a list; SI, numbers or symbols."""

    motor_rad: Any
    motor_rad_s: Any
    load_rad: list[Any]
    load_rad_s: list[Any]
    load_rad_s2: list[Any]
    torque_nm: list[Any]


def instant(
    task: Task, models: Sequence[Model], motor: tuple[Any, Any, Any], load: Any, duration: Any, scales: Scales
) -> Instant:
    """Inverse dynamics: the torque that a motor motion takes, given how the loads hang on it."""
    angle = task.start_rad + task.distance_rad * motor[0]
    speed = task.distance_rad * motor[1] / duration
    acceleration = task.distance_rad * motor[2] / duration**2
    found = Instant(angle, speed, [], [], [], [])
    for number, model in enumerate(models):
        if model.stiffness_nm_rad is None:
            torque = model.load_inertia(angle) * acceleration + model.load_needs(angle, speed)
            found.load_rad.append(angle)
            found.load_rad_s.append(speed)
            found.load_rad_s2.append(acceleration)
        else:
            twist = scales.twist_rad * load[2 * number]
            twist_speed = scales.twist_speed_rad_s * load[2 * number + 1]
            torque = model.shaft_torque(twist, twist_speed)
            place, rate = angle - twist, speed - twist_speed
            found.load_rad.append(place)
            found.load_rad_s.append(rate)
            found.load_rad_s2.append((torque - model.load_needs(place, rate)) / model.load_inertia(place))
        torque = torque + model.rotor_inertia_kgm2 * acceleration + model.motor_needs(angle, speed)
        found.torque_nm.append(model.reported(torque))
    return found


def resting_twist(model: Model, motor_rad: float) -> float:
    """Wind-up (rad) by which the load's own torque hangs at rest behind a motor at an angle (rad)."""
    twist = 0.0
    for _ in range(50):  # the wind-up is tiny: this contracts fast
        needed = float(model.load_needs(motor_rad - twist, 0.0))
        stiffness = float(model.stiffness_nm_rad or np.inf) + model.effects.cubic_nm_rad3 * twist**2
        twist = needed / stiffness
    return twist
