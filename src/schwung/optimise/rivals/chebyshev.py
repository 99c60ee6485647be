"""The Chebyshev method: a polynomial whose free coefficients a genetic algorithm finds.

After Van Oosterwyck et al., "Energy optimal point-to-point motion profile optimization", arXiv 2201.01595: position
as Chebyshev polynomial, at rest at both ends, RMS torque by the inverse dynamics of the stiff machine, bounded
coefficients, a global optimiser. The algorithm is scipy's differential evolution; the bound, derived anew: a curve that
stays within its stroke, |f − ½| ≤ ½, has |p_i| = 2/π |∫(f − ½) cos iφ dφ| ≤ 2/π.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.optimize import differential_evolution

from schwung.motion import Array
from schwung.optimise.model import Model
from schwung.optimise.values import Task

#: Free coefficients beside the six that rest at both ends asks for.
FREE = 5
#: Instants at which the torque is taken.
_INSTANTS = 201
#: What a torque beyond the limit costs, by its square, beside the squared torque itself.
_PENALTY = 1e3
_BOUND = 2 / np.pi


@dataclass(frozen=True, eq=False)
class ChebyshevStroke:
    """Coefficients p_i of Σ p_i T_i(x), x = −1…1 over the duration, which give the share of the stroke."""

    coefficients: Array
    evaluations: int  # of whole populations

    def shares(self, u: Array) -> Array:
        """Share of the stroke and its two derivatives by u, (3, n), at shares u of the duration."""
        return np.array(
            [2.0**k * chebyshev.chebval(2 * u - 1, chebyshev.chebder(self.coefficients, k)) for k in range(3)]
        )


def chebyshev_stroke(
    model: Model, task: Task, duration_s: float, seed: int = 0, free: int = FREE
) -> ChebyshevStroke:
    """The best polynomial of degree 5 + `free` by RMS torque on the stiff machine, within the torque limit."""
    degree = 5 + free
    u = (1 - np.cos(np.pi * np.arange(_INSTANTS) / (_INSTANTS - 1))) / 2
    weights = np.gradient(u)
    basis = _basis(degree, u)  # (3, degree+1, n)
    ends = _basis(degree, np.array([0.0, 1.0]))  # rest: share 0 and 1, both derivatives 0
    conditions = np.concatenate([ends[k].T for k in range(3)])  # (6, degree+1)
    wanted = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    solved = np.linalg.inv(conditions[:, :6])

    def whole(tail: Array) -> Array:
        head = solved @ (wanted[:, None] - conditions[:, 6:] @ tail)
        return np.concatenate([head, tail])

    def cost(tail: Array) -> Array:
        """Of a population (free, m): mean square of the torque, (m,)."""
        coefficients = whole(tail.reshape(free, -1))
        share, speed, acceleration = (np.tensordot(coefficients, basis[k], (0, 0)) for k in range(3))
        angle = task.start_rad + task.distance_rad * np.clip(share, -0.02, 1.02)
        pace = task.distance_rad * speed / duration_s
        needed = (model.rotor_inertia_kgm2 + model.load_inertia(angle)) * task.distance_rad * acceleration
        torque = model.reported(
            needed / duration_s**2 + model.load_needs(angle, pace) + model.motor_needs(angle, pace)
        )
        beyond = np.maximum(np.abs(torque) - model.torque_max_nm, 0.0)
        outside = np.maximum(np.abs(share - 0.5) - 0.5, 0.0) * model.torque_max_nm
        return np.asarray((torque**2 + _PENALTY * (beyond**2 + outside**2)) @ weights)

    found = differential_evolution(
        lambda tail: cost(tail) if tail.ndim > 1 else float(cost(tail)[0]),
        [(-_BOUND, _BOUND)] * free,
        rng=np.random.default_rng(seed),
        vectorized=True,
        updating="deferred",
        polish=True,
        init="sobol",
    )
    return ChebyshevStroke(whole(np.asarray(found.x)[:, None])[:, 0], int(found.nfev))


def fitted(share: Sequence[float] | Array, degree: int) -> Array:
    """Chebyshev coefficients (degree+1,) of a stroke given at even shares of its duration, rest at the ends kept."""
    values = np.asarray(share, dtype=float)
    u = np.linspace(0.0, 1.0, values.size)
    weight = np.ones(values.size)
    weight[[0, -1]] = 1e3  # the ends are where they are
    return np.asarray(chebyshev.chebfit(2 * u - 1, values, degree, w=weight))


def _basis(degree: int, u: Array) -> Array:
    """Chebyshev polynomials and their two derivatives by u, (3, degree+1, n)."""
    unit = np.eye(degree + 1)
    return np.array(
        [[2.0**k * chebyshev.chebval(2 * u - 1, chebyshev.chebder(row, k)) for row in unit] for k in range(3)]
    )
