"""What is asked of a motion, and what comes back: plain values, SI, angles absolute unless they say share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array, Motion

Objective = Literal["copper", "energy", "peak", "vibration", "fastest"]


@dataclass(frozen=True)
class MotionLimits:
    """Within what a motion has to stay; None: no limit. Window and speed hold for motor and load alike.

    Attributes, numbers without a shape: `torque_max_nm` (N·m), `position_min_rad` and `position_max_rad` (rad),
    `speed_max_rad_s` (rad/s), `jerk_max_rad_s3` (rad/s³), `following_error_rad` (rad). Raises InputError for a limit
    that is not above zero.

    >>> schwung.MotionLimits(torque_max_nm=40.0, speed_max_rad_s=60.0).jerk_max_rad_s3 is None
    True
    """

    torque_max_nm: float
    position_min_rad: float | None = None
    position_max_rad: float | None = None
    speed_max_rad_s: float | None = None
    jerk_max_rad_s3: float | None = None  # of motor and load
    following_error_rad: float | None = None  # of the closed loop; checked, not planned with

    def __post_init__(self) -> None:
        for name in ("torque_max_nm", "speed_max_rad_s", "jerk_max_rad_s3", "following_error_rad"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(name, f"is {value:g}", "Give a positive number.")


@dataclass(frozen=True)
class Task:
    """One rest-to-rest motion to be found.

    `weights`: what is minimised, each divided by what the fifth-order polynomial has of it. `duration_s` None: as fast
    as the limits allow; `weights` are then not asked. `payloads_kgm2`: load inertias on top of the machine's, all of
    which the motion has to keep its limits with. `band_sigmas`: likewise with the whole table so many of its standard
    deviations higher and lower. Numbers without a shape, in rad, s and kg·m². Raises InputError where that is no task.

    >>> schwung.Task(0.0, 3.14, schwung.MotionLimits(torque_max_nm=40.0), duration_s=0.2).ends_rad
    (0.0, 3.14)
    """

    start_rad: float
    distance_rad: float
    limits: MotionLimits
    duration_s: float | None = None
    weights: Mapping[Objective, float] = field(default_factory=lambda: {"copper": 1.0})
    regeneration: bool = True
    payloads_kgm2: tuple[float, ...] = (0.0,)
    band_sigmas: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.distance_rad) and self.distance_rad != 0):
            raise InputError("--distance", f"is {self.distance_rad:g}", "Give the stroke in rad, signed.")
        if self.duration_s is not None and not (math.isfinite(self.duration_s) and self.duration_s > 0):
            raise InputError("--duration", f"is {self.duration_s:g}", "Give a positive time.")
        if not self.weights or min(self.weights.values()) < 0 or max(self.weights.values()) <= 0:
            raise InputError("--objective", "has no weight above 0", "Give one, e.g. copper=1.")
        low, high = self.limits.position_min_rad, self.limits.position_max_rad
        for end in self.ends_rad:
            if (low is not None and end < low) or (high is not None and end > high):
                raise InputError(
                    "--distance",
                    f"leads to {end:.4g} rad, out of the window {_number(low)} … {_number(high)} rad",
                    "Shorten or turn the stroke, or widen the window.",
                )

    @property
    def ends_rad(self) -> tuple[float, float]:
        """Where the motor stands before and after (rad)."""
        return self.start_rad, self.start_rad + self.distance_rad


def _number(value: float | None) -> str:
    return "-∞" if value is None else f"{value:.4g}"


@dataclass(frozen=True, eq=False)
class Stroke:
    """The best motion of one stroke: at the nodes of an even grid, (n,).

    Between nodes the acceleration is straight. `torque_nm` is the motor's, of the first of the loads planned for.
    """

    start_rad: float
    distance_rad: float
    duration_s: float
    share: Array  # of the distance
    speed_share: Array  # its derivatives by the share of the duration
    acceleration_share: Array
    torque_nm: Array
    load_position_rad: Array
    load_speed_rad_s: Array
    hold_start_nm: float  # what holds the axis before
    hold_end_nm: float  # and after
    objective: float  # as IPOPT has it: 1 is the fifth-order polynomial's
    iterations: int
    active: Mapping[str, float] = field(default_factory=dict)  # share of the time at each limit

    @property
    def time_s(self) -> Array:
        """Instants of the nodes (s)."""
        return np.linspace(0.0, self.duration_s, self.share.size)

    @property
    def points(self) -> tuple[tuple[float, float, float], ...]:
        """As a `Motion` of the kind "points" has them, to nine digits: an attribute of HDF5 holds 64 kB."""
        columns = (self.share, self.speed_share, self.acceleration_share)
        rows = zip(*columns, strict=True)
        return tuple(tuple(float(f"{x:.9g}") for x in row) for row in rows)  # type: ignore[misc]

    def motion(self, back: Stroke | None = None, **timing: float) -> Motion:
        """The motion that commissioning plays; `back`: the way back, absent: it does not return."""
        return Motion.model_validate(
            {
                "kind": "points",
                "distance_rad": self.distance_rad,
                "duration_s": self.duration_s,
                "returns": back is not None,
                "points": self.points,
                "points_back": None if back is None else back.points,
                **timing,
            }
        )
