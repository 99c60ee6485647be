"""The trajectory fit itself: Gauss and Newton over parameters, Kalman's smoother over states, likelihood over noise.

The innovations of a Kalman filter are white, so that the likelihood of a recording is a sum of squares; filtered
alike, the sensitivities are its Jacobian. Parameters and states are improved in turn; sizes of noise are those that
make the innovations most likely.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.left_out import ALIKE, ROUGH, shown
from schwung.estimation.sampling import is_held
from schwung.estimation.trajectory_model import Layout, Model
from schwung.estimation.trajectory_prior import Posterior, Prior, posterior, prior_for
from schwung.innovations import kalman, kernel
from schwung.innovations.likelihood import (
    STICKING,
    Equations,
    Noise,
    coarsest_angle,
    deviance_of,
    first_noise,
    likely_noise,
    problem_of,
    resmoothed,
    systems_of,
)
from schwung.innovations.signals import LAGS, Signals, load_angle_range, signals_of
from schwung.innovations.splines import Basis
from schwung.innovations.steps import no_such_machine
from schwung.motion import Array
from schwung.session.derived import speed_is_derived
from schwung.session.model import Run

T = TypeVar("T")

#: Spline pieces over the visited range: at the least, at the most, and per rad on a rotary axis.
PIECES, MOST_PIECES, PIECES_PER_RAD = 40, 160, 12.0
MOST_ITERATIONS = 40
#: Iterations after which sizes of noise may keep wandering a little.
PATIENT = 12
#: Runs that the sizes of noise and the start are found from, at most.
FEW = 3
#: Converged: no coefficient moves by more than this share of its standard deviation.
SETTLED = 0.05
#: Nearly so, and ready for what had been held back.
NEARLY = 1.0
#: Pieces are halved where a cubic leaves out more than this share of the band.
LEFT_OUT = 0.3
#: No step changes log J_l by more than this.
LARGEST_STEP = 1.0
#: Highest excited frequency times this: the band that sensitivities are looked at in. Wider ones let noise in, which
#: biases where its torque is not small; narrower ones lose nothing until they touch the injection itself.
BAND = 1.8
#: Innovations further apart than this are taken as independent.
STRETCH_S = 0.02
#: A step over more standard deviations than this must make the recordings likelier, or is halved, so often at most.
FAR, HALVINGS = 10.0, 6
#: Constant inertias tried at the start, over the rotor's.
_TRIED = np.geomspace(0.05, 2000.0, 20)


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model: parameters (P,), covariance, scores, and every run, thinned, with its smoothed states."""

    model: Model
    parameters: Array
    covariance: Array
    scores: Array
    considered: Array  # (P,): what one standard deviation of the filters' loss moves the parameters by
    noise: Noise  # of the samples as recorded
    every: float  # so many of which make one of `runs`
    runs: tuple[Signals, ...]
    iterations: int
    converged: bool
    shown: tuple[int, ...]  # what of `LEFT_OUT` the recordings show
    rough: float  # how far their laws may put the inertia off, relative, one standard deviation

    def inertia_at(self, angle_rad: Array) -> tuple[Array, Array]:
        """J_l (kg·m²) and its standard deviation at load angles (rad), (n,) each.

        The deviation is the posterior's, or where the innovations turn out not to be white, as with physics that the
        model leaves out, the larger one that their sums over stretches of time call for (the "sandwich", White 1982).
        What a drive's filter may have taken off is not fitted and comes on top (Schmidt's "considered"), and so does
        how far the laws of what the recordings show are rough.
        """
        where = self.model.layout.inertia
        rows, _ = self.model.layout.basis.rows(angle_rad)
        inertia = np.exp(rows @ self.parameters[where])
        reach = rows @ self.covariance[where]
        posterior = np.einsum("ni,ni->n", reach[:, where], rows)
        observed = np.sum((reach @ self.scores.T) ** 2, axis=1)
        lost = rows @ self.considered[where]
        return inertia, inertia * np.sqrt(np.maximum(posterior, observed) + lost**2 + self.rough**2)

    def std_of(self, parameter: int) -> float:
        """Standard deviation of one parameter, as of the curve."""
        reach = self.covariance[parameter]
        observed = float(np.sum((self.scores @ reach) ** 2))
        return float(np.hypot(np.sqrt(max(reach[parameter], observed)), self.considered[parameter]))


@dataclass(frozen=True, eq=False)
class Passed:
    """What one pass of filter and smoother over all runs yields."""

    information: Array  # (P, P), data alone
    slope: Array  # (P,)
    scores: Array  # (blocks, P): the slope's parts, one per stretch of time
    runs: tuple[Signals, ...]  # with new states


@dataclass
class _Beside:
    """What of `LEFT_OUT` the recordings show, and the curve before any of that was fitted."""

    clear: set[int] = field(default_factory=set)
    plain: tuple[Basis, Array] | None = None

    def take(self, one: int, model: Model, parameters: Array) -> None:
        """One more, and all that are alike."""
        self.plain = self.plain or (model.layout.basis, parameters[model.layout.inertia])
        self.clear |= ALIKE[one]

    def rough(self, model: Model, parameters: Array) -> float:
        """How far the laws that were fitted may put the inertia off: a share of how far they moved it, in the mean."""
        if self.plain is None:
            return 0.0
        basis, before = self.plain
        grid = np.linspace(basis.low_rad, basis.high_rad, basis.size)
        now = model.layout.basis.rows(grid)[0] @ parameters[model.layout.inertia]
        return ROUGH * float(np.sqrt(np.mean((now - basis.rows(grid)[0] @ before) ** 2)))


def fit(
    recorded: Sequence[Run],
    machine: Machine,
    *,
    rotary: bool = True,
    start: InertiaTable | None = None,
    without: bool = False,
) -> Fit:
    """Fit the model to all runs at once.

    `start`: a curve that is near already; sizes of noise are looked for when the rest has come near, too, lest they
    take what is still to be explained. Else it begins at the constant inertia that explains the runs best, and the
    coupling is held as believed until the rest has settled: stiffness and inertia, both far off, can make up for each
    other. Then pieces are halved until the curve's bends are resolved; and what else the recordings show is fitted as
    well (`left_out.py`), unless it shall be `without`.

    Raises InputError where there is no torque or no motion at all, or nothing that these equations could fit.
    """
    _check_alive(recorded)
    model, runs = _model_of(recorded, machine, rotary)
    noise = first_noise(runs)
    logs = _begun(model, runs, noise, start)
    inertia = float(np.exp(np.mean(logs)))
    held = any(is_held(run) for run in recorded)
    released = machine.coupling is None or start is not None
    lags = recorded[0].extra.get(LAGS)
    beside = _Beside()
    made = partial(prior_for, machine=machine, inertia_kgm2=inertia, held=held, lags=lags, shown=beside.clear)
    prior = made(model.layout, coupling=released)
    parameters, smoothness = prior.mean.copy(), (np.log(0.01), np.log(0.01))
    parameters[model.layout.inertia] = logs
    restless, settled, iteration, reach = True, False, 0, 1.0
    # else a coloured speed is believed to the letter, and all the rest is noise
    coarsest = coarsest_angle(runs)
    moved = np.inf
    while not settled and iteration < MOST_ITERATIONS:
        iteration += 1
        about = systems_of(model, runs, parameters)
        if restless and (moved < FAR or start is None or iteration > PATIENT):
            likely = likely_noise(
                _few(about), _few(runs), noise, reach, model.layout.basis.span_rad, coarsest=coarsest
            )
            changed = likely.moved_from(noise)
            restless, noise = changed > (0.03 if iteration < PATIENT else 0.3), likely
            reach = float(np.clip(changed, 0.05, 0.3))
        passed = passed_over(model, about, runs, parameters, noise)
        found = posterior(prior, passed.information, passed.slope, parameters, smoothness)
        smoothness = found.log_deviations
        step = found.parameters - parameters
        largest = float(np.max(np.abs(step[model.layout.inertia])))
        moved = float(np.max(np.abs(step) / np.sqrt(np.diag(found.covariance))))
        step *= min(1.0, LARGEST_STEP / max(largest, 1e-12))
        if moved > FAR:
            step = _likelier(
                model, _few(about), _few(runs), parameters, step, noise, 1 / np.sqrt(prior.precision)
            )
        parameters = parameters + step
        runs = resmoothed(model, passed.runs, parameters, noise)
        if moved < NEARLY and not released:
            released, restless = True, True
            prior = made(model.layout, coupling=released)
        elif moved < NEARLY and _too_coarse(model, found):
            model, parameters = _refined(model, parameters)
            prior, restless = made(model.layout, coupling=released), True
        else:
            settled = moved < SETTLED and not restless
            restless = restless or moved > NEARLY
            one = _shown(model, prior, passed, smoothness, beside.clear) if settled and not without else None
            if one is not None:
                beside.take(one, model, parameters)
                prior, settled, restless = made(model.layout, coupling=released), False, True
    every = recorded[0].sample_rate_hz * runs[0].step_s
    return Fit(
        model=model,
        parameters=parameters,
        covariance=found.covariance,
        scores=passed.scores,
        considered=_considered(model, runs, found.covariance @ passed.information),
        noise=noise.times(np.sqrt(every)),
        every=every,
        runs=runs,
        iterations=iteration,
        converged=settled,
        shown=tuple(sorted(beside.clear)),
        rough=beside.rough(model, parameters),
    )


def _shown(
    model: Model, prior: Prior, passed: Passed, smoothness: tuple[float, float], clear: Collection[int]
) -> int | None:
    """What else the recordings show most clearly, counted from the first that is left out; None: nothing."""
    first, size = model.layout.left_out.start, model.layout.size
    asked = [place for place in range(first, size) if place - first not in clear]
    fitted = np.array([place for place in range(size) if place not in asked])
    precision, _ = prior.matrix(smoothness)
    found = shown(passed.information, passed.slope, passed.scores, precision, fitted, asked)
    return None if found is None else found - first


def _model_of(recorded: Sequence[Run], machine: Machine, rotary: bool) -> tuple[Model, tuple[Signals, ...]]:
    """The model over the angles that the load visits, and the runs with as many samples as its pieces need."""
    band = band_of(recorded)
    whole = tuple(signals_of(run, machine, band) for run in recorded)
    low, high = load_angle_range(whole, machine)
    pieces = int(np.clip((high - low) * PIECES_PER_RAD if rotary else PIECES, PIECES, MOST_PIECES))
    basis = Basis(low, high, pieces)
    peak_speed = max(float(np.max(np.abs(run.states[:, 1]))) for run in whole)
    passing = peak_speed * pieces / max(high - low, 1e-12)
    derived = speed_is_derived(recorded)
    runs = tuple(
        replace(signals_of(run, machine, band, passing), speed_measured=not derived) for run in recorded
    )
    return Model(machine, Layout(basis, basis), STICKING * peak_speed), runs


def _considered(model: Model, runs: Sequence[Signals], moves: Array) -> Array:
    """What one standard deviation of the filters' loss moves the parameters by, (P,); `moves`: by a unit of each."""
    return np.asarray(max(run.loss_std_s2 for run in runs) * moves[:, model.layout.loss])


def band_of(recorded: Sequence[Run]) -> float:
    """The band (Hz) that motion and injection are in; infinite without injection."""
    return BAND * max((run.excitation.frequency_hz for run in recorded if run.excitation), default=np.inf)


def _check_alive(recorded: Sequence[Run]) -> None:
    """There must be motion and torque, however little."""
    for what, ranges in (
        ("motion", [np.ptp(run.position_rad) for run in recorded]),
        ("torque", [np.ptp(run.torque_nm) for run in recorded]),
    ):
        if not max(ranges) > 0:
            raise InputError(
                "session", f"holds no {what} at all", "Record a motion, with the motor's torque."
            )


def _likelier(
    model: Model,
    about: Sequence[Equations],
    runs: Sequence[Signals],
    parameters: Array,
    step: Array,
    noise: Noise,
    deviations: Array,
) -> Array:
    """The step, halved until the runs are likelier after it: far from the truth, a linear model promises too much.

    Where no part of it makes them likelier, it is taken as far as parameters are naturally apart (`deviations`):
    likelihood has another maximum than the estimating equations, whose columns are about quiet signals (see
    `Model.columns`), and between the two says nothing of it.
    """
    before = deviance_of(about, runs, noise, scaled=True)
    for halvings in range(HALVINGS):
        tried = parameters + step * 0.5**halvings
        if deviance_of(systems_of(model, runs, tried), runs, noise, scaled=True) < before:
            return step * 0.5**halvings
    share = min(1.0, float(np.min(deviations / np.maximum(np.abs(step), 1e-300))))
    return np.asarray(share * step)


def _too_coarse(model: Model, found: Posterior) -> bool:
    """Whether pieces are too long for the curve: what a cubic leaves out, fourth difference/384, against the band."""
    where = model.layout.inertia
    left_out = np.abs(np.diff(found.parameters[where], 4)) / 384
    deviation = np.sqrt(np.diag(found.covariance)[where])[2:-2]
    return model.layout.basis.pieces < MOST_PIECES and bool(np.any(left_out > LEFT_OUT * deviation))


def _refined(model: Model, parameters: Array) -> tuple[Model, Array]:
    """The same curves with pieces half as long."""
    at = model.layout
    finer = np.concatenate([at.basis.refined(parameters[at.inertia]), parameters[at.inertia.stop :]])
    return replace(model, layout=replace(at, basis=at.basis.finer())), finer


def _few(each: Sequence[T]) -> Sequence[T]:
    """Some runs, or what belongs to them, evenly chosen: enough for what needs no more."""
    return each if len(each) <= FEW else [each[round(i)] for i in np.linspace(0, len(each) - 1, FEW)]


def passed_over(
    model: Model, about: Sequence[Equations], runs: Sequence[Signals], parameters: Array, noise: Noise
) -> Passed:
    """Filter and smooth every run: information and slope of the data about `parameters`, and new states."""
    size = model.layout.size
    information, scores, smoothed = np.zeros((size, size)), [], []
    for system, run in zip(about, runs, strict=True):
        result = kalman.filtered(problem_of(system, noise, run))
        rows = kernel.whitened(system.transition, result, model.columns(run, parameters, system))
        information += rows.T @ rows
        parts = rows * (result.error / np.sqrt(result.variance)).reshape(-1, 1)
        stretch = 2 * max(round(STRETCH_S / run.step_s), 1)
        scores.append(np.add.reduceat(parts, np.arange(0, parts.shape[0], stretch), axis=0))
        smoothed.append(replace(run, states=kernel.smoothed(system.transition, result)[:, :-1]))
    every = np.concatenate(scores)
    if not (np.all(np.isfinite(information)) and np.all(np.isfinite(every))):
        raise no_such_machine()
    return Passed(information, every.sum(0), every, tuple(smoothed))


def _begun(model: Model, runs: Sequence[Signals], noise: Noise, start: InertiaTable | None) -> Array:
    """Coefficients of the inertia at first."""
    basis = model.layout.basis
    if start is None:
        return np.full(basis.size, np.log(_constant_inertia(model, _few(runs), noise)))
    return np.asarray(basis.coefficients_of(lambda angle: np.log(start.at(angle))))


def _constant_inertia(model: Model, runs: Sequence[Signals], noise: Noise) -> float:
    """The constant inertia (kg·m²) that explains the runs best, whatever the size of the noise."""

    def deviance(log_inertia: float) -> float:
        parameters = np.zeros(model.layout.size)
        parameters[model.layout.inertia] = log_inertia
        return deviance_of(systems_of(model, runs, parameters), runs, noise, scaled=True)

    logs = np.log(_TRIED * model.machine.motor.inertia_kgm2)
    best = int(np.argmin([deviance(value) for value in logs]))
    around = (logs[max(best - 1, 0)], logs[min(best + 1, logs.size - 1)])
    return float(
        np.exp(minimize_scalar(deviance, bounds=around, method="bounded", options={"xatol": 0.01}).x)
    )
