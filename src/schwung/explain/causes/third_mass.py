"""A further mass behind the load, on a spring of its own: what it takes of the load's acceleration."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from schwung.compiled import compiled
from schwung.innovations import kernel
from schwung.motion import Array


@lru_cache(maxsize=256)
def _swing(rate: float, ratio: float, step_s: float) -> Array:
    """What a step does to the further mass's angle and speed, and what its drive at the start and the end of the step
    adds, straight between them, (2, 4).
    """
    whole = np.zeros((4, 4))
    whole[:2, :2] = [[0.0, 1.0], [-(rate**2), -2 * ratio * rate]]
    whole[1, 2], whole[2, 3] = 1.0, 1 / step_s
    step = expm(whole * step_s)[:2]
    return np.column_stack([step[:, :2], step[:, 2] - step[:, 3], step[:, 3]])


def third_mass(acceleration: Array, rate: float, ratio: float, step_s: float) -> Array:
    """H · α along a run that begins at rest, (n,), for the load's acceleration (n,)."""
    step = _swing(rate, ratio, step_s)
    transition, start, end = step[:, :2], step[:, 2], step[:, 3]
    late = kernel.driven(np.ascontiguousarray(transition), transition @ end + start, acceleration)
    states = late + end * acceleration[:, None]
    return np.asarray(states @ np.array([rate**2, 2 * ratio * rate]))


def stiffened(acceleration: Array, square: Array, decay: float, step_s: float) -> Array:
    """The same of a mass whose natural frequency changes along the run: its square (rad²/s², (n,)); its decay (1/s)."""
    found = np.zeros_like(acceleration)
    _follow(found, acceleration, square, decay, step_s)
    return found


@compiled
def _follow(found: Array, acceleration: Array, square: Array, decay: float, step_s: float) -> None:
    """x'' + 2 decay x' + square x = acceleration, and what the mass is accelerated by, in place.

    Within a step the square is constant, the acceleration is straight, and the swing about that is followed exactly.
    """
    falls, away, speed = np.exp(-decay * step_s), 0.0, 0.0
    for i in range(acceleration.size - 1):
        k = 0.5 * (square[i] + square[i + 1])
        slope = (acceleration[i + 1] - acceleration[i]) / step_s
        middle = (acceleration[i] - 2.0 * decay * slope / k) / k
        swing, rate = away - middle, speed - slope / k
        left = k - decay**2
        around = np.sqrt(abs(left))
        if left > 0.0:
            cosine, sine = np.cos(around * step_s), np.sin(around * step_s) / around
        else:
            cosine, sine = np.cosh(around * step_s), np.sinh(around * step_s) / max(around, 1e-12)
        speed = falls * (rate * cosine - (k * swing + decay * rate) * sine) + slope / k
        away = falls * (swing * cosine + (rate + decay * swing) * sine) + middle + slope / k * step_s
        found[i + 1] = square[i + 1] * away + 2.0 * decay * speed


@compiled
def explained(
    missed: Array,
    acceleration: Array,
    share: Array,
    starts: Array,
    step_s: float,
    rates: Array,
    stiffer: Array,
    ratio: float,
) -> Array:  # fmt: skip
    """What masses explain of a torque that is missed in runs one behind another, the square of it, (rates, stiffer).

    `share`: of the speed's square in the highest, 0…1; `starts`: of the runs, and the end of the last.
    """
    scores, found, square = np.zeros((rates.size, stiffer.size)), np.zeros_like(missed), np.zeros_like(missed)
    for r in range(rates.size):
        for q in range(stiffer.size):
            square[:] = rates[r] ** 2 * (1.0 + stiffer[q] * share)
            for one in range(starts.size - 1):
                where = slice(starts[one], starts[one + 1])
                _follow(found[where], acceleration[where], square[where], ratio * rates[r], step_s)
            scores[r, q] = np.dot(found, missed) ** 2 / max(np.dot(found, found), 1e-300)
    return scores
