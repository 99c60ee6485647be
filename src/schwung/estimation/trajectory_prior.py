"""What is known of the trajectory fit's parameters before any sample, and how smooth the curves are: by evidence.

Second differences of the splines' coefficients are taken as normal with one standard deviation per curve. Both
deviations are those that make the recording most likely with all coefficients integrated out (marginal likelihood),
so that no smoothness is ever set by hand: a constant inertia comes out constant, a bent one bent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from schwung.drivetrain.machine import Machine
from schwung.estimation.trajectory_model import Layout
from schwung.motion import Array

#: Standard deviation of a delay (s), and of the logarithms of stiffness and damping about the machine's.
DELAY_S, STIFFNESS, DAMPING = 5e-4, 0.1, 0.5
#: Of log J_l about the best constant one: anything within a few orders of magnitude.
LOG_INERTIA = 3.0
_PINNED = 1e-9
#: Logarithms of the deviations of second differences that are tried: log J_l itself, and T_l over peak torque.
_LOWEST, _HIGHEST = np.log(1e-6), np.log(3.0)


@dataclass(frozen=True, eq=False)
class Prior:
    """Normal prior: mean and precision (P,) of each parameter, and roughness of the two curves."""

    mean: Array
    precision: Array
    roughness: tuple[Array, Array]  # second-difference matrices (P, P) of log J_l and of T_l
    torque_nm: float

    def matrix(self, log_deviations: Sequence[float]) -> Array:
        """The whole precision (P, P) with the given deviations of second differences."""
        bent, loaded = (float(np.exp(-2 * value)) for value in log_deviations)
        result = np.diag(self.precision) + bent * self.roughness[0]
        result += loaded / self.torque_nm**2 * self.roughness[1]
        return np.asarray(result)


def prior_for(layout: Layout, machine: Machine, inertia_kgm2: float, *, held: bool) -> Prior:
    """The prior of a machine about a constant inertia; what it cannot have is pinned to zero."""
    peak = machine.motor.peak_torque_nm
    mean, deviation = np.zeros(layout.size), np.ones(layout.size)
    mean[layout.inertia] = np.log(inertia_kgm2)
    deviation[layout.inertia] = LOG_INERTIA
    deviation[layout.load_torque] = peak
    deviation[layout.coulomb] = 0.2 * peak
    deviation[layout.viscous] = 0.01 * peak
    deviation[[layout.torque_delay, layout.speed_delay]] = DELAY_S
    deviation[layout.controller_delay] = DELAY_S if held else _PINNED
    deviation[layout.stiffness] = STIFFNESS if machine.coupling else _PINNED
    deviation[layout.damping] = DAMPING if machine.coupling and machine.coupling.damping_nms > 0 else _PINNED
    return Prior(
        mean, deviation**-2.0, (_bend(layout, layout.inertia), _bend(layout, layout.load_torque)), peak
    )


def _bend(layout: Layout, where: slice) -> Array:
    count = layout.basis.size
    second = np.diff(np.eye(count), 2, axis=0)
    result = np.zeros((layout.size, layout.size))
    result[where, where] = second.T @ second
    return result


@dataclass(frozen=True, eq=False)
class Posterior:
    """Where data and prior agree: parameters (P,), their covariance (P, P), and the deviations chosen."""

    parameters: Array
    covariance: Array
    log_deviations: tuple[float, float]


def posterior(
    prior: Prior, information: Array, slope: Array, about: Array, start: tuple[float, float]
) -> Posterior:
    """The most likely parameters, for data of `information` (P, P) and `slope` (P,) about `about` (P,)."""
    pull = information @ about + slope

    def solved(log_deviations: Sequence[float]) -> tuple[float, Array, tuple[Array, bool], Array]:
        precision = prior.matrix(log_deviations)
        whole = information + precision
        scale = 1 / np.sqrt(np.diag(whole))
        factor = cho_factor(whole * scale[:, None] * scale)
        found = scale * cho_solve(factor, scale * (pull + precision @ prior.mean))
        step, away = found - about, found - prior.mean
        cost = -slope @ step + step @ information @ step / 2 + away @ precision @ away / 2
        cost += np.sum(np.log(np.diag(factor[0]))) - np.sum(np.log(scale))
        return float(cost - np.linalg.slogdet(precision)[1] / 2), found, factor, scale

    bounds = [(_LOWEST, _HIGHEST)] * 2
    best = minimize(
        lambda v: solved(np.clip(v, _LOWEST, _HIGHEST))[0], np.array(start), method="Nelder-Mead", bounds=bounds,
        options={"xatol": 0.02, "fatol": 1e-3, "initial_simplex": np.add(start, [[0, 0], [0.7, 0], [0, 0.7]])},
    )  # fmt: skip
    chosen = (float(best.x[0]), float(best.x[1]))
    _, found, factor, scale = solved(chosen)
    covariance = scale[:, None] * cho_solve(factor, np.eye(scale.size)) * scale
    return Posterior(found, covariance, chosen)
