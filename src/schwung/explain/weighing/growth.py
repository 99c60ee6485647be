"""Sets of causes grown one cause at a time, everything linearised anew about each.

The few that promise most by the linear model are each brought to rest, and their evidence there decides: of twenty
floors of a wrong stiffness a late torque explains, to first order, more than the stiffness does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from schwung.compiled import IS_FAST
from schwung.explain.weighing.candidate import RIGHT_TO
from schwung.explain.weighing.data import Data
from schwung.explain.weighing.exchange import (
    Worse,
    bent_otherwise,
    curve_alone,
    curve_instead,
    exchanged,
    numbers_exchanged,
    play_instead,
    resized,
)
from schwung.explain.weighing.offers import (
    inertia_beside,
    instead_of_each,
    laws_instead,
    limits_instead,
    numbers_instead,
    numbers_together,
    offered,
    searched,
)
from schwung.explain.weighing.present import Member
from schwung.explain.weighing.resting import Rests
from schwung.explain.weighing.round import View, few_of
from schwung.explain.weighing.search import HOPELESS, MOST, Scored, Search
from schwung.explain.weighing.sets import (
    Shaped,
    absent,
    carried,
    everything,
    is_unnamed,
    kept,
)
from schwung.explain.weighing.settling import (
    Settled,
    own_noise,
    smoothed,
)
from schwung.explain.weighing.taken import Held
from schwung.explain.weighing.wide import wide_fit
from schwung.innovations.statistics import Columns

#: How far off the noise may be, once it was found (log).
KNOWN = 0.3
#: Told what is being done, and the share that is done.
Progress = Callable[[str, float], None]
#: The share of the work that the noise takes, and what of the rest is left after each round.
NOISE_SHARE, _FURTHER = 0.2, 0.7

#: And what a coupling that is a curve may take beside it, where no law of it is enough.
_BENT = 0.3

#: Sets that are brought to rest each round; so many of one law more among them, or beside them.
_TRIED, _LAWS_TRIED = 3, 2


@dataclass(frozen=True, eq=False)
class Climbed:
    """A set at rest, and all that were visited about it."""

    search: Search
    best: Scored
    at: Settled
    beats_laws: bool = False  # whether it holds a coupling that is a curve, in place of laws alone at rest

    @property
    def log(self) -> float:
        """How probable it is, among sets about one and the same noise in the same runs."""
        return self.at.log + self.prior

    @property
    def prior(self) -> float:
        """How probable so many causes were (log)."""
        return self.search.prior(self.best.picks)

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
    coarse: bool = False  # whether these are a few runs, by which no noise can be told
    rival: float | None = None  # log probability, about the noise at hand, of what these causes stand in for
    believed: tuple[Member, ...] = ()  # what is always there, as it is where nothing else is
    unasked: float = 0.0  # what was gained (log) since it was asked where a bus's torque is taken
    tell: Progress = lambda _text, _share: None
    #: What each candidate that no line leads to gained (log) when it was last asked.
    gained: dict[int, float] = field(default_factory=dict)
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
        at = self._nearest(self.rests.settled(view, [absent(self.rests.candidates[i]) for i in self.always]))
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
            return found if self.bent else self._bent(found, named)

    def _bent(self, found: Climbed, named: bool) -> Climbed:
        """With a coupling that is a curve, where that is likelier: in place of what was found by which motor and load
        give way, or of all of it, whatever is found beside it then."""
        asked = self.rests, found.search, found.best, found.at
        bent = curve_instead(*asked)
        if bent is not None:
            self.bent = True
            grown = self._climbed(bent[1], kept(found.search, *bent), named=named)
            return replace(grown, beats_laws=not is_unnamed(found.search, found.best))
        alone = curve_alone(*asked, self.believed)
        if alone is None:
            return found
        self.memory = None  # what was found keeps its columns
        before = self.rests
        grown = self._climbed(alone[1], kept(found.search, *alone), named=named)
        log = found.log
        if self.rests.wide is not before.wide:  # the noise was looked at on the way
            log = self.rests.settled(found.at.about.view, found.at.members).log + found.prior
        self.bent = grown.log > log
        if self.bent:
            return grown
        self.rests = before  # what was found is about that noise
        return found

    def _climbed(self, at: Settled, picks: Shaped, *, named: bool = False, fresh: bool = False) -> Climbed:
        growing = True
        while True:  # each round is likelier than the one before, or the last but for a look at the noise
            share = NOISE_SHARE + (1 - NOISE_SHARE) * (1 - _FURTHER ** (next(self.rounds) - 1))
            self.tell(f"Weighing causes beside {len(picks)} found" if picks else "Weighing causes", share)
            search, start, at = self._about(at, picks)
            picks = kept(search, start, at)
            if search.data.work.spent:
                return self._ended(search, start, at)
            if growing:
                taken = self._grown(search, start, at)
                if taken is not None:
                    start, at = taken
                    if named and is_unnamed(search, start):
                        return Climbed(search, start, at)
                    shared = not search.candidate(start.picks[-1]).each_run
                    fresh = self.unrepeated and self._is_loud(at)
                    start, at = self.renewed(search, start, at) if fresh else (start, at)
                    picks = kept(search, start, at)
                    if fresh or shared or self.coarse or at.about.view.ranges.one_motion:
                        continue
                    # it was noise, for repeats do not share it; where all repeat one motion, nothing else tells noise
                # of what a few runs are made of, what stands in a name's place is told by all; of laws alone by those,
                # for where a curve is likelier, all are not asked for them again in time
                few_tell = self.coarse and self.among is None and not is_unnamed(search, start)
                if few_tell or self._is_hopeless(search, start, at):
                    return Climbed(search, start, at)
                if not fresh and not self.coarse:
                    start, at = self.renewed(search, start, at)
                    picks, fresh = kept(search, start, at), True
                    continue
                growing = False
            searched(search, start.picks)
            taken = exchanged(self.rests, search, start, at)
            if taken is None:
                return (
                    self._ended(search, start, at) if search.data.work.spent else Climbed(search, start, at)
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
        taken = self._further(search, start, at)
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

    def _is_hopeless(self, search: Search, best: Scored, at: Settled) -> bool:
        """Whether what grew in place of something is so much less probable that no exchange makes up for it.

        Where noise is what a set leaves, they are compared about the larger one: what was d (log) about the smaller one
        is d / (1 + 2d/n) there, of n samples.
        """
        if self.rival is None:
            return False
        behind = self.rival - at.log - search.prior(best.picks)
        if self.unrepeated and behind > 0:
            behind /= 1 + 2 * behind * self.rests.wide.excess / at.about.samples(self.rests.train)
        return behind > HOPELESS

    @property
    def has_few(self) -> bool:
        """Whether a few runs are not all, and repeats tell what is noise in them."""
        return not self.unrepeated and len(few_of(self.rests.train)) < len(self.rests.train)

    def by_few(self, view: View, work: AbstractContextManager[None]) -> Climbed:
        """What a few runs are made of, at rest in all: a few cost less, so that more is tried there, and have fewer
        maxima of the likelihood on the way. `work`: within which they are asked."""
        some = replace(self.afresh(self.among), rests=self.rests.of_few(), memory=None, coarse=True)
        with work:
            found = some.climbed(some.nothing(view), ())
        self.gained, self.worse, self.bent = some.gained, some.worse, some.bent
        return replace(found, at=self.rests.settled(view, found.at.members))

    def renewed(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled]:
        """A set at rest about the noise that it leaves: until then it was looked for about something less likely.
        Without what ends at a bound of its shapes there, for with that none is worth anything."""
        self._renew(at)
        found = self.rests.settled(at.about.view, at.members)
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
        """Whether a set leaves so much less than the noise is that it has not been known until now: about that nothing
        small can be told."""
        return bool(
            at.about.square(self.rests.train) < np.exp(-2 * KNOWN) * at.about.samples(self.rests.train)
        )

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

    def _further(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
        """The best set of one cause more, or of a law in place of a curve, at rest; None where none is more probable
        than the one at hand.
        """
        if len(start.picks) >= MOST:
            return None
        best, top = self._in_place(search, start, at)
        if top > HOPELESS:
            return best
        lines, beyond = self._asked(search, start, at)
        # a number of the belief costs least, and what is hopeless beside it costs little
        numbers = [one for one in lines if search.candidate(one.picks[-1]).is_number]
        asked = list(dict.fromkeys((*numbers, *(one for one in lines if one not in beyond), *beyond)))
        for one in asked:
            last = self.gained.get(search.index(one.picks[-1]), np.inf) if one in beyond else np.inf
            # what a cause takes beside more is seldom more: it is not asked again for less than there is already
            fruitless = best is not None and last <= top
            if best is not None and ((fruitless and one not in lines) or search.data.work.spent):
                continue
            everywhere = one in beyond and not fruitless
            tried, gain = self.rests.rest(search, one, start, at, top, everywhere=everywhere)
            if everywhere:
                self.gained[search.index(one.picks[-1])] = gain
            if everywhere or one not in beyond:
                search.asked[frozenset(one.picks)] = gain
            if np.isneginf(gain):  # what came to its end is what it is in its limit
                asked += [limit for limit in limits_instead(search, one.picks) if limit not in asked]
            if gain > top:
                best, top = (one, tried), gain
        if best is None or not self.rests.misses(at) or not self.rests.leaves(best[1]):
            return best
        for one in lines:
            if search.candidate(one.picks[-1]).bends_by_shape and not search.data.work.spent:
                found = self.rests.in_each_shape(search, one, start, at, top)
                if found is not None:
                    best, top = (found[0], found[1]), found[2]
        return best

    def _asked(self, search: Search, start: Scored, at: Settled) -> tuple[dict[Scored, None], list[Scored]]:
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
        if not self.rests.misses(at):  # what little of the coupling bends about such a set, a line leads to
            elsewhere = [one for one in elsewhere if search.candidate(one.picks[-1]).tangent is None]
        beside = laws_instead(search, start.picks)
        if self.rests.misses(at):  # of a load that is unknown, anything that is missed is a line
            beside += inertia_beside(search, start.picks)
        lines = dict.fromkeys((*promising, *(one for one in beside if one.log > start.log)))
        beyond = [*(one for one in opening if one not in lines), *elsewhere]
        return lines, beyond

    def _in_place(
        self, search: Search, start: Scored, at: Settled
    ) -> tuple[tuple[Scored, Settled] | None, float]:
        """A number of the belief in place of another, or of a cause what it is in its limit, at rest, and what that
        gains (log): it needs no cause more, so that where it is much, it comes before all that do."""
        best, top = None, 0.0
        for one in (*numbers_instead(search, start.picks), *limits_instead(search, start.picks)):
            if one.log <= start.log or search.data.work.spent:
                continue
            tried, gain = self.rests.rest(search, one, start, at, top)
            search.asked[frozenset(one.picks)] = gain
            if gain > top:
                best, top = (one, tried), gain
        return best, top

    def _renew(self, at: Settled) -> None:
        """Look for the noise again about what is present: far from the truth, noise had to be taken for what a linear
        model could not do. Sets are compared about one and the same, so that none has been at rest about the new one.
        """
        self.rival = None
        if self.unrepeated:  # of everything that may be there, something fits any noise
            noise = own_noise(at, self.rests.weighing)
            noise = replace(noise, torque_share=max(noise.torque_share, RIGHT_TO))
            self.rests = self.rests.about(replace(self.rests.wide, noise=noise))
        else:
            members = everything(self.rests.candidates, at.members)
            noise = self.rests.wide.noise
            self.rests = self.rests.about(wide_fit(at.about.view, members, noise, self.rests.train, KNOWN))
        self.rests = self.rests.beside(smoothed(at.about.view, self.believed, self.rests.weighing))
