"""Sets of causes grown one cause at a time, everything linearised anew about each.

The few that promise most by the linear model are each brought to rest, and their evidence there decides: of twenty
floors of a wrong stiffness a late torque explains, to first order, more than the stiffness does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from schwung.compiled import IS_FAST
from schwung.explain.weighing.candidate import Candidate
from schwung.explain.weighing.data import Data
from schwung.explain.weighing.round import View, few_of
from schwung.explain.weighing.search import HOPELESS, MOST, Scored, Search
from schwung.explain.weighing.sets import (
    Shaped,
    absent,
    begun_from,
    carried,
    everything,
    is_unnamed,
    kept,
    key_of,
    members_of,
)
from schwung.explain.weighing.settling import (
    Settled,
    Weighing,
    own_noise,
    settled,
    settled_beyond,
    settled_elsewhere,
)
from schwung.explain.weighing.wide import Wide, wide_fit
from schwung.motion import Array

#: How far off the noise may be, once it was found (log).
KNOWN = 0.3
#: Told what is being done, and the share that is done.
Progress = Callable[[str, float], None]
#: The share of the work that the noise takes, and what of the rest is left after each round.
NOISE_SHARE, _FURTHER = 0.2, 0.7

#: Of the work, what all causes may take in a few runs, and in all before laws alone are tried; and what those may take
#: beside it, in a few runs and then in all.
_FEW, _FIRST, _COARSE, _LAWS = 0.3, 0.5, 0.3, 0.3
#: Sets that are brought to rest each round; so many of one law more among them, or beside them.
_TRIED, _LAWS_TRIED = 3, 2


@dataclass(frozen=True, eq=False)
class Grown:
    """The most probable set and all that were visited, linearised about it."""

    data: Data
    search: Search
    best: Scored
    nothing: Settled  # the belief with what is always there


@dataclass(frozen=True, eq=False)
class _Climbed:
    """A set at rest, and all that were visited about it."""

    search: Search
    best: Scored
    at: Settled
    halfway: bool = False  # whether it was left for laws alone to be tried first

    @property
    def log(self) -> float:
        """How probable it is, among sets about one and the same noise in the same runs."""
        return self.at.log + self.search.prior(self.best.picks)

    @property
    def picks(self) -> Shaped:
        """The set's, in the shapes that they have come to rest in."""
        return kept(self.search, self.best, self.at)


@dataclass(eq=False)
class Growth:
    """One session's."""

    candidates: Sequence[Candidate]
    always: tuple[int, ...]  # candidates that are in every set
    train: Sequence[int]
    wide: Wide
    memory: Array | None = None
    rounds: int = 0  # of linearising, up to now
    among: frozenset[int] | None = None  # candidates that are looked at; None: all
    unrepeated: bool = False  # whether no run repeats another: then noise is what a set leaves
    coarse: bool = False  # whether these are a few runs, by which no noise can be told
    looked: bool = (
        False  # whether a few runs were looked at: what no line leads to was tried beside each of their sets
    )
    rival: float | None = None  # log probability, about the noise at hand, of what these causes stand in for
    tell: Progress = lambda _text, _share: None
    #: Kinds of sets that came to rest about the noise as it is known: their best shapes and sizes, and log probability.
    rested: dict[frozenset[int], tuple[Shaped, float]] = field(default_factory=dict)

    def grown(self, view: View) -> Grown:
        """From nothing but what is always there, or from what a few runs are made of, where that is likelier in all."""
        first = self.wide
        nothing = self._nothing(view)
        with view.work.within(_FEW):
            few = self._by_few(view)
        if few is not None and few.log > nothing.log:
            few = replace(few, at=self._renewed(few.at))
            climbed = self._climbed(few.at, few.picks, _FIRST, fresh=True)
        else:
            climbed = self._climbed(nothing, (), _FIRST)
        if is_unnamed(climbed.search, climbed.best):
            climbed = self._by_laws(view, climbed)
        search, best, at = climbed.search, climbed.best, climbed.at
        self._recall(search, best, at)
        if self.wide is not first:
            nothing = self._nothing(view)
        return Grown(search.data, search, best, nothing)

    def _nothing(self, view: View) -> Settled:
        """The belief with what is always there."""
        always = [absent(self.candidates[i]) for i in self.always]
        return settled(self.wide.seen(view), always, self._weighing)

    def _climbed(self, at: Settled, picks: Shaped, until: float = np.inf, *, fresh: bool = False) -> _Climbed:
        """From a set at rest, by one cause more at a time; then by what may stand in its place. Where something
        has no name after the share `until` of the work, it is left halfway: laws alone are tried then. `fresh`: whether
        the noise was looked at since something was found.
        """
        growing = True
        while True:  # each round is likelier than the one before, or the last but for a look at the noise
            self.rounds += 1
            share = NOISE_SHARE + (1 - NOISE_SHARE) * (1 - _FURTHER ** (self.rounds - 1))
            self.tell(f"Weighing causes beside {len(picks)} found" if picks else "Weighing causes", share)
            search = self._search(at)
            start = search.score(carried(search.data, picks))
            if search.data.work.spent:
                return _Climbed(search, start, at)
            if search.data.work.share > until:
                if is_unnamed(search, start):
                    return _Climbed(search, start, at, halfway=True)
                until = np.inf  # there is nothing that laws alone would stand for
            if growing:
                taken = self._further(search, start, at)
                if taken is not None:
                    start, at = taken
                    picks, fresh = kept(search, start, at), False
                    shared = not search.candidate(start.picks[-1]).each_run
                    if shared or self.coarse or at.about.view.ranges.one_motion:
                        continue
                    # it was noise, for repeats do not share it; where all repeat one motion, nothing else tells noise
                if self._is_hopeless(search, start, at):
                    return _Climbed(search, start, at)
                if not fresh and not self.coarse:
                    at, fresh = self._renewed(at), True
                    picks = kept(search, start, at)
                    continue
                growing = False
            search.best(start.picks)
            taken = self._instead(search, start, at) or self._fewer(search, start, at)
            if taken is None:
                return _Climbed(search, start, at)
            best, at = taken
            picks = kept(search, best, at)

    def _is_hopeless(self, search: Search, best: Scored, at: Settled) -> bool:
        """Whether what grew in place of something is so much less probable that no exchange makes up for it.

        Where noise is what a set leaves, they are compared about the larger one: what was d (log) about the smaller one
        is d / (1 + 2d/n) there, of n samples.
        """
        if self.rival is None:
            return False
        behind = self.rival - at.log - search.prior(best.picks)
        if self.unrepeated and behind > 0:
            behind /= 1 + 2 * behind * self.wide.excess / at.about.samples(self.train)
        return behind > HOPELESS

    def _is_law(self, candidate: Candidate) -> bool:
        """Whether it is looked for where laws alone are: of repeats a curve with a name is as good as one."""
        return candidate.is_law if self.unrepeated else candidate.named

    def _on(self, climbed: _Climbed, *, fresh: bool = False) -> _Climbed:
        """Further from there."""
        return self._climbed(climbed.at, climbed.picks, fresh=fresh)

    def _by_laws(self, view: View, found: _Climbed) -> _Climbed:
        """From laws alone, where that comes to rest at something likelier: what a curve was found to be first, no pair
        of laws takes from it one at a time.
        """
        among = frozenset(i for i, c in enumerate(self.candidates) if self._is_law(c) or i in self.always)
        rival = found.log
        laws = replace(self, among=among, rested={}, rival=rival)
        with view.work.apart(_COARSE):
            few = laws._by_few(view)
        if few is not None and few.log > rival:
            return self._on(replace(few, at=self._renewed(few.at)), fresh=True)
        with view.work.apart(_LAWS):
            other = laws._climbed(laws._nothing(view), ())
        self.memory, self.rounds = laws.memory, laws.rounds
        here = found.at
        if laws.wide is not self.wide:
            here = settled(laws.wide.seen(here.about.view), here.members, laws._weighing)
        mine, theirs = (
            at.log + one.search.prior(one.best.picks) for one, at in ((found, here), (other, other.at))
        )
        # of two about as likely, laws say more
        if theirs <= mine - (np.log(2) if self.unrepeated else 0.0):
            if laws.wide is self.wide:
                self.rested = laws.rested | self.rested
            return self._on(found)
        self.wide, self.rested = laws.wide, laws.rested
        self.rested[found.search.kind(found.best.picks)] = kept(found.search, found.best, here), mine
        return self._on(other)

    def _by_few(self, view: View) -> _Climbed | None:
        """What a few runs are made of, at rest in all; None where they are all, or nothing repeats them.

        A few cost less, so that more is tried there, and have fewer maxima of the likelihood on the way.
        """
        few = few_of(self.train)
        if self.unrepeated or len(few) == len(self.train):
            return None
        some = replace(self, train=few, rested={}, rival=None, memory=None, coarse=True, looked=False)
        found = some._climbed(some._nothing(view), ())
        self.rounds, self.looked = some.rounds, True
        return replace(found, at=settled(self.wide.seen(view), found.at.members, self._weighing))

    def _renewed(self, at: Settled) -> Settled:
        """At rest about the noise that it leaves: until then it was looked for about something less likely."""
        self._renew(at)
        return settled(self.wide.seen(at.about.view), at.members, self._weighing)

    @property
    def _weighing(self) -> Weighing:
        return Weighing(self.wide.noise, self.train, self.wide.excess)

    def _search(self, at: Settled) -> Search:
        present = {m.candidate.name: m.coefficients for m in at.members if m.candidate.bent is not None}
        linear = [c.about(present[c.name]) if c.bent and c.name in present else c for c in self.candidates]
        data = Data.of(at.about, at.members, linear, self.train, self.wide.excess, self.memory, self.among)
        self.memory = data.rows
        return Search(data, self.always)

    def _further(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
        """The best set of one cause more, or of a law in place of a curve, at rest; None where none is more probable
        than the one at hand.
        """
        if len(start.picks) >= MOST:
            return None
        offered = sorted(search.offered(start.picks), key=lambda one: -one.log)
        likelier = [one for one in offered if one.log > start.log]
        # what one motion has of its own could be anything: first all that another motion would show as well
        shared = [one for one in likelier if not search.candidate(one.picks[-1]).of_motion]
        likelier = shared or likelier
        # of much that is missed any curve promises more than a law keeps
        laws = [one for one in likelier if search.candidate(one.picks[-1]).is_law][:_LAWS_TRIED]
        promising = [*likelier[:_TRIED], *laws]
        # without numba a gap costs a hundred times as much: there a line has to promise something
        opening = [one for one in offered if IS_FAST and search.candidate(one.picks[-1]).opens][:1]
        # what is far off is missed by something else as well: where no line promises anything, nothing is
        elsewhere = [one for one in offered if search.candidate(one.picks[-1]).elsewhere and promising]
        named = [one for one in search.laws_instead(start.picks) if one.log > start.log]
        lines, beyond = (*promising, *named), (*opening, *elsewhere)
        # beside each set that grew in a few runs, those showed nothing of what no line leads to: where there is
        # anything else, it comes first
        goes = [(lines, False), (beyond, True)] if self.looked else [((*lines, *beyond), True)]
        best, top = None, 0.0
        for sets, everywhere in goes:
            for one in dict.fromkeys(sets):
                if best is not None and search.data.work.spent:
                    break
                tried, gain = self._rested(search, one, start, at, top, everywhere=everywhere)
                if gain > top:
                    best, top = (one, tried), gain
            if best is not None:
                break
        return best

    def _fewer(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
        """The set without one of its names, where that is more probable at rest.

        A name is as sure as its set is likelier at rest than without it, whatever a line says of that.
        """
        for pick in start.picks:
            others = search.score(tuple(other for other in start.picks if other != pick))
            known = search.kind(others.picks) in self.rested or not search.candidate(pick).named
            if known or search.data.work.spent:
                continue
            tried, gain = self._rested(search, others, start, at)
            if gain > 0:
                return others, tried
        return None

    def _instead(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
        """A visited set that is more probable than the one at hand at rest, too; what was only promised is noted."""
        search.resting = search.kind(start.picks)
        for _ in range(_TRIED):
            if search.data.work.spent:
                break
            rivals = [(one.log + search.unkept(kind), one) for kind, one in search.table.items()]
            untried = [
                pair for pair in rivals if search.kind(pair[1].picks) not in {search.resting, *search.kept}
            ]
            promised, one = max(untried, key=lambda pair: pair[0], default=(-np.inf, start))
            if promised <= start.log:
                break
            tried, gain = self._rested(search, one, start, at)
            if gain > 0:
                return one, tried
            search.kept[search.kind(one.picks)] = start.log + gain - one.log
        return None

    def _rested(
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
        if {key_of(m) for m in at.members} <= {key_of(m) for m in members}:
            promised, begun = [m.coefficients for m in members], begun_from(at.members, members)
            tried = settled_beyond(at.about, begun, promised, self._weighing)
            far = everywhere and members[-1].candidate.elsewhere
            if far and key_of(members[-1]) not in {key_of(m) for m in at.members}:
                other = settled_elsewhere(at, begun, self._weighing, least)
                tried = tried if other is None or other.log < tried.log else other
        else:
            tried = settled(at.about.view, members, self._weighing)
        if any(m.candidate.at_end(m.shape, m.coefficients) for m in tried.members):
            tried = replace(tried, log=-np.inf)  # it stands for what is none of its shapes
        kind, log = search.kind(one.picks), tried.log + search.prior(one.picks)
        if kind not in self.rested or self.rested[kind][1] < log:
            self.rested[kind] = kept(search, one, tried), log
        return tried, tried.log + search.prior(one.picks) - at.log - search.prior(start.picks)

    def _recall(self, search: Search, best: Scored, at: Settled) -> None:
        """Weigh sets that were at rest by what they were worth there: about another set, a linear model may show little
        of it, and of two that explain the same the last would have all."""
        here = at.log + search.prior(best.picks)
        for kind, (picks, log) in self.rested.items():
            promised = search.table.get(kind)
            if promised is None and log - here > -HOPELESS:
                promised = search.score(carried(search.data, picks))
            if promised is not None and kind != search.kind(best.picks):
                search.kept[kind] = log - here - (promised.log - best.log)

    def _renew(self, at: Settled) -> None:
        """Look for the noise again about what is present: far from the truth, noise had to be taken for what a linear
        model could not do. Sets are compared about one and the same, so that none has been at rest about the new one.
        """
        self.rival = None
        if self.unrepeated:  # of everything that may be there, something fits any noise
            self.wide = replace(self.wide, noise=own_noise(at, self._weighing))
            self.rested.clear()
            return
        members = everything(self.candidates, at.members)
        self.wide = wide_fit(at.about.view, members, self.wide.noise, self.train, KNOWN)
        self.rested.clear()
