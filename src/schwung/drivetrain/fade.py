"""A torque constant that falls as the motor heats, and recovers as it cools: within a motion, by the winding's heat.

Heat follows the mean of the torque's square, as the losses of the winding do, and takes its share of the torque: with
T_p as the peak torque τ dh/dt = (T/T_p)² − h, h = 1 where that lasts.
"""

from __future__ import annotations

import numpy as np

from schwung.compiled import compiled, inlined
from schwung.motion import Array


@inlined
def heating(torque: float, at_nm: float, time_s: float, heat: float) -> float:
    """How fast heat grows (1/s)."""
    return ((torque / at_nm) ** 2 - heat) / time_s


@inlined
def faded(torque: float, share: float, heat: float) -> float:
    """What heat leaves of a torque (N·m)."""
    return torque * (1.0 - min(share * heat, 1.0))


@compiled
def heated(torque_nm: Array, at_nm: float, time_s: float, step_s: float, first: float = 0.0) -> Array:
    """Heat at each of the samples (n,), so many seconds apart, gains straight between them; `first`: at the first."""
    x = step_s / time_s
    left = np.exp(-x)
    last = 1.0 + np.expm1(-x) / x  # of what the gain at a step's end is worth, exact for a straight one
    found, heat = np.empty_like(torque_nm), first
    for i in range(torque_nm.size):
        if i > 0:
            heat *= left
            heat += last * (torque_nm[i] / at_nm) ** 2 + (1.0 - left - last) * (torque_nm[i - 1] / at_nm) ** 2
        found[i] = heat
    return found
