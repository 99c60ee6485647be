"""What is asked about a set at rest: one cause more, or one in place of another, each brought to rest itself."""

from __future__ import annotations

import numpy as np

from schwung.compiled import IS_FAST
from schwung.explain.weighing.offers import (
    across_instead,
    inertia_beside,
    laws_instead,
    limits_instead,
    numbers_instead,
    numbers_together,
    offered,
)
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.search import HOPELESS, MOST, Scored, Search
from schwung.explain.weighing.sets import is_unnamed
from schwung.explain.weighing.settling import Settled

#: Sets that are brought to rest each round; so many of one law more among them, or beside them.
_TRIED, _LAWS_TRIED = 3, 2


def further(
    rests: Rests, search: Search, start: Scored, at: Settled, gained: dict[int, float]
) -> tuple[Scored, Settled] | None:
    """The best set of one cause more, or of a law in place of a curve, at rest; None where none is more probable
    than the one at hand.
    """
    if len(start.picks) >= MOST:
        return None
    rests.named.setdefault(search.kind(start.picks), 0.0)
    best, top = _in_place(rests, search, start, at)
    if top > HOPELESS:
        return best
    lines, beyond = _asked(rests, search, start, at)
    # a number of the belief costs least, and what is hopeless beside it costs little
    numbers = [one for one in lines if search.candidate(one.picks[-1]).is_number]
    asked = list(dict.fromkeys((*numbers, *(one for one in lines if one not in beyond), *beyond)))
    for one in asked:
        last = gained.get(search.index(one.picks[-1]), np.inf) if one in beyond else np.inf
        # what a cause takes beside more is seldom more: it is not asked again for less than there is already
        fruitless = best is not None and last <= top
        # nor is what no line leads to, where something leaves but noise
        nothing_left = best is not None and one in beyond and not rests.leaves(best[1])
        if nothing_left or (
            best is not None and ((fruitless and one not in lines) or search.data.work.spent)
        ):
            continue
        everywhere = one in beyond and not fruitless
        tried, gain = rests.rest(search, one, start, at, top, everywhere=everywhere)
        if everywhere:
            gained[search.index(one.picks[-1])] = gain
        if everywhere or one not in beyond:
            search.asked[frozenset(one.picks)] = gain
        rests.note_named(search, start, one, gain)
        if np.isneginf(gain):  # what came to its end is what it is in its limit
            asked += [limit for limit in limits_instead(search, one.picks) if limit not in asked]
        if gain > top:
            best, top = (one, tried), gain
    if best is None or not rests.misses(at) or not rests.leaves(best[1]):
        return best
    for one in lines:
        if search.candidate(one.picks[-1]).bends_by_shape and not search.data.work.spent:
            found = rests.in_each_shape(search, one, start, at, top)
            if found is not None:
                best, top = (found[0], found[1]), found[2]
    return best


def _asked(
    rests: Rests, search: Search, start: Scored, at: Settled
) -> tuple[dict[Scored, None], list[Scored]]:
    """Sets of one cause more, or of a law in place of a curve, that are brought to rest: those that a line promises
    something of, and those that no line leads to."""
    offers = sorted(offered(search, start.picks), key=lambda one: -one.log)
    likelier = [one for one in offers if one.log > start.log]
    # what one motion has of its own could be anything: first all that another motion would show as well
    shared = [one for one in likelier if not search.candidate(one.picks[-1]).of_motion]
    likelier = shared or likelier
    # of much that is missed any curve promises more than a law keeps
    laws = [one for one in likelier if search.candidate(one.picks[-1]).is_law][:_LAWS_TRIED]
    promising = [*likelier[:_TRIED], *laws]
    # of a rigid machine the inertia and the torque's scale are the same but for what is missed; beside a curve two
    # numbers do what that lacks
    rigid = at.about.view.runs[0].rigid
    together = None if rigid or is_unnamed(search, start) else numbers_together(search, start.picks)
    if together is not None and all(together[1] > one.log for one in (start, *likelier)):
        promising.append(search.score(together[0]))
    # without numba a gap costs a hundred times as much: there a line has to promise something
    opening = [one for one in offers if IS_FAST and search.candidate(one.picks[-1]).opens][:1]
    # what is far off is missed by something else as well: where no line promises anything, nothing is
    elsewhere = [one for one in offers if search.candidate(one.picks[-1]).elsewhere and promising]
    if not rests.misses(at):  # what little of the coupling bends about such a set, a line leads to
        elsewhere = [one for one in elsewhere if search.candidate(one.picks[-1]).tangent is None]
    beside = laws_instead(search, start.picks)
    if rests.misses(at):  # of a load that is unknown, anything that is missed is a line
        beside += inertia_beside(search, start.picks)
    lines = dict.fromkeys((*promising, *(one for one in beside if one.log > start.log)))
    beyond = [*(one for one in opening if one not in lines), *elsewhere]
    return lines, beyond


def _in_place(
    rests: Rests, search: Search, start: Scored, at: Settled
) -> tuple[tuple[Scored, Settled] | None, float]:
    """A number of the belief in place of another, or of a cause what it is in its limit, at rest, and what that
    gains (log): it needs no cause more, so that where it is much, it comes before all that do. Where more than noise is
    left, friction on the other side of the coupling, too: of what rings in a gap no line says on which it is."""
    best, top = None, 0.0
    lines = [*numbers_instead(search, start.picks), *limits_instead(search, start.picks)]
    across = across_instead(search, start.picks) if rests.leaves(at) else []
    across = [one for one in across if search.kind(one.picks) not in rests.rested]
    for one in (*across, *(one for one in lines if one.log > start.log)):
        if search.data.work.spent:
            break
        tried, gain = rests.rest(search, one, start, at, top)
        search.asked[frozenset(one.picks)] = gain
        if gain > top:
            best, top = (one, tried), gain
    return best, top
