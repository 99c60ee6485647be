"""What all runs of a motion have in common and nothing in the vocabulary carries: torque over time, one curve a motion.

No curve says anything about another motion. It is what names are held against: what a name carries has to stand out
from what is left to these curves.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from schwung.explain.weighing.along import Along
from schwung.explain.weighing.candidate import LADDER, Candidate, Curve, Shape
from schwung.innovations.effect import Effect
from schwung.session.model import Run

#: Within so much time (s) torque is alike.
_ALIKE_S = 0.01


def repeated(runs: Sequence[Run], torque_nm: float) -> list[Candidate]:
    """A curve for each commanded motion of several runs, whatever is injected; `torque_nm`: a natural torque."""
    motions: dict[str, list[int]] = {}
    for number, run in enumerate(runs):
        if run.motion is not None:
            motions.setdefault(run.motion.model_dump_json(), []).append(number)
    return [_curve(runs, numbers, torque_nm) for numbers in motions.values() if len(numbers) > 1]


def _curve(runs: Sequence[Run], numbers: Sequence[int], torque_nm: float) -> Candidate:
    last = max(float(runs[number].time_s[-1]) for number in numbers)
    curve = Curve.over(0.0, last, _ALIKE_S / last, 1 + round(2 * last / _ALIKE_S))
    effect = partial(_over_time, curve, frozenset(numbers))
    return Candidate("motion", effect, (torque_nm,) * curve.size, scales=LADDER, named=False)


def _over_time(curve: Curve, numbers: frozenset[int], along: Along, _shape: Shape) -> Effect:
    if along.number not in numbers:
        return Effect(on_load=np.zeros((along.speed.size, curve.size)))
    return Effect(on_load=curve.at(along.time_s))
