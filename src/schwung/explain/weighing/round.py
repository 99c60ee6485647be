"""One round: the runs with everything present that may be there, the noise found so, and all columns whitened."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from schwung.explain.weighing.along import Along, Ranges, TrueTorque, along
from schwung.explain.weighing.candidate import Candidate, Shape
from schwung.explain.weighing.equations import Acting, equations_of
from schwung.explain.weighing.known import Known
from schwung.explain.weighing.present import Member, with_members
from schwung.explain.weighing.work import LINEARISED, NOISE, PRODUCT, Work
from schwung.innovations.effect import Passed
from schwung.innovations.evidence import Weighed, weigh
from schwung.innovations.likelihood import Noise, likely_noise, unshared_deviance_of
from schwung.innovations.low_pass import heard
from schwung.innovations.signals import Signals
from schwung.innovations.statistics import Statistics, colour
from schwung.motion import Array
from schwung.session.model import Run

#: Runs, or pairs of runs of one motion, that the sizes of noise are found from, at most.
FEW = 3
#: Innovations further apart than this are taken as independent (s).
STRETCH_S = 0.02


T = TypeVar("T")
#: A candidate in one of its shapes.
Cause = tuple[Candidate, Shape]


@dataclass(frozen=True, eq=False)
class View:
    """The session as a round sees it: recorded and prepared runs, the belief."""

    recorded: Sequence[Run]
    runs: tuple[Signals, ...]
    known: Known
    ranges: Ranges
    torques: tuple[TrueTorque, ...]  # of each run, as far as it is known
    dry_nm: float | None = (
        None  # dry friction that leaves open where the shaft sticks; None: that of what is present
    )
    repeats: Sequence[Sequence[int]] = ()  # runs of each motion and injection
    work: Work = field(default_factory=Work)  # that was done since the session was first looked at

    @cached_property
    def _kept(self) -> list[dict[str, Array]]:
        """Coordinates of each run, as they were asked for."""
        return [{} for _ in self.runs]

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
                self.torques[number],
                self._kept[number],
            )
            for number, (run, recorded) in enumerate(zip(self.runs, self.recorded, strict=True))
        ]


def acting(view: View, along: Along, members: Sequence[Member]) -> Acting:
    """What the belief and the members do along a run."""
    known = view.known
    what = known.effect(along)
    total, dry = Acting(*what.of(np.ones(1))), known.dry(along)
    whole = dry  # whatever acts beyond the belief
    for member in members:
        if member.candidate.of_machine and view.dry_nm is not None:
            continue
        parts = member.candidate.done(along, member.shape, member.coefficients).of(np.ones(1))
        whole = whole + parts[0] + parts[1]
        if member.candidate.of_machine:
            continue
        total += Acting(*parts)
        if (
            member.candidate.tangent is not None
        ):  # then the filter knows how much more it winds up for more torque
            coupling = member.candidate.tangent(along, member.coefficients)
            wound = coupling[:, 0] * along.twist + coupling[:, 1] * along.twist_speed
            total += Acting(on_motor=wound, on_load=-wound, coupling=coupling)
        if member.candidate.dry:
            dry = dry + parts[0]
    return replace(total, dry_nm=_dry(along, dry, whole) if view.dry_nm is None else view.dry_nm)


def _dry(along: Along, dry: Array, whole: Array) -> float:
    """Size of dry friction where the shaft slides (N·m): curves may cancel, and no more of it is dry than there is."""
    return float(np.sqrt(min(np.mean(each[along.moves] ** 2) for each in (dry, whole))))


@dataclass(frozen=True, eq=False)
class Linearised:
    """The session about what is present: every run filtered."""

    view: View
    alongs: list[Along]
    passed: Mapping[int, Passed]  # of the runs that were asked for
    noise: Noise
    members: Sequence[Member] = ()  # that are present
    unlikely: float = 0.0  # what repeats do not share, where noise was found by it (−2 log likelihood)

    def beside(self, runs: Sequence[int]) -> Linearised:
        """Other runs about the same, with the states that it makes likely."""
        return at_rest(self.view, self.members, self.noise, runs)

    def samples(self, runs: Sequence[int]) -> int:
        """Σ2n of some runs."""
        return sum(self.passed[run].samples for run in runs)

    def stretches(self, runs: Sequence[int]) -> list[slice]:
        """Where each of some runs is, one behind another."""
        ends = np.cumsum([self.passed[run].samples for run in runs]).tolist()
        return [slice(start, end) for start, end in zip([0, *ends[:-1]], ends, strict=True)]

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
        """The same in an array that holds until columns are whitened next."""
        causes = list(causes)
        rows = self.view.work.rows(sum(candidate.size for candidate, _ in causes), self.samples(runs))
        self.whiten(causes, runs, rows)
        return rows

    def square(self, runs: Sequence[int]) -> float:
        """Sum of squares of some runs' innovations."""
        return float(np.sum(self.innovations(runs) ** 2))

    def innovations(self, runs: Sequence[int]) -> Array:
        """Of some runs, one behind another, (Σ2n,)."""
        return np.concatenate([self.passed[run].innovations for run in runs])


def linearised(
    view: View,
    members: Sequence[Member],
    noise: Noise,
    reach: float | None,
    runs: Sequence[int] | None = None,
) -> Linearised:
    """Filter some runs (None: all) with these members present; `reach`: how far off the noise may be (log), None: keep
    it.
    """
    alongs = view.alongs(members)
    runs = range(len(alongs)) if runs is None else runs
    pairs = _few([group for group in view.repeats if len(group) > 1])
    few = [] if reach is None else [i for pair in pairs for i in pair[:2]] or _few(range(len(alongs)))
    made = {i: equations_of(alongs[i], acting(view, alongs[i], members)) for i in {*runs, *few}}
    unlikely = 0.0
    if reach is not None:
        equations = [made[i][0] for i in few]
        these, span = [view.runs[i] for i in few], view.ranges.span_rad
        places = [(2 * i, 2 * i + 1) for i in range(len(pairs))]
        noise = likely_noise(equations, these, noise, reach, span, whole=True, repeats=places)
        unlikely = unshared_deviance_of(equations, these, noise, places)
        view.work.add(NOISE * sum(2 * run.time_s.size for run in these))
    passed = {i: Passed.of(*made[i], noise, view.runs[i]) for i in runs}
    view.work.add(LINEARISED * sum(one.samples for one in passed.values()))
    return Linearised(view, alongs, passed, noise, members, unlikely)


def _few(every: Sequence[T]) -> list[T]:
    """A few of these, evenly spread."""
    places = np.unique(np.round(np.linspace(0, len(every) - 1, FEW))) if every else ()
    return [every[int(place)] for place in places]


def resmoothed(
    view: View, members: Sequence[Member], noise: Noise, runs: Sequence[int] | None = None
) -> View:
    """Some runs (None: all) with the states that these members make likely, given the noise.

    What the true torque is taken to be stays: were it smoothed about a set, what that set cannot do would be in it, and
    from there in the set's own columns.
    """
    return _resmoothed(linearised(view, members, noise, None, runs))


def _resmoothed(about: Linearised) -> View:
    """With the states that what is present makes likely."""
    runs = list(about.view.runs)
    for i, passed in about.passed.items():
        runs[i] = runs[i].about(np.ascontiguousarray(passed.states[:, :-1]))
    return replace(about.view, runs=tuple(runs))


def _torques(about: Linearised) -> tuple[TrueTorque, ...]:
    """The torque of each run without what is noise of it."""
    view, noise = about.view, about.noise
    torques = list(view.torques)
    for i, passed in about.passed.items():
        run = view.runs[i]
        size = float(np.sqrt(noise.torque_nm**2 + np.mean((noise.torque_share * run.load_nm) ** 2)))
        reported = run.drive.smooth_nm - passed.states[:, -1]
        torques[i] = TrueTorque(run, heard(reported, size) + run.drive.injected_nm)
    return tuple(torques)


def at_rest(
    view: View, members: Sequence[Member], noise: Noise, runs: Sequence[int] | None = None
) -> Linearised:
    """Some runs (None: all) about the states that these members make likely, smoothed until those stay as they are.

    As recorded, a shaft is not wound up: about such states, and about those smoothed once from there, a machine that is
    as believed misses several times its noise.
    """
    about = linearised(resmoothed(view, members, noise, runs), members, noise, None, runs)
    every = tuple(about.passed)
    for _ in range(_STEPS):
        before, missed = about.square(every), max(1.0, about.square(every) / about.samples(every))
        about = linearised(_resmoothed(about), members, noise, None, runs)
        if abs(about.square(every) - before) < _ALIKE * missed:
            break
    return about


@dataclass(frozen=True, eq=False)
class Wide:
    """Everything that is smooth, fitted at once: what noise and effective samples are found from."""

    noise: Noise
    excess: float  # variance of scores over that of white noise
    torques: tuple[TrueTorque, ...]  # of each run, as far as it is known
    dry_nm: float  # friction that leaves open where the shaft sticks

    def seen(self, view: View) -> View:
        """The session with what is known of all sets alike: they differ in what they predict, not in how surely."""
        return replace(view, torques=self.torques, dry_nm=self.dry_nm)


#: Passes of noise, coefficients and states at most; settled, where no size of noise moves by more than this (log).
_PASSES, _SETTLED = 6, 0.05
#: Of repeats the noise does not depend on what else is known.
_PASSES_OF_REPEATS = 2
#: How far off the sizes of noise may be in the next pass (log).
_REACHES = (0.1, 1.0)
#: Sizes of all curves are found by so many steps of their fixed point (MacKay), within these.
_SIZING, _SMALLEST, _LARGEST = 12, 1e-4, 10.0
#: Steps of a set's coefficients at most, halvings of each; at rest, where none moves by more than this (deviations).
_STEPS, _HALVINGS, _AT_REST = 12, 4, 0.1
#: Costs (−2 log) that differ by less are the same: the filter's equations change a little with the states.
_ALIKE = 0.5


def wide_fit(
    view: View, candidates: Sequence[Member], noise: Noise, train: Sequence[int], reach: float = 1.0
) -> Wide:
    """Fit the belief with all of these present. `candidates` begin with the coefficients they have; `reach`: how far
    off the noise may be (log).

    Where repeats are likelier about the former states, what was found about those holds: curves that cancel one another
    may make them differ by more than their noise.
    """
    members, least = list(candidates), np.inf
    view = at_rest(replace(view, dry_nm=None), members, noise).view
    passes = _PASSES_OF_REPEATS if any(len(group) > 1 for group in view.repeats) else _PASSES
    for number in range(passes):
        latest = linearised(view, members, noise, reach)
        if latest.unlikely > least:
            break
        about, least = latest, latest.unlikely
        moved, noise = about.noise.moved_from(noise), about.noise
        reach = float(np.clip(moved, *_REACHES))
        rows = about.whitened([(m.candidate.about(m.coefficients), m.shape) for m in members], train)
        present = np.concatenate([m.coefficients for m in members])
        target = about.innovations(train) + present @ rows
        view.work.add(PRODUCT * rows.size * rows.shape[0])
        data = Statistics.of(rows.T, target)
        found = _sized(data, members)
        members, view, torques = _nearer(about, members, found.coefficients - present, train)
        if moved < _SETTLED or number == passes - 1 or view.work.spent:
            break
        view = replace(view, torques=torques)
    excess = excess_of(rows, target - found.coefficients @ rows, about, train)
    dry = max(acting(view, where, members).dry_nm for where in view.alongs(members))
    return Wide(noise, excess, torques, dry)


def _nearer(
    about: Linearised, members: Sequence[Member], step: Array, train: Sequence[int]
) -> tuple[list[Member], View, tuple[TrueTorque, ...]]:
    """Members a step (P,) on, or so much of it as makes the runs likelier, and the runs about them."""
    before, at = about.square(train), np.cumsum([m.candidate.size for m in members])[:-1]
    share = 1.0
    for _ in range(_HALVINGS):
        tried = [
            replace(m, coefficients=_within(m, m.coefficients + share * part))
            for m, part in zip(members, np.split(step, at), strict=True)
        ]
        beyond = linearised(about.view, tried, about.noise, None)
        view = _resmoothed(beyond)
        if _finite(view) and linearised(view, tried, about.noise, None, train).square(train) < before:
            return tried, view, _torques(beyond)
        share /= 2
    whole = linearised(about.view, members, about.noise, None)
    return list(members), _resmoothed(whole), _torques(whole)


@dataclass(frozen=True, eq=False)
class Weighing:
    """What a set is weighed by: the sizes of noise, the runs that are fitted, and the tempering."""

    noise: Noise
    train: Sequence[int]
    excess: float


@dataclass(frozen=True, eq=False)
class Settled:
    """The session about a set whose coefficients have come to rest, and the set's evidence there (log)."""

    about: Linearised
    members: tuple[Member, ...]
    log: float


def settled(view: View, members: Sequence[Member], weighing: Weighing) -> Settled:
    """Gauss and Newton over the coefficients of a few members, whose noise is known.

    A step that makes the runs less likely is halved: far from the truth, a linear model promises too much.
    """
    view = resmoothed(view, members, weighing.noise, weighing.train)
    return _at_rest(_stepped(view, members, weighing), weighing)


def settled_beyond(
    about: Linearised, members: Sequence[Member], promised: Sequence[Array], weighing: Weighing
) -> Settled:
    """The same from members with the coefficients they have where all is linearised; `promised`: the linear model's.

    Where no part of that step makes the runs likelier, the set is worth nothing: what it promised is no machine.
    """
    steps = [new - m.coefficients for new, m in zip(promised, members, strict=True)]
    cost = _cost(about, members, weighing)
    return _at_rest(_Step(about, tuple(members), steps, np.inf, cost, -np.inf), weighing)


def _at_rest(at: _Step, weighing: Weighing) -> Settled:
    samples = at.about.samples(weighing.train) / weighing.excess
    for _ in range(_STEPS):
        missed = max(1.0, float(np.sqrt(at.cost / samples)))  # coefficients are known so many times less well
        if at.moved < _AT_REST * missed or at.about.view.work.late:
            break
        share, better = 1.0, at
        for _ in range(_HALVINGS):
            tried = [
                replace(m, coefficients=_within(m, m.coefficients + share * step))
                for m, step in zip(at.members, at.steps, strict=True)
            ]
            view = resmoothed(at.about.view, tried, weighing.noise, weighing.train)
            if _finite(view):
                better = _stepped(view, tried, weighing)
                if better.cost < at.cost + _ALIKE * missed**2:
                    break
            share /= 2
        if better is at or better.cost >= at.cost + _ALIKE * missed**2:
            break
        at = better
    return Settled(at.about, at.members, at.log)


def _finite(view: View) -> bool:
    """Whether the machine still moved as machines do: coefficients far off make its numbers run away."""
    return all(bool(np.all(np.isfinite(run.states))) for run in view.runs)


@dataclass(frozen=True, eq=False)
class _Step:
    """About coefficients: what the data ask for next, how unlikely they and the runs are (−2 log), and the evidence
    there (Laplace's, of the coefficients as they are: what a further step promises is not kept everywhere).
    """

    about: Linearised
    members: tuple[Member, ...]
    steps: list[Array]
    moved: float  # the largest step, over its deviation
    cost: float
    log: float


def _cost(about: Linearised, members: Sequence[Member], weighing: Weighing) -> float:
    """How unlikely the runs and the members' coefficients are (−2 log)."""
    prior = sum(float(np.sum((m.coefficients / m.deviations) ** 2)) for m in members)
    return about.square(weighing.train) / weighing.excess + prior


def _stepped(view: View, members: Sequence[Member], weighing: Weighing) -> _Step:
    about = linearised(view, members, weighing.noise, None, weighing.train)
    train, excess = weighing.train, weighing.excess
    present = np.concatenate([m.coefficients for m in members])
    deviations = np.concatenate([m.deviations for m in members])
    rows = about.whitened([(m.candidate.about(m.coefficients), m.shape) for m in members], train)
    target = about.innovations(train) + present @ rows
    if not np.all(np.isfinite(target)):  # its numbers run away: worth nothing, and no step leads on from here
        return _Step(about, tuple(members), [0.0 * m.coefficients for m in members], 0.0, np.inf, -np.inf)
    view.work.add(PRODUCT * rows.size * rows.shape[0])
    found = weigh(Statistics.of(rows.T, target).tempered(excess), deviations)
    step, at = found.coefficients - present, np.cumsum([m.candidate.size for m in members])[:-1]
    cost = _cost(about, members, weighing)
    return _Step(
        about=about,
        members=tuple(members),
        steps=np.split(step, at),
        moved=float(np.max(np.abs(step) / found.spread)),
        cost=cost,
        log=-0.5 * cost - float(np.sum(np.log(np.diag(found.factor)))),
    )


def _within(member: Member, coefficients: Array) -> Array:
    """Coefficients that leave a total above what no machine goes below; no step takes more than most of it."""
    held = coefficients.copy()
    for which, least in member.candidate.bounds_below:
        total = member.coefficients[which] - least
        if total > 0 and member.candidate.of_machine:
            held[which] = max(held[which], least + total / 4)
    return held


def target_of(about: Linearised, members: Sequence[Member], runs: Sequence[int]) -> Array:
    """The innovations of some runs as if the members were not there, (Σ2n,)."""
    rows = about.whitened([(m.candidate.about(m.coefficients), m.shape) for m in members], runs)
    return np.asarray(about.innovations(runs) + np.concatenate([m.coefficients for m in members]) @ rows)


def excess_of(rows: Array, rest: Array, about: Linearised, train: Sequence[int]) -> float:
    """How much more than white noise's the scores of these columns (P, Σ2n) vary, at least 1: the median column's.

    Of what repeats do not share, where there are repeats: what they share is no noise.
    """
    wheres, every = dict(zip(train, about.stretches(train), strict=True)), []
    groups = [[i for i in group if i in wheres] for group in about.view.repeats]
    groups = [group for group in groups if len(group) > 1]
    for group in groups or [[i] for i in train]:
        length = min(about.passed[i].samples for i in group)
        heads = [slice(wheres[i].start, wheres[i].start + length) for i in group]
        rests = np.stack([rest[head] for head in heads])
        if groups:
            rests = (rests - np.mean(rests, axis=0)) * np.sqrt(len(group) / (len(group) - 1))
        for i, head, own in zip(group, heads, rests, strict=True):
            stretch = 2 * max(round(STRETCH_S / about.view.runs[i].step_s), 1)
            every.append(colour(rows[:, head].T, own, stretch))
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
