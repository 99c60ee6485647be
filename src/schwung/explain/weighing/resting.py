"""Sets of causes brought to rest about one noise, and what each kind of them was worth there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from schwung.explain.causes.candidate import RIGHT_TO, Candidate
from schwung.explain.causes.present import Member, moves
from schwung.explain.weighing.alike import goes_otherwise, misses_less
from schwung.explain.weighing.balance import balanced
from schwung.explain.weighing.round import FAR, Linearised, View, few_of
from schwung.explain.weighing.search import HOPELESS, Scored, Search
from schwung.explain.weighing.sets import Shaped, begun_from, carried, is_unnamed, kept, key_of, members_of
from schwung.explain.weighing.settling import Settled, Weighing, settled, settled_beyond, settled_elsewhere
from schwung.explain.weighing.wide import Wide


@dataclass(eq=False)
class Rests:
    """Of one session's, or of a few of its runs."""

    candidates: Sequence[Candidate]
    train: Sequence[int]
    wide: Wide
    #: What makes up for laws that are a little off may be worth so much (log): no cause is told that is worth less.
    inexact: float = 0.0
    #: Kinds of sets that came to rest: their best shapes and sizes, and log probability.
    rested: dict[frozenset[int], tuple[Shaped, float]] = field(default_factory=dict)
    #: What a cause with a name gained most (log) beside such kinds of sets.
    named: dict[frozenset[int], float] = field(default_factory=dict)
    #: Kinds of sets whose late cause was begun where what is usual says.
    timed: set[frozenset[int]] = field(default_factory=set)

    def afresh(self) -> Rests:
        """Before anything came to rest."""
        return replace(self, rested={}, named={}, timed=set())

    def of_few(self) -> Rests:
        """In a few of its runs."""
        return replace(self.afresh(), train=few_of(self.train))

    def about(self, wide: Wide) -> Rests:
        """About another noise: sets are compared about one and the same, so that none has been at rest about it."""
        return replace(self.afresh(), wide=wide)

    def beside(self, belief: Linearised) -> Rests:
        """The same, knowing what the belief misses: a law is right to `RIGHT_TO` of what it does, and so is all that a
        set does."""
        missed = belief.square(self.train) - belief.samples(self.train)
        return replace(self, inexact=RIGHT_TO**2 * max(missed, 0.0) / (2 * self.wide.excess))

    @property
    def weighing(self) -> Weighing:
        """What sets are weighed by."""
        return Weighing(self.wide.noise, self.train, self.wide.excess)

    def settled(self, view: View, members: Sequence[Member]) -> Settled:
        """Any members at rest."""
        return settled(self.wide.seen(view), members, self.weighing)

    def rest(
        self,
        search: Search,
        one: Scored,
        start: Scored,
        at: Settled,
        least: float = 0.0,
        *,
        everywhere: bool = True,
    ) -> tuple[Settled, float]:
        """A set at rest, and how much more probable it is there (log) than the one at hand; where that is not more than
        `least`, or it is not looked for `everywhere`, perhaps not where it is most probable."""
        members = members_of(search, one, self.candidates)
        to_exceed = self.least(search, one, start, at) + least
        if {key_of(m) for m in at.members} <= {key_of(m) for m in members}:
            promised, begun = [m.coefficients for m in members], begun_from(at.members, members)
            tried = settled_beyond(at.about, begun, promised, self.weighing, to_exceed)
            if members[-1].candidate.is_inertia_curve and self.misses(at):
                tried = self._balanced(at, begun, tried)
            far = everywhere and members[-1].candidate.elsewhere
            if far and key_of(members[-1]) not in {key_of(m) for m in at.members}:
                starts = [
                    replace(begun[-1], coefficients=np.array([value]))
                    for value in members[-1].candidate.elsewhere
                ]
                other = settled_elsewhere(at, begun[:-1], starts, self.weighing, few_of(self.train), least)
                tried = tried if other is None or other.log < tried.log else other
        else:
            tried = settled(at.about.view, members, self.weighing, to_exceed)
        return self.noted(search, one, start, at, tried)

    def in_each_shape(
        self, search: Search, one: Scored, start: Scored, at: Settled, least: float
    ) -> tuple[Scored, Settled, float] | None:
        """A set whose last cause bends the coupling, begun in every shape of it, at rest as above where it gains more
        than `least`: where much more than noise is missed, a line takes a multiple of the order for it. It is looked
        for in the run that misses most."""
        *others, last = begun_from(at.members, members_of(search, one, self.candidates))
        starts = [
            replace(last, shape=shape, coefficients=0 * last.coefficients) for shape in last.candidate.shapes
        ]
        least_log = self.least(search, one, start, at) + least - at.log
        most = max(few_of(self.train), key=lambda run: at.about.square([run]) / at.about.samples([run]))
        tried = settled_elsewhere(at, others, starts, self.weighing, [most], least_log)
        if tried is None:
            return None
        one = search.score(
            (*one.picks[:-1], search.nearest(search.index(one.picks[-1]), tried.members[-1].shape))
        )
        tried, gain = self.noted(search, one, start, at, tried)
        return (one, tried, gain) if gain > least else None

    def _balanced(self, at: Settled, begun: Sequence[Member], tried: Settled) -> Settled:
        """A curve of inertia that came to rest, or the same begun where a balance of torque leads, if that is likelier:
        so far off, no line leads there."""
        told = balanced(at.about, at.members, begun[-1], self.train)
        start = [*begun[:-1], replace(begun[-1], coefficients=told)]
        if not moves(at.about.view.known.machine, start, at.about.view.ranges):
            return tried
        found = settled(at.about.view, start, self.weighing)
        return found if found.log > tried.log else tried

    def misses(self, at: Settled) -> bool:
        """Whether a set misses more than its noise is: then what is missed is no line about it."""
        return bool(at.about.square(self.train) > FAR**2 * at.about.samples(self.train))

    def leaves(self, at: Settled) -> bool:
        """Whether a set misses more than noise does by chance (two standard deviations)."""
        samples = at.about.samples(self.train)
        return at.about.square(self.train) > samples + 2 * float(np.sqrt(2 * samples))

    def least(self, search: Search, one: Scored, start: Scored, at: Settled) -> float:
        """What a set has to be at rest to be as probable as the one at hand (log)."""
        return at.log + search.prior(start.picks) - search.prior(one.picks)

    def by_chance(self, one: Settled, other: Settled) -> float:
        """How much more evidence one set at rest has than another (log) by the noise of the torque alone; nothing where
        one of them misses more than noise."""
        if not np.isfinite(one.log) or self.leaves(one) or self.leaves(other):
            return 0.0
        plain = other.about.square(self.train) - one.about.square(self.train)
        return (plain - misses_less(one.about, other.about, self.train)) / (2 * self.wide.excess)

    def alike(self, search: Search, best: Scored, at: Settled) -> tuple[Scored, Settled, float]:
        """The likeliest of all that came to rest about as likely, but for what each owes to chance, and how probable it
        is so (log): until then sets are compared with what they miss of the torque's noise."""
        here = at.log + search.prior(best.picks)
        if self.leaves(at) or not goes_otherwise(at.about):
            return best, at, here
        found, top = (best, at), 0.0
        for kind, (_, log) in sorted(self.rested.items(), key=lambda item: -item[1][1]):
            if kind == search.kind(best.picks) or np.isneginf(log) or search.data.work.spent:
                continue  # what ended at a bound of its shapes ends there again
            one = search.score(carried(search.data, self.rested[kind][0]))
            if max(log - here, one.log - best.log) < -HOPELESS:
                continue
            tried, gain = self.rest(search, one, best, at, -HOPELESS, everywhere=False)
            chance = self.by_chance(tried, at)
            picks, at_rest = self.rested[kind]
            self.rested[kind] = picks, at_rest - chance
            if gain - chance > top:
                found, top = (one, tried), gain - chance
        self.rested[search.kind(best.picks)] = kept(search, best, at), here
        return (*found, here + top)

    def noted(
        self, search: Search, one: Scored, start: Scored, at: Settled, tried: Settled
    ) -> tuple[Settled, float]:
        """Of a set that was brought to rest the same; it is kept in mind where it is the best of its kind."""
        if any(m.candidate.at_end(m.shape, m.coefficients) for m in tried.members):
            tried = replace(tried, log=-np.inf)  # it stands for what is none of its shapes
        kind, log = search.kind(one.picks), tried.log + search.prior(one.picks)
        if kind not in self.rested or self.rested[kind][1] < log:
            self.rested[kind] = kept(search, one, tried), log
        return tried, tried.log + search.prior(one.picks) - at.log - search.prior(start.picks)

    def note_named(self, search: Search, start: Scored, one: Scored, gain: float) -> None:
        """Keep in mind what a set gained on the one that it was made of, where all of it has a name."""
        if not is_unnamed(search, one):
            kind = search.kind(start.picks)
            self.named[kind] = max(gain, self.named.get(kind, 0.0))

    def recall(self, search: Search, best: Scored, here: float) -> None:
        """Weigh sets that were at rest by what they were worth there: about another set, a linear model may show little
        of it, and of two that explain the same the last would have all."""
        for kind, (picks, log) in self.rested.items():
            promised = search.table.get(kind)
            if promised is None and log - here > -HOPELESS:
                promised = search.score(carried(search.data, picks))
            if promised is not None and kind != search.kind(best.picks):
                search.note(kind, log - here, promised.log - best.log)
