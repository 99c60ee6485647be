"""Recursive least squares with exponential forgetting, on the denoised signals.

Source: Ljung, System Identification, section 11.2 (the algorithm); of the paper's family [1, 5, 16]. Model of
the load's side, as drives have it: C = J ω̇_l + B ω_l + c. B takes friction that is not known and the J̇ of a
changing inertia, d(Jω)/dt = J ω̇ + J̇ ω; c takes an offset. The forgetting factor is e^(−4/N), so that a
sample of a period ago counts for 2 % (rule of `common`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.compiled import compiled
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.rivals.common import age_s, labelled, memory_s, started
from schwung.estimation.rivals.loadside import load_side
from schwung.motion import Array

#: Covariance of the scaled coefficients, over that of the noise: at first, and the largest trace let grow.
FIRST, LARGEST = 1e3, 1e6


@dataclass(frozen=True)
class RecursiveLeastSquares:
    """J, B and c, one update per sample."""

    name: str = "rls"
    needs_reference: bool = True

    def traces(self, task: Task) -> Outcome:
        """One recursion per run. Raises InputError as the denoised method does."""
        start, traces = started(task, self.name), []
        for pair, trace in zip(start.denoised, start.traces, strict=True):
            rate = pair.excited.sample_rate_hz
            load = load_side(task.machine, pair.torque_nm, pair.speed_rad_s, rate, task.frequency_hz)
            columns = np.column_stack(
                [load.acceleration_rad_s2, load.speed_rad_s, np.ones(load.speed_rad_s.size)]
            )
            memory = memory_s(task.frequency_hz)
            found = recursive_least_squares(columns, load.torque_nm, np.exp(-1 / (memory * rate)))
            traces.append(labelled(trace, pair, task, found[:, 0], age=age_s(rate, task.frequency_hz)))
        return replace(start, traces=tuple(traces))


def recursive_least_squares(regressors: Array, values: Array, forgetting: float) -> Array:
    """Coefficients after each sample, (n, p), of values (n,) ≈ regressors (n, p) · coefficients.

    Columns are scaled to equal size, so that one start covariance suits all units. `forgetting`: 0…1, the
    weight that a sample keeps per step.
    """
    scale = np.sqrt(np.mean(regressors**2, axis=0))
    scale[scale == 0] = 1.0
    return np.asarray(_recursion(regressors / scale, values, forgetting) / scale)


@compiled
def _recursion(regressors: Array, values: Array, forgetting: float) -> Array:
    n, p = regressors.shape
    found = np.zeros((n, p))
    theta = np.zeros(p)
    covariance = np.eye(p) * FIRST
    along = np.zeros(p)
    for i in range(n):
        row = regressors[i]
        power = forgetting
        miss = values[i]
        for a in range(p):
            along[a] = 0.0
            for b in range(p):
                along[a] += covariance[a, b] * row[b]
            power += row[a] * along[a]
            miss -= row[a] * theta[a]
        trace = 0.0
        for a in range(p):
            theta[a] += along[a] / power * miss
            found[i, a] = theta[a]
            trace += covariance[a, a] - along[a] * along[a] / power
        # without excitation forgetting would let the covariance grow for ever
        growth = 1 / forgetting if trace < LARGEST else 1.0
        for a in range(p):
            for b in range(a + 1):
                covariance[a, b] = (covariance[a, b] - along[a] * along[b] / power) * growth
                covariance[b, a] = covariance[a, b]
    return found
