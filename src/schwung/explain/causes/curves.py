"""Smooth curves and surfaces: modes of a Gaussian process, of which a cause has a coefficient each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.compiled import compiled
from schwung.innovations.splines import interpolated
from schwung.motion import Array


def curve_modes(points: Array, reach: float, *, least: float = 1e-3) -> Array:
    """Modes of a Matérn-3/2 process of deviation 1 at points (g,), those that matter, (g, m).

    `reach`: within which the curve is alike, in the points' unit.
    """
    away = np.sqrt(3.0) * np.abs(points[:, None] - points) / reach
    values, vectors = np.linalg.eigh((1 + away) * np.exp(-away))
    matter = values > least * values[-1]
    return np.asarray(vectors[:, matter] * np.sqrt(values[matter]))[:, ::-1]


#: Modes of a bent curve that are kept, as a share of the largest variance: torque goes by what they are the slope of.
_LEAST_BENT = 1e-6


def bent_modes(points: Array, reach: float) -> Array:
    """Modes of a Matérn-5/2 process of deviation 1 at points (g,), whose slope is as continuous as it is, (g, m)."""
    away = np.sqrt(5.0) * np.abs(points[:, None] - points) / reach
    values, vectors = np.linalg.eigh((1 + away + away**2 / 3) * np.exp(-away))
    matter = values > _LEAST_BENT * values[-1]
    return np.asarray(vectors[:, matter] * np.sqrt(values[matter]))[:, ::-1]


@dataclass(frozen=True, eq=False)
class BentCurve:
    """A curve over a coordinate whose slope is one, too, cubic between points: `modes` (g, m) at `points` (g,)."""

    points: Array
    modes: Array

    @classmethod
    def over(cls, low: float, high: float, reach: float, count: int = 65) -> BentCurve:
        """Between two ends; `reach` as a share of the range."""
        points = np.linspace(low, high, count)
        return cls(points, bent_modes(points, reach * (high - low)))

    @property
    def size(self) -> int:
        return int(self.modes.shape[1])

    def at(self, where: Array) -> Array:
        """Every mode at coordinates (n,), (n, m); beyond the ends as at them."""
        return self._of(self.modes, where, 0)

    def folded(self, where: Array, coefficients: Array) -> Array:
        """The one curve with these coefficients of its modes (m,) there, (n,)."""
        return self._of(self.modes @ coefficients, where, 0)

    def slope(self, where: Array, coefficients: Array) -> Array:
        """And its slope, (n,); beyond the ends none."""
        inside = (where >= self.points[0]) & (where <= self.points[-1])
        return np.where(inside, self._of(self.modes @ coefficients, where, 1), 0.0)

    def _of(self, values: Array, where: Array, derivative: int) -> Array:
        low, high = self.points[0], self.points[-1]
        step = (high - low) / (self.points.size - 1)
        return interpolated(values, low, step, np.clip(where, low, high), derivative)


@dataclass(frozen=True, eq=False)
class Curve:
    """A smooth curve over a coordinate, straight lines between points: `modes` (g, m) at `points` (g,)."""

    points: Array
    modes: Array

    @classmethod
    def over(cls, low: float, high: float, reach: float, count: int = 33, least: float = 1e-3) -> Curve:
        """Between two ends; `reach` as a share of the range."""
        points = np.linspace(low, high, count)
        return cls(points, curve_modes(points, reach * (high - low), least=least))

    @property
    def size(self) -> int:
        return int(self.modes.shape[1])

    def at(self, where: Array) -> Array:
        """Every mode at coordinates (n,), (n, m)."""
        return np.asarray(_blended(self.modes, self._places(where)))

    def slope(self, where: Array, coefficients: Array) -> Array:
        """Of the one curve with these coefficients (m,) at coordinates (n,), (n,)."""
        values, step = self.modes @ coefficients, self.points[1] - self.points[0]
        left = np.minimum(self._places(where).astype(int), self.points.size - 2)
        return np.asarray((values[left + 1] - values[left]) / step)

    def by_direction(self, where: Array, direction: Array) -> Array:
        """Every mode while the motion goes ahead, then while it goes back, times the direction (n,), (n, 2m)."""
        return np.asarray(_blended_by_direction(self.modes, self._places(where), direction))

    def folded(self, coefficients: Array) -> Curve:
        """The one curve with these coefficients of its modes (m,)."""
        return Curve(self.points, (self.modes @ coefficients)[:, None])

    def folded_by_direction(self, where: Array, direction: Array, coefficients: Array) -> Array:
        """`by_direction` with these coefficients (2m,), (n, 1)."""
        both = Curve(self.points, self.modes @ coefficients.reshape(2, -1).T).at(where)
        return column(both[:, 0] * np.maximum(direction, 0) + both[:, 1] * np.maximum(-direction, 0))

    def _places(self, where: Array) -> Array:
        """Coordinates in steps from the first point, within the points."""
        return np.clip(np.interp(where, self.points, np.arange(self.points.size)), 0, self.points.size - 1)


#: Within so much time (s) torque is alike; and within such a share of the longest motion, for what a curve costs.
_ALIKE_S, _ALIKE = 0.01, 0.01


def curve_over_time(longest_s: float) -> Curve:
    """A curve that follows whatever a motion has of its own."""
    alike = max(_ALIKE_S, _ALIKE * longest_s)
    return Curve.over(0.0, longest_s, alike / longest_s, 1 + round(2 * longest_s / alike))


@compiled
def _blended(modes: Array, places: Array) -> Array:
    """Modes (g, m) at places (n,), straight lines between the points, (n, m)."""
    found = np.empty((places.size, modes.shape[1]))
    for k in range(places.size):
        left = min(int(places[k]), modes.shape[0] - 2)
        part = places[k] - left
        for i in range(modes.shape[1]):
            found[k, i] = (1 - part) * modes[left, i] + part * modes[left + 1, i]
    return found


@compiled
def _blended_by_direction(modes: Array, places: Array, direction: Array) -> Array:
    count = modes.shape[1]
    found = np.zeros((places.size, 2 * count))
    for k in range(places.size):
        left = min(int(places[k]), modes.shape[0] - 2)
        part, first = places[k] - left, 0 if direction[k] >= 0 else count
        size = abs(direction[k])
        for i in range(count):
            found[k, first + i] = size * ((1 - part) * modes[left, i] + part * modes[left + 1, i])
    return found


#: Pairs of modes of a plane that are kept: those of more than this share of the largest deviation.
_MATTERS = 0.1


@dataclass(frozen=True, eq=False)
class Plane:
    """A smooth surface over two coordinates: products of two curves' modes, those that matter, `pairs` (2, m).

    The covariance is the product of the curves' (a Kronecker product), whose modes are the products of theirs.
    """

    one: Curve
    other: Curve
    pairs: NDArray[np.intp]

    @classmethod
    def of(cls, one: Curve, other: Curve) -> Plane:
        """With the modes that matter, the largest first."""
        sizes = np.outer(*(np.sqrt(np.mean(curve.modes**2, axis=0)) for curve in (one, other)))
        order = np.argsort(-sizes, axis=None)
        order = order[sizes.reshape(-1)[order] > _MATTERS * sizes.max()]
        return cls(one, other, np.stack(np.unravel_index(order, sizes.shape)))

    @property
    def size(self) -> int:
        return int(self.pairs.shape[1])

    def at(self, one: Array, other: Array) -> Array:
        """Every mode at coordinates (n,) each, (n, m)."""
        return np.asarray(_products(self.one.at(one), self.other.at(other), self.pairs))

    def folded(self, one: Array, other: Array, coefficients: Array) -> Array:
        """The surface with these coefficients (m,), (n, 1)."""
        table = np.zeros((self.one.size, self.other.size))
        table[self.pairs[0], self.pairs[1]] = coefficients
        return column(np.einsum("ni,ni->n", self.one.at(one) @ table, self.other.at(other)))


@compiled
def _products(one: Array, other: Array, pairs: NDArray[np.intp]) -> Array:
    found = np.empty((one.shape[0], pairs.shape[1]))
    for k in range(one.shape[0]):
        for i in range(pairs.shape[1]):
            found[k, i] = one[k, pairs[0, i]] * other[k, pairs[1, i]]
    return found


def column(values: Array) -> Array:
    """(n,) as (n, 1)."""
    return values[:, None]
