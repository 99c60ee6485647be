"""Hysteresis of a coupling: beside its spring something stiff that yields, as elastomers and strain-wave gears do.

R. Bouc, Forced Vibration of Mechanical Systems with Hysteresis, 1967, and Y.-K. Wen, Method for Random Vibration of
Hysteretic Systems, J. Eng. Mech. 102, 1976, with β = γ: dz/dφ = κ (1 − |z/Z|ⁿ) while it is loaded, κ while it is
unloaded. n = 1 nears Z as e^−φκ/Z, n = 2 as tanh, a large n is a spring that slips.
"""

from __future__ import annotations

import numpy as np

from schwung.compiled import compiled, inlined
from schwung.motion import Array

#: Steps in which it is followed, as shares of the wind-up over which it yields, shorter for larger exponents; what is
#: short of that; after how many it has yielded, and what it holds then.
_STEP, _STEP_OF_EXPONENT, _SHORT, _YIELDED, _HELD = 0.4, 2.0, 0.25, 30.0, 1.0 - 1e-9


@inlined
def yields(share: float, speed: float, exponent: float) -> float:
    """Of its stiffness, what is left where it holds so much of what it yields at, −1…1."""
    if share * speed <= 0.0:
        return 1.0
    there = abs(share)
    if exponent == 1.0:
        return 1.0 - there
    return float(1.0 - there**exponent)


@inlined
def yielding_rate(torque: float, stiffness: float, exponent: float, held: float, speed: float) -> float:
    """How fast what it holds (N·m) grows at a speed (rad/s), when it yields at `torque`; none where that is none."""
    return stiffness * speed * yields(held / torque, speed, exponent) if torque > 0.0 else 0.0


@compiled
def yielded(wound: Array, over: float, exponent: float, first: float = 0.0) -> Array:
    """What it holds over what it yields at, −1…1, along wind-ups (rad), (n,), from `first` on; `over`: Z/κ (rad)."""
    found = np.full_like(wound, first)
    longest = min(_STEP, _STEP_OF_EXPONENT / exponent)
    held, side = abs(first), 1.0 if first >= 0.0 else -1.0
    for i in range(1, wound.size):
        way = side * (wound[i] - wound[i - 1]) / over
        if way < 0.0:  # it is unloaded, in proportion, and loaded the other way
            held += way
            way = 0.0
            if held < 0.0:
                side, way, held = -side, min(-held, _YIELDED), 0.0
        if way < _SHORT * longest:
            held = _loaded_shortly(held, way, exponent)
        else:
            steps = int(np.ceil(way / longest))
            for _ in range(steps):
                if held > _HELD:
                    break
                held = _loaded(held, way / steps, exponent)
        found[i] = side * held
    return found


@inlined
def _loaded_shortly(held: float, way: float, exponent: float) -> float:
    """Held so little further on, by the midpoint rule."""
    half = held + 0.5 * way * yields(held, 1.0, exponent)
    return min(max(held + way * yields(half, 1.0, exponent), 0.0), 1.0)


@inlined
def _loaded(held: float, way: float, exponent: float) -> float:
    """Held so much further on, by Runge and Kutta's rule of fourth order."""
    first = yields(held, 1.0, exponent)
    second = yields(held + 0.5 * way * first, 1.0, exponent)
    third = yields(held + 0.5 * way * second, 1.0, exponent)
    fourth = yields(held + way * third, 1.0, exponent)
    return min(max(held + way / 6.0 * (first + 2.0 * second + 2.0 * third + fourth), 0.0), 1.0)


@compiled
def left_of(share: Array, speed: Array, exponent: float) -> Array:
    """`yields` of each (n,); 0 where nothing was ever wound up, for then nobody knows how far it has yielded."""
    found = np.zeros_like(share)
    for i in range(share.size):
        if share[i] != 0.0 or speed[i] != 0.0:
            found[i] = yields(share[i], speed[i], exponent)
    return found
