"""How far laws of hysteresis are off each other: springs side by side, each of which slips at its own way.

Any law whose branches follow from its first loading (Masing's rule) is so many of them: W. D. Iwan, A
Distributed-Element Model for Hysteresis and Its Steady-State Dynamic Response, J. Appl. Mech. 33, 1966. Of such laws
there are many, which agree on little more than how much there is.
"""

from __future__ import annotations

import numpy as np

from schwung.drivetrain.hysteresis import yielded
from schwung.motion import Array

#: Exponent of a spring that slips; over how many times the way of a law one does.
_SLIPPING, _AT = 20.0, (0.1, 0.3, 1.0, 3.0, 10.0)
#: Each may hold so many times the share that laws are else off by.
_AS_MUCH = 10.0
SPRINGS = len(_AT)


def springs(way: Array, over: float, first: float = 0.0) -> Array:
    """What springs hold along a way (rad), (n,), of their natural size, (n, `SPRINGS`), which a law holds that yields
    `over` one (rad); `first`: what all hold at first, −1…1."""
    return _AS_MUCH * np.stack([yielded(way, at * over, _SLIPPING, first) for at in _AT], 1)
