"""Two masses on a spring, by how a motor's torque answers its speed: where a fit of whole motions may begin.

T/ω = J_r s + b + 1/(1/(d + k/s) + 1/(J_l s))        method.md (3), turned round
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from schwung.motion import Array

#: Where the search begins: the rotor's share of all, anti-resonance over the band's ends (geometric), damping ratio.
_SHARES, _PLACES, _DAMPING = (0.05, 0.15, 0.4, 0.7), (0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0, 1.15), 0.05
#: Starts that are followed.
_FOLLOWED = 6


@dataclass(frozen=True, eq=False)
class Response:
    """Torque over speed (N·m·s/rad), (n,), and the power of the speed that it was taken from."""

    frequency_hz: Array
    impedance_nms: NDArray[np.complex128]
    power: Array


def two_masses_of(response: Response) -> Array:
    """Logarithms of J_r, k, d and J_l: (4,)."""
    s = np.asarray(2j * np.pi * response.frequency_hz, dtype=complex)
    apparent = np.abs(response.impedance_nms) / np.abs(s)
    total = float(np.median(apparent[: max(3, apparent.size // 20)]))
    ends = np.log(response.frequency_hz[[0, -1]])
    starts = []
    for share, place in product(_SHARES, _PLACES):
        load = (1 - share) * total
        stiffness = load * (2 * np.pi * np.exp(ends[0] + place * (ends[1] - ends[0]))) ** 2
        damping = 2 * _DAMPING * np.sqrt(stiffness * load)
        starts.append(np.log([share * total, stiffness, damping, load]))
    weight = np.sqrt(response.power / response.power.max())

    def cost(x: Array) -> Array:
        off = np.log(_impedance(x, s) / response.impedance_nms) * weight**0.25
        return np.asarray(np.concatenate([off.real, off.imag]))

    starts.sort(key=lambda x: float(np.sum(cost(x) ** 2)))
    found = [least_squares(cost, x, method="lm", max_nfev=200) for x in starts[:_FOLLOWED]]
    return np.asarray(min(found, key=lambda one: float(one.cost)).x)


def _impedance(x: Array, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
    rotor, stiffness, damping, load = np.exp(np.clip(x, -60.0, 60.0))
    return np.asarray(rotor * s + 1 / (1 / (damping + stiffness / s) + 1 / (load * s)))
