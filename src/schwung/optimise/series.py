"""A table over the angle as one Chebyshev series: smooth, and the same expression for numbers and for symbols.

Newton's method wants second derivatives, which PCHIP has not at its points; a series has all of them.
Clenshaw's recurrence: Press et al., Numerical Recipes, 3rd ed., 5.8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from schwung.motion import Array

#: A series may be off by this share of the largest value, or by what the curve itself is uncertain by.
TOLERANCE = 1e-4
#: Degrees that are tried, lowest first; a table with steps keeps what the last one leaves.
_DEGREES = (0, 2, 4, 6, 8, 12, 16, 24, 32, 48, 64)


@dataclass(frozen=True, eq=False)
class Series:
    """Σ c_i T_i over low_rad…high_rad; `misfit` is what the series is off at the most, in the curve's unit."""

    coefficients: Array
    low_rad: float
    high_rad: float
    misfit: float = 0.0

    def at(self, angle_rad: Any) -> Any:
        """Value at an angle (rad): a number, an array (n,), or a symbol of CasADi."""
        x = (2 * angle_rad - (self.low_rad + self.high_rad)) / (self.high_rad - self.low_rad)
        ahead, behind = 0 * x, 0 * x
        for coefficient in self.coefficients[:0:-1]:
            ahead, behind = 2 * x * ahead - behind + float(coefficient), ahead
        return x * ahead - behind + float(self.coefficients[0])

    def slope(self) -> Series:
        """The derivative by the angle, per rad."""
        width = (self.high_rad - self.low_rad) / 2
        slope = np.asarray(chebyshev.chebder(self.coefficients), dtype=float) / width
        return Series(slope if slope.size else np.zeros(1), self.low_rad, self.high_rad)


def series_of(
    curve: Callable[[Array], Array], low_rad: float, high_rad: float, uncertainty: float = 0.0
) -> Series:
    """The series of lowest degree that keeps within TOLERANCE of a curve between two angles (rad).

    `uncertainty`: standard deviation of the curve, in its unit; a series that is no further off, by root mean square,
    has all that the curve tells, and follows no noise.
    """
    x = np.cos(np.pi * (np.arange(1024) + 0.5) / 1024)
    values = curve((low_rad + high_rad) / 2 + (high_rad - low_rad) / 2 * x)
    allowed = TOLERANCE * float(np.max(np.abs(values)))
    for degree in _DEGREES:
        coefficients = np.asarray(chebyshev.chebfit(x, values, degree), dtype=float)
        off = chebyshev.chebval(x, coefficients) - values
        misfit = float(np.max(np.abs(off)))
        if misfit <= allowed or float(np.sqrt(np.mean(off**2))) <= uncertainty:
            break
    return Series(coefficients, low_rad, high_rad, misfit)
