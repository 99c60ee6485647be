"""One round: the runs with everything present that may be there, the noise found so, and all columns whitened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from schwung.explain.weighing.along import Along, Ranges, along
from schwung.explain.weighing.candidate import Candidate, Shape
from schwung.explain.weighing.equations import Acting, equations_of
from schwung.explain.weighing.known import Known
from schwung.explain.weighing.work import LINEARISED, Work
from schwung.innovations.effect import Passed
from schwung.innovations.evidence import Weighed, weigh
from schwung.innovations.likelihood import Equations, Noise, likely_noise
from schwung.innovations.signals import Signals
from schwung.innovations.statistics import Statistics, colour
from schwung.motion import Array
from schwung.session.model import Run

#: Runs that the sizes of noise are found from, at most.
FEW = 3
#: Innovations further apart than this are taken as independent (s).
STRETCH_S = 0.02


#: A candidate in one of its shapes.
Cause = tuple[Candidate, Shape]


@dataclass(frozen=True, eq=False)
class Member:
    """A candidate in one of its shapes, with coefficients (p,)."""

    candidate: Candidate
    shape: Shape
    coefficients: Array


@dataclass(frozen=True, eq=False)
class View:
    """The session as a round sees it: recorded and prepared runs, the belief."""

    recorded: Sequence[Run]
    runs: tuple[Signals, ...]
    known: Known
    ranges: Ranges
    errors_nm: tuple[Array, ...] = ()  # of each run's reported torque, as smoothed
    work: Work = field(default_factory=Work)  # that was done since the session was first looked at

    def alongs(self) -> list[Along]:
        """Every run's coordinates."""
        return [
            along(
                run,
                recorded,
                self.known.machine,
                self.ranges,
                number,
                self.errors_nm[number] if self.errors_nm else 0.0,
            )
            for number, (run, recorded) in enumerate(zip(self.runs, self.recorded, strict=True))
        ]


def acting(known: Known, along: Along, members: Sequence[Member]) -> Acting:
    """What the belief and the members do along a run."""
    what = known.effect(along)
    total, dry = Acting(*what.of(np.ones(1))), known.dry(along)
    for member in members:
        parts = member.candidate.effect(along, member.shape).of(member.coefficients)
        total += Acting(*parts)
        if member.candidate.dry:
            dry = dry + parts[0]
    return replace(total, dry_nm=float(np.sqrt(np.mean(dry[along.moves] ** 2))))


@dataclass(frozen=True, eq=False)
class Linearised:
    """The session about what is present: every run filtered."""

    view: View
    alongs: list[Along]
    passed: list[Passed]
    noise: Noise

    def samples(self, runs: Sequence[int]) -> int:
        """Σ2n of some runs."""
        return sum(self.passed[run].samples for run in runs)

    def whiten(self, causes: Iterable[Cause], runs: Sequence[int], rows: Array) -> None:
        """Write causes as the innovations of some runs show them, one run behind another, to `rows` (Σp, Σ2n)."""
        causes, across = list(causes), 0
        for run in runs:
            where = self.alongs[run]
            effects = (candidate.effect(where, shape) for candidate, shape in causes)
            self.passed[run].whiten(effects, rows, across)
            across += self.passed[run].samples
        self.view.work.add(across * sum(candidate.size for candidate, _ in causes))

    def whitened(self, causes: Iterable[Cause], runs: Sequence[int]) -> Array:
        """The same in an array of its own."""
        causes = list(causes)
        rows = np.empty((sum(candidate.size for candidate, _ in causes), self.samples(runs)))
        self.whiten(causes, runs, rows)
        return rows

    def innovations(self, runs: Sequence[int]) -> Array:
        """Of some runs, one behind another, (Σ2n,)."""
        return np.concatenate([self.passed[run].innovations for run in runs])


def linearised(view: View, members: Sequence[Member], noise: Noise, reach: float | None) -> Linearised:
    """Filter all runs with these members present; `reach`: how far off the noise may be (log), None: keep it."""
    alongs = view.alongs()
    made = [equations_of(where, acting(view.known, where, members)) for where in alongs]
    if reach is not None:
        few = np.unique(np.round(np.linspace(0, len(made) - 1, FEW)).astype(int))
        equations: list[Equations] = [made[i][0] for i in few]
        these, span = [view.runs[i] for i in few], view.ranges.span_rad
        noise = likely_noise(equations, these, noise, reach, span, proportional=True)
    passed = [
        Passed.of(equations, steps, noise, run)
        for (equations, steps), run in zip(made, view.runs, strict=True)
    ]
    view.work.add(LINEARISED * sum(one.samples for one in passed))
    return Linearised(view, alongs, passed, noise)


def resmoothed(view: View, members: Sequence[Member], noise: Noise) -> View:
    """The runs with the states that these members make likely, given the noise."""
    states = [one.states() for one in linearised(view, members, noise, None).passed]
    runs = tuple(replace(run, states=s[:, :-1]) for run, s in zip(view.runs, states, strict=True))
    return replace(view, runs=runs, errors_nm=tuple(s[:, -1] for s in states))


@dataclass(frozen=True, eq=False)
class Wide:
    """Everything that is smooth, fitted at once: what noise and effective samples are found from."""

    noise: Noise
    excess: float  # variance of scores over that of white noise


#: Passes of noise, coefficients and states at most; settled, where no size of noise moves by more than this (log).
_PASSES, _SETTLED = 6, 0.05
#: How far off the sizes of noise may be in the next pass (log).
_REACHES = (0.1, 1.0)
#: Sizes of all curves are found by so many steps of their fixed point (MacKay), within these.
_SIZING, _SMALLEST, _LARGEST = 12, 1e-4, 10.0


def wide_fit(view: View, candidates: Sequence[Member], noise: Noise, train: Sequence[int]) -> Wide:
    """Fit the belief with all of these present. `candidates` begin with the coefficients they have."""
    members = list(candidates)
    reach = 1.0
    for number in range(_PASSES):
        about = linearised(view, members, noise, reach)
        moved, noise = about.noise.moved_from(noise), about.noise
        reach = float(np.clip(moved, *_REACHES))
        rows = about.whitened([(m.candidate, m.shape) for m in members], train)
        present = np.concatenate([m.coefficients for m in members])
        target = about.innovations(train) + present @ rows
        data = Statistics.of(rows.T, target)
        found = _sized(data, members)
        members, at = [], 0
        for member in candidates:
            size = member.candidate.size
            members.append(replace(member, coefficients=found.coefficients[at : at + size]))
            at += size
        if moved < _SETTLED or number == _PASSES - 1:
            break
        view = resmoothed(view, members, noise)
    return Wide(noise, excess_of(rows, target - found.coefficients @ rows, about, train))


def about_set(view: View, members: Sequence[Member], noise: Noise) -> Linearised:
    """The session about a few members alone, whose noise is known."""
    for _ in range(2):
        view = resmoothed(view, members, noise)
    return linearised(view, members, noise, None)


def target_of(about: Linearised, members: Sequence[Member], runs: Sequence[int]) -> Array:
    """The innovations of some runs as if the members were not there, (Σ2n,)."""
    rows = about.whitened([(m.candidate, m.shape) for m in members], runs)
    return np.asarray(about.innovations(runs) + np.concatenate([m.coefficients for m in members]) @ rows)


def excess_of(rows: Array, rest: Array, about: Linearised, train: Sequence[int]) -> float:
    """How much more than white noise's the scores of these columns (P, Σ2n) vary, at least 1: the median column's."""
    every, at = [], 0
    for i in train:
        stretch = 2 * max(round(STRETCH_S / about.view.runs[i].step_s), 1)
        mine = slice(at, at + about.passed[i].samples)
        every.append(colour(rows[:, mine].T, rest[mine], stretch))
        at = mine.stop
    return max(1.0, float(np.median(np.mean(every, axis=0))))


def _sized(data: Statistics, members: Sequence[Member]) -> Weighed:
    """All columns, the size of each curve as the evidence wants it."""
    natural = np.concatenate([np.array(m.candidate.deviations) for m in members])
    blocks, at = [], 0
    for member in members:
        blocks.append(slice(at, at + member.candidate.size))
        at += member.candidate.size
    scale = np.ones(len(members))
    for _ in range(_SIZING):
        deviations = natural * np.repeat(scale, [m.candidate.size for m in members])
        found = weigh(data, deviations)
        sure = 1 - (found.spread / deviations) ** 2
        for j, (member, where) in enumerate(zip(members, blocks, strict=True)):
            if len(member.candidate.scales) > 1:
                power = float(np.sum((found.coefficients[where] / natural[where]) ** 2))
                scale[j] = np.clip(
                    np.sqrt(power / max(float(np.sum(sure[where])), 1e-3)), _SMALLEST, _LARGEST
                )
    return found
