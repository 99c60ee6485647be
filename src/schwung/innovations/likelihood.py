"""The likelihood of runs under an innovations model: filter equations, sizes of noise, states.

A `Model` says what one run's equations are about its states; all else here holds for any.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.optimize import minimize

from schwung.innovations import kalman, kernel
from schwung.innovations.signals import FINEST, Signals, count_of
from schwung.innovations.values import Added, System
from schwung.motion import Array

#: Dry friction is smoothed within this share of the peak speed; up to a few times that its sign is open.
STICKING = 0.005
#: First guess of the angle's error, over the visited range.
_ANGLE_ERROR = 1e-6
#: And of the noise of torque and speed, over their size: counted signals may not bend at all.
_LEAST_ROUGH = 1e-4
#: Noise of a smaller share of the torque is as good as none.
LEAST_SHARE = 1e-3
#: Error of a speed that was not measured, over its range: it tells nothing.
_UNTOLD = 1e6
#: Some of the torque's noise does not go with the torque: at least so much of it, at the usual torque.
_LEAST_EVEN = 0.05
#: A sampling that is so much uneven is as good as even (s).
LEAST_JITTER_S = 1e-7
#: Noise of what was counted is no less than this share of the rounding.
_COUNTED = 0.5
#: Of the angle's noise, what is left where jitter is tried for the rest.
_EVEN_ANGLE = 0.2


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the errors of each sample, and of the torque."""

    torque_nm: float
    speed_rad_s: float
    position_rad: float
    torque_share: float = 0.0  # of the torque, beside what does not depend on it
    jitter_s: float = 0.0  # of the instants at which samples are taken

    def times(self, factor: float) -> Noise:
        """All of them so many times as large."""
        return Noise(
            factor * self.torque_nm,
            factor * self.speed_rad_s,
            factor * self.position_rad,
            factor * self.torque_share,
            factor * self.jitter_s,
        )

    def moved_from(self, other: Noise) -> float:
        """By how much that one differs which differs most, as a logarithm."""
        return float(np.max(np.abs(np.log(self._sizes / other._sizes))))

    @property
    def _sizes(self) -> Array:
        share, jitter = self.torque_share + LEAST_SHARE, self.jitter_s + LEAST_JITTER_S
        return np.array([self.torque_nm, self.speed_rad_s, self.position_rad, share, jitter])


@dataclass(frozen=True, eq=False)
class Play:
    """What the filter met of a coupling's gap.

    `contact`: how surely it touches in each step, on which side (−1…1), and what of its wind-up is gap (rad),
    (n − 1, 3).
    `logs_without`: Σ log of the innovations' variances, had it no gap.
    `open_contact`: of `System`.
    """

    contact: Array
    logs_without: float
    open_contact: Array


@dataclass(frozen=True, eq=False)
class Equations:
    """One run about its latest states: all that the filter takes. The last state is the torque's error (N·m)."""

    transition: Array  # (n − 1, s, s)
    forcing: Array  # (n − 1, s)
    noise: Array  # (n − 1, s): what the torque's error of the sample at the end of each step does
    slack: Array  # (n,) variance of the torque (N·m)² beyond the sensor's
    apart: Array  # (n − 1, 2) and of what acts within each step alone, on the motor and on the load
    measured: Array  # (n, 2)
    first: Array  # (s,)
    torques: Array  # (n − 1, 6) over each step, see `Steps`
    play: Play | None = field(default=None, kw_only=True)  # of the coupling; None: it has none
    on_load: Array | None = field(default=None, kw_only=True)  # of `System`; None: nothing is open there


class Model(Protocol):
    """What gives a run's equations about its states, and what a unit of each parameter adds to them."""

    def equations(self, run: Signals, parameters: Array) -> Equations:
        """The run's filter equations about its states."""

    def columns(self, run: Signals, parameters: Array, equations: Equations) -> Added:
        """What a unit of each parameter adds to each step, and to the samples."""


def systems_of(model: Model, runs: Sequence[Signals], parameters: Array) -> list[Equations]:
    """The equations of every run about its states and these parameters."""
    return [model.equations(run, parameters) for run in runs]


def resmoothed(model: Model, runs: Sequence[Signals], parameters: Array, noise: Noise) -> tuple[Signals, ...]:
    """The runs with the states that these parameters make likely."""
    systems = systems_of(model, runs, parameters)
    results = [kalman.filtered(problem_of(s, noise, r)) for s, r in zip(systems, runs, strict=True)]
    return tuple(
        run.about(kernel.smoothed(system.transition, result)[:, :-1])
        for run, system, result in zip(runs, systems, results, strict=True)
    )


def problem_of(equations: Equations, noise: Noise, run: Signals) -> System:
    """The filter's problem: equations, sizes of noise, and a first state that is known a little."""
    speed = 0.1 * float(np.ptp(run.states[:, 1])) + noise.speed_rad_s
    position = 1e-3 * float(np.ptp(run.position_rad)) + noise.position_rad
    power, alone = torque_errors(noise, run)
    power, apart = power + equations.slack, np.column_stack([equations.apart, alone])
    shaft = [position, speed] if run.rigid else [position, speed, position, speed]
    size = equations.first.size
    behind = [0.0] * (size - 1 - len(shaft))  # a further mass is at rest at first, as the motion begins
    return System(
        equations.transition,
        equations.forcing,
        equations.noise,
        power[1:],
        apart,
        equations.measured,
        variances_of(noise, run),
        equations.first,
        np.array([*shaft, *behind, np.sqrt(power[0])]),
        np.zeros_like(equations.forcing) if equations.play is None else equations.play.open_contact,
        np.zeros((len(apart), 2, size)) if equations.on_load is None else equations.on_load,
    )


def variances_of(noise: Noise, run: Signals) -> Array:
    """Of the errors of angle and speed at each sample, (n, 2): what it was taken late or early by, too."""
    even = [noise.position_rad, noise.speed_rad_s if run.speed_measured else _untold(run)]
    variances = np.tile(np.square(even), (run.time_s.size, 1))
    variances[:, 0] += run.unmoved_rad2
    if noise.jitter_s > 0:
        variances += (noise.jitter_s * run.rates[:, :2]) ** 2
    return variances


def torque_errors(noise: Noise, run: Signals) -> tuple[Array, Array]:
    """Variance (N·m)² of the torque's error at each sample (n,), and of what each step has besides, alone and all along
    it, (n − 1,).

    Over a step of m > 1 recorded samples, of errors σ each, the mean of a cubic spline through them has a variance of
    about (1 − ¼/m) σ²/m, and ⅛ σ²/m² in common with the next step's: as if errors of σ/m √½ at the steps' ends were
    beside such of √(m − ½) σ/m that are the step's own.
    """
    power, many = power_of(noise, run), run.drive.every
    within = (power[1:] + power[:-1]) / 2
    if many < 2:
        return power, 0.0 * within
    return power / (2 * many**2), (many - 0.5) / many**2 * within


def power_of(noise: Noise, run: Signals) -> Array:
    """Variance (N·m)² of the torque's error of each recorded sample, about those that are taken, (n,)."""
    power = np.full(run.time_s.size, noise.torque_nm**2)
    if noise.torque_share > 0:
        power += (noise.torque_share * run.load_nm) ** 2
    if noise.jitter_s > 0:
        power += (noise.jitter_s * run.rates[:, 2]) ** 2
    return power


def _untold(run: Signals) -> float:
    """Error of a speed that is none (rad/s): so large that the filter learns nothing of it."""
    return _UNTOLD * max(float(np.ptp(run.states[:, 1])), 1e-12)


def first_noise(runs: Sequence[Signals]) -> Noise:
    """A rough guess, to start from: what second differences of torque and speed show, and no less than rounding."""
    stroke = max(float(np.ptp(run.position_rad)) for run in runs)
    return Noise(
        torque_nm=_roughness([run.drive.recorded_nm for run in runs]),
        speed_rad_s=_roughness([run.speed_rad_s for run in runs]),
        position_rad=max(_ANGLE_ERROR * stroke, *(_rounding(run.count_rad) for run in runs), 1e-15),
    )


def coarsest_angle(runs: Sequence[Signals]) -> float:
    """The most that white noise of the angle can be (rad): a motion only adds to the fourth differences it makes."""
    bends = np.concatenate([np.diff(run.position_rad, 4) for run in runs])
    return float(np.sqrt(np.mean(bends**2) / 70))


def _roughness(signals: Sequence[Array]) -> float:
    """Standard deviation of the white noise that would bend most of the samples as much as they are bent; of coarse
    counts most do not bend at all."""
    bends = np.concatenate([np.diff(values, 2) for values in signals])
    size = float(np.sqrt(np.mean(np.concatenate(signals) ** 2)))
    rounding = max(_rounding(count_of(values)) for values in signals)
    return max(1.4826 * float(np.median(np.abs(bends))) / 6**0.5, rounding, _LEAST_ROUGH * size, 1e-12)


def _rounding(count: float) -> float:
    """Standard deviation of what rounding to whole counts leaves."""
    return count / float(np.sqrt(12))


def deviance_of(
    systems: Sequence[Equations], runs: Sequence[Signals], noise: Noise, *, scaled: bool
) -> float:
    """−2 log likelihood but for a constant; `scaled`: with the best common factor of all noise."""
    logs = squares = 0.0
    for system, run in zip(systems, runs, strict=True):
        log, square = kalman.deviance(problem_of(system, noise, run))
        logs, squares = logs + log, squares + square
    if not (np.isfinite(logs) and np.isfinite(squares)):
        return float(np.finfo(float).max)
    count = 2 * sum(run.time_s.size for run in runs)
    return float(logs + count * np.log(squares / count)) if scaled else float(logs + squares)


def unshared_deviance_of(
    systems: Sequence[Equations], runs: Sequence[Signals], noise: Noise, repeats: Sequence[Sequence[int]]
) -> float:
    """−2 log likelihood of what repeats of a motion do not share; `repeats`: groups of two runs or more.

    Whatever physics the equations lack is the same in all of a group, and in the difference of their innovations gone.
    """
    logs = squares = 0.0
    for group in repeats:
        passed = [kalman.filtered(problem_of(systems[i], noise, runs[i])) for i in group]
        count = min(one.error.shape[0] for one in passed)
        errors = np.stack([one.error[:count] / np.sqrt(one.variance[:count]) for one in passed])
        share = len(group) / (len(group) - 1)
        squares += share * float(np.sum((errors - np.mean(errors, axis=0)) ** 2))
        logs += float(sum(np.sum(np.log(one.variance[:count])) for one in passed))
    return logs + squares if np.isfinite(logs + squares) else float(np.finfo(float).max)


def likely_noise(
    systems: Sequence[Equations],
    runs: Sequence[Signals],
    start: Noise,
    reach: float,
    span_rad: float,
    *,
    whole: bool = False,
    coarsest: float = np.inf,
    repeats: Sequence[Sequence[int]] = (),
) -> Noise:
    """The sizes of noise that make the innovations most likely.

    `reach`: how far off they may be (log); `span_rad`: the range of angles; `whole`: a part of the torque's noise may
    go with the torque, and samples may be taken unevenly; then the first size is that of the torque's whole, an angle
    divides it, and the last is the jitter, where it is surely likelier than none (by BIC). `coarsest`: no angle is
    noisier than that (rad). `repeats`: groups of runs that repeat a motion; noise is then what they do not share.
    """
    # a simulation's runs have no noise: below this the filter's own rounding would be told; repeats may share that of
    # what was recorded
    speed_shows = any(run.speed_measured for run in runs)
    # where the angle alone tells, it is as noisy as rounding makes it in motion: at rest, a count stays, none shows
    counted = _COUNTED if speed_shows else 1.0
    finest = max(FINEST * span_rad, counted * max(_rounding(run.count_rad) for run in runs))
    least_nm = FINEST * max(float(np.ptp(run.load_nm)) for run in runs)
    least_rad_s = max(
        max(FINEST * float(np.ptp(run.speed_rad_s)), _COUNTED * _rounding(count_of(run.speed_rad_s)))
        for run in runs
    )
    usual = float(np.sqrt(np.mean(np.concatenate([run.load_nm for run in runs]) ** 2))) if whole else 0.0

    def noise_of(place: Array) -> Noise:
        torque, speed, position = (float(v) for v in np.exp(place[:3]))
        speed = speed if speed_shows else start.speed_rad_s
        torque, speed = max(torque, least_nm), max(speed, least_rad_s)
        position = float(max(min(position, coarsest), finest))
        if not whole:
            return Noise(torque, speed, position)
        even, share = torque * abs(float(np.cos(place[3]))), torque * abs(float(np.sin(place[3]))) / usual
        jitter = float(np.exp(place[4])) if place.size > 4 else 0.0
        return Noise(max(even, _LEAST_EVEN * torque), speed, position, share, jitter)

    def cost(place: Array) -> float:
        if repeats:
            return unshared_deviance_of(systems, runs, noise_of(place), repeats)
        return deviance_of(systems, runs, noise_of(place), scaled=False)

    torque, further = start.torque_nm, []
    if whole:
        torque = float(np.hypot(torque, start.torque_share * usual))
        further = [float(np.arctan2(start.torque_share * usual, start.torque_nm))]
    # while much is unexplained, the angle's error means nothing and may have gone anywhere: offer a fresh one, too
    starts = [
        np.concatenate([np.log([torque, start.speed_rad_s, position]), further])
        for position in (max(start.position_rad, finest), max(_ANGLE_ERROR * span_rad, 2 * finest))
    ]

    def likeliest(first: Array) -> tuple[Array, float]:
        moves = np.diag([*(reach * np.array([-0.7, 0.3, 0.7])), 0.6, 0.7 * reach][: first.size])
        best = minimize(
            cost, first, method="Nelder-Mead",
            options={"xatol": 0.02, "fatol": 0.5, "maxfev": 20 * first.size,
                     "initial_simplex": first + np.vstack([np.zeros(first.size), moves])},
        )  # fmt: skip
        return best.x, float(best.fun)

    if whole and start.jitter_s > 0:
        return noise_of(likeliest(np.append(min(starts, key=cost), np.log(start.jitter_s)))[0])
    found, least = likeliest(min(starts, key=cost))
    if not whole:
        return noise_of(found)
    # of an angle that is as noisy as this at its usual speed, jitter may be the most
    speed = float(np.sqrt(np.mean(np.concatenate([run.states[:, 1] for run in runs]) ** 2)))
    uneven = np.append(found, np.log(max(noise_of(found).position_rad / max(speed, 1e-12), LEAST_JITTER_S)))
    uneven[2] += np.log(_EVEN_ANGLE)
    surely = least - np.log(sum(2 * run.time_s.size for run in runs))
    if cost(uneven) > surely:
        return noise_of(found)
    jittered, cost_of_it = likeliest(uneven)
    return noise_of(jittered if cost_of_it < surely else found)
