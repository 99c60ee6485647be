"""The inertia table: load-side inertia over load angle, the thing that all of this is about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from schwung.errors import InputError
from schwung.motion import Array


@dataclass(frozen=True, eq=False)
class InertiaTable:
    """Load inertia J_l over the load angle; arrays (n,), position increasing. Held constant outside.

    Interpolated by PCHIP: monotone between points, so that a table never dips below zero between two good values.
    """

    position_rad: Array
    inertia_kgm2: Array
    std_kgm2: Array | None = None

    def __post_init__(self) -> None:
        n = self.position_rad.size
        if n < 2 or self.inertia_kgm2.size != n or (self.std_kgm2 is not None and self.std_kgm2.size != n):
            raise InputError("inertia table", "needs two points or more and columns of one length")
        if not (np.all(np.isfinite(self.position_rad)) and np.all(np.diff(self.position_rad) > 0)):
            raise InputError("inertia table", "position_rad does not increase", "Sort it, drop duplicates.")
        bad = np.flatnonzero(~(np.isfinite(self.inertia_kgm2) & (self.inertia_kgm2 > 0)))
        if bad.size:
            raise InputError(
                "inertia table",
                f"inertia_kgm2 is {self.inertia_kgm2[bad[0]]:g} at {self.position_rad[bad[0]]:g} rad",
                "An inertia is a positive number.",
            )

    def at(self, position_rad: Array) -> Array:
        """J_l (kg·m²) at the given angles (rad)."""
        inside = np.clip(position_rad, self.position_rad[0], self.position_rad[-1])
        return np.asarray(PchipInterpolator(self.position_rad, self.inertia_kgm2)(inside), dtype=float)

    def slope_at(self, position_rad: Array) -> Array:
        """dJ_l/dθ (kg·m²/rad) at the given angles (rad); 0 outside the table."""
        inside = (position_rad >= self.position_rad[0]) & (position_rad <= self.position_rad[-1])
        slope = PchipInterpolator(self.position_rad, self.inertia_kgm2).derivative()
        clipped = np.clip(position_rad, self.position_rad[0], self.position_rad[-1])
        return np.where(inside, slope(clipped), 0.0)


def slider_crank_inertia(
    position_rad: Array, base_kgm2: float = 0.055, swing_kgm2: float = 0.105, ratio: float = 0.25
) -> Array:
    """J_0 + A (sin θ + λ sin θ cos θ / √(1 − λ² sin² θ))², kg·m².

    A crank with a light rod of length r/λ and a mass on the slider. The defaults are *inferred*: the paper only
    draws its J_l(θ) (Fig. 8); with these, MIV and DPR come out as it reports.
    """
    sine, cosine = np.sin(position_rad), np.cos(position_rad)
    slider_speed = sine + ratio * sine * cosine / np.sqrt(1 - (ratio * sine) ** 2)
    return np.asarray(base_kgm2 + swing_kgm2 * slider_speed**2)
