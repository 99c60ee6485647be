"""One round: the runs with everything present that may be there, the noise found so, and all columns whitened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from schwung.explain.weighing.along import Along, Ranges, along
from schwung.explain.weighing.candidate import Candidate, Shape
from schwung.explain.weighing.equations import Acting, equations_of
from schwung.explain.weighing.known import Known
from schwung.explain.weighing.present import Member, with_members
from schwung.innovations.effect import Passed, joined
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


@dataclass(frozen=True, eq=False)
class View:
    """The session as a round sees it: recorded and prepared runs, the belief."""

    recorded: Sequence[Run]
    runs: tuple[Signals, ...]
    known: Known
    ranges: Ranges
    errors_nm: tuple[Array, ...] = ()  # of each run's reported torque, as smoothed

    def alongs(self, members: Sequence[Member]) -> list[Along]:
        """Every run's coordinates, with these members present."""
        present = with_members(self.known.machine, members, self.ranges)
        return [
            along(
                run,
                recorded,
                self.known.machine,
                present,
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
        if member.candidate.of_machine:
            continue
        parts = member.candidate.done(along, member.shape, member.coefficients).of(np.ones(1))
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

    def rows(self, candidate: Candidate, shape: Shape) -> list[Array]:
        """A candidate's columns in one shape as each run's innovations show them, (2n, p) each."""
        return [
            one.whitened(candidate.effect(where, shape))
            for one, where in zip(self.passed, self.alongs, strict=True)
        ]

    @property
    def innovations(self) -> list[Array]:
        """Of each run, (2n,)."""
        return [one.innovations for one in self.passed]


def linearised(view: View, members: Sequence[Member], noise: Noise, reach: float | None) -> Linearised:
    """Filter all runs with these members present; `reach`: how far off the noise may be (log), None: keep it."""
    alongs = view.alongs(members)
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
    return Linearised(view, alongs, passed, noise)


def resmoothed(about: Linearised, members: Sequence[Member]) -> View:
    """The runs with the states that these members make likely, given the noise."""
    later = linearised(about.view, members, about.noise, None)
    states = [one.states() for one in later.passed]
    runs = tuple(replace(run, states=s[:, :-1]) for run, s in zip(about.view.runs, states, strict=True))
    return replace(about.view, runs=runs, errors_nm=tuple(s[:, -1] for s in states))


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
#: Steps of a set's coefficients at most, halvings of each; at rest, where none moves by more than this (deviations).
_STEPS, _HALVINGS, _AT_REST = 12, 4, 0.1


def wide_fit(view: View, candidates: Sequence[Member], noise: Noise, train: Sequence[int]) -> Wide:
    """Fit the belief with all of these present. `candidates` begin with the coefficients they have."""
    members = list(candidates)
    reach = 1.0
    for number in range(_PASSES):
        about = linearised(view, members, noise, reach)
        moved, noise = about.noise.moved_from(noise), about.noise
        reach = float(np.clip(moved, *_REACHES))
        rows = [
            one.whitened(joined([m.candidate.effect(where, m.shape) for m in members], where.speed.size))
            for one, where in zip(about.passed, about.alongs, strict=True)
        ]
        present = np.concatenate([m.coefficients for m in members])
        target = [e + x @ present for e, x in zip(about.innovations, rows, strict=True)]
        data = _sum([Statistics.of(rows[i], target[i]) for i in train])
        found = _sized(data, members)
        members, at = [], 0
        for member in candidates:
            size = member.candidate.size
            members.append(replace(member, coefficients=found.coefficients[at : at + size]))
            at += size
        if moved < _SETTLED or number == _PASSES - 1:
            break
        view = resmoothed(about, members)
    rest = [y - x @ found.coefficients for y, x in zip(target, rows, strict=True)]
    return Wide(noise, excess_of(rows, rest, about, train))


@dataclass(frozen=True, eq=False)
class Settled:
    """The session about a set whose coefficients have come to rest, and each run's target as if it were not there."""

    about: Linearised
    members: tuple[Member, ...]
    target: list[Array]


def settled(view: View, members: Sequence[Member], noise: Noise, train: Sequence[int]) -> Settled:
    """Gauss and Newton over the coefficients of a few members, whose noise is known.

    A step that makes the runs less likely is halved: far from the truth, a linear model promises too much.
    """
    view = resmoothed(linearised(view, members, noise, None), members)
    at = _stepped(view, members, noise, train)
    for _ in range(_STEPS):
        share, better = 1.0, at
        for _ in range(_HALVINGS):
            tried = [
                replace(m, coefficients=_within(m, m.coefficients + share * step))
                for m, step in zip(at.members, at.steps, strict=True)
            ]
            better = _stepped(resmoothed(at.about, tried), tried, noise, train)
            if better.cost < at.cost:
                break
            share /= 2
        if not better.cost < at.cost:
            break
        moved, at = share * at.moved, better
        if moved < _AT_REST:
            break
    return Settled(at.about, at.members, at.target)


@dataclass(frozen=True, eq=False)
class _Step:
    """About coefficients: what the data ask for next, and how unlikely they and the runs are (−2 log)."""

    about: Linearised
    members: tuple[Member, ...]
    target: list[Array]
    steps: list[Array]
    moved: float  # the largest step, over its deviation
    cost: float


def _stepped(view: View, members: Sequence[Member], noise: Noise, train: Sequence[int]) -> _Step:
    about = linearised(view, members, noise, None)
    present = np.concatenate([m.coefficients for m in members])
    deviations = np.concatenate([m.deviations for m in members])
    every = [m.candidate.about(m.coefficients) for m in members]
    rows = [
        one.whitened(
            joined([c.effect(where, m.shape) for c, m in zip(every, members, strict=True)], where.speed.size)
        )
        for one, where in zip(about.passed, about.alongs, strict=True)
    ]
    target = [e + x @ present for e, x in zip(about.innovations, rows, strict=True)]
    found = weigh(_sum([Statistics.of(rows[i], target[i]) for i in train]), deviations)
    step, at = found.coefficients - present, np.cumsum([m.candidate.size for m in members])[:-1]
    cost = sum(about.passed[i].deviance for i in train) + float(np.sum((present / deviations) ** 2))
    return _Step(
        about, tuple(members), target, np.split(step, at), float(np.max(np.abs(step) / found.spread)), cost
    )


def _within(member: Member, coefficients: Array) -> Array:
    """Coefficients that leave a total above what no machine goes below; no step takes more than most of it."""
    held = coefficients.copy()
    for which, least in member.candidate.bounds_below:
        total = member.coefficients[which] - least
        if total > 0 and member.candidate.of_machine:
            held[which] = max(held[which], least + total / 4)
    return held


def excess_of(rows: list[Array], rest: list[Array], about: Linearised, train: Sequence[int]) -> float:
    """How much more than white noise's the scores of these columns vary, at least 1: the median column's."""
    every = []
    for i in train:
        stretch = 2 * max(round(STRETCH_S / about.view.runs[i].step_s), 1)
        every.append(colour(rows[i], rest[i], stretch))
    return max(1.0, float(np.median(np.mean(every, axis=0))))


def _sum(parts: list[Statistics]) -> Statistics:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


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
