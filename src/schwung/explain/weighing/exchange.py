"""Sets that stand in the place of one at rest, each brought to rest itself: one cause for another, or one less."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schwung.compiled import IS_FAST
from schwung.explain.causes.present import Member
from schwung.explain.weighing.offers import bending_instead, coupling_instead, numbers_beside
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.search import MOST, TOLD, Scored, Search
from schwung.explain.weighing.sets import begun_from, is_unnamed, members_of, timed, without_damping
from schwung.explain.weighing.settling import Settled, settled, settled_beyond, smoothed

#: Sets that are brought to rest before another round.
_TRIED = 3
#: Causes, and what lost in their place more than all else could gain: beside more it is not asked again.
Worse = tuple[frozenset[int], int]


def exchanged(
    rests: Rests, search: Search, start: Scored, at: Settled, most: int = MOST
) -> tuple[Scored, Settled] | None:
    """What is more probable at rest than the set at hand, as it is with another late cause, as any set that was
    visited of so many causes at `most`, or without one of its names; None where nothing is."""
    return (
        _timed(rests, search, start, at)
        or _instead(rests, search, start, at, most)
        or _fewer(rests, search, start, at)
    )


def numbers_exchanged(
    rests: Rests, search: Search, start: Scored, at: Settled, worse: set[Worse]
) -> tuple[Scored, Settled]:
    """The set, or with another number of the belief in place of one that is further off than is natural, where that
    is likelier at rest: so far off, no line says which of them it is.

    `worse`: see `Worse`.
    """
    best, top = (start, at), 0.0
    for pick, member in zip(start.picks, at.members[len(at.members) - len(start.picks) :], strict=True):
        if not member.candidate.is_number or np.all(np.abs(member.coefficients) <= member.deviations):
            continue
        others = tuple(other for other in start.picks if other != pick)
        for instead in numbers_beside(search, start.picks):
            one = search.score((*others, instead))
            exchange = frozenset({search.index(pick)}), search.index(instead)
            if exchange in worse or search.kind(one.picks) in rests.rested or search.data.work.spent:
                continue
            begun = [
                without_damping(m) for m in begun_from(at.members, members_of(search, one, rests.candidates))
            ]
            least = rests.least(search, one, start, at) + top
            tried = settled(at.about.view, begun, rests.weighing, least)
            tried, gain = rests.noted(search, one, start, at, tried)
            if _loses_all(rests, at, gain):
                worse.add(exchange)
            if gain > top:
                best, top = (one, tried), gain
    return best


def bent_otherwise(rests: Rests, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled]:
    """The set, or with another law by which its coupling bends in place of the one that was found last, where that is
    likelier at rest: a law that yields takes some of what one takes that stiffens, and beside it there is no room."""
    best, top = (start, at), 0.0
    for one in bending_instead(search, start.picks):
        if search.kind(one.picks) in rests.rested or search.data.work.spent:
            continue
        tried, gain = rests.rest(search, one, start, at, top)
        if gain > top:
            best, top = (one, tried), gain
    return best


def _timed(rests: Rests, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
    """The set with another late cause, or with one where what is usual is further off than a name costs; where that
    is more probable at rest.

    To first order all of them say the same, and where little is noise no line about the one leads to another.
    """
    others = tuple(pick for pick in start.picks if not any(search.candidate(pick).late))
    apart = [m for m in at.members if any(m.candidate.late) and not all(m.candidate.late)]
    off = sum(0.5 * float((m.coefficients[0] / m.deviations[0]) ** 2) for m in apart)
    if len(start.picks) - len(others) > 1 or (len(others) == len(start.picks) and off < -search.handicap):
        return None
    for index, candidate in enumerate(rests.candidates):
        kind = search.kind(others) | {index}
        begun = timed(at.members, candidate) if candidate.named and any(candidate.late) else None
        if begun is None or kind in rests.timed or kind == search.kind(start.picks) or search.data.work.spent:
            continue
        rests.timed.add(kind)
        tried = settled(at.about.view, begun, rests.weighing)
        one = search.score((*others, search.nearest(index, tried.members[-1].shape)))
        tried, gain = rests.noted(search, one, start, at, tried)
        if gain > 0:
            return one, tried
        former = search.kept.get(kind, -np.inf)
        search.note(kind, start.log + gain, one.log)
        search.kept[kind] = max(former, search.kept[kind])
    return None


def play_instead(
    rests: Rests, search: Search, start: Scored, at: Settled, worse: set[Worse]
) -> tuple[Scored, Settled] | None:
    """Play in place of all else by which motor and load give way to each other, where that is likelier at rest:
    together those may do what play does, and beside them there is no room for it. `worse`: see `Worse`."""
    others = tuple(pick for pick in start.picks if not search.candidate(pick).yields)
    play = search.opening() if IS_FAST else None
    if (
        play is None
        or len(others) == len(start.picks)
        or any(search.candidate(pick).opens for pick in start.picks)
    ):
        return None
    one = search.score((*others, play))
    exchange = search.kind(start.picks) - search.kind(others), search.index(play)
    if exchange in worse or search.kind(one.picks) in rests.rested or search.data.work.spent:
        return None
    members = begun_from(at.members, members_of(search, one, rests.candidates))
    about = smoothed(at.about.view, members, rests.weighing)
    still = [m.coefficients for m in members]
    least = rests.least(search, one, start, at)
    tried = settled_beyond(about, members, still, rests.weighing, least)
    tried, gain = rests.noted(search, one, start, at, tried)
    if gain > 0:
        return one, tried
    if _loses_all(rests, at, gain):
        worse.add(exchange)
    search.note(search.kind(one.picks), start.log + gain, one.log)
    return None


def may_bend(rests: Rests, search: Search, start: Scored, at: Settled) -> bool:
    """Whether there is anything in whose place `curve_instead` or `curve_alone` may be."""
    least = 1 if _misses_plainly(rests, at) else 2
    return coupling_instead(search, start.picks, least) is not None


def curve_instead(rests: Rests, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
    """A coupling that is a curve in place of several causes that together do what it does (`coupling_instead`), where
    that is likelier at rest."""
    one = coupling_instead(search, start.picks, 1 if _misses_plainly(rests, at) else 2)
    if one is None or search.kind(one.picks) in rests.rested:
        return None
    tried, gain = rests.rest(search, one, start, at)
    if gain <= 0:  # where all that it stands for is gone, a line from there may lead to no machine
        begun = begun_from(at.members, members_of(search, one, rests.candidates))
        tried, gain = rests.noted(search, one, start, at, settled(at.about.view, begun, rests.weighing))
    if gain > 0:
        return one, tried
    search.note(search.kind(one.picks), start.log + gain, one.log)
    return None


def curve_alone(
    rests: Rests,
    search: Search,
    start: Scored,
    at: Settled,
    believed: Sequence[Member],
    *,
    bends: bool = False,
) -> tuple[Scored, Settled] | None:
    """The same in place of all that was found, at rest from the belief on, where something of it has no name or is
    plainly missed, or it `bends`, as is known by then: what was found beside laws that no coupling has makes up for
    what they do wrong, and a curve beside it ends there."""
    plainly = _misses_plainly(rests, at)
    bent = coupling_instead(search, start.picks, 1 if plainly else 2)
    if bent is None or not (bends or plainly or is_unnamed(search, start)) or search.data.work.spent:
        return None
    one = search.score(bent.picks[-1:])
    begun = begun_from(believed, members_of(search, one, rests.candidates))
    tried, gain = rests.noted(search, one, start, at, settled(at.about.view, begun, rests.weighing))
    search.note(search.kind(one.picks), start.log + gain, one.log)
    return (one, tried) if np.isfinite(gain) else None


def resized(rests: Rests, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled]:
    """The set at rest with its curves as large as the evidence has them there: else whatever is asked beside them would
    have what that gains."""
    one = search.sized(start)
    if one.picks == start.picks:
        return start, at
    tried, gain = rests.rest(search, one, start, at)
    return (one, tried) if gain > 0 else (start, at)


def _misses_plainly(rests: Rests, at: Settled) -> bool:
    """Whether a set misses as much again as the noise is."""
    return at.about.square(rests.train) > 2 * at.about.samples(rests.train)


def _loses_all(rests: Rests, at: Settled, gain: float) -> bool:
    """Whether an exchange loses more (log) than all else could gain: what is left is not worth as much.

    One that came to an end of its range (gain of minus infinity) lost nothing that was measured: with more beside it,
    it may not end there.
    """
    return np.isfinite(gain) and -gain > at.about.square(rests.train) / (2 * rests.wide.excess)


def _fewer(rests: Rests, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
    """The set without one of its names, where that is more probable at rest.

    A name is as sure as its set is likelier at rest than without it, whatever a line says of that.
    """
    for pick in start.picks:
        others = search.score(tuple(other for other in start.picks if other != pick))
        known = search.kind(others.picks) in rests.rested or not search.candidate(pick).named
        if known or search.data.work.spent:
            continue
        tried, gain = rests.rest(search, others, start, at)
        if gain > 0:
            return others, tried
    return None


def _instead(
    rests: Rests, search: Search, start: Scored, at: Settled, most: int
) -> tuple[Scored, Settled] | None:
    """A visited set that is more probable than the one at hand at rest, too; what was only promised is noted, of
    all that promise to be worth telling.
    """
    for _ in range(_TRIED):
        if search.data.work.spent:
            break
        visited = [(kind, one) for kind, one in search.table.items() if len(one.picks) <= most]
        rivals = [(one.log + search.unkept(kind), one) for kind, one in visited]
        untried = [
            pair for pair in rivals if search.kind(pair[1].picks) not in {search.resting, *search.kept}
        ]
        promised, one = max(untried, key=lambda pair: pair[0], default=(-np.inf, start))
        if promised <= start.log + np.log(TOLD):
            break
        gain = search.asked.get(frozenset(one.picks), np.inf)
        if gain > 0:
            tried, gain = rests.rest(search, one, start, at)
        if gain > 0:
            return one, tried
        search.note(search.kind(one.picks), start.log + gain, one.log)
    return None
