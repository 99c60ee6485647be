"""Sufficient statistics of a linear model with white noise: all that sets of columns are compared by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.motion import Array

#: Of columns.
Numbers = NDArray[np.intp]
#: Columns, one a row, as they are kept: there may be gigabytes of them, and what they are worked out from is known to
#: fewer figures.
Columns = NDArray[np.float32]
#: Sums of products are worked out of so many columns at once, and of so many of their numbers: they are made longer for
#: it, and what was made longer is to be in the near memory yet when it is multiplied.
_COLUMNS, _NUMBERS = 64, 2**18


@dataclass(frozen=True, eq=False)
class Statistics:
    """XᵀX (P, P), Xᵀy (P,), yᵀy and the number of samples, of one run or of several."""

    gram: Array
    slope: Array
    square: float
    count: float

    @classmethod
    def of(cls, rows: Array, target: Array, count: float | None = None) -> Statistics:
        """Of rows X (m, P) and y (m,); `count`: how many of them tell anything, None: all."""
        many = float(target.size if count is None else count)
        return cls(rows.T @ rows, rows.T @ target, float(target @ target), many)

    def __add__(self, other: Statistics) -> Statistics:
        return Statistics(
            self.gram + other.gram,
            self.slope + other.slope,
            self.square + other.square,
            self.count + other.count,
        )

    def tempered(self, ratio: float) -> Statistics:
        """As so many times fewer samples would tell."""
        return Statistics(self.gram / ratio, self.slope / ratio, self.square / ratio, self.count / ratio)

    def at(self, which: Numbers) -> Statistics:
        """Of these columns alone (indices)."""
        return Statistics(self.gram[np.ix_(which, which)], self.slope[which], self.square, self.count)

    def missed(self, coefficients: Array) -> float:
        """Sum of squares of y − Xβ."""
        bent = coefficients @ self.gram @ coefficients
        return float(self.square - 2 * self.slope @ coefficients + bent)


def products(one: Columns | Array, other: Columns) -> Array:
    """Sums of products of columns (p, n) with others (q, n), (p, q), to all figures that they are kept to.

    Those of columns that run away are no numbers, the others are.
    """
    found = np.zeros((one.shape[0], other.shape[0]))
    at_once = min(_COLUMNS, other.shape[0])
    stretch = max(_NUMBERS // max(one.shape[0], at_once, 1), 1)
    for start in range(0, one.shape[1], stretch):
        span = slice(start, start + stretch)
        mine = one[:, span].astype(np.float64, copy=False)
        for first in range(0, other.shape[0], _COLUMNS):
            some = slice(first, first + _COLUMNS)
            with np.errstate(invalid="ignore", over="ignore"):
                found[:, some] += mine @ other[some, span].astype(np.float64).T
    return found


def products_with(target: Array, columns: Columns) -> tuple[Array, Array]:
    """Sums of products of columns (p, n) with one another, (p, p), and with a target (n,), (p,); see `products`."""
    gram, slope = np.zeros((columns.shape[0],) * 2), np.zeros(columns.shape[0])
    stretch = max(_NUMBERS // max(columns.shape[0], 1), 1)
    for start in range(0, target.size, stretch):
        span = slice(start, start + stretch)
        mine = columns[:, span].astype(np.float64)
        with np.errstate(invalid="ignore", over="ignore"):
            gram += mine @ mine.T
            slope += mine @ target[span]
    return gram, slope


def colour(rows: Array, rest: Array, stretch: int) -> Array:
    """How much more the columns' scores vary over stretches than with white noise, (P,), ≥ 0.

    `rest` (m,): what is left of the innovations; `stretch`: samples further apart are taken as independent.
    """
    parts = np.add.reduceat(rows * rest[:, None], np.arange(0, rest.size, stretch), axis=0)
    white = np.sum(rows**2, axis=0)
    return np.asarray(np.sum(parts**2, axis=0) / np.maximum(white, 1e-300))
