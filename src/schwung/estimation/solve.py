"""Penalised least squares with the roughness that the data's own likelihood asks for (REML)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.linalg import LinAlgError
from scipy.linalg import block_diag
from scipy.linalg.lapack import dpotrf, dtrtrs

from schwung.motion import Array

#: Order of the differences that the penalty squares: 4 draws towards a cubic.
ORDER = 4
#: Exponents of λ over the mean power of a penalised column: from no smoothing at all to none but a cubic.
_COARSE, _FINE, _FINEST = (
    np.arange(-18.0, 8.1, 1.0),
    np.arange(-0.75, 0.76, 0.25),
    np.arange(-0.2, 0.21, 0.05),
)


@dataclass(frozen=True, eq=False)
class Solution:
    """Coefficients (K,), nuisances (m,), covariance of both (K + m, K + m), residuals (rows,) and their variance.

    `leverage`, (rows,): the share of each row's own noise that the fit has followed, 0…1.
    """

    coefficients: Array
    nuisances: Array
    covariance: Array
    variance: float
    residual: Array
    leverage: Array


def solve(
    inertia: Array, nuisance: Array, y: Array, prior_std: Array, considered: Array | None = None
) -> Solution:
    """Minimise |y − inertia·c − nuisance·p|² + λ|Δᵏc|² + σ²Σ(p/prior)², λ by restricted maximum likelihood.

    `considered`, (rows, j): what y may be off by, one standard deviation each, without being fitted; it only widens the
    covariance, by the square of what it would move the solution by.

    In coordinates in which the penalty is λ times 1 or 0, and each column scaled to 1: else a stiff curve and a limp
    one differ by so much that nothing is left of the covariance.
    """
    size, count = inertia.shape[1], nuisance.shape[1]
    bends = _bending_coordinates(size)
    design = np.column_stack([inertia @ bends, nuisance])
    scale = np.sqrt(np.sum(design**2, axis=0))
    scale[ORDER:size] = np.sqrt(np.mean(scale[ORDER:size] ** 2))
    power = float(y @ y)
    scale = np.maximum(scale, 1e-12 * scale[0])
    design = design / scale
    normal, right = design.T @ design, design.T @ y
    penalised = np.zeros(size + count)
    penalised[ORDER:size] = 1.0
    degrees = y.size - ORDER
    known = np.zeros(size + count)
    variance = exponent = 0.0
    for exponents in (_COARSE, _FINE, _FINEST):
        found = []
        for tried in exponent + exponents:
            root = _Root.of(normal, 10.0**tried * penalised + known)
            half = root.lower(right)
            loss = max(power - float(half @ half), 1e-14 * power)
            criterion = degrees * np.log(loss) + root.log_determinant
            found.append((criterion - (size - ORDER) * np.log(10.0**tried), tried, loss))
        _, exponent, loss = min(found)
        variance = loss / degrees
        known[size:] = variance / (prior_std * scale[size:]) ** 2
    root = _Root.of(normal, 10.0**exponent * penalised + known)
    inverse = root.inverse()
    x = inverse @ right
    leverage = np.clip(np.einsum("ri,ri->r", design @ inverse, design), 0.0, 1.0)
    back = block_diag(bends, np.eye(count)) / scale
    values = back @ x
    moved = (
        back @ (inverse @ (design.T @ considered)) if considered is not None else np.zeros((values.size, 0))
    )
    return Solution(
        coefficients=values[:size],
        nuisances=values[size:],
        covariance=variance * back @ inverse @ back.T + moved @ moved.T,
        variance=variance,
        residual=y - design @ x,
        leverage=leverage,
    )


@cache
def _bending_coordinates(size: int) -> Array:
    """Coefficients = result · z, of which the first ORDER bend nothing; |Δᵏc|² is the sum of the others squared."""
    difference = np.diff(np.eye(size), ORDER, axis=0)
    values, vectors = np.linalg.eigh(difference.T @ difference)
    vectors[:, ORDER:] /= np.sqrt(values[ORDER:])
    return np.asarray(vectors)


@dataclass(frozen=True, eq=False)
class _Root:
    """Cholesky's factor of a matrix scaled to ones on its diagonal; by LAPACK itself, as dozens are tried."""

    factor: Array
    scale: Array

    @classmethod
    def of(cls, matrix: Array, diagonal: Array) -> _Root:
        whole = matrix.copy()
        own = whole.reshape(-1)[:: matrix.shape[0] + 1]  # a view
        own += diagonal
        own *= 1 + 1e-13
        scale = 1 / np.sqrt(np.maximum(own, 1e-300))
        factor, failed = dpotrf(whole * scale[:, None] * scale, lower=True)
        if failed:
            raise LinAlgError("not positive definite")
        return cls(factor, scale)

    @property
    def log_determinant(self) -> float:
        return 2 * float(np.sum(np.log(self.factor.diagonal())) - np.sum(np.log(self.scale)))

    def lower(self, right: Array) -> Array:
        """The factor's inverse on a right-hand side."""
        return np.asarray(dtrtrs(self.factor, self.scale * right, lower=True)[0])

    def inverse(self) -> Array:
        half = dtrtrs(self.factor, np.diag(self.scale), lower=True)[0]
        return np.asarray(half.T @ half)
