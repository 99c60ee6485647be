"""Penalised least squares with the roughness that the data's own likelihood asks for (REML)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from schwung.motion import Array

#: Order of the differences that the penalty squares: 3 draws towards a parabola.
ORDER = 3


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


def solve(inertia: Array, nuisance: Array, y: Array, prior_std: Array) -> Solution:
    """Minimise |y − inertia·c − nuisance·p|² + λ|Δ³c|² + σ²Σ(p/prior)², λ by restricted maximum likelihood."""
    size, count = inertia.shape[1], nuisance.shape[1]
    scale = np.maximum(np.sqrt(np.sum(nuisance**2, axis=0)), 1e-300)
    design = np.column_stack([inertia, nuisance / scale])
    difference = np.diff(np.eye(size), ORDER, axis=0)
    penalty = np.zeros((size + count,) * 2)
    penalty[:size, :size] = difference.T @ difference
    normal, right, power = design.T @ design, design.T @ y, float(y @ y)
    normal[np.diag_indices_from(normal)] *= 1 + 1e-13
    unit = np.trace(normal[:size, :size]) / np.trace(penalty)
    degrees = y.size - ORDER
    known = np.zeros((size + count,) * 2)
    variance = exponent = 0.0
    for exponents in (np.arange(-9.0, 9.1, 1.0), np.arange(-0.75, 0.76, 0.25), np.arange(-0.2, 0.21, 0.05)):
        found = []
        for tried in exponent + exponents:
            strength = unit * 10.0**tried
            factor = cholesky(normal + strength * penalty + known, lower=True, check_finite=False)
            half = solve_triangular(factor, right, lower=True, check_finite=False)
            loss = max(power - float(half @ half), 1e-14 * power)
            criterion = degrees * np.log(loss) + 2 * float(np.sum(np.log(np.diag(factor))))
            found.append((criterion - (size - ORDER) * np.log(strength), tried, loss))
        _, exponent, loss = min(found)
        variance = loss / degrees
        known[size:, size:] = np.diag(variance / (prior_std * scale) ** 2)
    matrix = normal + unit * 10.0**exponent * penalty + known
    x = np.linalg.solve(matrix, right)
    back = np.concatenate([np.ones(size), 1 / scale])
    inverse = np.linalg.inv(matrix)
    leverage = np.clip(np.einsum("ri,ri->r", design @ inverse, design), 0.0, 1.0)
    covariance = variance * inverse * np.outer(back, back)
    return Solution(x[:size], x[size:] / scale, covariance, variance, y - design @ x, leverage)
