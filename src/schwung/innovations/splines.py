"""Uniform cubic B-splines over a coordinate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from schwung.innovations import spline_kernel
from schwung.motion import Array


def slopes(values: Array, step: float) -> Array:
    """Of the cubic spline through evenly spaced values (n, …) at these, (n, …); n ≥ 4, "not a knot" at the ends."""
    return np.asarray(spline_kernel.spline_slopes(_flat(values), step)).reshape(values.shape)


def bends(values: Array, step: float) -> Array:
    """Height of that spline over the straight line in the middle between values (n,), (n − 1,)."""
    return np.asarray(-step / 8 * np.diff(slopes(values, step)))


def interpolated(values: Array, start: float, step: float, places: Array, derivative: int = 0) -> Array:
    """The same spline through values (n, …) from `start` on, or its `derivative` up to the second, at places (m,),
    (m, …)."""
    flat = _flat(values)
    found = spline_kernel.spline_at(
        flat, spline_kernel.spline_slopes(flat, step), start, step, places, derivative
    )
    return np.asarray(found).reshape(places.size, *values.shape[1:])


def _flat(values: Array) -> Array:
    return np.ascontiguousarray(values.reshape(values.shape[0], -1))


@dataclass(frozen=True)
class Basis:
    """Uniform cubic B-splines over an angle range, `pieces` + 3 of them; straight on outside."""

    low_rad: float
    high_rad: float
    pieces: int

    @property
    def size(self) -> int:
        return self.pieces + 3

    @property
    def span_rad(self) -> float:
        return self.high_rad - self.low_rad

    def finer(self) -> Basis:
        """Twice the pieces."""
        return Basis(self.low_rad, self.high_rad, 2 * self.pieces)

    def refined(self, coefficients: Array) -> Array:
        """The same curve's coefficients in the finer basis: each piece halved (exact)."""
        c = coefficients
        between, at = (c[1:] + c[:-1]) / 2, (c[:-2] + 6 * c[1:-1] + c[2:]) / 8
        result = np.empty(between.size + at.size)
        result[::2], result[1::2] = between, at
        return result

    def coefficients_of(self, curve: Callable[[Array], Array]) -> Array:
        """Those that come nearest to a curve over angles (rad), (size,)."""
        grid = np.linspace(self.low_rad, self.high_rad, 8 * self.size)
        return np.asarray(np.linalg.lstsq(self.rows(grid)[0], curve(grid), rcond=None)[0])

    def rows(self, angle_rad: Array) -> tuple[Array, Array]:
        """All splines and their derivatives at angles (n,): (n, size) each."""
        step = (self.high_rad - self.low_rad) / self.pieces
        values, slopes = spline_kernel.spline_rows(
            self.low_rad, step, self.pieces, np.ascontiguousarray(angle_rad)
        )
        return values, slopes
