"""How far names stand out from what has none.

Evidence takes for granted that one of the sets is true. Where none is, names that are only like the truth share what it
does, each surely. What is left to no name (curves, and what repeats of a motion share beyond any set) may point along
any name's columns: it is one sample, of an unknown size, of how far a name may be wrong, however many there are of the
noise. Of a normal error of unknown size, of which one other is seen, a gain of evidence G beyond what is left, L, is
likelier by 1 + G/L (Cauchy's distribution), not by exp G. A name that falls by this counts to what is left, unless it
is a part of one that stands: the inertia that changes over the angle may be another one everywhere.

A curve that all motions have alike is a law that nobody has named, as surely as they have it: what has no name then is
its formula, and names stand beside it as beside any law. What one motion alone shows, or each otherwise, is left.

Beside curves, a name gains what it takes with the numbers that it has beside them: what is there for the little that a
curve could not quite do would else be taken for all that the curve does.

What is left is an error of the torque that the model foresees, and is held against what a name takes of the recording
while all that is usual keeps what it has. Whether a late speed is a defect or usual no recording tells: both take the
same of it, and what each is worth is the prior's.

A change of what is believed is a finding if it is larger than that is usually off by, however surely it is recorded:
no machine is built, and no drive timed, as exactly as a recording tells. So is one without which as much again is
missed as the noise is: that is plain to see.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import expit

from schwung.explain.causes.candidate import RIGHT_TO
from schwung.explain.weighing.one_law import law_without_name, one_law
from schwung.explain.weighing.repeated import Shared
from schwung.explain.weighing.search import Pick, Scored, Search, Set
from schwung.innovations.evidence import block_gains, weigh
from schwung.innovations.statistics import Numbers, Statistics
from schwung.motion import Array


@dataclass(frozen=True)
class Standing:
    """What is left, as a log evidence, and how probable it is that names of the best set are no part of it."""

    left: float
    unnamed: float  # of that, what is no error of the laws themselves, which is a part of them already
    names: Mapping[str, float]  # of the best set
    usual: Mapping[str, float] = field(
        default_factory=dict
    )  # of its names: that they are as much as is usual
    curves: Mapping[int, float] = field(
        default_factory=dict
    )  # log evidence of what is left to none of it, for it is a law without a name

    def of(self, search: Search, name: str) -> float:
        """The same of any name that was visited: of one that the best set does not hold, in the best that does."""
        if name not in self.names:
            sets = [one for one in search.table.values() if name in map(search.name, one.picks)]
            best = max(sets, key=lambda one: one.log)
            pick = next(one for one in best.picks if search.name(one) == name)
            worth = _worth(search, best.picks, pick)
            # what does nearly what a curve of the best set does is only like it
            instead = set(self.curves) - set(map(search.index, best.picks))
            left = self.left + sum(self.curves[curve] for curve in instead)
            sure = _sure(search, worth, max(worth, taken(search, best.picks, pick)), left)
            return sure * float(expit(one_law(search, best, pick))) * finding(search, best, pick)
        return self.names[name]

    def sure(self, search: Search, gain: float) -> float:
        """Probability of a name that adds so much evidence (log), all of it the recording's."""
        return _sure(search, gain, gain, self.left)

    @property
    def tempering(self) -> float:
        """How many times less evidence tells sets apart that differ along what is left."""
        return 1 + 2 * self.left

    @property
    def blurring(self) -> float:
        """How many times less is told of a law's numbers, beside what has no name."""
        return 1 + 2 * self.unnamed


#: Of a cause in a set.
Of = Callable[[Search, Scored, Pick], float]


def finding(search: Search, scored: Scored, pick: Pick) -> float:
    """Probability that a cause of a set is no part of what is usual: larger than that, or plain."""
    return 1.0 if is_plain(search, scored, pick) else larger_than_usual(search, scored, pick)


def is_plain(search: Search, scored: Scored, pick: Pick) -> bool:
    """Whether a set without one of its causes misses as much again as the noise is."""
    return 2 * _worth(search, scored.picks, pick) > search.data.statistics.count


def larger_than_usual(search: Search, scored: Scored, pick: Pick) -> float:
    """Probability that a cause of a set is larger than the belief is usually off by."""
    candidate, atom, found = search.candidate(pick), search.data.atoms[pick.atom], scored.found
    mine = _columns(scored, atom.where)
    if not candidate.with_usual:
        return candidate.beyond(found.coefficients[mine], found.covariance[np.ix_(mine, mine)], atom.shape)
    # all of it together, of which so much is usual as was before anything was seen
    counts = np.zeros(scored.which.size)
    counts[mine] = 1.0
    at = 0
    for index in search.always:
        usual = search.data.candidates[index]
        counts[at : at + usual.size] = candidate.with_usual.get(usual.name, 0.0)
        at += usual.size
    square = float(counts @ found.covariance @ counts) + candidate.known_to**2
    return candidate.beyond(np.maximum([counts @ found.coefficients], 0.0), np.array([[square]]), atom.shape)


def _columns(scored: Scored, where: slice) -> Numbers:
    """Which of a set's columns are an atom's."""
    return np.flatnonzero((scored.which >= where.start) & (scored.which < where.stop))


def taken(search: Search, picks: Set, pick: Pick) -> float:
    """Log evidence that goes with a cause from a set while what is usual keeps the coefficients that it has there."""
    whole, less = (search.sized(search.score(one)) for one in (picks, _without(picks, pick)))
    usual = np.arange(sum(search.data.candidates[index].size for index in search.always))
    kept = whole.found.coefficients[usual]
    return _held(search, whole, usual, kept) - _held(search, less, usual, kept)


def taken_as_told(search: Search, best: Scored, picks: Set, pick: Pick) -> float:
    """The same of a set of names alone, where the cause keeps its own as well, as they are beside the best set's
    curves."""
    whole, less = (search.sized(search.score(one)) for one in (picks, _without(picks, pick)))
    where = search.data.atoms[pick.atom].where
    usual = np.arange(sum(search.data.candidates[index].size for index in search.always))
    own, told = _columns(whole, where), best.found.coefficients[_columns(best, where)]
    kept = best.found.coefficients[usual]
    with_it = _held(search, whole, np.concatenate([usual, own]), np.concatenate([kept, told]))
    return with_it - _held(search, less, usual, kept)


def _held(search: Search, scored: Scored, fixed: Numbers, to: Array) -> float:
    """Log evidence of a set some of whose coefficients are given."""
    data = search.data.at(scored.which)
    free = np.setdiff1d(np.arange(scored.which.size), fixed)
    slope = data.slope[free] - data.gram[np.ix_(free, fixed)] @ to
    own = Statistics(data.gram[np.ix_(free, free)], slope, data.at(fixed).missed(to), data.count)
    return weigh(own, scored.deviations[free]).log_evidence


def standing(
    search: Search,
    best: Scored,
    repeated: Sequence[Shared],
    law: Of,
    larger: Of = finding,
    takes: Callable[[Search, Set, Pick], float] = taken,
    told: Callable[[Search, Scored, Set, Pick], float] = taken_as_told,
    besides: float = 0.0,
    alike: Of = law_without_name,
) -> Standing:
    """Of the best set's names; `repeated`: curves of what only repeats share; `law`: log odds of being one law;
    `larger`: probability of being no part of what is usual; `takes`: log evidence of the recording alone; `told`:
    of that, what the numbers take that it has beside what has no name; `besides`: what is left by laws that do not hold
    elsewhere; `alike`: log odds that a curve is a law, if without a name.
    """
    left = besides + sum(max(_gain(search, best, shared), 0.0) for shared in repeated)
    picks, whole = best.picks, search.sized(best)
    without_name: dict[Pick, float] = {}
    for pick in picks:
        if not search.candidate(pick).named:
            is_law, worth_of = alike(search, whole, pick), max(_worth(search, picks, pick), 0.0)
            left += float(expit(-is_law)) * worth_of
            picks = _without(picks, pick)
            without_name |= {pick: worth_of} if is_law > 0 else {}
    picks += tuple(without_name)
    curves = len(picks) < len(best.picks)
    of_laws = RIGHT_TO**2 * max(_log(search, picks) - _log(search, ()), 0.0)
    left += of_laws
    names: dict[str, float] = {}
    # beside all others: what is left out as no finding is still there, and would be taken over by what is like it
    named = [pick for pick in picks if search.candidate(pick).named]
    large = {pick: larger(search, search.sized(search.score(picks)), pick) for pick in named}
    usual = {search.candidate(pick).name: 1 - share for pick, share in large.items()}
    while named := [pick for pick in picks if search.candidate(pick).named]:
        worth = {pick: _worth(search, picks, pick) for pick in named}
        data = {pick: max(gain, takes(search, picks, pick)) for pick, gain in worth.items()}
        if curves:
            data = {pick: min(gain, max(told(search, best, picks, pick), 0.0)) for pick, gain in data.items()}
        here = search.sized(search.score(picks))
        laws = {pick: law(search, here, pick) for pick in named}
        sure = {
            pick: _sure(search, gain, data[pick], left + _others(search, worth, pick))
            * float(expit(laws[pick]))
            * large[pick]
            for pick, gain in worth.items()
        }
        own = min(named, key=lambda pick: min(laws[pick], large[pick] - 0.5))
        if laws[own] < 0 or large[own] < 0.5:  # it says nothing about laws
            names[search.candidate(own).name], picks = sure[own], _without(picks, own)
            continue
        weakest = min(named, key=lambda pick: data[pick])
        if sure[weakest] > 0.5:
            names |= {search.candidate(p).name: sure[p] for p in named}
            break
        names[search.candidate(weakest).name] = sure[weakest]
        picks = _without(picks, weakest)
        if search.candidate(weakest).part_of not in map(search.name, picks):
            left += max(worth[weakest], 0.0)
    laws_of = {search.index(pick): worth_of for pick, worth_of in without_name.items()}
    return Standing(left, left - of_laws, names, usual, laws_of)


def _others(search: Search, worth: Mapping[Pick, float], pick: Pick) -> float:
    """What is left to a curve of torque with a name by the others of the set: with no law to tell them apart, several
    are one. An inertia over the angle is none of them: it has another part in each acceleration.
    """

    def is_curve(one: Pick) -> bool:
        return len(search.candidate(one).scales) > 1 and search.candidate(one).inertia is None

    others = (gain for other, gain in worth.items() if other != pick and is_curve(other))
    return sum((max(gain, 0.0) for gain in others), 0.0) if is_curve(pick) else 0.0


def _sure(search: Search, gain: float, data: float, left: float) -> float:
    """Probability of a name that adds so much evidence, `data` of it the recording's, where so much is left."""
    if gain <= 0:
        return 0.0
    counted = min(gain, float(np.log1p(data / left))) if left > 0 else gain
    return float(expit(counted + search.odds))


def _without(picks: Set, pick: Pick) -> Set:
    return tuple(other for other in picks if other != pick)


def _worth(search: Search, picks: Set, pick: Pick) -> float:
    """Log evidence that goes with a cause from a set, its shapes and sizes weighed."""
    return (
        _log(search, picks)
        - _log(search, _without(picks, pick))
        - search.candidate(pick).causes * search.handicap
    )


def _log(search: Search, picks: Set) -> float:
    """Of a set, its curves in their best sizes."""
    return search.sized(search.score(picks)).log


def _gain(search: Search, best: Scored, shared: Shared) -> float:
    """Log evidence that what only repeats share adds to a set; 0 where none of them is fitted."""
    data, curve = search.data, shared.curve
    runs = [run for run in shared.runs if run in data.train]
    if not runs:
        return 0.0
    known = weigh(data.at(best.which), best.deviations)
    cross, gram, slope = data.beside(best.which, [(curve, ())], runs)
    across = solve_triangular(known.factor, (cross * best.deviations).T, lower=True, check_finite=False)
    beyond = (gram - across.T @ across)[None], (slope - cross @ known.coefficients)[None]
    return float(np.max(block_gains(*beyond, np.array(curve.deviations), curve.scales)))
