"""Discrepancies: torque that follows a coordinate in a way that has no name, as Gaussian processes.

Over angle, speed and torque by direction (two curves each), acceleration, time in the motion, a level per run by
direction, and over two at once: angle and speed, angle and torque, torque and time. Their sizes are a ladder, of which
the evidence takes what it needs.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import LADDER, SMALL, Candidate, Shape
from schwung.explain.causes.curves import Curve, Plane, column, curve_over_time
from schwung.explain.causes.joined import run_by_run
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: What a unit of each coefficient of a curve does, and all that it does with these.
_Both = tuple[Callable[[Along, Shape], Effect], Callable[[Along, Shape, Array], Effect]]
#: Speeds are told apart the finer the slower they are, down to this share of the peak.
_SLOW = 0.02
#: Family of what follows the torque or the acceleration. Of two the equation of motion itself can be made,
#: c T = c (J α + friction): it takes nothing, and carries of friction what its prior makes cheap.
_BALANCE = "balance"
#: What scales the torque, in one way or another.
_SCALES = (
    "torque_constant",
    "torque_constant_drop",
    "torque_constant_fade",
    "torque_ripple",
    "torque_saturation",
)
#: What makes it late.
_LATE = ("torque_lag", "torque_filter")
#: Names that are cases of a curve, or cancel it: where the curve stands, they say nothing more.
_CASES = {
    "position": ("coulomb_friction", "asymmetric_friction", "local_friction", "friction_over_angle"),
    "speed": (
        "coulomb_friction",
        "asymmetric_friction",
        "viscous_friction",
        "quadratic_drag",
        "stribeck_friction",
    ),
    "run": (
        "coulomb_friction",
        "asymmetric_friction",
        "stribeck_friction",
        "friction_over_angle",
        "friction_drift",
        "torque_offset",
        "offset_drift",
    ),
    "acceleration": ("load_inertia", "inertia_profile", *_SCALES, *_LATE),
    "torque": (*_SCALES, *_LATE),
    "position, torque": (*_SCALES, *_LATE),
    "torque, time_in_motion": (*_SCALES, *_LATE),
}


def unnamed(of: Ranges, torque_nm: float) -> list[Candidate]:
    """All of them; `torque_nm`: a natural torque."""
    angle = Curve.over(of.low_rad, of.high_rad, 0.15, 65)
    end = float(np.arcsinh(1 / _SLOW))
    speed = Curve.over(0.0, end, 0.2)
    acceleration = Curve.over(-of.peak_acceleration_rad_s2, of.peak_acceleration_rad_s2, 0.3)
    torque = Curve.over(0.0, of.peak_torque_nm, 0.3)
    own = of.one_motion  # then nothing tells what follows from the time from what follows from anything else
    time = curve_over_time(of.longest_s) if own else Curve.over(0.0, of.longest_s, 0.08, 97)

    place = Curve.over(of.low_rad, of.high_rad, 0.15, 65)
    pace = Curve.over(-of.peak_speed_rad_s, of.peak_speed_rad_s, 0.5)
    load = Curve.over(-of.peak_torque_nm, of.peak_torque_nm, 0.5)
    while_moving = Curve.over(0.0, of.longest_s, 0.2)
    place_pace, place_load, load_time = (
        Plane.of(place, pace),
        Plane.of(place, load),
        Plane.of(load, while_moving),
    )

    slow = _SLOW * of.peak_speed_rad_s

    def ways(along: Along) -> Array:
        return np.arcsinh(np.abs(along.speed) / slow)

    def of_both(curve: Curve, where: Callable[[Along], Array]) -> _Both:
        """A curve for each direction."""

        def whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
            return Effect(curve.folded_by_direction(where(along), along.direction, coefficients))

        return lambda along, _: Effect(curve.by_direction(where(along), along.direction)), whole

    def of_load(curve: Curve, where: Callable[[Along], Array]) -> _Both:
        """One curve, on the load."""

        def whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
            return Effect(on_load=curve.folded(coefficients).at(where(along)))

        return lambda along, _: Effect(on_load=curve.at(where(along))), whole

    @run_by_run
    def over_runs(along: Along, _shape: Shape) -> Effect:
        found = np.zeros((along.speed.size, 2 * of.runs))
        if along.number < of.runs:  # of a run that is yet to come nothing of its own is known
            found[:, along.number] = np.maximum(along.direction, 0)
            found[:, of.runs + along.number] = np.maximum(-along.direction, 0)
        return Effect(found)

    @run_by_run
    def over_runs_whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
        if along.number >= of.runs:
            return Effect(column(np.zeros(along.speed.size)))
        ahead, back = coefficients[along.number], coefficients[of.runs + along.number]
        return Effect(column(ahead * np.maximum(along.direction, 0) + back * np.maximum(-along.direction, 0)))

    def over_angle_and_speed(along: Along, _shape: Shape) -> Effect:
        return Effect(on_load=place_pace.at(along.load_angle, along.load_speed))

    def over_angle_and_speed_whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
        return Effect(on_load=place_pace.folded(along.load_angle, along.load_speed, coefficients))

    def over_angle_and_torque(along: Along, _shape: Shape) -> Effect:
        return Effect(place_load.at(along.angle, along.torque))

    def over_angle_and_torque_whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
        return Effect(place_load.folded(along.angle, along.torque, coefficients))

    def over_torque_and_time(along: Along, _shape: Shape) -> Effect:
        return Effect(load_time.at(along.torque, along.motion_time_s))

    def over_torque_and_time_whole(along: Along, _shape: Shape, coefficients: Array) -> Effect:
        return Effect(load_time.folded(along.torque, along.motion_time_s, coefficients))

    def heavier(along: Along, _shape: Shape, coefficients: Array) -> Array:
        return -acceleration.slope(along.load_acceleration, coefficients)

    return [
        Candidate(name, effect, (torque_nm,) * size, scales=SMALL if own and "time_in_motion" in name else LADDER,
                  named=False, of_motion=own and "time_in_motion" in name, coordinate=name,
                  family=_BALANCE if "torque" in name or name == "acceleration" else "",
                  cases=frozenset(_CASES.get(name, ())), whole=whole,
                  heavier=heavier if name == "acceleration" else None)
        for name, (effect, whole), size in (
            ("position", of_both(angle, lambda a: a.angle), 2 * angle.size),
            ("speed", of_both(speed, ways), 2 * speed.size),
            ("acceleration", of_load(acceleration, lambda a: a.load_acceleration), acceleration.size),
            ("torque", of_both(torque, lambda a: np.abs(a.torque)), 2 * torque.size),
            ("time_in_motion", of_load(time, lambda a: a.motion_time_s), time.size),
            ("run", (over_runs, over_runs_whole), 2 * of.runs),
            ("position, speed", (over_angle_and_speed, over_angle_and_speed_whole), place_pace.size),
            ("position, torque", (over_angle_and_torque, over_angle_and_torque_whole), place_load.size),
            ("torque, time_in_motion", (over_torque_and_time, over_torque_and_time_whole), load_time.size),
        )
    ]  # fmt: skip
