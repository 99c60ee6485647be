"""Sets of causes grown one cause at a time, everything linearised anew about each.

The few that promise most by the linear model are each brought to rest, and their evidence there decides: of twenty
floors of a wrong stiffness a late torque explains, to first order, more than the stiffness does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from schwung.explain.causes.present import Member
from schwung.explain.weighing.asked import further
from schwung.explain.weighing.data import Data
from schwung.explain.weighing.exchange import (
    Worse,
    bent_otherwise,
    curve_alone,
    curve_instead,
    exchanged,
    may_bend,
    numbers_exchanged,
    play_instead,
    resized,
)
from schwung.explain.weighing.its_noise import KNOWN, about_its_noise
from schwung.explain.weighing.offers import instead_of_each, searched
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.round import View, few_of
from schwung.explain.weighing.search import HOPELESS, MOST, Scored, Search
from schwung.explain.weighing.sets import Shaped, absent, bends, carried, is_unnamed, kept
from schwung.explain.weighing.settling import Settled, smoothed
from schwung.explain.weighing.taken import Held
from schwung.explain.weighing.wide import Wide
from schwung.innovations.statistics import Columns

#: Told what is being done, and the share that is done.
Progress = Callable[[str, float], None]
#: The share of the work that the noise takes, and what of the rest is left after each round.
NOISE_SHARE, _FURTHER = 0.2, 0.7

#: And what a coupling that is a curve may take beside it, where no law of it is enough.
_BENT = 0.3


@dataclass(frozen=True, eq=False)
class Climbed:
    """A set at rest, and all that were visited about it."""

    search: Search
    best: Scored
    at: Settled
    beats_laws: bool = False  # whether it holds a coupling that is a curve, in place of laws alone at rest
    fresh: bool = False  # whether the noise was looked at since anything was found
    hopeless: bool = False  # whether it was left for what it stands in for, which is so much likelier

    @property
    def log(self) -> float:
        """How probable it is, among sets about one and the same noise in the same runs."""
        return self.at.log + self.prior

    @property
    def prior(self) -> float:
        """How probable so many causes were (log)."""
        return self.search.prior(self.best.picks)

    @property
    def bends(self) -> bool:
        """Whether its coupling is a curve."""
        return bends(self.search, self.best)

    @property
    def picks(self) -> Shaped:
        """The set's, in the shapes that they have come to rest in."""
        return kept(self.search, self.best, self.at)


@dataclass(eq=False)
class Growth:
    """One session's."""

    rests: Rests
    always: tuple[int, ...]  # candidates that are in every set
    held: Held
    memory: Columns | None = None
    #: Counts rounds of linearising, with those of the others that were made of it: progress never goes back.
    rounds: Iterator[int] = field(default_factory=lambda: count(1))
    among: frozenset[int] | None = None  # candidates that are looked at; None: all
    bent: bool = False  # whether the coupling is known to be none of its laws, but a curve over its wind-up
    unrepeated: bool = False  # whether no run repeats another: then noise is what a set leaves
    every: Sequence[int] = ()  # where these are a few runs: all of them, for by a few no noise can be told
    rival: float | None = None  # log probability, about the noise at hand, of what these causes stand in for
    believed: tuple[Member, ...] = ()  # what is always there, as it is where nothing else is
    unasked: float = 0.0  # what was gained (log) since it was asked where a bus's torque is taken
    left: float = 1.0  # what was left, over noise, when that was last looked for; 1: or more
    tell: Progress = lambda _text, _share: None
    #: What each candidate that no line leads to gained (log) when it was last asked.
    gained: dict[int, float] = field(default_factory=dict)
    #: The belief at rest, about each noise in the runs that it was asked in.
    nothings: dict[tuple[Wide, tuple[int, ...]], Settled] = field(default_factory=dict)
    #: What is not exchanged again.
    worse: set[Worse] = field(default_factory=set)

    @property
    def laws(self) -> frozenset[int]:
        """What is looked for where laws alone are: of repeats a curve with a name is as good as one. Without them an
        inertia over the angle is, which has another part in each acceleration."""
        found = set(self.always)
        for number, candidate in enumerate(self.rests.candidates):
            if candidate.named if not self.unrepeated else candidate.is_law or candidate.is_inertia_curve:
                found.add(number)
        return frozenset(found)

    @property
    def without_curves(self) -> frozenset[int]:
        """Laws of a few numbers: a curve with a name does what two of them do together, too."""
        return frozenset({*self.always, *(i for i, c in enumerate(self.rests.candidates) if c.is_law)})

    def afresh(self, among: frozenset[int] | None = None) -> Growth:
        """The same before anything was found, of these causes alone; None: of all."""
        return replace(self, among=among, rests=self.rests.afresh(), gained={}, worse=set(), rival=None)

    def nothing(self, view: View) -> Settled:
        """The belief with what is always there; from then on it is known what that misses."""
        asked = self.rests.wide, tuple(self.rests.train)
        if asked not in self.nothings:
            alone = [absent(self.rests.candidates[i]) for i in self.always]
            self.nothings[asked] = self._nearest(self.rests.settled(view, alone))
        at = self.nothings[asked]
        self.rests, self.believed = self.rests.beside(at.about), at.members
        return at

    def climbed(self, at: Settled, picks: Shaped, *, named: bool = False, fresh: bool = False) -> Climbed:
        """From a set at rest, by one cause more at a time; then by what may stand in its place. `named`: whether it is
        left halfway where something has no name. `fresh`: whether the noise was looked at since something was found.

        Raises TakenLater where a set shows that what a bus holds is taken a sample later.
        """
        found = self._climbed(at, picks, named=named, fresh=fresh)
        with found.search.data.work.apart(_BENT):
            # last of all: what is still missed, a curve takes as well as the law that would be found for it next
            return found if self.bent or found.hopeless else self._bent(found, named)

    def _bent(self, found: Climbed, named: bool, only: bool = False) -> Climbed:
        """With a coupling that is a curve, where that is likelier: in place of all that was found, whatever is found
        beside it then, or of that by which motor and load give way. A few runs are asked first, where they are not all:
        they cost less. `only`: whether it is left where it is no curve any more.
        """
        asked = self.rests, found.search, found.best, found.at
        if not may_bend(*asked):
            return found
        self.memory = None  # what was found keeps its columns
        if self.has_few:
            some = self._of_few()
            here = some.rests.settled(found.at.about.view, found.at.members)
            few = Climbed(*some._about(here, found.picks))
            bent = some._bent(few, named=False, only=True)
            if not bent.bends:
                return found
            at = self.rests.settled(bent.at.about.view, bent.at.members)
            grown = self._likelier(found, at, bent.picks, named)
            return found if grown is found else replace(grown, beats_laws=bent.beats_laws)
        instead = curve_instead(*asked)
        rival = found if instead is None else Climbed(found.search, *instead)
        beats_laws = instead is not None and not is_unnamed(found.search, found.best)
        # what was found beside laws that no coupling has makes up for what they do wrong
        alone = curve_alone(*asked, self.believed, bends=instead is not None)
        if alone is not None:
            grown = self._likelier(rival, alone[1], kept(found.search, *alone), named, only)
            if grown is not rival:
                return replace(grown, beats_laws=True) if beats_laws else grown
        if instead is None:
            return found
        self.bent = True
        grown = self._climbed(instead[1], kept(found.search, *instead), named=named)
        return replace(grown, beats_laws=beats_laws)

    def _likelier(
        self, found: Climbed, at: Settled, picks: Shaped, named: bool, only: bool = False
    ) -> Climbed:
        """What grows from a coupling that is a curve, or what was found, where that is likelier."""
        before, rival = self.rests, self.rival
        self.rival = found.log
        grown = self._climbed(at, picks, named=named, bent=only)
        log, self.rival = found.log, rival
        if self.rests.wide is not before.wide:  # the noise was looked at on the way
            log = self.rests.settled(found.at.about.view, found.at.members).log + found.prior
            self.rival = None
        self.bent = grown.log > log
        if self.bent:
            return grown
        self.rests, self.rival = before, rival  # what was found is about that noise
        return found

    def _climbed(
        self, at: Settled, picks: Shaped, *, named: bool = False, fresh: bool = False, bent: bool = False
    ) -> Climbed:
        """`bent`: whether it is left where a coupling that is a curve, of which it begins, is none any more."""
        growing = True
        while True:  # each round is likelier than the one before, or the last but for a look at the noise
            share = NOISE_SHARE + (1 - NOISE_SHARE) * (1 - _FURTHER ** (next(self.rounds) - 1))
            self.tell(f"Weighing causes beside {len(picks)} found" if picks else "Weighing causes", share)
            search, start, at = self._about(at, picks)
            picks = kept(search, start, at)
            if search.data.work.spent:
                return replace(self._ended(search, start, at), fresh=fresh)
            if growing:
                before = at.log + search.prior(start.picks)
                taken = self._grown(search, start, at)
                if taken is not None:
                    start, at = taken
                    if self._is_hopeless(search, start, at, before):
                        return Climbed(search, start, at, hopeless=True)
                    if (named and is_unnamed(search, start)) or (bent and not bends(search, start)):
                        return Climbed(search, start, at)
                    shared = not search.candidate(start.picks[-1]).each_run
                    loud = self._is_loud(at)
                    with search.data.work.besides() if self.every else nullcontext():
                        start, at = self.renewed(search, start, at) if loud else (start, at)
                    # of what repeats do not share little is changed by what they do, until they leave much less
                    fresh = loud or (fresh and shared and not self.unrepeated)
                    picks = kept(search, start, at)
                    if loud or shared or self.coarse or at.about.view.ranges.one_motion:
                        continue
                    # it was noise, for repeats do not share it; where all repeat one motion, nothing else tells noise
                # of what a few runs are made of, what stands in a name's place is told by all; of laws alone by those,
                # for where a curve is likelier, all are not asked for them again in time
                few_tell = self.coarse and self.among is None and not is_unnamed(search, start)
                if few_tell or self._is_hopeless(search, start, at):
                    return Climbed(search, start, at, fresh=fresh, hopeless=not few_tell)
                if not fresh and not self.coarse:
                    start, at = self.renewed(search, start, at)
                    picks, fresh = kept(search, start, at), True
                    continue
                growing = False
            searched(search, start.picks)
            taken = exchanged(self.rests, search, start, at)
            if taken is None:
                return (
                    self._ended(search, start, at)
                    if search.data.work.spent
                    else Climbed(search, start, at, fresh=fresh)
                )
            start, at = taken
            if named and is_unnamed(search, start):
                return Climbed(search, start, at)
            picks = kept(search, start, at)

    def alike(self, climbed: Climbed) -> Climbed:
        """The same, or what is likelier but for chance; with all that came to rest beside it, as probable as so."""
        search, best, at = climbed.search, climbed.best, climbed.at
        one, other, log = self.rests.alike(search, best, at)
        if one is not best:
            search, best, at = self._about(other, kept(search, one, other))
        self.rests.recall(search, best, log)
        return replace(climbed, search=search, best=best, at=at)

    def _about(self, at: Settled, picks: Shaped) -> tuple[Search, Scored, Settled]:
        """All linearised about a set at rest, with its curves as large as they are likeliest there."""
        search = self._search(at)
        start = search.score(carried(search.data, picks))
        search.resting = search.kind(start.picks)
        return (search, *resized(self.rests, search, start, at))

    def _ended(self, search: Search, start: Scored, at: Settled) -> Climbed:
        """Where the work is over: what is left of it goes to what stands in the place of what was found, for that is
        told, and then to what lines say of the rest. Not while other causes have yet to be asked."""
        if self.coarse or self.among is not None:
            return Climbed(search, start, at)
        with search.data.work.ending():
            while True:
                # what one motion has of its own could be anything
                search.hidden |= {i for i, c in enumerate(search.data.candidates) if c.of_motion}
                instead_of_each(search, start)
                taken = exchanged(self.rests, search, start, at, len(start.picks))
                if taken is None:
                    break
                search, start, at = self._about(taken[1], kept(search, *taken))
            searched(search, start.picks)
        search.doubt(start)
        return Climbed(search, start, at)

    def _grown(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
        """The best set of one cause more at rest, or what stands for it there; None where none is more probable, or
        what a few runs gain by it is so little that all have to tell it."""
        before = at.log + search.prior(start.picks)
        taken = further(self.rests, search, start, at, self.gained)
        if taken is None:
            return None
        coarsely = self.coarse and not is_unnamed(search, start)
        if coarsely and taken[1].log + search.prior(taken[0].picks) - before < HOPELESS:
            return None
        start, at = numbers_exchanged(self.rests, search, *taken, self.worse)
        if at.log + search.prior(start.picks) - before > HOPELESS:
            start, at = bent_otherwise(self.rests, search, start, at)
        start, at = play_instead(self.rests, search, start, at, self.worse) or (start, at)
        return start, self._nearest(at, at.log + search.prior(start.picks) - before)

    def _is_hopeless(self, search: Search, best: Scored, at: Settled, before: float = np.inf) -> bool:
        """Whether what grew in place of something is so much less probable that no exchange makes up for it; nor as
        many causes as there may be, were each worth what the last was, `before` which it was so probable (log).

        Where noise is what a set leaves, they are compared about the larger one: what was d (log) about the smaller one
        is d / (1 + 2d/n) there, of n samples.
        """
        if self.rival is None:
            return False
        here = at.log + search.prior(best.picks)
        behind = self.rival - here
        if self.unrepeated and behind > 0:
            behind /= 1 + 2 * behind * self.rests.wide.excess / at.about.samples(self.rests.train)
        return behind > HOPELESS + (MOST - len(best.picks)) * max(here - before, 0.0)

    @property
    def coarse(self) -> bool:
        """Whether these are a few runs."""
        return bool(self.every)

    @property
    def has_few(self) -> bool:
        """Whether a few runs are not all, and repeats tell what is noise in them."""
        return not self.unrepeated and len(few_of(self.rests.train)) < len(self.rests.train)

    def _of_few(self) -> Growth:
        """The same in a few runs."""
        few, train = self.rests.of_few(), self.rests.train
        return replace(self, rests=few, memory=None, every=train, gained={}, worse=set())

    def by_few(
        self,
        view: View,
        work: AbstractContextManager[None],
        rival: Climbed | None = None,
        beside: Climbed | None = None,
    ) -> Climbed:
        """What a few runs are made of, at rest in all: a few cost less, so that more is tried there, and have fewer
        maxima of the likelihood on the way. `work`: within which they are asked; `rival`: what they
        stand in for; `beside`: a set, with what is looked for of which it begins.
        """
        some = self.afresh(self.among)._of_few()
        with work:
            if rival is not None:
                there = some.rests.settled(rival.at.about.view, rival.at.members)
                some.rival = there.log + rival.prior
            found = some.climbed(*some.begun(view, beside), fresh=rival is not None and rival.fresh)
        self.gained, self.worse, self.bent = some.gained, some.worse, some.bent
        if some.rests.wide is not self.rests.wide:
            self.rests, self.left = self.rests.about(some.rests.wide), some.left
            self.rests = self.rests.beside(smoothed(view, self.believed, self.rests.weighing))
        # causes cost more where all runs miss more
        search = replace(found.search, inexact=self.rests.inexact)
        return replace(found, search=search, at=self.rests.settled(found.at.about.view, found.at.members))

    def begun(self, view: View, found: Climbed | None) -> tuple[Settled, Shaped]:
        """What was found of the causes that are looked for, at rest about the noise at hand, or nothing, where that is
        likelier, or nothing was found."""
        if found is None:
            return self.nothing(view), ()
        search, members, own = found.search, found.at.members, found.best.picks
        stay = [i for i, pick in enumerate(own) if self.among is None or search.index(pick) in self.among]
        if len(stay) == len(own) and self._knows(found.at):
            return found.at, found.picks
        nothing, first = self.nothing(view), len(members) - len(own)
        begun = [*members[:first], *(members[first + i] for i in stay)]
        at = self.rests.settled(found.at.about.view, begun)
        return (at, tuple(found.picks[i] for i in stay)) if at.log > nothing.log else (nothing, ())

    def _knows(self, at: Settled) -> bool:
        """Whether a set is at rest about the noise at hand in the runs at hand."""
        return at.about.noise is self.rests.wide.noise and set(self.rests.train) == set(at.about.passed)

    def renewed(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled]:
        """A set at rest about the noise that it leaves: until then it was looked for about something less likely.
        Without what ends at a bound of its shapes there, for with that none is worth anything."""
        self.rival = None  # sets are compared about one and the same noise
        self.rests, at = about_its_noise(self.rests, at, self.every, self.believed, self.unrepeated)
        found = self.rests.settled(at.about.view, at.members)
        self.left = min(self._left(found), 1.0)
        own = found.members[len(found.members) - len(start.picks) :]
        ends = [m.candidate.at_end(m.shape, m.coefficients) for m in own]
        if not any(ends):
            return start, found
        standing = tuple(pick for pick, ended in zip(start.picks, ends, strict=True) if not ended)
        always = found.members[: len(found.members) - len(own)]
        members = [*always, *(m for m, ended in zip(own, ends, strict=True) if not ended)]
        return search.score(standing), self.rests.settled(found.about.view, members)

    def _nearest(self, at: Settled, gained: float = np.inf) -> Settled:
        """With what a bus holds taken where that is likelier; `gained`: by what was found last (log). What is hardly
        likelier than a set about which it was asked answers the same."""
        self.unasked += gained
        if self.unasked < HOPELESS or self.rests.misses(at) or at.about.view.work.spent:
            return at
        self.unasked = 0.0
        return self.held.nearest(at, self.rests.weighing)

    def _is_loud(self, at: Settled) -> bool:
        """Whether a set leaves so much less than the noise is, or than was left when that was looked for, that it has
        not been known until now: about that nothing small can be told."""
        return self._left(at) < float(np.exp(-2 * KNOWN)) * self.left

    def _left(self, at: Settled) -> float:
        """What a set leaves, over what noise does."""
        return at.about.square(self.rests.train) / at.about.samples(self.rests.train)

    def _search(self, at: Settled) -> Search:
        present = {
            (m.candidate.name, m.candidate.size): m.coefficients
            for m in at.members
            if m.candidate.bent is not None
        }
        linear = [
            c.about(present[c.name, c.size]) if c.bent and (c.name, c.size) in present else c
            for c in self.rests.candidates
        ]
        among = frozenset(range(len(linear))) if self.among is None else self.among
        data = Data.of(
            at.about, at.members, linear, self.rests.train, self.rests.wide.excess, self.memory, among
        )
        self.memory = data.rows
        # it does what any of its laws does, which are asked first
        hidden = frozenset() if self.bent else frozenset(i for i, c in enumerate(linear) if c.instead_of_laws)
        return Search(data, self.always, inexact=self.rests.inexact, hidden=hidden)
