"""What one merit costs in another: copper over the time of the stroke, or two objectives against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.drivetrain import Machine
from schwung.errors import InputError
from schwung.motion import Motion
from schwung.optimise.dynamics import Merits, follow, merits_of
from schwung.optimise.solve import best_stroke
from schwung.optimise.values import Objective, Task

#: Points of a front.
POINTS = 9
#: The slowest motion of a front over time, in times of the fastest.
SLOWEST = 3.0


@dataclass(frozen=True)
class Point:
    """One best motion."""

    duration_s: float
    weights: dict[Objective, float]
    merits: Merits


def front(machine: Machine, task: Task, points: int = POINTS) -> tuple[Point, ...]:
    """The Pareto front of a task: over its time where the fastest is asked for, else between its two objectives.

    Raises InputError where it has another number of objectives, and as `best_stroke`.
    """
    if task.duration_s is None:
        shortest = best_stroke(machine, task)
        first = Point(shortest.duration_s, {"fastest": 1.0}, _merits(machine, task, shortest.motion()))
        times = np.geomspace(shortest.duration_s, SLOWEST * shortest.duration_s, points)[1:]
        return (first, *(_point(machine, replace(task, duration_s=float(time))) for time in times))
    names = [name for name, weight in task.weights.items() if weight > 0]
    if len(names) != 2:
        raise InputError(
            "--front",
            f"has {len(names)} objective{'' if len(names) == 1 else 's'} to weigh",
            "Give --fastest, or two in --objective: copper=1,peak=1.",
        )
    shares = np.linspace(0.0, 1.0, points)
    return tuple(
        _point(machine, replace(task, weights={names[0]: 1.0 - float(share), names[1]: float(share)}))
        for share in shares
    )


def _point(machine: Machine, task: Task) -> Point:
    stroke = best_stroke(machine, task)
    return Point(stroke.duration_s, dict(task.weights), _merits(machine, task, stroke.motion()))


def _merits(machine: Machine, task: Task, motion: Motion) -> Merits:
    return merits_of(machine, follow(machine, motion, task.start_rad))
