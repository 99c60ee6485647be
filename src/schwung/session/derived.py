"""Whether a drive makes the speed that it reports of its encoder's angle: then it tells nothing that the angle does
not, and has the angle's errors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schwung.motion import Array
from schwung.session.model import Run

#: So many steps of the angle before and after each sample, and speeds before it, are what a filter may take.
_EARLIER, _LATER, _BEFORE = 9, 2, 2


def speed_is_derived(runs: Sequence[Run]) -> bool:
    """Whether the speed of a drive's runs is the slope of its angle: by their own word, or by the angle's errors in it.

    A speed that was measured by itself knows nothing of the angle's errors. Foreseen by angles, with weights w, it is
    missed by |w| times their noise at least; one that was made of those angles, filtered or not, by less.
    """
    if any("speed_origin" in run.extra for run in runs):
        return True
    found = [_foreseen(run) for run in runs if len(run) > 2 * (_EARLIER + _LATER + _BEFORE)]
    missed, least = np.sum(found, axis=0) if found else (0.0, 0.0)
    return bool(missed < least)


def _foreseen(run: Run) -> tuple[float, float]:
    """Sum of squares by which a run's speed is missed where angles and its own past foresee it, and half of what the
    angles' noise makes of that."""
    speed, moved = run.speed_rad_s, np.diff(run.position_rad) * run.sample_rate_hz
    where = np.arange(_EARLIER, speed.size - _LATER)
    steps = moved[where[:, None] + np.arange(-_EARLIER, _LATER)]
    asked = np.column_stack([steps, speed[where[:, None] - np.arange(1, 1 + _BEFORE)]])
    weights = np.linalg.lstsq(asked, speed[where], rcond=None)[0]
    missed = speed[where] - asked @ weights
    of_angles = np.diff(weights[: _EARLIER + _LATER], prepend=0.0, append=0.0)
    noise = float(of_angles @ of_angles) * _white(run.position_rad * run.sample_rate_hz)
    return float(missed @ missed), where.size * noise / 2


def _white(values: Array) -> float:
    """Variance of the white noise of a signal (n,), or less: third differences have −15 times that in common with the
    next ones, and of what moves smoothly something positive."""
    third = np.diff(values, 3)
    return max(-float(np.mean(third[1:] * third[:-1])) / 15, 0.0)
