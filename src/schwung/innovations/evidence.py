"""The evidence of a set of columns: y = X·β + white noise of deviation 1, β normal about 0, and β integrated out.

    log p(y | set) = −½ yᵀy + ½ bᵀ(V⁻¹ + XᵀX)⁻¹b − ½ log det(1 + V·XᵀX) + const        b = Xᵀy

All from sufficient statistics. `gains` is what each of many blocks of columns would add to a set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.lapack import dtrtri

from schwung.innovations.statistics import Numbers, Statistics
from schwung.motion import Array

#: Of sums of products, over the largest of them.
ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Weighed:
    """A set's evidence (log, but for what all sets share), its coefficients (P,) and their covariance's factor."""

    log_evidence: float
    coefficients: Array
    factor: Array  # lower; of D(V⁻¹ + XᵀX)D, D = deviations
    deviations: Array

    @property
    def covariance(self) -> Array:
        """(P, P)."""
        root = self._root
        return np.asarray(root.T @ root)

    @property
    def spread(self) -> Array:
        """Standard deviations (P,)."""
        return np.asarray(np.sqrt(np.sum(self._root**2, axis=0)))

    @property
    def _root(self) -> Array:
        """Of the covariance, lower."""
        inverse, _ = dtrtri(self.factor, lower=1)
        return np.asarray(inverse * self.deviations)


def weigh(data: Statistics, deviations: Array) -> Weighed:
    """All columns of `data`, with prior deviations (P,)."""
    inner = data.gram * deviations[:, None] * deviations
    # columns that are nearly one another's sum leave nothing of the 1 but rounding
    inner[np.diag_indices_from(inner)] += 1.0 + ROUNDING * float(np.max(np.diag(inner), initial=0.0))
    factor, _ = cho_factor(inner, lower=True, check_finite=False)
    pull = deviations * data.slope
    found = cho_solve((factor, True), pull, check_finite=False)
    log = -0.5 * data.square + 0.5 * float(pull @ found) - float(np.sum(np.log(np.diag(factor))))
    return Weighed(log, deviations * found, np.tril(factor), deviations)


@dataclass(frozen=True, eq=False)
class Beyond:
    """What all columns hold beyond a set's: `across` (A, P) takes the set's part off the others'."""

    data: Statistics
    across: Array
    slope: Array  # (P,)

    @classmethod
    def of(cls, data: Statistics, members: Numbers, deviations: Array) -> Beyond:
        """Beyond the columns `members` (A,) with prior deviations (A,)."""
        if members.size == 0:
            return cls(data, np.zeros((0, data.slope.size)), data.slope)
        set_of = weigh(data.at(members), deviations)
        across = solve_triangular(
            set_of.factor, deviations[:, None] * data.gram[members], lower=True, check_finite=False
        )
        slope = data.slope - set_of.coefficients @ data.gram[members]
        return cls(data, across, slope)

    def gains(self, wheres: Sequence[slice], deviations: Array, scales: Sequence[float]) -> Array:
        """Log evidence that each of some blocks of p columns adds, their deviations (p,) times each of the scales.

        (blocks, scales).
        """
        which = np.array([np.arange(where.start, where.stop) for where in wheres])
        part = self.across[:, which].transpose(1, 0, 2)  # (blocks, A, p)
        gram = self.data.gram[which[:, :, None], which[:, None, :]] - part.transpose(0, 2, 1) @ part
        return block_gains(gram, self.slope[which], deviations, scales)


def block_gains(gram: Array, slope: Array, deviations: Array, scales: Sequence[float]) -> Array:
    """Log evidence that blocks of columns (b, p, p), (b, p) add to nothing, (b, scales); see `Beyond.gains`.

    Columns that run away are worth nothing (−∞).
    """
    runs_away = np.logical_not(np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(slope).all(axis=1))
    if np.any(runs_away):
        gram, slope = gram.copy(), slope.copy()
        gram[runs_away], slope[runs_away] = 0.0, 0.0
    gram = gram * deviations[:, None] * deviations
    slope = deviations * slope
    if deviations.size == 1:
        values, turned = gram[:, :, 0], slope**2
    else:
        values, vectors = np.linalg.eigh(gram)
        turned = (slope[:, None, :] @ vectors)[:, 0] ** 2
    values, squares = np.maximum(values, 0.0)[:, None], np.square(scales)[:, None]
    each = squares * turned[:, None] / (1 + squares * values) - np.log1p(squares * values)
    return np.asarray(np.where(np.reshape(runs_away, (-1, 1)), -np.inf, 0.5 * np.sum(each, axis=2)))
