"""Rest-to-rest motions: what the axis is asked to do.

Every profile is a normalised stroke s(u), u = t/duration in 0…1, s in 0…1, with its first two derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

Array = NDArray[np.float64]
MotionKind = Literal["third", "poly5", "scurve", "cosine", "cycloid", "points"]
#: One point of a motion of the kind "points": share of the stroke, and its derivatives by the share of the duration.
Point = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
#: By how much the points may differ from the cubics between them (shares of the stroke).
_ON_CURVE = 1e-6


@dataclass(frozen=True)
class Demand:
    """Demanded position (rad), speed (rad/s) and acceleration (rad/s²), each (n,)."""

    position_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array


@dataclass(frozen=True)
class _Stroke:
    position: Array
    speed: Array
    acceleration: Array


def _third(u: Array) -> _Stroke:
    """1/3 trapezoid: accelerate, cruise and brake for one third each; peak speed 1.5, acceleration 4.5."""
    position = np.where(
        u < 1 / 3, 2.25 * u**2, np.where(u < 2 / 3, 0.25 + 1.5 * (u - 1 / 3), 1 - 2.25 * (1 - u) ** 2)
    )
    speed = np.where(u < 1 / 3, 4.5 * u, np.where(u < 2 / 3, 1.5, 4.5 * (1 - u)))
    acceleration = np.where(u < 1 / 3, 4.5, np.where(u < 2 / 3, 0.0, -4.5))
    return _Stroke(position, speed, acceleration)


def _poly5(u: Array) -> _Stroke:
    """Fifth-order polynomial with zero speed and acceleration at both ends; peak speed 1.875."""
    return _Stroke(u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - u) * (1 - 2 * u))


def _scurve(u: Array) -> _Stroke:
    """1/3 profile with sine-squared accelerations: jerk-limited; peak speed 1.5, acceleration 9."""
    w = 6 * np.pi  # one full sine-squared bump per third
    up, down = np.minimum(u, 1 / 3), np.maximum(u - 2 / 3, 0.0)

    def bump_speed(v: Array) -> Array:
        return 4.5 * (v - np.sin(w * v) / w)

    def bump_position(v: Array) -> Array:
        return 4.5 * (v**2 / 2 + (np.cos(w * v) - 1) / w**2)

    cruise = np.clip(u - 1 / 3, 0.0, None)
    position = bump_position(up) + 1.5 * cruise - bump_position(down)
    speed = bump_speed(up) - bump_speed(down)
    acceleration = 4.5 * (1 - np.cos(w * u)) * np.where(u < 1 / 3, 1.0, np.where(u < 2 / 3, 0.0, -1.0))
    return _Stroke(position, speed, acceleration)


def _cosine(u: Array) -> _Stroke:
    """Half a cosine: lowest peak acceleration of the smooth ones, with steps of it at both ends."""
    return _Stroke(
        (1 - np.cos(np.pi * u)) / 2, np.pi / 2 * np.sin(np.pi * u), np.pi**2 / 2 * np.cos(np.pi * u)
    )


def _cycloid(u: Array) -> _Stroke:
    """Inclined sine: one full sine of acceleration, smooth at both ends; peak speed 2, acceleration 2π."""
    w = 2 * np.pi
    return _Stroke(u - np.sin(w * u) / w, 1 - np.cos(w * u), w * np.sin(w * u))


def _through(points: Array, u: Array) -> _Stroke:
    """Straight accelerations between points (n, 3) at even shares of the duration."""
    last = len(points) - 1
    i = np.clip((u * last).astype(int), 0, last - 1)
    t = u - i / last
    share, speed, acceleration = points[i].T
    rise = (points[i + 1, 2] - acceleration) * last
    return _Stroke(
        share + t * (speed + t * (acceleration / 2 + t * rise / 6)),
        speed + t * (acceleration + t * rise / 2),
        acceleration + t * rise,
    )


_STROKES: dict[str, Callable[[Array], _Stroke]] = {
    "third": _third,
    "poly5": _poly5,
    "scurve": _scurve,
    "cosine": _cosine,
    "cycloid": _cycloid,
}


def _turned(points: tuple[Point, ...]) -> tuple[Point, ...]:
    """The same way the other way round in time."""
    return tuple((1 - share, speed, -acceleration) for share, speed, acceleration in reversed(points))


class Motion(BaseModel):
    """A rest-to-rest motion, as stored in a run's `motion` attribute.

    The axis rests for `start_time_s`, moves `distance_rad` (signed) within `duration_s`, rests for `dwell_s`,
    and, where it `returns`, moves back and rests for `dwell_s` again.

    The kind "points" goes through `points`, at even shares of the duration, its acceleration straight between them;
    back through `points_back`, which count from where the way back begins, or else as it came, the other way round in
    time. `demand(time)` gives the demand at instants (s), arrays of shape (n,) in rad, rad/s and rad/s².

    Raises pydantic's ValidationError, a ValueError, for numbers that are no motion.

    >>> motion = schwung.Motion(kind="poly5", distance_rad=3.14, duration_s=0.25)
    >>> round(motion.total_s, 3), round(motion.peak_speed_rad_s, 1)
    (0.8, 23.6)
    """

    model_config = ConfigDict(frozen=True, extra="allow")

    kind: MotionKind = "third"
    distance_rad: float = Field(allow_inf_nan=False)
    duration_s: float = Field(gt=0, allow_inf_nan=False)
    start_time_s: float = Field(default=0.1, ge=0, allow_inf_nan=False)
    returns: bool = True
    dwell_s: float = Field(default=0.1, ge=0, allow_inf_nan=False)
    points: tuple[Point, ...] | None = None
    points_back: tuple[Point, ...] | None = None

    @model_validator(mode="after")
    def _points_are_a_stroke(self) -> Motion:
        if (self.kind == "points") != (self.points is not None):
            raise ValueError('points are given with the kind "points", and only with that')
        for name in ("points", "points_back"):
            given = getattr(self, name)
            if given is None:
                continue
            points = np.array(given)
            ends = len(points) > 1 and np.allclose(points[[0, -1], :2], [[0, 0], [1, 0]], atol=_ON_CURVE)
            if not ends:
                raise ValueError(f"{name} do not lead from 0 to 1, at rest at both ends")
            before = np.nextafter(np.linspace(0, 1, len(points))[1:], 0)
            reached = _through(points, before)
            if not (
                np.allclose(reached.position, points[1:, 0], rtol=0, atol=_ON_CURVE)
                and np.allclose(reached.speed, points[1:, 1], rtol=0, atol=_ON_CURVE * len(points))
            ):
                raise ValueError(f"{name} do not lie on one curve of straight accelerations")
        return self

    @model_serializer(mode="wrap")
    def _without_absent_points(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        kept: dict[str, Any] = handler(self)
        return {k: v for k, v in kept.items() if v is not None or k not in ("points", "points_back")}

    def way_back(self) -> Motion:
        """The motion that undoes this one, on its own."""
        changes: dict[str, Any] = {"distance_rad": -self.distance_rad}
        if self.points is not None:
            changes |= {"points": self.points_back or _turned(self.points), "points_back": self.points}
        return self.model_copy(update=changes)

    def _stroke(self, u: Array, back: bool) -> _Stroke:
        if self.points is None:
            return _STROKES[self.kind](u)
        if not back:
            return _through(np.array(self.points), u)
        return _through(np.array(self.points_back or _turned(self.points)), u)

    @property
    def stroke_starts_s(self) -> tuple[float, ...]:
        """When each stroke starts, in the run's time (s)."""
        first = self.start_time_s
        return (first, first + self.duration_s + self.dwell_s) if self.returns else (first,)

    @property
    def end_s(self) -> float:
        """When the last stroke has come to rest (s)."""
        return self.stroke_starts_s[-1] + self.duration_s

    @property
    def total_s(self) -> float:
        """Length of a run, the last dwell included (s)."""
        return self.end_s + self.dwell_s

    @property
    def peak_speed_rad_s(self) -> float:
        """Highest demanded speed, unsigned."""
        return float(np.max(np.abs(self._fine().speed_rad_s)))

    @property
    def peak_acceleration_rad_s2(self) -> float:
        """Highest demanded acceleration, unsigned."""
        return float(np.max(np.abs(self._fine().acceleration_rad_s2)))

    def _fine(self) -> Demand:
        return self.demand(self.start_time_s + self.duration_s * np.linspace(0.0, 1.0, 2001))

    def time(self, sample_rate_hz: float) -> Array:
        """Sample instants of a whole run, 0 at the start trigger (s), (n,)."""
        return np.arange(round(self.total_s * sample_rate_hz) + 1) / sample_rate_hz

    def moving(self, time: Array) -> NDArray[np.bool_]:
        """True where the demand is within a stroke, (n,)."""
        starts = self.stroke_starts_s
        return np.asarray(np.any([(time >= s) & (time <= s + self.duration_s) for s in starts], axis=0))

    def demand(self, time: Array) -> Demand:
        """Demand at the given instants (s), relative to where the axis rests at first."""
        position, speed, acceleration = (np.zeros_like(time, dtype=float) for _ in range(3))
        for start, sign in zip(self.stroke_starts_s, (1.0, -1.0), strict=False):
            u = (time - start) / self.duration_s
            stroke = self._stroke(np.clip(u, 0.0, 1.0), back=sign < 0)
            inside = (u >= 0) & (u < 1)
            scale = sign * self.distance_rad
            position += scale * stroke.position
            speed += np.where(inside, scale * stroke.speed / self.duration_s, 0.0)
            acceleration += np.where(inside, scale * stroke.acceleration / self.duration_s**2, 0.0)
        return Demand(position, speed, acceleration)
