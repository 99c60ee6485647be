"""Whether a coupling with a gap touches, as far as its wind-up is known."""

from __future__ import annotations

from math import erf, erfc

import numpy as np

from schwung.compiled import inlined

#: Parts of a step, in each of which it is asked whether the coupling touches.
PARTS = 8
#: The wind-up is never surer than to this share of the gap.
SUREST = 1e-9


@inlined
def touching(twist: float, ahead: float, half: float, spread: float) -> tuple[float, float, float]:
    """How surely a coupling touches on one side, the torque over the stiffness that it lacks there (rad), and the
    variance (rad²) of what it carries beyond what a line through the wind-up says of that.

    `twist` towards that side, `ahead`: the same and what the damping adds to it, over the stiffness; a contact that
    lifts lets go where it would pull.
    """
    away = (min(twist, ahead) - half) / spread
    sure = 0.5 * (1.0 + erf(away / np.sqrt(2.0)))
    dense = np.exp(-0.5 * away * away) / np.sqrt(2.0 * np.pi)
    # what is carried beyond the line is as much so far within the gap as so far beyond its end
    off, rarely = -abs(away), 0.5 * erfc(abs(away) / np.sqrt(2.0))
    mean = off * rarely + dense
    beyond = (off * off + 1.0) * rarely + off * dense - mean * mean - rarely * rarely
    return sure, half * sure - spread * dense, spread * spread * max(beyond, 0.0)
