"""Whether a coupling with a gap touches, as far as its wind-up is known."""

from __future__ import annotations

from math import erf

import numpy as np

from schwung.compiled import inlined

#: Parts of a step, in each of which it is asked whether the coupling touches.
PARTS = 8
#: The wind-up is never surer than to this share of the gap.
SUREST = 1e-9


@inlined
def touching(twist: float, ahead: float, half: float, spread: float) -> tuple[float, float]:
    """How surely a coupling touches on one side, and the torque over the stiffness that it lacks there (rad).

    `twist` towards that side, `ahead`: the same and what the damping adds to it, over the stiffness; a contact that
    lifts lets go where it would pull.
    """
    away = (min(twist, ahead) - half) / spread
    sure = 0.5 * (1.0 + erf(away / np.sqrt(2.0)))
    return sure, half * sure - spread * np.exp(-0.5 * away * away) / np.sqrt(2.0 * np.pi)
