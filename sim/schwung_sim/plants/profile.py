"""Quantities over the angle, as tables that a kernel can read: load inertia and load torque.

A profile is sampled densely at even steps and read back by cubic Hermite interpolation, whose derivative is
exactly the derivative of what is read: so the ½J'ω² term and J fit together, and energy is conserved.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from schwung_sim.compiled import compiled
from schwung_sim.errors import BenchError

Array = NDArray[np.float64]
ProfileName = Literal["slider-crank", "four-bar", "constant"]

_NODES_PER_TURN = 1024


class Samples(NamedTuple):
    """A profile as a kernel takes it: values (n,) and slopes per rad (n,) at start_rad + i·step_rad."""

    values: Array
    slopes: Array
    start_rad: float
    step_rad: float
    periodic: bool


@compiled
def read_profile(samples: Any, angle: float) -> Any:
    """Value and slope of a profile at an angle (rad). Held constant outside, unless periodic."""
    values, slopes, step = samples.values, samples.slopes, samples.step_rad
    last = values.size - 1
    u = (angle - samples.start_rad) / step
    if samples.periodic:
        u -= np.floor(u / last) * last
    elif u <= 0.0:
        return values[0], 0.0
    elif u >= last:
        return values[last], 0.0
    i = min(int(u), last - 1)
    f = u - i
    rise = values[i + 1] - values[i]
    a, b = slopes[i] * step - rise, -slopes[i + 1] * step + rise
    g = 1.0 - f
    value = g * values[i] + f * values[i + 1] + f * g * (a * g + b * f)
    slope = (rise + (g - f) * (a * g + b * f) + f * g * (b - a)) / step
    return value, slope


@dataclass(frozen=True, eq=False)
class Profile:
    """A quantity over the angle (rad)."""

    samples: Samples

    @classmethod
    def of_turn(cls, function: Callable[[Array], Array]) -> Profile:
        """Sample a function of the angle that repeats with every turn."""
        angle = np.linspace(0.0, 2 * np.pi, _NODES_PER_TURN + 1)
        values = np.asarray(function(angle), dtype=float)
        spectrum = np.fft.rfft(values[:-1])
        order = np.arange(spectrum.size)
        order[-1] = 0  # the highest order has no slope at the nodes
        slopes = np.fft.irfft(1j * order * spectrum, _NODES_PER_TURN)
        return cls(Samples(values, np.append(slopes, slopes[0]), 0.0, float(angle[1]), True))

    @classmethod
    def of_pairs(cls, angle_rad: Array, values: Array) -> Profile:
        """Through given points (n,) without overshoot (PCHIP), held constant outside."""
        angle_rad, values = np.asarray(angle_rad, dtype=float), np.asarray(values, dtype=float)
        if angle_rad.size < 2 or angle_rad.size != values.size or np.any(np.diff(angle_rad) <= 0):
            raise BenchError("table over the angle", "needs two points or more, angles increasing")
        from scipy.interpolate import PchipInterpolator

        curve = PchipInterpolator(angle_rad, values)
        even = np.linspace(angle_rad[0], angle_rad[-1], 2 * _NODES_PER_TURN + 1)
        return cls(
            Samples(curve(even), curve.derivative()(even), even[0].item(), (even[1] - even[0]).item(), False)
        )

    @classmethod
    def constant(cls, value: float) -> Profile:
        """The same everywhere."""
        return cls(Samples(np.full(2, float(value)), np.zeros(2), 0.0, 2 * np.pi, True))

    def at(self, angle_rad: Array) -> Array:
        """Values at the given angles (rad), (n,)."""
        return np.array([read_profile(self.samples, float(x))[0] for x in np.atleast_1d(angle_rad)])

    def slope_at(self, angle_rad: Array) -> Array:
        """Slopes per rad at the given angles (rad), (n,)."""
        return np.array([read_profile(self.samples, float(x))[1] for x in np.atleast_1d(angle_rad)])


def slider_crank(angle_rad: Array, rest: float = 0.055, swing: float = 0.105, ratio: float = 0.25) -> Array:
    """Inertia (kg·m²) reflected by crank and slider, rod light and of length r/ratio; inferred from Fig. 8.

    The slider moves by (sin θ + λ sin θ cos θ / √(1 − λ² sin² θ)) r per rad of the crank.
    """
    sine = np.sin(angle_rad)
    lever = sine * (1 + ratio * np.cos(angle_rad) / np.sqrt(1 - (ratio * sine) ** 2))
    return np.asarray(rest + swing * lever**2)


def four_bar(angle_rad: Array, rest: float = 0.06, rocker: float = 0.16) -> Array:
    """Reflected inertia (kg·m²) of a crank-rocker: links 1 (crank), 3 (coupler), 2.5 (rocker), 3.5 (ground).

    rest + rocker·(dψ/dθ)², the rocker's speed ratio from the closure of the loop.
    """
    a, b, c, d = 1.0, 3.0, 2.5, 3.5
    x, y = d - a * np.cos(angle_rad), -a * np.sin(angle_rad)  # crank pin to rocker pivot
    diagonal = np.hypot(x, y)
    psi = np.arctan2(y, x) + np.pi - np.arccos((diagonal**2 + c**2 - b**2) / (2 * diagonal * c))
    coupler = np.arctan2(y + c * np.sin(psi), x + c * np.cos(psi))
    ratio = a * np.sin(angle_rad - coupler) / (c * np.sin(psi - coupler))
    return np.asarray(rest + rocker * ratio**2)


#: The inertias that have a name.
PROFILES: Mapping[ProfileName, Callable[[], Profile]] = {
    "slider-crank": lambda: Profile.of_turn(slider_crank),
    "four-bar": lambda: Profile.of_turn(four_bar),
    "constant": lambda: Profile.constant(0.11),
}
