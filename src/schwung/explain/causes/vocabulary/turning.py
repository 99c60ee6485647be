"""What teeth, a transmission, an encoder and a ripple have in common: they turn with the motor's angle."""

from __future__ import annotations

import numpy as np

from schwung.explain.causes.along import Along
from schwung.explain.causes.joined import Joined
from schwung.motion import Array


def turning(along: Along, order: float) -> Array:
    """Sine and cosine of so many times the motor's angle, (n, 2); of joined runs each order is worked out once."""
    if not isinstance(along, Joined):
        return _turning(along.angle, order)
    if order not in along.turning:
        along.turning[order] = _turning(along.angle, order)
    return along.turning[order]


def _turning(angle: Array, order: float) -> Array:
    turned = order * angle
    return np.stack([np.sin(turned), np.cos(turned)]).T
