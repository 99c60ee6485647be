"""How far names stand out from what has none.

Evidence takes for granted that one of the sets is true. Where none is, names that are only like the truth share what it
does, each surely. What is left to no name (curves, and what repeats of a motion share beyond any set) may point along
any name's columns: it is one sample, of an unknown size, of how far a name may be wrong, however many there are of the
noise. Of a normal error of unknown size, of which one other is seen, a gain of evidence G beyond what is left, L, is
likelier by 1 + G/L (Cauchy's distribution), not by exp G. A name that falls by this counts to what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import expit

from schwung.explain.weighing.candidate import Candidate
from schwung.explain.weighing.one_law import one_law
from schwung.explain.weighing.search import Pick, Scored, Search, Set
from schwung.innovations.evidence import block_gains, weigh

#: A law is right to this share of what it does: so much of all that is named is left, at least.
RIGHT_TO = 0.003


@dataclass(frozen=True)
class Standing:
    """What is left, as a log evidence, and how probable it is that names of the best set are no part of it."""

    left: float
    names: Mapping[str, float]  # of the best set

    def of(self, search: Search, name: str) -> float:
        """The same of any name that was visited: of one that the best set does not hold, in the best that does."""
        if name not in self.names:
            sets = [one for one in search.table.values() if name in map(search.name, one.picks)]
            best = max(sets, key=lambda one: one.log)
            pick = next(one for one in best.picks if search.name(one) == name)
            sure = _sure(search, _worth(search, best.picks, pick), self.left)
            return sure * float(expit(one_law(search, best, pick)))
        return self.names[name]

    @property
    def tempering(self) -> float:
        """How many times less evidence tells sets apart that differ along what is left."""
        return 1 + 2 * self.left


def standing(
    search: Search, best: Scored, repeated: Sequence[Candidate], law: Callable[[Search, Scored, Pick], float]
) -> Standing:
    """Of the best set's names; `repeated`: curves of what only repeats share; `law`: log odds of being one law."""
    left = sum(max(_gain(search, best, curve), 0.0) for curve in repeated)
    picks = best.picks
    for pick in picks:
        if not search.candidate(pick).named:
            left, picks = left + max(_worth(search, picks, pick), 0.0), _without(picks, pick)
    left += RIGHT_TO**2 * max(_log(search, picks) - _log(search, ()), 0.0)
    names: dict[str, float] = {}
    while picks:
        worth = {pick: _worth(search, picks, pick) for pick in picks}
        laws = {pick: law(search, search.sized(search.score(picks)), pick) for pick in picks}
        sure = {
            pick: _sure(search, gain, left + _others(search, worth, pick)) * float(expit(laws[pick]))
            for pick, gain in worth.items()
        }
        own = min(picks, key=lambda pick: laws[pick])
        if laws[own] < 0:  # it says nothing about laws
            names[search.candidate(own).name], picks = sure[own], _without(picks, own)
            continue
        weakest = min(picks, key=lambda pick: worth[pick])
        if sure[weakest] > 0.5:
            return Standing(left, {**names, **{search.candidate(p).name: sure[p] for p in picks}})
        names[search.candidate(weakest).name] = sure[weakest]
        left, picks = left + max(worth[weakest], 0.0), _without(picks, weakest)
    return Standing(left, names)


def _others(search: Search, worth: Mapping[Pick, float], pick: Pick) -> float:
    """What is left to a curve with a name by the others of the set: with no law to tell them apart, several are one."""

    def is_curve(one: Pick) -> bool:
        return len(search.candidate(one).scales) > 1

    others = (gain for other, gain in worth.items() if other != pick and is_curve(other))
    return sum((max(gain, 0.0) for gain in others), 0.0) if is_curve(pick) else 0.0


def _sure(search: Search, gain: float, left: float) -> float:
    """Probability of a name that adds so much evidence, where so much is left."""
    if gain <= 0:
        return 0.0
    counted = min(gain, float(np.log1p(gain / left))) if left > 0 else gain
    return float(expit(counted + search.odds))


def _without(picks: Set, pick: Pick) -> Set:
    return tuple(other for other in picks if other != pick)


def _worth(search: Search, picks: Set, pick: Pick) -> float:
    """Log evidence that goes with a cause from a set, its shapes and sizes weighed."""
    return _log(search, picks) - _log(search, _without(picks, pick)) - search.odds


def _log(search: Search, picks: Set) -> float:
    """Of a set, its curves in their best sizes."""
    return search.sized(search.score(picks)).log


def _gain(search: Search, best: Scored, curve: Candidate) -> float:
    """Log evidence that what only repeats share adds to a set."""
    known = weigh(search.data.at(best.which), best.deviations)
    cross, gram, slope = search.data.beside(best.which, [(curve, ())])
    across = solve_triangular(known.factor, (cross * best.deviations).T, lower=True, check_finite=False)
    beyond = (gram - across.T @ across)[None], (slope - cross @ known.coefficients)[None]
    return float(np.max(block_gains(*beyond, np.array(curve.deviations), curve.scales)))
