"""Curves of causes over their coordinate: what they add to the torque forward and backward, with deviations."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np

from schwung.drivetrain.residual import UNDIRECTED, Over
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.motion import Array

#: Points of a curve; of a law that swings, so many for each period.
_POINTS, _PER_PERIOD = 65, 16
#: Speeds are told apart the finer the slower they are, down to this share of the peak.
_SLOW = 0.02


@dataclass(frozen=True, eq=False)
class Drawn:
    """Torque (N·m) over a coordinate; (n,) each, deviations too. Where direction does not matter, both are the same."""

    over: Over
    x: Array
    forward_nm: Array
    forward_std_nm: Array
    backward_nm: Array
    backward_std_nm: Array

    @property
    def directed(self) -> bool:
        """Whether the direction of motion matters."""
        return self.over not in UNDIRECTED and not np.array_equal(self.forward_nm, self.backward_nm)


#: What a candidate's coordinate is called in a file; None of the others can be drawn as a torque.
_OVER: dict[str, Over] = {
    "position": "position",
    "speed": "speed",
    "direction": "speed",
    "torque": "torque",
    "run": "run",
    "acceleration": "acceleration",
    "time_in_motion": "time_in_motion",
    "wind_up": "wind_up",
}


def drawn(
    candidate: Candidate, shape: Shape, coefficients: Array, covariance: Array, of: Ranges
) -> Drawn | None:
    """The curve of a cause with these coefficients (p,), covariance (p, p); None where it is no such torque."""
    over = _OVER.get(candidate.coordinate)
    if (
        over is None
        or (over == "torque" and candidate.named)
        or candidate.of_machine
        or candidate.bent is not None
    ):
        return None
    x = _grid(over, of, max(shape[:1], default=0.0) if candidate.name in ("cogging",) else 0.0)
    sides = []
    for way in (1.0, -1.0):
        columns = _columns(candidate, shape, over, x, way, of)
        if columns is None:
            return None
        deviation = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", columns, covariance, columns), 0.0))
        sides += [columns @ coefficients, deviation]
    if candidate.effect(_probe(over, x[:1], 1.0, of), shape).on_load is not None and over == "position":
        over = "load_position"
    return Drawn(over, x, *sides)


def _grid(over: Over, of: Ranges, order: float) -> Array:
    if over == "position":
        points = max(_POINTS, int(_PER_PERIOD * order * of.span_rad / (2 * np.pi)))
        return np.linspace(of.low_rad, of.high_rad, points)
    if over == "speed":
        slow = _SLOW * of.peak_speed_rad_s
        return np.asarray(slow * np.sinh(np.linspace(0.0, np.arcsinh(1 / _SLOW), _POINTS)))
    if over == "torque":
        return np.linspace(0.0, of.peak_torque_nm, _POINTS)
    if over == "run":
        return np.linspace(0.0, 1.0, max(of.runs, 2))
    if over in ("acceleration", "wind_up"):
        end = of.peak_acceleration_rad_s2 if over == "acceleration" else of.wound_rad
        return np.linspace(-end, end, _POINTS)
    return np.linspace(0.0, of.longest_s, 97)


def _probe(over: Over, x: Array, way: float, of: Ranges) -> Along:
    """A run that would go through these coordinates, in one direction."""
    nothing, ahead = np.zeros_like(x), np.full_like(x, way)
    angle = x if over in ("position", "load_position") else nothing
    speed = way * x if over == "speed" else way * np.full_like(x, of.peak_speed_rad_s)
    torque = x if over == "torque" else nothing
    made = SimpleNamespace(
        angle=angle, load_angle=angle, speed=speed, load_speed=speed, direction=ahead, load_direction=ahead,
        torque=torque, acceleration=nothing, load_acceleration=x if over == "acceleration" else nothing,
        motion_time_s=x if over == "time_in_motion" else nothing, ranges=of, number=0,
        share=x if over == "run" else 1.0, wound=x if over == "wind_up" else nothing,
    )  # fmt: skip
    return cast(Along, made)


def _columns(
    candidate: Candidate, shape: Shape, over: Over, x: Array, way: float, of: Ranges
) -> Array | None:
    """What a unit of each coefficient adds, (n, p)."""
    if over == "run" and not candidate.named:
        rows = []
        for number in range(x.size):
            probe = _probe(over, x[:1], way, of)
            probe.__dict__["number"] = min(number, of.runs - 1)
            rows.append(candidate.effect(probe, shape).parts[0])
        return np.concatenate([row for row in rows if row is not None])
    try:
        motor, load, position, speed = candidate.effect(_probe(over, x, way, of), shape).parts
    except AttributeError:  # it asks for what no such run has: the shaft, rates of the torque
        return None
    if over == "wind_up":  # as it is told of the load
        return load
    if position is not None or speed is not None or (motor is not None and load is not None):
        return None
    return motor if motor is not None else load
