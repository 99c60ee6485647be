"""Sigma-point (unscented) Kalman filter on the same augmented model as the extended one.

Source: van der Merwe, "Sigma-point Kalman filters for probabilistic inference in dynamic state-space models" (PhD
thesis, 2004), reference [20] of the paper; the points and weights are the symmetric set with κ = 0 (the cubature
rule of Arasaratnam and Haykin, 2009): 2 n points of equal weight at √n standard deviations, none of them negative.
Model and tuning: `augmented`. Instead of a Jacobian the points themselves go through the integrated step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schwung.compiled import compiled
from schwung.estimation.rivals.augmented import (
    LOG_INERTIA,
    ROTOR,
    STATES,
    AugmentedKalman,
    Filtering,
    Params,
    advance,
)
from schwung.motion import Array

POINTS = 2 * STATES


@dataclass(frozen=True)
class SigmaPoint(AugmentedKalman):
    """Sigma-point Kalman filter."""

    name: str = "sigma_point"

    def log_inertia(self, run: Filtering) -> Array:
        """Of the compiled filter, (n,)."""
        return np.asarray(_filter(*run.arguments))


@compiled
def _filter(
    torque: Array, speed: Array, start: Array, covariance: Array, process: Array, variance: float, p: Params
) -> Array:
    n = torque.size
    found = np.empty(n)
    state, cov, root = start.copy(), covariance.copy(), np.zeros((STATES, STATES))
    points, point = np.empty((POINTS, STATES)), np.empty(STATES)
    work, gain = np.empty((5, STATES)), np.empty(STATES)
    for i in range(n):
        if i > 0:
            _square_root(cov, root)
            for k in range(POINTS):
                side = math.sqrt(STATES) * (1 - 2 * (k % 2))
                for a in range(STATES):
                    point[a] = state[a] + side * root[a, k // 2]
                advance(point, torque[i - 1], torque[i], p, points[k], work)
            _moments(points, process, state, cov)
        # the measurement is linear: the sigma points would give the plain update
        spread = cov[ROTOR, ROTOR] + variance
        miss = speed[i] - state[ROTOR]
        for a in range(STATES):
            gain[a] = cov[a, ROTOR] / spread
        for a in range(STATES):
            state[a] += gain[a] * miss
            for b in range(STATES):
                cov[a, b] -= gain[a] * gain[b] * spread
        found[i] = state[LOG_INERTIA]
    return found


@compiled
def _moments(points: Array, process: Array, mean: Array, covariance: Array) -> None:
    """Mean and covariance of the points, into `mean` and `covariance`; the process noise is added."""
    for a in range(STATES):
        mean[a] = 0.0
        for k in range(POINTS):
            mean[a] += points[k, a] / POINTS
    for a in range(STATES):
        for b in range(STATES):
            covariance[a, b] = process[a] if a == b else 0.0
            for k in range(POINTS):
                covariance[a, b] += (points[k, a] - mean[a]) * (points[k, b] - mean[b]) / POINTS


@compiled
def _square_root(covariance: Array, root: Array) -> None:
    """Lower Cholesky factor; a direction without any variance (rounding may make it negative) gets none."""
    for a in range(STATES):
        for b in range(a + 1):
            total = covariance[a, b]
            for c in range(b):
                total -= root[a, c] * root[b, c]
            if a == b:
                root[a, a] = math.sqrt(max(total, 0.0))
            else:
                root[a, b] = total / root[b, b] if root[b, b] > 1e-12 * math.sqrt(covariance[b, b]) else 0.0
