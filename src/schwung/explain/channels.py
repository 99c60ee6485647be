"""What each reported channel has beyond the motion: noise by differences, and whether a speed says anything new."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schwung.motion import Array
from schwung.session.imports import motion_identity
from schwung.session.model import Run

#: Repeats of which the differences have this share of the noise's variance have none in common.
UNLIKE = 0.7
_DIFFERENCES = 6
_DIFFERENCE_GAIN = np.sqrt(924.0)  # of white noise by six differences: √C(12, 6)
_MAD = 1.4826


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what each reported channel has beyond the motion, from its sixth differences."""

    position_rad: float
    speed_rad_s: float
    torque_nm: float


def differences_noise(values: Array) -> float:
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


def channel_noise(runs: Sequence[Run]) -> Noise:
    """Of all runs, the median; a speed that says nothing new has an infinite one. Raises nothing."""

    def of(name: str) -> float:
        return float(np.median([differences_noise(getattr(run, name)) for run in runs]))

    position, torque = max(of("position_rad"), 1e-12), max(of("torque_nm"), 1e-12)
    speed = np.inf if any(_derived(run) for run in runs) else max(of("speed_rad_s"), 1e-12)
    return Noise(position, speed, torque)


def repeating(runs: Sequence[Run]) -> bool:
    """Whether any of them repeats another."""
    return len({motion_identity(run) for run in runs}) < len(runs)


def alike_noise(runs: Sequence[Run], noise: Noise) -> Noise:
    """Noise that comes again in each repeat: counts that fall alike, and what a controller makes of them."""
    pairs: list[tuple[Run, Run]] = []
    last: dict[object, Run] = {}
    for run in runs:
        motion = motion_identity(run)
        if motion in last:
            pairs.append((last[motion], run))
        last[motion] = run

    def of(name: str, whole: float) -> float:
        if not pairs or not np.isfinite(whole):
            return 0.0
        differences = []
        for first, second in pairs:
            size = min(len(first), len(second))
            differences.append(
                _roughness(getattr(first, name)[:size] - getattr(second, name)[:size]) ** 2 / 2
            )
        share = float(np.median(differences)) / whole**2
        return whole * float(np.sqrt(1 - share)) if share < UNLIKE else 0.0

    return Noise(
        of("position_rad", noise.position_rad),
        of("speed_rad_s", noise.speed_rad_s),
        of("torque_nm", noise.torque_nm),
    )


def _derived(run: Run) -> bool:
    """Whether a run's speed is worked out from its angle, or is worse than what could be."""
    return nothing_new(run) or run.extra.get("speed_source") == "position" or run.is_held


def nothing_new(run: Run) -> bool:
    """Whether a run's speed says what its angle says: by its own word, or being the difference of two angles."""
    if "speed_origin" in run.extra:
        return True
    difference = np.diff(run.position_rad) * run.sample_rate_hz
    return _roughness(run.speed_rad_s[1:] - difference) < 0.5 * _roughness(difference)
