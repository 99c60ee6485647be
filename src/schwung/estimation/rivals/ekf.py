"""Extended Kalman filter: the two-mass state with the inertia as one state more.

Source: Schütte, Beineke, Rolfsmeier, Grotstollen, "Online identification of mechanical parameters using extended
Kalman filters" (IAS 1997) and Perdomo, Pacas, Eutebach, Immel, "Identification of variable mechanical parameters
using extended Kalman filters" (SDEMPED 2013): references [19] and [18] of the paper. Model and tuning: `augmented`.
The transition's Jacobian is taken by differences of the integrated step, which is exact to rounding for the three
linear states. The covariance is updated in Joseph's form, which stays positive.
"""

from __future__ import annotations

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


@dataclass(frozen=True)
class ExtendedKalman(AugmentedKalman):
    """Extended Kalman filter."""

    name: str = "ekf"

    def log_inertia(self, run: Filtering) -> Array:
        """Of the compiled filter, (n,)."""
        return np.asarray(_filter(*run.arguments))


@compiled
def _filter(
    torque: Array, speed: Array, start: Array, covariance: Array, process: Array, variance: float, p: Params
) -> Array:
    n = torque.size
    found = np.empty(n)
    state, cov = start.copy(), covariance.copy()
    ahead, shifted, other = np.empty(STATES), np.empty(STATES), np.empty(STATES)
    jacobian, half, work = np.empty((STATES, STATES)), np.empty((STATES, STATES)), np.empty((5, STATES))
    gain = np.empty(STATES)
    for i in range(n):
        if i > 0:
            advance(state, torque[i - 1], torque[i], p, ahead, work)
            for k in range(STATES):
                delta = 1e-6 * max(1.0, abs(state[k]))
                shifted[:] = state
                shifted[k] += delta
                advance(shifted, torque[i - 1], torque[i], p, other, work)
                for a in range(STATES):
                    jacobian[a, k] = (other[a] - ahead[a]) / delta
            state[:] = ahead
            _sandwich(jacobian, cov, half)
            for a in range(STATES):
                cov[a, a] += process[a]
        spread = cov[ROTOR, ROTOR] + variance
        miss = speed[i] - state[ROTOR]
        for a in range(STATES):
            gain[a] = cov[a, ROTOR] / spread
            state[a] += gain[a] * miss
            for b in range(STATES):
                jacobian[a, b] = 1.0 if a == b else 0.0
            jacobian[a, ROTOR] -= gain[a]
        _sandwich(jacobian, cov, half)
        for a in range(STATES):
            for b in range(STATES):
                cov[a, b] += variance * gain[a] * gain[b]
        found[i] = state[LOG_INERTIA]
    return found


@compiled
def _sandwich(matrix: Array, covariance: Array, half: Array) -> None:
    """covariance ← matrix · covariance · matrixᵀ, kept symmetric; `half` is scratch."""
    for a in range(STATES):
        for b in range(STATES):
            half[a, b] = 0.0
            for c in range(STATES):
                half[a, b] += matrix[a, c] * covariance[c, b]
    for a in range(STATES):
        for b in range(a + 1):
            total = 0.0
            for c in range(STATES):
                total += half[a, c] * matrix[b, c]
            covariance[a, b] = total
            covariance[b, a] = total
