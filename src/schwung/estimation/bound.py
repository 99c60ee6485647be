"""The Cramér-Rao bound of a session: how well its J_l(θ) can be known at all, whatever the method.

No unbiased estimate from these recordings, with this machine and this noise, has a smaller standard deviation. It
comes from the sensitivities of the innovations of a Kalman filter along the session's own trajectories (Ljung, System
Identification, 2nd ed., 7.4), the same model as the trajectory fit's; other parameters may be known or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from schwung.drivetrain.effects import effects_of
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.sampling import is_held
from schwung.estimation.table import DEFAULT_POINTS
from schwung.estimation.trajectory_fit import band_of, passed_over
from schwung.estimation.trajectory_model import Layout, Model
from schwung.estimation.trajectory_prior import posterior, prior_for
from schwung.innovations.likelihood import STICKING, Noise, likely_noise, resmoothed, systems_of
from schwung.innovations.signals import load_angle_range, signals_of
from schwung.innovations.splines import Basis
from schwung.motion import Array
from schwung.session.model import Run, Session

#: Spline pieces over the visited range, unless asked for: detail of a sixteenth of the stroke.
PIECES = 16
#: How often the states are brought to agree with the given machine.
_ROUNDS = 4
_GIVEN = 1e12  # precision of a logarithm that is given
_ROUGH = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Bound:
    """The least standard deviation over the load angle; arrays (points,)."""

    position_rad: Array
    inertia_kgm2: Array  # the given one
    std_kgm2: Array
    noise: Noise  # that it holds for

    @property
    def rms_kgm2(self) -> float:
        """Root mean square over the angles: the least RMSE of a table over them."""
        return float(np.sqrt(np.mean(self.std_kgm2**2)))


def cramer_rao(
    session: Session,
    machine: Machine,
    *,
    noise: Noise | None = None,
    pieces: int = PIECES,
    points: int = DEFAULT_POINTS,
    all_else_known: bool = False,
) -> Bound:
    """The bound of a session for a machine whose inertia is given, as the truth or as an estimate of it.

    Args:
        session: as recorded; its noise hardly matters, its trajectories do.
        machine: with load inertia; its learned dry and viscous friction count.
        noise: of each sample; None: what the recordings show.
        pieces: of the spline over the visited angles whose coefficients are unknown; more pieces resolve finer
            detail and are bound to larger deviations (about as √pieces).
        points: angles of the answer, uniform over those visited.
        all_else_known: load torque, frictions, delays and coupling are known; else estimated beside the inertia.

    Raises InputError where the machine's inertia is unknown or a number is out of range.
    """
    if pieces < 1 or points < 2:
        raise InputError(
            "pieces" if pieces < 1 else "points", "is too small", "Give 1 piece, 2 points or more."
        )
    kinds = _kinds(session.runs)
    runs = tuple(signals_of(run, machine, band_of(session.runs)) for run in kinds)
    counts = tuple(kinds.values())
    low, high = load_angle_range(runs, machine)
    peak_speed = max(float(np.max(np.abs(run.states[:, 1]))) for run in runs)
    basis = Basis(low, high, pieces)
    model = Model(machine, Layout(basis, basis), STICKING * peak_speed)
    parameters = _truth(model)
    found = noise or Noise(0.01 * machine.motor.peak_torque_nm, 1e-3 * peak_speed, 1e-6 * (high - low))
    at, held = model.layout, any(is_held(run) for run in session.runs)
    prior = prior_for(at, machine, 1.0, held=held, coupling=True)
    precision, mean = prior.precision.copy(), prior.mean.copy()
    precision[at.inertia], mean[at.inertia] = _GIVEN, parameters[at.inertia]
    given = replace(prior, precision=precision, mean=mean)
    for _ in range(_ROUNDS):  # what the session says of all else, so that its trajectories are met
        runs = resmoothed(model, runs, parameters, found)
        about = systems_of(model, runs, parameters)
        found = noise or likely_noise(about, runs, found, 1.0, high - low)
        each = [
            passed_over(model, [system], [run], parameters, found)
            for system, run in zip(about, runs, strict=True)
        ]
        told = sum((n * one.information for n, one in zip(counts, each, strict=True)), np.zeros(()))
        slope = sum((n * one.slope for n, one in zip(counts, each, strict=True)), np.zeros(()))
        parameters = posterior(given, told, slope, parameters, _ROUGH).parameters
    # the prior enters where there is no data: what is pinned stays so, and no matrix is singular
    information = told + np.diag(prior.precision)
    if all_else_known:
        covariance = np.linalg.inv(information[at.inertia, at.inertia])
    else:
        scale = 1 / np.sqrt(np.diag(information))
        covariance = scale[:, None] * np.linalg.inv(information * scale[:, None] * scale) * scale
        covariance = covariance[at.inertia, at.inertia]
    grid = np.linspace(low, high, points)
    rows, _ = basis.rows(grid)
    inertia = machine.load_inertia_at(grid)
    spread = np.einsum("ni,ij,nj->n", rows, covariance, rows)
    return Bound(grid, inertia, inertia * np.sqrt(np.maximum(spread, 0.0)), found)


def _kinds(runs: Sequence[Run]) -> dict[Run, int]:
    """One run of each kind, and how many there are of it: repeats of a motion tell as much as each other."""
    kinds: list[tuple[Run, int]] = []
    for run in runs:
        for i, (other, count) in enumerate(kinds):
            same = (run.role, run.motion, run.excitation) == (other.role, other.motion, other.excitation)
            if same and run.motion is not None and len(run) == len(other):
                kinds[i] = (other, count + 1)
                break
        else:
            kinds.append((run, 1))
    return dict(kinds)


def _truth(model: Model) -> Array:
    """The parameters that the machine stands for; its own load torque and frictions are in the equations already."""
    at, machine = model.layout, model.machine
    parameters = np.zeros(at.size)
    parameters[at.inertia] = at.basis.coefficients_of(lambda angle: np.log(machine.load_inertia_at(angle)))
    learned = effects_of(machine.physics)
    parameters[at.coulomb] = (learned.coulomb_positive_nm + learned.coulomb_negative_nm) / 2
    parameters[at.viscous] = learned.viscous_nms
    return parameters
