"""Discrepancies: torque that follows a coordinate in a way that has no name, as Gaussian processes.

Over angle, speed and torque by direction (two curves each), acceleration, time in the motion, a level per run by
direction, and over two at once: angle and speed, angle and torque, torque and time. Their sizes are a ladder, of which
the evidence takes what it needs.
"""

from __future__ import annotations

import numpy as np

from schwung.explain.weighing.along import Along, Ranges
from schwung.explain.weighing.candidate import LADDER, Candidate, Curve, Plane, Shape
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: Speeds are told apart the finer the slower they are, down to this share of the peak.
_SLOW = 0.02
#: Names that are cases of a curve: where the curve stands, they say nothing more.
_CASES = {
    "position": ("coulomb_friction", "asymmetric_friction", "local_friction", "friction_over_angle"),
    "speed": (
        "coulomb_friction",
        "asymmetric_friction",
        "viscous_friction",
        "quadratic_drag",
        "stribeck_friction",
    ),
}


def unnamed(of: Ranges, torque_nm: float) -> list[Candidate]:
    """All of them; `torque_nm`: a natural torque."""
    angle = Curve.over(of.low_rad, of.high_rad, 0.15, 65)
    end = float(np.arcsinh(1 / _SLOW))
    speed = Curve.over(0.0, end, 0.2)
    acceleration = Curve.over(-of.peak_acceleration_rad_s2, of.peak_acceleration_rad_s2, 0.3)
    torque = Curve.over(0.0, of.peak_torque_nm, 0.3)
    time = Curve.over(0.0, of.longest_s, 0.08, 97)

    place = Curve.over(of.low_rad, of.high_rad, 0.15, 65)
    pace = Curve.over(-of.peak_speed_rad_s, of.peak_speed_rad_s, 0.5)
    load = Curve.over(-of.peak_torque_nm, of.peak_torque_nm, 0.5)
    while_moving = Curve.over(0.0, of.longest_s, 0.2)
    place_pace, place_load, load_time = (
        Plane.of(place, pace),
        Plane.of(place, load),
        Plane.of(load, while_moving),
    )

    def by_direction(curve: Array, direction: Array) -> Array:
        ahead = direction[:, None]
        return np.concatenate([curve * np.maximum(ahead, 0), curve * np.maximum(-ahead, 0)], 1)

    def over_angle(along: Along, _shape: Shape) -> Effect:
        return Effect(by_direction(angle.at(along.angle), along.direction))

    def over_speed(along: Along, _shape: Shape) -> Effect:
        slow = _SLOW * of.peak_speed_rad_s
        return Effect(by_direction(speed.at(np.arcsinh(np.abs(along.speed) / slow)), along.direction))

    def over_acceleration(along: Along, _shape: Shape) -> Effect:
        return Effect(on_load=acceleration.at(along.load_acceleration))

    def over_torque(along: Along, _shape: Shape) -> Effect:
        return Effect(by_direction(torque.at(np.abs(along.torque)), along.direction))

    def over_time(along: Along, _shape: Shape) -> Effect:
        return Effect(on_load=time.at(along.motion_time_s))

    def over_runs(along: Along, _shape: Shape) -> Effect:
        mine = np.zeros((along.speed.size, of.runs))
        mine[:, along.number] = 1.0
        return Effect(by_direction(mine, along.direction))

    def over_angle_and_speed(along: Along, _shape: Shape) -> Effect:
        return Effect(on_load=place_pace.at(along.load_angle, along.load_speed))

    def over_angle_and_torque(along: Along, _shape: Shape) -> Effect:
        return Effect(place_load.at(along.angle, along.torque))

    def over_torque_and_time(along: Along, _shape: Shape) -> Effect:
        return Effect(load_time.at(along.torque, along.motion_time_s))

    return [
        Candidate(name, effect, (torque_nm,) * size, scales=LADDER, named=False, dry=dry, coordinate=name,
                  cases=frozenset(_CASES.get(name, ())))
        for name, effect, size, dry in (
            ("position", over_angle, 2 * angle.size, True),
            ("speed", over_speed, 2 * speed.size, True),
            ("acceleration", over_acceleration, acceleration.size, False),
            ("torque", over_torque, 2 * torque.size, True),
            ("time_in_motion", over_time, time.size, False),
            ("run", over_runs, 2 * of.runs, False),
            ("position, speed", over_angle_and_speed, place_pace.size, False),
            ("position, torque", over_angle_and_torque, place_load.size, False),
            ("torque, time_in_motion", over_torque_and_time, load_time.size, False),
        )
    ]  # fmt: skip
