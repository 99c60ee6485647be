"""The trajectory fit itself: Gauss and Newton over parameters, Kalman's smoother over states, likelihood over noise.

The innovations of a Kalman filter are white, so that the likelihood of a recording is a sum of squares; filtered
alike, the sensitivities are its Jacobian. Parameters and states are improved in turn; sizes of noise are those that
make the innovations most likely.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from schwung.drivetrain.machine import Machine
from schwung.estimation import trajectory_kernel as kernel
from schwung.estimation.sampling import is_held
from schwung.estimation.trajectory_model import (
    STICKING,
    Basis,
    Layout,
    Linearised,
    Model,
    Noise,
    Signals,
    load_angle_range,
    signals_of,
)
from schwung.estimation.trajectory_prior import posterior, prior_for
from schwung.motion import Array
from schwung.session.model import Run

#: Spline pieces over the visited range: at the least, at the most, and per rad on a rotary axis.
PIECES, MOST_PIECES, PIECES_PER_RAD = 40, 160, 12.0
MOST_ITERATIONS, NOISE_ITERATIONS = 25, 10
#: Runs that the sizes of noise and the start are found from, at most.
FEW = 4
#: Converged: no coefficient moves by more than this share of its standard deviation.
SETTLED = 0.05
#: No step changes log J_l by more than this.
LARGEST_STEP = 1.0
#: Constant inertias tried at the start, over the rotor's.
_TRIED = np.geomspace(0.05, 2000.0, 20)
#: Smallest error of the angle that is believed, over the visited range.
_FINEST = 1e-9


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model: parameters (P,), their covariance, noise, and every run with its smoothed states."""

    model: Model
    parameters: Array
    covariance: Array
    noise: Noise
    runs: tuple[Signals, ...]
    iterations: int
    converged: bool


@dataclass(frozen=True, eq=False)
class Passed:
    """What one pass of filter and smoother over all runs yields."""

    information: Array  # (P, P), data alone
    slope: Array  # (P,)
    runs: tuple[Signals, ...]  # with new states


def fit(recorded: Sequence[Run], machine: Machine, *, rotary: bool = True) -> Fit:
    """Fit the model to all runs at once."""
    runs = tuple(signals_of(run, machine) for run in recorded)
    low, high = load_angle_range(runs)
    pieces = int(np.clip((high - low) * PIECES_PER_RAD if rotary else PIECES, PIECES, MOST_PIECES))
    layout = Layout(Basis(low, high, pieces))
    peak_speed = max(float(np.max(np.abs(run.states[:, 1]))) for run in runs)
    model = Model(machine, layout, STICKING * peak_speed)
    noise = _first_noise(runs)
    inertia = _constant_inertia(model, _few(runs), noise)
    prior = prior_for(layout, machine, inertia, held=any(is_held(run) for run in recorded))
    parameters, smoothness = prior.mean, (np.log(0.01), np.log(0.01))
    restless = True
    for iteration in range(1, MOST_ITERATIONS + 1):
        if restless:
            likely = likely_noise(model, _few(runs), parameters, noise, 1.0 if iteration == 1 else 0.3)
            restless = iteration < NOISE_ITERATIONS and (iteration < 3 or likely.differs_from(noise))
            noise = likely
        passed = passed_over(model, runs, parameters, noise)
        found = posterior(prior, passed.information, passed.slope, parameters, smoothness)
        step = found.parameters - parameters
        largest = float(np.max(np.abs(step[layout.inertia])))
        parameters = parameters + step * min(1.0, LARGEST_STEP / max(largest, 1e-12))
        smoothness = found.log_deviations
        runs = resmoothed(model, passed.runs, parameters, noise)
        moved = float(np.max(np.abs(step) / np.sqrt(np.diag(found.covariance))))
        if moved < SETTLED and iteration > 2:
            break
    return Fit(model, parameters, found.covariance, noise, runs, iteration, moved < SETTLED)


def _few(runs: Sequence[Signals]) -> Sequence[Signals]:
    """Some runs, evenly chosen: enough for what needs no more."""
    return runs if len(runs) <= FEW else [runs[round(i)] for i in np.linspace(0, len(runs) - 1, FEW)]


def passed_over(model: Model, runs: Sequence[Signals], parameters: Array, noise: Noise) -> Passed:
    """Filter and smooth every run: information and slope of the data about `parameters`, and new states."""
    size = model.layout.size
    information, slope, smoothed = np.zeros((size, size)), np.zeros(size), []
    for run in runs:
        system = model.linearised(run, parameters, columns=True)
        result = kernel.filtered(*_filter_arguments(system, noise, run))
        rows = kernel.whitened(system.transition, result, system.columns, system.of_speed)
        information += rows.T @ rows
        slope += rows.T @ (result.error / np.sqrt(result.variance)).ravel()
        smoothed.append(replace(run, states=kernel.smoothed(system.transition, result)))
    return Passed(information, slope, tuple(smoothed))


def resmoothed(
    model: Model, runs: Sequence[Signals], parameters: Array, noise: Noise
) -> tuple[Signals, ...]:
    """The runs with the states that these parameters make likely."""
    systems = _systems(model, runs, parameters)
    results = [kernel.filtered(*_filter_arguments(s, noise, r)) for s, r in zip(systems, runs, strict=True)]
    return tuple(
        replace(run, states=kernel.smoothed(system.transition, result))
        for run, system, result in zip(runs, systems, results, strict=True)
    )


def _filter_arguments(system: Linearised, noise: Noise, run: Signals) -> tuple[Array, ...]:
    speed = 0.1 * float(np.ptp(run.states[:, 1])) + noise.speed_rad_s
    position = 1e-3 * float(np.ptp(run.position_rad)) + noise.position_rad
    spread = np.array([position, speed] if run.rigid else [position, speed, position, speed])
    variances = np.array([noise.position_rad**2, noise.speed_rad_s**2])
    power = noise.torque_nm**2 + system.slack
    return (
        system.transition,
        system.forcing,
        system.noise,
        power,
        system.measured,
        variances,
        system.first,
        spread,
    )


def _first_noise(runs: Sequence[Signals]) -> Noise:
    """A rough guess, to start from."""
    torque = np.concatenate([run.drive.smooth(run.time_s) for run in runs])
    bends = np.concatenate([np.diff(run.speed_rad_s, 2) for run in runs])
    stroke = max(float(np.ptp(run.position_rad)) for run in runs)
    return Noise(
        torque_nm=max(0.02 * float(np.sqrt(np.mean(torque**2))), 1e-12),
        speed_rad_s=max(1.4826 * float(np.median(np.abs(bends))) / np.sqrt(6), 1e-12),
        position_rad=max(1e-6 * stroke, 1e-15),
    )


def _constant_inertia(model: Model, runs: Sequence[Signals], noise: Noise) -> float:
    """The constant inertia (kg·m²) that explains the runs best, whatever the size of the noise."""
    rotor = model.machine.motor.inertia_kgm2
    values = []
    for ratio in _TRIED:
        parameters = np.zeros(model.layout.size)
        parameters[model.layout.inertia] = np.log(ratio * rotor)
        values.append(_deviance(_systems(model, runs, parameters), runs, noise, scaled=True))
    return float(_TRIED[int(np.argmin(values))] * rotor)


def _systems(model: Model, runs: Sequence[Signals], parameters: Array) -> list[Linearised]:
    return [model.linearised(run, parameters, columns=False) for run in runs]


def _deviance(systems: Sequence[Linearised], runs: Sequence[Signals], noise: Noise, *, scaled: bool) -> float:
    """−2 log likelihood but for a constant; `scaled`: with the best common factor of all noise."""
    logs = squares = 0.0
    for system, run in zip(systems, runs, strict=True):
        log, square = kernel.deviance(*_filter_arguments(system, noise, run))
        logs, squares = logs + log, squares + square
    if not (np.isfinite(logs) and np.isfinite(squares)):
        return float(np.finfo(float).max)
    count = 2 * sum(run.time_s.size for run in runs)
    return float(logs + count * np.log(squares / count)) if scaled else float(logs + squares)


def likely_noise(
    model: Model, runs: Sequence[Signals], parameters: Array, start: Noise, reach: float
) -> Noise:
    """The sizes of noise that make the innovations most likely; `reach`: how far off they may be (log)."""
    systems = _systems(model, runs, parameters)
    finest = _FINEST * (model.layout.basis.high_rad - model.layout.basis.low_rad)

    def noise_of(logs: Array) -> Noise:
        torque, speed, position = (float(v) for v in np.exp(logs))
        return Noise(torque, speed, max(position, finest))

    first = np.log([start.torque_nm, start.speed_rad_s, max(start.position_rad, finest)])
    best = minimize(
        lambda logs: _deviance(systems, runs, noise_of(logs), scaled=False), first, method="Nelder-Mead",
        options={"xatol": 0.02, "fatol": 0.5, "maxfev": 60,
                 "initial_simplex": first + reach * np.vstack([np.zeros(3), np.diag([0.7, 0.3, -0.7])])},
    )  # fmt: skip
    return noise_of(best.x)
