"""A further mass behind the load, on a spring of its own: what it takes of the load's acceleration."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.linalg import expm

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
