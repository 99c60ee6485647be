"""Several runs as one, one behind another: what follows the coordinates alone is worked out of all of them at once.

A run is a thousand samples or two, of which numpy takes longer to be asked than to answer. What goes from sample to
sample (filters, bristles, a further mass), or has a number of its own in each run, is asked for run by run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import numpy as np

from schwung.explain.causes.along import Along
from schwung.innovations.effect import Effect
from schwung.motion import Array

P = ParamSpec("P")
R = TypeVar("R")


def _of_each(name: str) -> Any:
    """A coordinate of every run."""

    def coordinate(self: Joined) -> Array:
        return np.concatenate([getattr(part, name) for part in self.parts])

    return cached_property(coordinate)


@dataclass(frozen=True, eq=False)
class Joined(Along):
    """Coordinates of several runs about one machine; arrays (N,), N all their samples. Where runs have each their own
    number, so has each sample (`share`); what belongs to one run (`run`, `number`) is that of the first.
    """

    parts: Sequence[Along] = ()
    turning: dict[float, Array] = field(default_factory=dict)  # by their orders: what turns with the angle

    @classmethod
    def of(cls, parts: Sequence[Along]) -> Joined:
        """These runs, of which there is one at least."""
        own = {each.name: getattr(parts[0], each.name) for each in fields(Along)}
        return cls(**{**own, "kept": {}, "met": None}, parts=tuple(parts))

    @cached_property
    def wheres(self) -> list[slice]:
        """Where each run is."""
        ends = np.cumsum([part.speed.size for part in self.parts]).tolist()
        return [slice(start, end) for start, end in zip([0, *ends[:-1]], ends, strict=True)]

    @cached_property
    def step_s(self) -> Array:
        """Of each sample's run."""
        return np.concatenate([np.full(part.speed.size, part.step_s) for part in self.parts])

    @cached_property
    def ends(self) -> Array:
        """The first and the last sample of each run."""
        return np.array([place for where in self.wheres for place in (where.start, where.stop - 1)])

    @cached_property
    def share(self) -> Array:  # type: ignore[override]  # of each sample
        return np.concatenate([np.full(part.speed.size, part.share) for part in self.parts])

    time_s = _of_each("time_s")
    motion_time_s = _of_each("motion_time_s")
    angle = _of_each("angle")
    load_angle = _of_each("load_angle")
    speed = _of_each("speed")
    load_speed = _of_each("load_speed")
    direction = _of_each("direction")
    load_direction = _of_each("load_direction")
    moves = _of_each("moves")
    acceleration = _of_each("acceleration")
    acceleration_before = _of_each("acceleration_before")
    jerk_before = _of_each("jerk_before")
    accelerated = _of_each("accelerated")
    load_acceleration = _of_each("load_acceleration")
    torque = _of_each("torque")
    torque_rate = _of_each("torque_rate")
    torque_bend = _of_each("torque_bend")
    reported_rate = _of_each("reported_rate")
    reported_bend = _of_each("reported_bend")
    beyond_band = _of_each("beyond_band")
    twist = _of_each("twist")
    twist_speed = _of_each("twist_speed")
    contact = _of_each("contact")
    push_slopes = _of_each("push_slopes")


def run_by_run(asked: Callable[Concatenate[Along, P], R]) -> Callable[Concatenate[Along, P], R]:
    """What is asked of one run, of each where several are joined: effects and arrays one behind another."""

    @wraps(asked)
    def of_all(along: Along, /, *arguments: P.args, **options: P.kwargs) -> R:
        if not isinstance(along, Joined):
            return asked(along, *arguments, **options)
        return cast(R, behind([asked(part, *arguments, **options) for part in along.parts]))

    return of_all


def behind(found: Sequence[Any]) -> Any:
    """What runs answered, one behind another: arrays, effects, or several of these."""
    first = found[0]
    if isinstance(first, Effect):
        return Effect(*(None if part[0] is None else np.concatenate(part)
                        for part in zip(*(one.parts for one in found), strict=True)))  # fmt: skip
    if isinstance(first, tuple):
        return tuple(behind(each) for each in zip(*found, strict=True))
    return np.concatenate(found)
