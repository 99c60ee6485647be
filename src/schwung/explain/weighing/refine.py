"""The shape of a cause between the points of its grid: where the evidence is highest, and how sharp it is there.

About a shape, columns are polynomials of the shape's numbers: whitened at a few nodes, they are known everywhere
between them, and so is the evidence. The nodes move with its top, and are drawn together until it is as high as
they say.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.weighing.data import Atom, Data
from schwung.innovations.evidence import block_gains, weigh
from schwung.innovations.statistics import Numbers
from schwung.motion import Array

#: A shape is refined until its evidence is known within this.
_SETTLED = 0.05
#: Nodes in each of a shape's numbers, by how many of these there are; how often they are laid at most.
_NODES, _DRAWS = {1: 5, 2: 4, 3: 3}, 10
#: Half of what the nodes span at first, over the grid's spacing; what it shrinks by.
_FIRST, _SHRINK = 0.5, 0.1
#: A shape that was refined before is sought again within so many of its deviations.
_AGAIN = 4.0
#: Beyond so many times their reach the nodes say nothing.
_TRUSTED = 2.0
#: Places in each number that are looked at between the nodes; how near the best is come to, over the box.
_PLACES, _FINE = {1: 33, 2: 9, 3: 7}, 1 / 200
#: Of the width over which the evidence is measured, as a share of the grid's spacing; divided until it is about one.
_STEP = 0.25


@dataclass(frozen=True, eq=False)
class _Box:
    """Columns at the nodes of a box of shapes, with what a set's members explain taken off."""

    centre: Array  # (d,) in spacings from where the search began
    reach: float  # half of the width
    gram: Array  # (nodes, p, nodes, p)
    slope: Array  # (nodes, p)
    deviations: Array  # (p,)
    allowed: Callable[[Array], NDArray[np.bool_]]  # which of several shapes (m, d) are within their bounds

    def gain(self, moved: Array) -> float:
        """Log evidence that the columns of a shape (d,) add; −∞ where it is none."""
        return float(self.gains(moved[None])[0])

    def gains(self, moved: Array) -> Array:
        """Of several shapes (m, d), (m,)."""
        away, size = (moved - self.centre) / self.reach, self.deviations.size
        weights: Array = np.ones((away.shape[0], 1))
        for numbers in away.T:
            each = _lagrange(_points(self.centre.size), numbers)
            weights = (weights[:, :, None] * each[:, None]).reshape(away.shape[0], -1)
        nodes = weights.shape[1]
        once = (weights @ self.gram.reshape(nodes, -1)).reshape(-1, size, nodes, size)
        gram = np.einsum("mn,mpnq->mpq", weights, once)
        found = block_gains(gram, weights @ self.slope, self.deviations, (1.0,))[:, 0]
        near = np.max(np.abs(away), axis=1) <= _TRUSTED
        return np.where(near & self.allowed(moved), found, -np.inf)

    def top(self) -> Array:
        """The best shape in the box: the best of evenly spread places, then of others about that."""
        size = self.centre.size
        each = np.array(list(product(np.linspace(-1.0, 1.0, _PLACES[size]), repeat=size)))
        best, about = self.centre, self.reach
        while about > _FINE * self.reach:
            places = np.clip(best + about * each, self.centre - self.reach, self.centre + self.reach)
            best = places[int(np.argmax(self.gains(places)))]
            about *= 2 / (_PLACES[size] - 1)
        return best


def refined(data: Data, atom: Atom, members: Numbers, deviations: Array, scale: float) -> Atom | None:
    """An atom of a better shape beside `members`, or None where there is none within bounds.

    Its log share of all shapes is that of a Gaussian of the evidence's width among as many shapes as the grid has.
    """
    candidate, start = data.candidates[atom.candidate], _coded(data.candidates[atom.candidate], atom.shape)
    laid = partial(_laid, data, atom, members, deviations, scale)
    centre, reach = np.zeros(start.size), _reach(candidate, atom)
    box = laid(centre, reach)
    first = height = box.gain(centre)
    for _ in range(_DRAWS):
        if data.work.spent:
            break
        best = box.top()
        told, edge = box.gain(best), bool(np.max(np.abs(best - centre)) > 0.9 * reach)
        if told < height + _SETTLED:
            break
        tried = laid(best, reach if edge else _SHRINK * reach)
        found = tried.gain(best)
        if found < height:  # the nodes were too far apart
            box = laid(centre, reach := _SHRINK * reach)
            continue
        centre, reach, height, box = best, tried.reach, found, tried
        if abs(found - told) < _SETTLED and not edge:
            break
    if height <= first + (_SETTLED if atom.refined is not None else 0.0):
        return None
    shape = tuple(_decoded(candidate, start + centre * np.array(candidate.spacing)).tolist())
    share, widths = candidate.shape_log, np.zeros(start.size)
    for axis in range(start.size):
        width = _width(partial(_on_line, box.gain, centre, np.eye(start.size)[axis]), height)
        share += min(0.0, float(np.log(np.sqrt(2 * np.pi) * width)))
        widths[axis] = width * _unit(candidate, shape, axis)
    return data.append(atom.candidate, shape, share, tuple(widths.tolist()))


def _laid(
    data: Data, atom: Atom, members: Numbers, deviations: Array, scale: float, centre: Array, reach: float
) -> _Box:
    """Nodes about a shape that is `centre` spacings from the atom's."""
    candidate = data.candidates[atom.candidate]
    start, spacing = _coded(candidate, atom.shape), np.array(candidate.spacing)
    low, high = np.array(candidate.bounds).T

    def shapes_at(moved: Array) -> Array:
        return np.asarray(_decoded(candidate, start + moved * spacing))

    def allowed(moved: Array) -> NDArray[np.bool_]:
        shapes = shapes_at(moved)
        return np.asarray(np.all((low <= shapes) & (shapes <= high), axis=-1))

    nodes_at = centre + reach * np.array(list(product(_points(start.size), repeat=start.size)))
    causes = [(candidate, tuple(shape)) for shape in shapes_at(nodes_at).tolist()]
    cross, gram, slope = data.beside(members, causes)
    known = weigh(data.at(members), deviations)
    across = solve_triangular(known.factor, (cross * deviations).T, lower=True, check_finite=False)
    nodes, size = len(causes), candidate.size
    return _Box(
        centre,
        reach,
        (gram - across.T @ across).reshape(nodes, size, nodes, size),
        (slope - cross @ known.coefficients).reshape(nodes, size),
        scale * np.array(candidate.deviations),
        allowed,
    )


def _points(numbers: int) -> Array:
    """Chebyshev's, from −1 to 1."""
    count = _NODES[numbers]
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count))


def _lagrange(points: Array, places: Array) -> Array:
    """Weights of values at points (k,) in their polynomial at places (m,), (m, k)."""
    own = np.eye(points.size, dtype=bool)
    between = np.where(own, 1.0, points[:, None] - points)
    others = np.where(own, 1.0, (places[:, None] - points)[:, None])
    return np.asarray(np.prod(others / between, axis=2))


def _reach(candidate: Candidate, atom: Atom) -> float:
    """Half of what the first nodes span (spacings)."""
    if not atom.spread:
        return _FIRST
    widths = [spread / _unit(candidate, atom.shape, axis) for axis, spread in enumerate(atom.spread)]
    return min(_FIRST, _AGAIN * max(widths))


def _unit(candidate: Candidate, shape: Shape, axis: int) -> float:
    """One spacing, in the unit of the shape's number."""
    return candidate.spacing[axis] * (shape[axis] if candidate.logarithmic[axis] else 1.0)


def _on_line(log_at: Callable[[Array], float], at: Array, along: Array, far: float) -> float:
    return log_at(at + far * along)


def _width(log_at: Callable[[float], float], top: float) -> float:
    """Standard deviation (in grid spacings) of a Gaussian that falls like the evidence about its top."""
    step = _STEP
    for _ in range(20):
        drop = top - (log_at(step) + log_at(-step)) / 2
        if not np.isfinite(drop) or drop > 2:
            step /= 3
            continue
        return float(step / np.sqrt(2 * max(drop, 1e-6)))
    return step


def _coded(candidate: Candidate, shape: Shape) -> Array:
    values = [np.log(v) if log else v for v, log in zip(shape, candidate.logarithmic, strict=True)]
    return np.array(values, dtype=float)


def _decoded(candidate: Candidate, code: Array) -> Array:
    """Shapes (…, d)."""
    logarithmic = np.array(candidate.logarithmic)
    return np.where(logarithmic, np.exp(np.where(logarithmic, code, 0.0)), code)
