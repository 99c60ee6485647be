"""Hysteresis of a coupling: beside its spring something stiff that yields, as elastomers and strain-wave gears do.

R. Bouc, Forced Vibration of Mechanical Systems with Hysteresis, 1967, and Y.-K. Wen, Method for Random Vibration of
Hysteretic Systems, J. Eng. Mech. 102, 1976, with β = γ: dz/dφ = κ (1 − |z/Z|ⁿ) while it is loaded, κ while it is
unloaded. n = 1 nears Z as e^−φκ/Z, n = 2 as tanh, a large n is a spring that slips.
"""

from __future__ import annotations

import numpy as np

from schwung.compiled import compiled, inlined
from schwung.motion import Array

#: In which it is followed, as shares of the wind-up over which it yields, and after how many it has.
_STEP, _YIELDED = 0.1, 30.0


@inlined
def yields(share: float, speed: float, exponent: float) -> float:
    """Of its stiffness, what is left where it holds so much of what it yields at, −1…1."""
    if share * speed <= 0.0:
        return 1.0
    return float(1.0 - abs(share) ** exponent)


@inlined
def yielding_rate(torque: float, stiffness: float, exponent: float, held: float, speed: float) -> float:
    """How fast what it holds (N·m) grows at a speed (rad/s), when it yields at `torque`; none where that is none."""
    return stiffness * speed * yields(held / torque, speed, exponent) if torque > 0.0 else 0.0


@compiled
def yielded(wound: Array, over: float, exponent: float) -> Array:
    """What it holds over what it yields at, −1…1, along wind-ups (rad), (n,), from nothing on; `over`: Z/κ (rad)."""
    found = np.zeros_like(wound)
    share = 0.0
    for i in range(1, wound.size):
        way = (wound[i] - wound[i - 1]) / over
        way = min(max(way, -_YIELDED), _YIELDED)
        steps = max(int(np.ceil(abs(way) / _STEP)), 1)
        step = way / steps
        for _ in range(steps):  # the midpoint rule
            half = share + 0.5 * step * yields(share, step, exponent)
            share = min(max(share + step * yields(half, step, exponent), -1.0), 1.0)
        found[i] = share
    return found


@compiled
def left_of(share: Array, speed: Array, exponent: float) -> Array:
    """`yields` of each (n,); 0 where nothing was ever wound up, for then nobody knows how far it has yielded."""
    found = np.zeros_like(share)
    for i in range(share.size):
        if share[i] != 0.0 or speed[i] != 0.0:
            found[i] = yields(share[i], speed[i], exponent)
    return found
