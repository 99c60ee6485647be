"""Sets that are offered for one at hand, with a cause more or one in another's place, and the search by such steps.

By the linear model alone: what is offered has yet to be brought to rest.
"""

from __future__ import annotations

from itertools import chain, combinations

import numpy as np

from schwung.explain.weighing.search import HOPELESS, MOST, Pick, Scored, Search, Set
from schwung.innovations.evidence import block_gains

#: The best so many candidates are looked at closely wherever one is added.
_LOOKED_AT = 3
#: So many laws are among those.
_LAWS = 2
_ROUNDS = 4
#: By so many deviations at most two numbers that hide each other may be off.
_NATURALLY = 3.0


def offered(search: Search, picks: Set, without: frozenset[int] = frozenset()) -> list[Scored]:
    """Sets of one cause more, those that promise most or that no line tells, and curves in place of their cases.

    The two laws that promise most are among them: between the shapes of its grid, and where it is no line about the
    set at hand, a law may be worth more than any curve.
    """
    offers = [o for o in search.additions(picks) if search.index(o[1]) not in without]
    rest = offers[_LOOKED_AT:]
    beyond = [o for o in rest if search.candidate(o[1]).opens][:1]
    beyond += [o for o in rest if search.candidate(o[1]).elsewhere]
    laws = [o for o in offers if search.candidate(o[1]).is_law][:_LAWS]
    beyond += [o for o in laws if o in rest and o not in beyond]
    return [
        *(search.with_pick(picks, pick) for _, pick in [*offers[:_LOOKED_AT], *beyond]),
        *_curves_instead(search, picks, without),
    ]


def _curves_instead(search: Search, picks: Set, without: frozenset[int]) -> list[Scored]:
    """Every curve of which a set holds cases, in their place."""
    found, without = [], without | search.hidden
    for index, curve in enumerate(search.data.candidates):
        others = tuple(pick for pick in picks if search.candidate(pick).name not in curve.cases)
        if len(others) < len(picks) and index not in without:
            offers = [pick for _, pick in search.additions(others, (index,))]
            found += [search.with_pick(others, pick) for pick in offers]
    return found


def laws_instead(search: Search, picks: Set) -> list[Scored]:
    """In place of each curve the law that promises most: what a curve took first may be one, once others are there
    that it took the part of.
    """
    found = []
    laws = {index for index, candidate in enumerate(search.data.candidates) if candidate.is_law}
    for curve in picks:
        if not search.candidate(curve).is_law:
            others = tuple(pick for pick in picks if pick != curve)
            found += [search.with_pick(others, pick) for _, pick in search.additions(others, laws)[:1]]
    return found


def numbers_instead(search: Search, picks: Set) -> list[Scored]:
    """In place of each number of the belief the other one that promises most: beside what was found since, it may be
    that."""
    found = []
    for pick in picks:
        if search.candidate(pick).is_number:
            others = tuple(other for other in picks if other != pick)
            instead = [search.score((*others, number)) for number in numbers_beside(search, picks)]
            found += sorted(instead, key=lambda one: -one.log)[:1]
    return found


def inertia_beside(search: Search, picks: Set) -> list[Scored]:
    """The set with a curve of inertia, where it has none."""
    curves = {i for i, c in enumerate(search.data.candidates) if c.is_inertia_curve}
    return [search.with_pick(picks, pick) for _, pick in search.additions(picks, curves)]


def numbers_beside(search: Search, picks: Set) -> list[Pick]:
    """Changes of the belief's numbers that a set does not hold."""
    inside = search.kind(picks)
    every = enumerate(search.data.candidates)
    return [Pick(search.first_atom(i), 1.0) for i, c in every if c.is_number and i not in inside]


def across_instead(search: Search, picks: Set) -> list[Scored]:
    """In place of each friction the same on the other side of the coupling."""
    asked, found = {atom.candidate for atom in search.data.atoms}, []
    for pick in picks:
        own, others = search.candidate(pick), tuple(other for other in picks if other != pick)
        for index, there in enumerate(search.data.candidates):
            alike = there.name == own.behind if own.behind else there.behind == own.name
            if alike and bool(there.behind) != bool(own.behind) and index in asked:
                found.append(search.score((*others, Pick(search.first_atom(index), 1.0))))
    return found


def numbers_together(search: Search, picks: Set) -> tuple[Set, float] | None:
    """A set with the two changes of the belief's numbers more that promise most, and what it promises (log), where they
    do together what neither does alone: of an inertia and a torque constant that are both off, either hides the other.
    None: no two do.

    Of numbers that could be naturally so far off: hardly any inertia with hardly any torque misses nothing either,
    whatever was left out.
    """
    beside = numbers_beside(search, picks)
    if len(beside) < 2:
        return None
    beyond, without = search.data.beyond(*search.columns(picks)), search.score(picks).log
    columns = np.array([search.data.atoms[pick.atom].where.start for pick in beside])
    sizes = np.array([search.candidate(pick).deviations[0] for pick in beside])
    own = search.data.at(columns).gram
    across = beyond.across[:, columns]
    gram, slope = (own - across.T @ across) * np.outer(sizes, sizes), beyond.slope[columns] * sizes
    ones, pairs = np.ones(2), np.array(list(combinations(range(len(beside)), 2)))
    alone = block_gains(np.diagonal(gram)[:, None, None], slope[:, None], ones[:1], [1.0])[:, 0]
    blocks = gram[pairs[:, :, None], pairs[:, None, :]]
    both = block_gains(blocks, slope[pairs], ones, [1.0])[:, 0] + 2 * search.handicap
    more = both - np.sum(np.maximum(alone[pairs] + search.handicap, 0.0), axis=1)
    known = np.linalg.inv(blocks + np.eye(2))
    off, spread = (known @ slope[pairs][:, :, None])[:, :, 0], np.sqrt(np.diagonal(known, axis1=1, axis2=2))
    best: tuple[Set, float] | None = None
    for where in np.flatnonzero((more > 0) & np.all(np.abs(off) < _NATURALLY, axis=1)).tolist():
        promised = without + float(both[where])
        for place, each, unsure in zip(pairs[where], off[where], spread[where], strict=True):
            size = sizes[place : place + 1]
            promised += search.candidate(beside[place]).allowed(each * size, unsure * size, size)
        if best is None or promised > best[1]:
            one, other = pairs[where]
            best = (*picks, beside[one], beside[other]), promised
    return best


def coupling_instead(search: Search, picks: Set, least: int = 2) -> Scored | None:
    """A coupling that is a curve in place of several causes that are laws by which motor and load give way to each
    other, or that have no name beside one; None where there are none. `least`: so many of them."""
    every = [(pick, search.candidate(pick)) for pick in picks]
    laws = [pick for pick, cause in every if cause.yields]
    instead = {pick for pick, cause in every if cause.yields or not cause.named}
    curves = {i for i, c in enumerate(search.data.candidates) if c.instead_of_laws}
    if not laws or len(instead) < least or any(cause.instead_of_laws for _, cause in every):
        return None
    others = tuple(pick for pick in picks if pick not in instead)
    return next((search.with_pick(others, pick) for _, pick in search.additions(others, curves)), None)


def limits_instead(search: Search, picks: Set) -> list[Scored]:
    """In place of each cause what it is in its limit."""
    found = []
    for pick in picks:
        name, own = search.candidate(pick).limit, search.index(pick)
        among = {i for i, c in enumerate(search.data.candidates) if c.name == name and i != own}
        others = tuple(other for other in picks if other != pick)
        offers = search.additions(others, among) if among else []
        found += [search.with_pick(others, one) for _, one in offers]
    return found


def bending_instead(search: Search, picks: Set) -> list[Scored]:
    """In place of the last, if it bends the coupling, each other law that does, and what it is in its limit."""
    last = search.candidate(picks[-1]) if picks else None
    if last is None or last.tangent is None:
        return []
    others, inside, found = picks[:-1], search.kind(picks), []
    for index, candidate in enumerate(search.data.candidates):
        bends = candidate.named and candidate.tangent is not None
        if (bends or candidate.name == last.limit) and index not in inside:
            found += [search.with_pick(others, pick) for _, pick in search.additions(others, {index})[:1]]
    return found


def searched(search: Search, start: Set) -> Scored:
    """Search from a set; then drop and exchange until nothing is better. What comes of a set without one of its causes
    is not asked again for other shapes of the same."""
    best = _added(search, search.score(start))
    dropped: set[tuple[frozenset[int], int]] = set()
    for _ in range(_ROUNDS):
        before = best.log
        for pick in best.picks:
            others = tuple(other for other in best.picks if other != pick)
            asked = search.kind(others), search.index(pick)
            if asked in dropped or search.data.work.spent:
                continue
            dropped.add(asked)
            less = search.sized(search.score(others))
            best = max(best, less, _added(search, less, frozenset({search.index(pick)})), key=lambda s: s.log)
        for place, pick in enumerate(best.picks):
            if search.candidate(pick).spacing and not search.data.work.spent:
                best = search.shaped(best, place)
        if search.data.work.spent:
            break
        if best.log > before:
            continue
        _neighbours(search, best)
        best = max(search.table.values(), key=lambda scored: scored.log)
        if best.log <= before:
            break
    return best


def _added(search: Search, start: Scored, without: frozenset[int] = frozenset()) -> Scored:
    """Grow a set for as long as that makes it more probable."""
    best = start
    for _ in range(MOST - len(start.picks)):
        if search.data.work.spent:
            break
        top = max(offered(search, best.picks, without), key=lambda scored: scored.log, default=best)
        if top.log <= best.log:
            break
        best = top
    return best


def _neighbours(search: Search, best: Scored) -> None:
    """Whatever is one step away is in the table, too: one cause more, or one in the place of another or of two, for
    what two do together may be what one does."""
    for gain, pick in search.additions(best.picks)[: 2 * _LOOKED_AT]:
        if gain > -HOPELESS and not search.data.work.spent:
            search.with_pick(best.picks, pick)
    for left in chain(combinations(best.picks, 1), combinations(best.picks, 2)):
        if search.data.work.spent:
            break
        _instead(search, best, left)


def instead_of_each(search: Search, best: Scored) -> None:
    """Whatever may be in the place of one is in the table, whether or not the work is over: that is soon done."""
    for left in combinations(best.picks, 1):
        _instead(search, best, left)


def _instead(search: Search, best: Scored, left: Set) -> None:
    """One in the place of some."""
    others = tuple(other for other in best.picks if other not in left)
    less = search.score(others)
    for gain, instead in search.additions(others)[: 2 * _LOOKED_AT]:
        if less.log + gain > best.log - HOPELESS:
            search.with_pick(others, instead)
