"""Our motion beside its rivals, each judged by the same integrator and the same merits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from schwung.drivetrain import Machine
from schwung.errors import InputError
from schwung.motion import Array, Demand, Motion, MotionKind
from schwung.optimise.closed_loop import require_followed
from schwung.optimise.dynamics import Followed, Merits, follow, follow_demand, merits_of, sampled
from schwung.optimise.model import Model, models_of, not_planned
from schwung.optimise.rivals import chebyshev_stroke, shaped_demand, toppra_stroke
from schwung.optimise.solve import NoMotionError, best_stroke
from schwung.optimise.values import Objective, Stroke, Task

#: A limit counts as kept that is passed by no more than this share: what lies between the points of the grid.
KEPT = 0.01

#: The longest that a standard profile is given to keep the limits (s).
_LONGEST_S = 30.0

#: The standard profiles, by their names.
STANDARD = {
    "third": "1/3 trapezoid",
    "poly5": "fifth-order polynomial",
    "scurve": "S-curve",
    "cosine": "cosine",
    "cycloid": "cycloid",
}


@dataclass(frozen=True, eq=False)
class Contender:
    """One motion, what it does to the machine, and which limits it breaks there."""

    name: str
    followed: Followed
    merits: Merits
    broken: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """Of the stroke (s)."""
        return self.followed.duration_s


@dataclass(frozen=True, eq=False)
class Comparison:
    """Ours, there and back, and the rivals; `left_out`: [[physics]] that the plan does not know."""

    task: Task
    stroke: Stroke
    back: Stroke
    ours: Contender
    rivals: tuple[Contender, ...]
    left_out: tuple[str, ...]

    @property
    def reference(self) -> Contender:
        """The 1/3 trapezoid, which machines are commissioned with."""
        return self.rivals[0]


def optimise(machine: Machine, task: Task, rivals: bool = True) -> Comparison:
    """The best motion of a task, there and back, beside its rivals (the standard ones only, where not `rivals`).

    Raises InputError and NoMotionError as `best_stroke`.
    """
    machine.require_torque("the best motion")
    stroke, back = there_and_back(machine, task)
    require_followed(machine, task, stroke)
    ours = contender(machine, task, "optimised", follow(machine, stroke.motion(), task.start_rad))
    others = tuple(contenders(machine, task, stroke.duration_s, rivals))
    return Comparison(task, stroke, back, ours, others, not_planned(machine))


def there_and_back(machine: Machine, task: Task) -> tuple[Stroke, Stroke]:
    """The best stroke and the best way back in one time: the slower one's where the fastest is asked for."""
    stroke = best_stroke(machine, task)
    returning = replace(task, start_rad=task.ends_rad[1], distance_rad=-task.distance_rad)
    back = best_stroke(machine, returning)
    if back.duration_s > stroke.duration_s:
        stroke = _in_time(machine, task, stroke, back)
    elif back.duration_s < stroke.duration_s:
        back = _in_time(machine, returning, back, stroke)
    return stroke, back


def _in_time(machine: Machine, task: Task, faster: Stroke, other: Stroke) -> Stroke:
    """A stroke that would be faster, in the other's time (and on its grid), and so with less peak torque."""
    slower = replace(task, duration_s=other.duration_s, weights={"peak": 1.0})
    return best_stroke(machine, slower, intervals=other.share.size - 1, start=faster)


def contenders(
    machine: Machine, task: Task, duration_s: float, all_of_them: bool = True
) -> Iterator[Contender]:
    """The rivals in the time that ours takes; the 1/3 trapezoid first, TOPP-RA in its own time where the fastest is
    asked for."""
    for kind in get_args(MotionKind):
        if kind in STANDARD:
            motion = Motion(kind=kind, distance_rad=task.distance_rad, duration_s=duration_s)
            yield contender(machine, task, STANDARD[kind], follow(machine, motion, task.start_rad))
    model = model_for(machine, task, duration_s)
    time = sampled(machine, duration_s)
    for shaper in ("zv", "zvd"):
        demand = shaped_demand(model, shaper, task.distance_rad, duration_s, task.ends_rad[1], time)
        if demand is not None:
            followed = follow_demand(machine, demand, duration_s, task.start_rad)
            yield contender(machine, task, f"1/3 trapezoid, {shaper.upper()} shaped", followed)
    if not all_of_them:
        return
    found = chebyshev_stroke(model, task, duration_s)
    yield contender(
        machine, task, "Chebyshev, genetic", follow_shares(machine, task, duration_s, found.shares)
    )
    if task.duration_s is None:
        try:
            fastest = toppra_stroke(model, task)
        except (InputError, ImportError):
            return
        demand = fastest.demand(sampled(machine, fastest.duration_s))
        yield contender(
            machine, task, "TOPP-RA", follow_demand(machine, demand, fastest.duration_s, task.start_rad)
        )


def model_for(machine: Machine, task: Task, duration_s: float) -> Model:
    """The machine as the rivals have it."""
    limit = min(task.limits.torque_max_nm, machine.motor.peak_torque_nm)
    return models_of(machine, task.ends_rad, abs(task.distance_rad) / duration_s, limit)[0]


def shortest_profile(machine: Machine, task: Task, kind: MotionKind) -> float:
    """In how short a time a standard profile keeps the task's limits (s), to a thousandth of it.

    Raises NoMotionError where it keeps them in no time.
    """
    low, high = 1e-3, _LONGEST_S

    def keeps(duration_s: float) -> bool:
        motion = Motion(kind=kind, distance_rad=task.distance_rad, duration_s=duration_s)
        return not contender(machine, task, kind, follow(machine, motion, task.start_rad)).broken

    first = math.sqrt(low * high)
    if keeps(first):
        high = first
    elif keeps(
        high
    ):  # not asked where there is no need: so long a motion takes as long as all others to follow
        low = first
    else:
        raise NoMotionError(
            "limits", f"a {STANDARD[kind]} keeps them in no time", "Allow more, or choose another profile."
        )
    while high > 1.001 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if keeps(middle) else (middle, high)
    return high


def follow_shares(machine: Machine, task: Task, duration_s: float, shares: object) -> Followed:
    """A motion that is given as a function of the share of its duration: share and two derivatives, (3, n)."""
    time = sampled(machine, duration_s)
    u = np.clip(time / duration_s, 0.0, 1.0)
    share, speed, acceleration = shares(u)  # type: ignore[operator]
    moving: Array = np.where(time < duration_s, task.distance_rad, 0.0)
    demand = Demand(
        task.distance_rad * share, moving * speed / duration_s, moving * acceleration / duration_s**2
    )
    return follow_demand(machine, demand, duration_s, task.start_rad)


def contender(machine: Machine, task: Task, name: str, followed: Followed) -> Contender:
    """Judge a motion: merits, and which limits it breaks on the flexible machine."""
    limits, merits = task.limits, merits_of(machine, followed)
    torque = min(limits.torque_max_nm, machine.motor.peak_torque_nm)
    broken = ["torque"] if merits.peak_torque_nm > (1 + KEPT) * torque else []
    curve = machine.motor.torque_over_speed
    if curve is not None:
        speeds, torques = np.array(curve).T
        allowed = np.interp(np.abs(followed.speed_rad_s), speeds, torques)
        if np.any(np.abs(followed.torque_nm) > allowed + KEPT * torque):
            broken.append("torque over speed")
    fastest = max(merits.peak_speed_rad_s, float(np.max(np.abs(followed.load_speed_rad_s))))
    if limits.speed_max_rad_s is not None and fastest > (1 + KEPT) * limits.speed_max_rad_s:
        broken.append("speed")
    if limits.jerk_max_rad_s3 is not None:
        jerk = np.abs(np.diff(followed.acceleration_rad_s2)) / np.diff(followed.time_s)
        if float(np.max(jerk)) > (1 + KEPT) * limits.jerk_max_rad_s3:
            broken.append("jerk")
    room = KEPT * abs(task.distance_rad)
    both = np.concatenate([followed.position_rad, followed.load_position_rad])
    if (limits.position_max_rad is not None and float(np.max(both)) > limits.position_max_rad + room) or (
        limits.position_min_rad is not None and float(np.min(both)) < limits.position_min_rad - room
    ):
        broken.append("window")
    return Contender(name, followed, merits, tuple(broken))


def merit(machine: Machine, name: Objective, contender: Contender, regeneration: bool = True) -> float:
    """One merit as a number that is the better the smaller it is."""
    merits = contender.merits
    drawn = merits.drawn_j if regeneration else merits.drawn_one_way_j
    return {
        "copper": merits.copper_n2m2s,
        "energy": float("nan") if drawn is None else drawn,
        "peak": merits.peak_torque_nm,
        "vibration": merits.residual_rad,
        "fastest": contender.duration_s,
    }[name]
