"""Torque over two coordinates at once, sampled as the file's `residual` holds it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from schwung.drivetrain.residual_plane import PAIRS, Pair, Plane
from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.motion import Array

#: What the coordinates of candidates are called.
PLANES: dict[str, Pair] = {", ".join(pair): pair for pair in PAIRS}
#: Points over each coordinate.
_POINTS = {"position": 65, "speed": 25, "torque": 25, "time_in_motion": 65}


def drawn_plane(candidate: Candidate, shape: Shape, coefficients: Array, of: Ranges) -> Plane | None:
    """A cause with these coefficients (p,) as a plane; None where it is over one coordinate."""
    pair = PLANES.get(candidate.coordinate)
    if pair is None:
        return None
    ends = {
        "position": (of.low_rad, of.high_rad),
        "speed": (-of.peak_speed_rad_s, of.peak_speed_rad_s),
        "torque": (-of.peak_torque_nm, of.peak_torque_nm),
        "time_in_motion": (0.0, of.longest_s),
    }
    x, y = (np.linspace(*ends[one], _POINTS[one]) for one in pair)
    places = dict(zip(pair, (np.repeat(x, y.size), np.tile(y, x.size)), strict=True))
    nothing = np.zeros(x.size * y.size)
    position, speed = places.get("position", nothing), places.get("speed", nothing)
    made = SimpleNamespace(
        angle=position, load_angle=position, speed=speed, load_speed=speed, ranges=of,
        torque=places.get("torque", nothing), motion_time_s=places.get("time_in_motion", nothing),
    )  # fmt: skip
    motor, load, _, _ = candidate.effect(cast(Along, made), shape).of(coefficients)
    return Plane(pair, x, y, np.asarray(motor + load).reshape(x.size, y.size))
