"""What all runs of a motion have in common and nothing in the vocabulary carries: torque over time, one curve a motion.

No curve says anything about another motion. It is what names are held against: what a name carries has to stand out
from what is left to these curves.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import partial

import numpy as np

from schwung.explain.weighing.along import Along
from schwung.explain.weighing.candidate import LADDER, Candidate, Shape
from schwung.explain.weighing.curves import Curve
from schwung.explain.weighing.joined import run_by_run
from schwung.innovations.effect import Effect
from schwung.session.model import Run

#: Within so much time (s) torque is alike; and within such a share of the longest motion, for what a curve costs.
_ALIKE_S, _ALIKE = 0.01, 0.01


def motions_of(runs: Sequence[Run]) -> list[list[int]]:
    """Which runs are of one motion, whatever is injected: commanded, or found to be the same where they were imported.

    Runs of which nothing is known stand alone.
    """
    motions: dict[Hashable, list[int]] = {}
    for number, run in enumerate(runs):
        told = run.extra.get("same_motion") if run.motion is None else run.motion.model_dump_json()
        motions.setdefault((told, number if told is None else None), []).append(number)
    return list(motions.values())


def curve_over_time(longest_s: float) -> Curve:
    """A curve that follows whatever a motion has of its own."""
    alike = max(_ALIKE_S, _ALIKE * longest_s)
    return Curve.over(0.0, longest_s, alike / longest_s, 1 + round(2 * longest_s / alike))


def repeated(runs: Sequence[Run], torque_nm: float) -> list[Candidate]:
    """A curve for each motion of several runs; `torque_nm`: a natural torque."""
    return [_curve(runs, numbers, torque_nm) for numbers in motions_of(runs) if len(numbers) > 1]


def _curve(runs: Sequence[Run], numbers: Sequence[int], torque_nm: float) -> Candidate:
    curve = curve_over_time(max(float(runs[number].time_s[-1]) for number in numbers))
    effect = partial(_over_time, curve=curve, numbers=frozenset(numbers))
    return Candidate("motion", effect, (torque_nm,) * curve.size, scales=LADDER, named=False)


@run_by_run
def _over_time(along: Along, _shape: Shape, curve: Curve, numbers: frozenset[int]) -> Effect:
    if along.number not in numbers:
        return Effect(on_load=np.zeros((along.speed.size, curve.size)))
    return Effect(on_load=curve.at(along.time_s))
