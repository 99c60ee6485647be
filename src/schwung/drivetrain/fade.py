"""A torque constant that falls as the motor heats, and recovers as it cools: within a motion, by the winding's heat.

Heat follows the mean of the torque's square, as the losses of the winding do, and takes its share of the torque: with
T_p as the peak torque τ dh/dt = (T/T_p)² − h, h = 1 where that lasts.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from schwung.compiled import inlined
from schwung.motion import Array


@inlined
def heating(torque: float, at_nm: float, time_s: float, heat: float) -> float:
    """How fast heat grows (1/s)."""
    return ((torque / at_nm) ** 2 - heat) / time_s


@inlined
def faded(torque: float, share: float, heat: float) -> float:
    """What heat leaves of a torque (N·m)."""
    return torque * (1.0 - min(share * heat, 1.0))


def heated(torque_nm: Array, at_nm: float, time_s: float, step_s: float, first: float = 0.0) -> Array:
    """Heat at each of the samples (n,), so many seconds apart, gains straight between them; `first`: at the first."""
    gain = (torque_nm / at_nm) ** 2
    x = step_s / time_s
    left = np.exp(-x)
    last = 1 + np.expm1(-x) / x  # of what the gain at a step's end is worth, exact for a straight one
    pushed = np.concatenate([[first], last * gain[1:] + (1 - left - last) * gain[:-1]])
    return np.asarray(lfilter([1.0], [1.0, -left], pushed))
