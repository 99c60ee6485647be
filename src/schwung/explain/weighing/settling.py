"""A set at rest: its coefficients and shapes where a linear model promises nothing more, and its evidence there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from schwung.explain.causes.inexact import SHARES, deviations_of, error_of
from schwung.explain.causes.present import Member, moves
from schwung.explain.weighing.further import AT_SAMPLE, leads_across, leads_beyond, taken_further
from schwung.explain.weighing.round import (
    ALIKE,
    STEPS,
    Linearised,
    View,
    few_of,
    finite,
    linearised,
    resmoothed,
    resmoothed_about,
)
from schwung.explain.weighing.search import HOPELESS, logsumexp
from schwung.explain.weighing.sharpness import shape_slopes
from schwung.explain.weighing.work import PRODUCT
from schwung.innovations.evidence import Weighed, weigh
from schwung.innovations.likelihood import Noise
from schwung.innovations.statistics import Numbers, Statistics
from schwung.motion import Array

#: Halvings at most, of what leaves no machine; at rest, where no coefficient moves by more than this (deviations).
HALVINGS, _AT_REST = 4, 0.1
#: After so many steps a line promises no less than half of what is still to be gained: far from the truth it may
#: promise next to nothing of what a step leads to.
_TRUSTED = 3
#: A step that leads nowhere is tried again at most so much of it, at least so much; of less than the last nothing is.
_MOST_OF, _LEAST_OF, _LEAST_SHARE = 0.5, 0.1, 0.1
#: Passes of a set's own noise at most; known, where no size of it moves by more than this (log).
_PASSES, _KNOWN = 4, 0.1
#: How well a gap is found (log) before all else comes to rest with it.
_NEARLY = 0.03


@dataclass(frozen=True, eq=False)
class Weighing:
    """What a set is weighed by: the sizes of noise, the runs that are fitted, and the tempering."""

    noise: Noise
    train: Sequence[int]
    excess: float


@dataclass(frozen=True, eq=False)
class Settled:
    """The session about a set whose coefficients have come to rest, and the set's evidence there (log), with what its
    laws may be off by."""

    about: Linearised
    members: tuple[Member, ...]
    log: float


def settled(view: View, members: Sequence[Member], weighing: Weighing, least: float = -np.inf) -> Settled:
    """Gauss and Newton over the coefficients and shapes of a few members, whose noise is known; what is hopelessly less
    likely than `least` (log) does not come to rest.

    A step that makes the runs less likely is halved: far from the truth, a linear model promises too much.
    """
    members = _that_move(view, members)
    return _at_rest(_stepped(smoothed(view, members, weighing), members, weighing), weighing, least)


def own_noise(at: Settled, weighing: Weighing) -> Noise:
    """The noise that a set makes likeliest, about which it comes to rest again."""
    for _ in range(_PASSES):
        noise = linearised(at.about.view, at.members, at.about.noise, 1.0, weighing.train).noise
        moved = noise.moved_from(at.about.noise)
        if moved < _KNOWN or at.about.view.work.spent:
            break
        at = settled(at.about.view, at.members, replace(weighing, noise=noise))
    return noise


def _that_move(view: View, members: Sequence[Member]) -> Sequence[Member]:
    """With so much of a change of the inertia as leaves one."""
    for _ in range(HALVINGS):
        if moves(view.known.machine, members, view.ranges):
            break
        members = [
            replace(m, coefficients=m.coefficients / 2) if m.candidate.inertia is not None else m
            for m in members
        ]
    return members


def smoothed(view: View, members: Sequence[Member], weighing: Weighing) -> Linearised:
    """The session about the states that the members make likely.

    Where the coupling bends, whether it touches follows from the states that follow from whether it touches; what a
    further mass does, too, follows from what it does. So they are smoothed for as long as that makes the runs likelier.
    """
    noise, train = weighing.noise, weighing.train
    about = linearised(resmoothed(view, members, noise, train), members, noise, None, train)
    bends = view.known.bends or any(m.candidate.tangent is not None for m in members)
    for _ in range(STEPS if bends or about.swings else 0):
        if not finite(about.view):
            break
        further = linearised(resmoothed_about(about), members, noise, None, train)
        if not further.square(train) < about.square(train) - ALIKE * weighing.excess:
            break
        about = further
    return about


def settled_beyond(
    about: Linearised,
    members: Sequence[Member],
    promised: Sequence[Array],
    weighing: Weighing,
    least: float = -np.inf,
) -> Settled:
    """The same from members with the coefficients they have where all is linearised; `promised`: the linear model's.

    Where no part of that step makes the runs likelier, they are begun where it leads: far from the truth a set may have
    to be worse before it is better, as a late speed is, which bends in proportion to how late it is.
    """
    if any(_shut(m) for m in members):
        opened = _opened(about, members, weighing)
        if opened is None:
            return Settled(about, tuple(members), -np.inf)
        return settled(about.view, opened, weighing, least)
    steps = [new - m.coefficients for new, m in zip(promised, members, strict=True)]
    cost = _cost(about, members, weighing)
    still = [np.zeros(len(m.candidate.spacing)) for m in members]
    begun = _Step(about, tuple(members), steps, still, np.inf, np.inf, cost, -np.inf)
    found = _at_rest(begun, weighing, least)
    if np.isneginf(found.log):
        there = [replace(m, coefficients=new) for new, m in zip(promised, members, strict=True)]
        return settled(about.view, there, weighing, least)
    return found


def settled_elsewhere(
    at: Settled,
    members: Sequence[Member],
    starts: Sequence[Member],
    weighing: Weighing,
    few: Sequence[int],
    least: float,
) -> Settled | None:
    """Members and one of `starts`, begun where no line leads, at rest; None where by a `few` runs none of that is
    likelier than the set at rest without it, by more than `least` (log) in all.

    A resonance that is far off, and a stiffness of another order, have maxima of the likelihood of their own.
    """
    first = replace(weighing, train=few)
    here = settled(at.about.view, at.members, first)
    in_all = at.about.samples(weighing.train) / at.about.samples(first.train)
    least /= in_all
    best: Settled | None = None
    for start in starts:
        if best is not None and at.about.view.work.spent:
            break
        # none is left for what another is worth: from far off, the best promised less on its way than others were
        found = settled(at.about.view, [*members, start], first, here.log + least)
        if found.log > (here.log + least if best is None else best.log):
            best = found
    if best is None or in_all == 1:
        return best
    return settled(at.about.view, best.members, weighing)


def _shut(member: Member) -> bool:
    """Whether it opens a gap that is not open yet."""
    return member.candidate.opens and member.coefficients[0] <= 0


def _opened(about: Linearised, members: Sequence[Member], weighing: Weighing) -> list[Member] | None:
    """With the likeliest gap, all else as it is; None where none is likelier than no gap.

    Far from the likeliest gap no column says where that is. It is looked for in a few runs, for a gap is in all of
    them, and asked of all where those have one. A smaller gap than the likeliest mostly gains some of what that does;
    where the load is pressed to one side and thrown to the other, all but those near it are worse than none, and so
    the middles between are asked as well.
    """
    place = next(i for i, member in enumerate(members) if _shut(member))
    first = replace(weighing, train=few_of(weighing.train))

    def tried(log: float) -> list[Member]:
        gap = np.array([float(np.exp(log)), 0.0])
        return [replace(m, coefficients=gap) if i == place else m for i, m in enumerate(members)]

    def cost(log: float, among: Weighing = first) -> float:
        if about.view.work.late:
            return np.inf
        found = tried(log)
        return _cost(linearised(about.view, found, among.noise, None, among.train), found, among)

    coarse = np.log([gap for (gap,) in members[place].candidate.shapes])
    middles = (coarse[1:] + coarse[:-1]) / 2
    shut = _cost(about, members, first)
    costs: dict[float, float] = {}
    for grid in (coarse, middles):
        costs |= {log: cost(log) for log in grid.tolist()}
        if min(costs.values()) < shut:
            break
    else:
        return None
    every = sorted(costs)
    best = every.index(min(costs, key=costs.__getitem__))
    ends = every[max(best - 1, 0)], every[min(best + 1, len(every) - 1)]
    found = minimize_scalar(cost, bounds=ends, method="bounded", options={"xatol": _NEARLY})
    gap = found.x if found.fun < costs[every[best]] else every[best]
    return tried(gap) if cost(gap, weighing) < _cost(about, members, weighing) else None


def _at_rest(at: _Step, weighing: Weighing, least: float) -> Settled:
    """Step by step, each likelier than the one before.

    Where none is, the one before may be too good for any: it is about states that were smoothed about another. It is
    asked again about its own, and has come to rest where those are no likelier than its own were before.
    """
    samples = at.about.samples(weighing.train) / weighing.excess
    before = np.inf
    for number in range(STEPS):
        missed = max(1.0, float(np.sqrt(at.cost / samples)))  # coefficients are known so many times less well
        if at.moved < _AT_REST * missed or at.about.view.work.late:
            break
        worse = at.cost + ALIKE * missed**2
        # within what is known of the coefficients a line is right: it is the states that are not
        near = at.moved < missed
        if near and _is_hopeless(at, weighing, least):
            break
        if number >= _TRUSTED and _is_hopeless(at, weighing, least, 2 * at.promised):
            break
        better, share = _better(at, worse, weighing, at.share, once=near)
        if better is None and _is_hopeless(at, weighing, least):
            break
        if better is None:
            own = _stepped(smoothed(at.about.view, at.members, weighing), at.members, weighing)
            if not own.cost < worse:
                at, alike = own, own.cost > before - ALIKE * missed**2
                before = own.cost
                if alike:
                    break
                continue
            better, _ = _better(at, worse, weighing, share) if near else (None, share)
            if better is None:
                break
        at = better
    return Settled(at.about, at.members, at.log + _inexact(at.about, at.members, weighing))


def _is_hopeless(at: _Step, weighing: Weighing, least: float, further: float | None = None) -> bool:
    """Whether what a line promises, or so much `further` (log), and errors of its laws, are far from what is to be
    exceeded (log)."""
    promised = at.log + (at.promised if further is None else further)
    return promised < least - HOPELESS and (
        promised + _inexact(at.about, at.members, weighing) < least - HOPELESS
    )


def _better(
    at: _Step, worse: float, weighing: Weighing, share: float, *, once: bool = False
) -> tuple[_Step | None, float]:
    """So much of the step, or less, as leads to less than such a cost; None: none does; and the share to try next.
    `once`: whether no more is tried than this share."""
    while share >= _LEAST_SHARE:
        tried = [
            taken_further(m, share * step, share * shift)
            for m, step, shift in zip(at.members, at.steps, at.shifts, strict=True)
        ]
        about, cost = smoothed(at.about.view, tried, weighing), np.inf
        if finite(about.view):
            better = _stepped(about, tried, weighing, (share, at.whole))
            if better.cost < worse:
                return better, share
            cost = better.cost
        share *= _shorter(at, share, cost)
        if once:
            break
    return None, share


def _shorter(at: _Step, share: float, cost: float) -> float:
    """How much of a share of the step is least unlikely, if cost is a parabola over it: it begins as the line promises,
    and was so much there."""
    begins = 4 * at.promised * share
    bends = cost - at.cost + begins
    if not np.isfinite(bends) or bends <= 0:
        return _MOST_OF
    return min(max(begins / (2 * bends), _LEAST_OF), _MOST_OF)


@dataclass(frozen=True, eq=False)
class _Step:
    """About coefficients: what the data ask for next, how unlikely they and the runs are (−2 log), and the evidence
    there (Laplace's, of the coefficients as they are: what a further step promises is not kept everywhere).
    """

    about: Linearised
    members: tuple[Member, ...]
    steps: list[Array]
    shifts: list[Array]  # of their shapes, in spacings of the grid
    moved: float  # the largest step, over its deviation
    promised: float  # what a line says that the step gains (log)
    cost: float
    log: float
    share: float = 1.0  # of the step, that is asked first

    @property
    def whole(self) -> Array:
        """The step of all coefficients, and behind them of all shapes."""
        return np.concatenate([*self.steps, *self.shifts])


def _to_and_fro(share: float, whole: Array, step: Array, gram: Array) -> float:
    """How much of a step is to be taken, if so much of the one before was, and that went further than its line says.

    Of a slope that is too small the coefficients would go to and fro about where they are likeliest. What is asked for
    next says where that was along the step before (A. C. Aitken 1926), and so much of the next leads there, too.
    """
    left = float(whole @ gram @ step) / max(float(whole @ gram @ whole), 1e-300)
    return 1.0 if left >= 1 - share else max(share / (1 - left), _LEAST_SHARE)


def _of_shapes(members: Sequence[Member]) -> Statistics:
    """What is known beforehand of shapes that go with their coefficients, by all coefficients and all shapes."""
    coefficients, shapes = (
        sum(m.candidate.size for m in members),
        sum(len(m.candidate.spacing) for m in members),
    )
    rows, targets, at, place = [], [], 0, coefficients
    for member in members:
        if member.candidate.bends is not None:
            off, by_coefficient, by_shape = member.candidate.unbent(member.shape, member.coefficients)
            row = np.zeros(coefficients + shapes)
            row[at], row[place] = by_coefficient, by_shape * member.candidate.spacing[0]
            rows.append(row)
            targets.append(by_coefficient * float(member.coefficients[0]) - off)
        at, place = at + member.candidate.size, place + len(member.candidate.spacing)
    return Statistics.of(np.reshape(rows, (-1, coefficients + shapes)), np.array(targets), 0.0)


def _cost(about: Linearised, members: Sequence[Member], weighing: Weighing) -> float:
    """How unlikely the runs and the members' coefficients are (−2 log)."""
    prior = sum(float(np.sum((m.coefficients / m.deviations) ** 2)) for m in members)
    bent = (m for m in members if m.candidate.bends is not None)
    prior += sum(m.candidate.unbent(m.shape, m.coefficients)[0] ** 2 for m in bent)
    return (about.square(weighing.train) + about.unsure(weighing.train)) / weighing.excess + prior


def _stepped(
    about: Linearised, members: Sequence[Member], weighing: Weighing, after: tuple[float, Array] | None = None
) -> _Step:
    """About members; `after`: so much of a step led there, and the whole of it."""
    train, excess = weighing.train, weighing.excess
    present = np.concatenate([m.coefficients for m in members])
    deviations = np.concatenate([m.deviations for m in members])
    slopes = [slope for m in members for slope in shape_slopes(m)]
    size = present.size
    rows = about.whitened([*((m.candidate.about(m.coefficients), m.shape) for m in members), *slopes], train)
    target = about.innovations(train) + present @ rows[:size]
    still = [np.zeros(len(m.candidate.spacing)) for m in members]
    machine = about.view.known.machine
    if not np.all(np.isfinite(target)) or not moves(machine, members, about.view.ranges):
        # its numbers run away, or would, were the inertia not held: worth nothing, and no step leads on from here
        nowhere = [0.0 * m.coefficients for m in members]
        return _Step(about, tuple(members), nowhere, still, 0.0, 0.0, np.inf, -np.inf)
    about.view.work.add(PRODUCT * rows.size * rows.shape[0])
    statistics = Statistics.of(rows.T, target).tempered(excess)
    at, ends = (
        np.cumsum(sizes)[:-1] for sizes in ([m.candidate.size for m in members], [one.size for one in still])
    )
    every, start = np.append(deviations, np.ones(len(slopes))), np.append(present, np.zeros(len(slopes)))

    told = statistics + _of_shapes(members)

    def solved(free: Numbers) -> tuple[Weighed, Array]:
        found, step = weigh(told.at(free), every[free]), np.zeros(start.size)
        step[free] = found.coefficients - start[free]
        return found, step

    free = np.arange(start.size)
    found, step = solved(free)
    each, shifts = np.split(step[:size], at), np.split(step[size:], ends)
    across = [leads_across(*pair) for pair in zip(members, each, strict=True)]
    beyond = np.concatenate([*across, *(leads_beyond(*pair) for pair in zip(members, shifts, strict=True))])
    if np.any(beyond):
        free = np.flatnonzero(~beyond)
        found, step = solved(free)
        # what lies on the other side of a sample has another slope, which the next step asks
        step[:size] -= np.where(beyond[:size], present + np.where(present < 0, -1, 1) * AT_SAMPLE, 0.0)
    cost = _cost(about, members, weighing)
    alone = slopes or np.any(beyond)
    plain = weigh(statistics.at(np.arange(size)), deviations) if alone else found
    return _Step(
        about=about,
        members=tuple(members),
        steps=np.split(step[:size], at),
        shifts=np.split(step[size:], ends),
        moved=float(np.max(np.abs(step[free]) / found.spread)),
        promised=0.5 * float(np.sum((found.factor.T @ (step[free] / found.deviations)) ** 2)),
        cost=cost,
        log=-0.5 * cost - float(np.sum(np.log(np.diag(plain.factor)))) + _allowed(members, plain.spread),
        share=1.0 if after is None else _to_and_fro(*after, step, statistics.gram),
    )


def _allowed(members: Sequence[Member], spread: Array) -> float:
    """Log probability that no coefficient (deviations (P,)) is beyond its bound, over that before anything was seen."""
    each = np.split(spread, np.cumsum([m.candidate.size for m in members])[:-1])
    return sum(
        m.candidate.allowed(m.coefficients, own, m.deviations) for m, own in zip(members, each, strict=True)
    )


def _inexact(about: Linearised, members: Sequence[Member], weighing: Weighing) -> float:
    """What the errors of the members' laws add to the evidence (log): about coefficients that fit without them, for an
    error is as large as its law, and a law that grew with it would have no size.
    """
    laws = [(m.candidate.about(m.coefficients), m.shape) for m in members]
    ends = np.cumsum([m.coefficients.size for m in members]).tolist()
    wheres = [slice(end - m.coefficients.size, end) for m, end in zip(members, ends, strict=True)]
    found = [(error_of(law), m, where) for (law, _), m, where in zip(laws, members, wheres, strict=True)]
    errors = [(error, m, where) for error, m, where in found if error is not None and np.any(m.coefficients)]
    if not errors or not finite(about.view):
        return 0.0
    present = np.concatenate([m.coefficients for m in members])
    deviations = np.concatenate([m.deviations for m in members])
    rows = about.whitened([*laws, *((error, m.shape) for error, m, _ in errors)], weighing.train)
    about.view.work.add(PRODUCT * rows.size * rows.shape[0])
    target = about.innovations(weighing.train) + present @ rows[: present.size]
    statistics = Statistics.of(rows.T, target).tempered(weighing.excess)
    exact = weigh(statistics.at(np.arange(present.size)), deviations).log_evidence
    gram = statistics.gram
    sizes = np.concatenate([deviations_of(m.coefficients, gram[at, at], e.size) for e, m, at in errors])
    logs = [weigh(statistics, np.concatenate([deviations, share * sizes])).log_evidence for share in SHARES]
    return logsumexp(np.array(logs)) - float(np.log(len(SHARES))) - exact
