"""What is known of the trajectory fit's parameters before any sample, and how smooth the curves are: by evidence.

Differences of the splines' coefficients are taken as normal with one standard deviation per curve: fourth ones of
log J_l, as in `solve.py`, second ones of T_l. Both deviations are those that make the recording most likely with all
coefficients integrated out (marginal likelihood), so that no smoothness is ever set by hand: a constant inertia comes
out constant, a bent one bent. Fourth differences of a smooth curve shrink with the fourth power of a piece's length,
noise does not: where second ones leave a band twice the Cramér-Rao bound, these come below it, and a step in the curve
costs them nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from schwung.drivetrain.machine import Machine
from schwung.estimation.left_out import LEFT_OUT
from schwung.estimation.trajectory_model import Layout
from schwung.innovations import kernel
from schwung.innovations.steps import no_such_machine
from schwung.motion import Array

#: Standard deviation of a delay (s), and of the logarithms of stiffness and damping about the machine's.
DELAY_S, STIFFNESS, DAMPING = 5e-4, 0.1, 0.5
#: Delays are within so many times as far of what the ripple says as that says itself: it is seen by the fit, too, and
#: would else count twice.
SEEN = 3.0
#: Of log J_l about the best constant one: anything within a few orders of magnitude.
LOG_INERTIA = 3.0
_PINNED = 1e-9
_PINNED_S2 = 1e-18  # the same of a loss: how far it is unknown is counted beside the fit
#: Orders of the differences that are small in log J_l and in T_l.
ORDER, TORQUE_ORDER = 4, 2
#: Logarithms of their deviations that are tried: log J_l itself, and T_l over peak torque.
_LOWEST, _HIGHEST = np.log(1e-7), np.log(3.0)


@dataclass(frozen=True, eq=False)
class Prior:
    """Normal prior: mean and precision (P,) of each parameter, and roughness of the two curves."""

    layout: Layout
    mean: Array
    precision: Array
    torque_nm: float

    def matrix(self, log_deviations: Sequence[float]) -> tuple[Array, float]:
        """The whole precision (P, P) with the given deviations of the differences, and log of its determinant."""
        at, result = self.layout, np.diag(self.precision)
        logs = np.log(self.precision)
        for where, order, weight in (
            (at.inertia, ORDER, np.exp(-2 * log_deviations[0])),
            (at.load_torque, TORQUE_ORDER, np.exp(-2 * log_deviations[1]) / self.torque_nm**2),
        ):
            bends, values = _bends(where.stop - where.start, order)
            result[where, where] += weight * bends
            logs[where] = np.log(self.precision[where] + weight * values)
        return result, float(np.sum(logs))


@cache
def _bends(count: int, order: int) -> tuple[Array, Array]:
    """Sum of squared differences of an order as a matrix (count, count), and its eigenvalues."""
    differences = np.diff(np.eye(count), order, axis=0)
    matrix = differences.T @ differences
    values = np.zeros(count)  # as many vanish as a polynomial has coefficients
    values[order:] = np.linalg.eigvalsh(matrix)[order:]
    return matrix, values


def prior_for(
    layout: Layout,
    machine: Machine,
    inertia_kgm2: float,
    *,
    held: bool,
    coupling: bool,
    shown: Collection[int] = (),
    lags: tuple[tuple[float, float], tuple[float, float]] | None = None,
) -> Prior:
    """The prior of a machine about a constant inertia; what it cannot have is pinned, and its coupling unless asked.

    `shown`: what of `LEFT_OUT` is there. `lags`: what the ripple by itself said of the delays of torque and speed, and
    its standard deviations (s). Without,
    a coupling twice as limp and a torque half a millisecond off make up for each other.
    """
    peak = machine.motor.peak_torque_nm
    mean, deviation = np.zeros(layout.size), np.ones(layout.size)
    mean[layout.inertia] = np.log(inertia_kgm2)
    deviation[layout.inertia] = LOG_INERTIA
    deviation[layout.load_torque] = peak
    deviation[layout.coulomb] = 0.2 * peak
    deviation[layout.viscous] = 0.01 * peak
    deviation[[layout.torque_delay, layout.speed_delay]] = DELAY_S
    if lags is not None:
        delays = [layout.torque_delay, layout.speed_delay]
        mean[delays], known = lags
        deviation[delays] = np.minimum(SEEN * np.array(known), DELAY_S)
    deviation[layout.controller_delay] = DELAY_S if held else _PINNED
    deviation[layout.loss] = _PINNED_S2
    for number, one in enumerate(LEFT_OUT):
        natural = one.natural * (peak if one.of_peak else 1.0)
        deviation[layout.left_out.start + number] = natural if number in shown else _PINNED * natural
    shaft = machine.coupling if coupling else None
    deviation[layout.stiffness] = STIFFNESS if shaft else _PINNED
    deviation[layout.damping] = DAMPING if shaft and shaft.damping_nms > 0 else _PINNED
    return Prior(layout, mean, deviation**-2.0, peak)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Where data and prior agree: parameters (P,), their covariance (P, P), and the deviations chosen."""

    parameters: Array
    covariance: Array
    log_deviations: tuple[float, float]


def posterior(
    prior: Prior, information: Array, slope: Array, about: Array, start: tuple[float, float]
) -> Posterior:
    """The most likely parameters, for data of `information` (P, P) and `slope` (P,) about `about` (P,).

    Raises InputError where rounding is all that is left of the information.
    """
    pull = information @ about + slope

    def solved(log_deviations: Sequence[float]) -> tuple[float, Array, Array]:
        precision, volume = prior.matrix(log_deviations)
        whole = information + precision
        scale = 1 / np.sqrt(np.diag(whole))
        factor = kernel.cholesky(whole * scale[:, None] * scale)
        if not np.all(np.isfinite(factor)):
            return np.inf, about, factor
        half = solve_triangular(factor, scale * (pull + precision @ prior.mean), lower=True)
        found = scale * solve_triangular(factor, half, lower=True, trans="T")
        step, away = found - about, found - prior.mean
        cost = -slope @ step + step @ information @ step / 2 + away @ precision @ away / 2
        cost += np.sum(np.log(np.diag(factor))) - np.sum(np.log(scale)) - volume / 2
        return float(cost), found, factor / scale[:, None]

    best = minimize(
        lambda v: solved(v)[0], np.array(start), method="Nelder-Mead", bounds=[(_LOWEST, _HIGHEST)] * 2,
        options={"xatol": 0.05, "fatol": 0.02, "initial_simplex": np.array(start) + 0.7 * np.eye(3, 2, -1)},
    )  # fmt: skip
    chosen = (float(best.x[0]), float(best.x[1]))
    cost, found, factor = solved(chosen)
    if not np.isfinite(cost):
        raise no_such_machine()
    root = solve_triangular(factor, np.eye(found.size), lower=True)
    return Posterior(found, root.T @ root, chosen)
