"""Which way a shaft goes, and where it sticks or turns, told by its angles.

What holds a shaft that sticks is open: any friction within its size. So of its speed at a sample, between two torques
that may be anything, hardly more is known than what was measured of it, and its sign goes to and fro from one sample to
the next; friction by that sign drives the states that it was read from. Its angles tell how far it went.
"""

from __future__ import annotations

import numpy as np

from schwung.motion import Array


def on_average(angles: Array, step_s: float) -> Array:
    """Speed in each step (rad/s), (n − 1, m), of m shafts' angles (n, m)."""
    return np.asarray(np.diff(angles, axis=0) / step_s)


def direction(on_average: Array, sticking_rad_s: float) -> Array:
    """At samples (n,), −1…1: by the steps (n − 1,) before and after each."""
    around = np.concatenate([on_average[:1], (on_average[1:] + on_average[:-1]) / 2, on_average[-1:]])
    return np.asarray(np.tanh(around / sticking_rad_s))


def slowest(speeds: Array, on_average: Array) -> Array:
    """Without its sign, where each shaft is slowest in each step or beside it (rad/s), (n − 1, m): 0 where it turns.

    `speeds`: at samples, (n, m). Of a step beside one that sticks, one end is as open.
    """
    least = np.minimum(np.abs(speeds[:-1]), np.abs(speeds[1:]))
    beside = np.pad(np.abs(on_average), ((1, 1), (0, 0)), mode="edge")
    least = np.minimum(least, np.minimum(beside[1:-1], np.minimum(beside[:-2], beside[2:])))
    return np.where(speeds[:-1] * speeds[1:] > 0, least, 0.0)
