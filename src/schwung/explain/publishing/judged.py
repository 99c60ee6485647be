"""The proof of a machine file: what belief and file, each as it is read, miss on runs that were not fitted.

Nothing of the file is fitted again. What no file says, the usual timing of a drive and what a measured inertia is
usually off by, is the same for both, as it was found beside all causes: about the belief alone it would be fitted to
what the belief leaves out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.causes.along import Along
from schwung.explain.causes.known import Known, known
from schwung.explain.causes.present import Member, with_members
from schwung.explain.weighing.phases import phased
from schwung.explain.weighing.round import Linearised, View
from schwung.explain.weighing.search import Scored
from schwung.explain.weighing.sets import members_of
from schwung.explain.weighing.settling import smoothed
from schwung.explain.weighing.weigh import Posterior
from schwung.innovations.effect import Passed
from schwung.innovations.likelihood import power_of, variances_of
from schwung.motion import Array

#: Deviations beyond which a difference is no chance, of 19 in 20.
_SURE = 1.645
#: Log likelihoods are compared over stretches of so much time (s), which are taken as independent.
_STRETCH_S = 0.02


@dataclass(frozen=True, eq=False)
class Shown:
    """A run as a machine explains it: torque and speed that it misses, smoothed, and likelihood (log) by stretches."""

    run: int
    along: Along
    missed_nm: Array  # (n,)
    torque_noise_nm: Array  # deviations of its noise (n,)
    missed_rad_s: Array | None  # reported speed that it misses, (n,); None: not measured
    speed_noise_rad_s: Array
    injected_hz: tuple[float, ...]
    innovations: Array  # (2n,) over their deviations; (n,) where no speed was measured
    logs: Array  # (stretches,)

    @property
    def missed(self) -> float:
        """Root mean square of the innovations over the noise's; 1: nothing but noise."""
        return float(np.sqrt(np.mean(self.innovations**2)))


@dataclass(frozen=True, eq=False)
class Judged:
    """A machine over some runs, and over those that were fitted."""

    runs: tuple[Shown, ...]
    fitted: tuple[Shown, ...]

    @property
    def missed(self) -> float:
        """Root mean square of the innovations over the noise's; 1: nothing but noise."""
        every = np.concatenate([shown.innovations for shown in self.runs])
        return float(np.sqrt(np.mean(every**2)))

    @property
    def missed_nm(self) -> float:
        """The same of the torque (N·m), smoothed, while the axis moves."""
        every = np.concatenate([shown.missed_nm[shown.along.moves] for shown in self.runs])
        return float(np.sqrt(np.mean(every**2)))

    @property
    def logs(self) -> Array:
        """Of all stretches."""
        return np.concatenate([shown.logs for shown in self.runs])

    @property
    def samples(self) -> int:
        """Of angle and of measured speed, of all runs."""
        return sum(shown.innovations.size for shown in self.runs)


def judged(outcome: Posterior, machine: Machine, runs: Sequence[int], beside: Scored | None = None) -> Judged:
    """Judge a machine, as it was read, on some runs; `beside`: the set that what no file says was found beside; None:
    all causes that hold."""
    of = outcome.view.ranges
    return judged_by(outcome, known(machine, of.low_rad, of.high_rad), runs, beside)


def judged_by(outcome: Posterior, told: Known, runs: Sequence[int], beside: Scored | None = None) -> Judged:
    """The same of what is known of a machine, in whatever form."""
    rests, of = outcome.growth.rests, outcome.view.ranges
    usual = _usual(outcome, outcome.holding if beside is None else beside)
    off = [member for member in usual if member.candidate.of_machine]
    timing = [member for member in usual if not member.candidate.of_machine]
    told = replace(told, machine=with_members(told.machine, off, of))
    view = rests.wide.seen(phased(replace(outcome.view, known=told), rests.wide.noise))
    about = smoothed(view, timing, rests.weighing)
    aside = _shown(about.beside(runs), runs) if runs else ()
    return Judged(aside, _shown(about, rests.train))


def _usual(outcome: Posterior, beside: Scored) -> Sequence[Member]:
    """What is always there, as it was found beside a set."""
    if not beside.picks:
        return outcome.grown.nothing.members
    growth = outcome.growth
    return members_of(outcome.grown.search, beside, growth.rests.candidates)[: len(growth.always)]


def _shown(about: Linearised, runs: Sequence[int]) -> tuple[Shown, ...]:
    return tuple(_run(about.view, about.passed[run], about.alongs[run], run) for run in runs)


def _run(view: View, passed: Passed, along: Along, run: int) -> Shown:
    error, variance = passed.result.error, passed.result.variance
    logs = -0.5 * np.sum(error**2 / variance + np.log(variance), axis=1)
    stretch = max(round(_STRETCH_S / view.runs[run].step_s), 1)
    measured, excitation = view.runs[run].speed_measured, view.recorded[run].excitation
    return Shown(
        run=run,
        along=along,
        missed_nm=-passed.torque_error_nm,
        torque_noise_nm=np.sqrt(power_of(passed.noise, passed.run) / passed.run.drive.every),
        missed_rad_s=passed.speed_error_rad_s if measured else None,
        speed_noise_rad_s=np.sqrt(variances_of(passed.noise, passed.run)[:, 1]),
        injected_hz=() if excitation is None else tuple(excitation.lines_hz.tolist()),
        innovations=passed.innovations if measured else passed.innovations[::2],
        logs=np.add.reduceat(logs, np.arange(0, logs.size, stretch)),
    )


def as_good(one: Judged, other: Judged) -> bool:
    """Whether the first predicts as well as the second, as far as these runs tell."""
    return surely_lost(one, other) == 0


def surely_lost(one: Judged, other: Judged) -> float:
    """How much less likely these runs are by the first than by the second (log); 0 where that may be chance."""
    difference = other.logs - one.logs
    lost, deviation = float(np.sum(difference)), float(np.std(difference)) * np.sqrt(difference.size)
    return lost if lost > _SURE * deviation else 0.0
