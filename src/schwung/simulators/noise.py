"""What each reported channel has beyond the motion: noise by differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schwung.motion import Array
from schwung.session.derived import speed_is_derived
from schwung.session.model import Run

_DIFFERENCES = 6
_DIFFERENCE_GAIN = np.sqrt(924.0)  # of white noise by six differences: √C(12, 6)
_MAD = 1.4826


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what each reported channel has beyond the motion, from its sixth differences."""

    position_rad: float
    speed_rad_s: float
    torque_nm: float


def _differences_noise(values: Array) -> float:
    """Standard deviation of white noise in a smooth signal (n,): robust, of its sixth differences."""
    spread = _roughness(values)
    steps = np.abs(np.diff(values))
    steps = steps[steps > 0]
    if steps.size and np.mean(np.diff(values) == 0) > 0.02:  # it repeats values: it is counted
        spread = max(spread, float(steps.min()) / np.sqrt(12))
    return spread


def _roughness(values: Array) -> float:
    if values.size <= 2 * _DIFFERENCES:
        return 0.0
    sixth = np.diff(values, _DIFFERENCES)
    return _MAD * float(np.median(np.abs(sixth - np.median(sixth)))) / float(_DIFFERENCE_GAIN)


def reported_noise(runs: Sequence[Run]) -> Noise:
    """Of all runs, the median; a speed that says nothing new has an infinite one. Raises nothing."""

    def of(name: str) -> float:
        return float(np.median([_differences_noise(getattr(run, name)) for run in runs]))

    position, torque = max(of("position_rad"), 1e-12), max(of("torque_nm"), 1e-12)
    nothing_new = speed_is_derived(runs) or any(_worse(run) for run in runs)
    speed = np.inf if nothing_new else max(of("speed_rad_s"), 1e-12)
    return Noise(position, speed, torque)


def _worse(run: Run) -> bool:
    """Whether a run's speed is worse than what its angle gives."""
    return run.extra.get("speed_source") == "position" or run.is_held
