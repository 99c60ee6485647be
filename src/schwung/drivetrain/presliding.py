"""Friction that is a spring before it slides: bristles that bend over a distance and then give way.

P. R. Dahl, A Solid Friction Model, 1968, with his exponent 1: dF/dθ = σ (1 − F sign ω/F_c). Over a stretch without a
reversal F nears ±F_c as exp(−way/distance), distance = F_c/σ; so it is in proportion to F_c, whatever the motion.
"""

from __future__ import annotations

import numpy as np

from schwung.compiled import compiled
from schwung.motion import Array


@compiled
def bent(angle: Array, distance: float, first: float) -> Array:
    """How far bristles are bent along angles (n,), from `first` on; ±1: they slide. Exact between reversals."""
    found = np.empty_like(angle)
    found[0] = first
    for i in range(1, angle.size):
        way = angle[i] - angle[i - 1]
        side = 1.0 if way > 0.0 else -1.0
        found[i] = side + (found[i - 1] - side) * np.exp(-abs(way) / distance)
    return found
