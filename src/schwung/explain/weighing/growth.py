"""Sets of causes grown one cause at a time, everything linearised anew about each.

The few that promise most by the linear model are each brought to rest, and their evidence there decides: of twenty
floors of a wrong stiffness a late torque explains, to first order, more than the stiffness does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from schwung.compiled import IS_FAST
from schwung.explain.weighing.balance import balanced
from schwung.explain.weighing.candidate import RIGHT_TO, Candidate
from schwung.explain.weighing.data import Data
from schwung.explain.weighing.present import Member, moves
from schwung.explain.weighing.round import View, few_of
from schwung.explain.weighing.search import HOPELESS, MOST, TOLD, Scored, Search
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
    timed,
    without_damping,
)
from schwung.explain.weighing.settling import (
    Settled,
    Weighing,
    own_noise,
    settled,
    settled_beyond,
    settled_elsewhere,
    smoothed,
)
from schwung.explain.weighing.taken import Held
from schwung.explain.weighing.wide import Wide, wide_fit
from schwung.motion import Array

#: How far off the noise may be, once it was found (log).
KNOWN = 0.3
#: Told what is being done, and the share that is done.
Progress = Callable[[str, float], None]
#: The share of the work that the noise takes, and what of the rest is left after each round.
NOISE_SHARE, _FURTHER = 0.2, 0.7

#: A set that misses so many times its noise is far from the truth.
_FAR = 2.0
#: Sets that are brought to rest each round; so many of one law more among them, or beside them.
_TRIED, _LAWS_TRIED = 3, 2


@dataclass(frozen=True, eq=False)
class Climbed:
    """A set at rest, and all that were visited about it."""

    search: Search
    best: Scored
    at: Settled
    halfway: bool = False  # whether it was left because something has no name

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

    candidates: Sequence[Candidate]
    always: tuple[int, ...]  # candidates that are in every set
    train: Sequence[int]
    wide: Wide
    held: Held
    memory: Array | None = None
    #: Counts rounds of linearising, with those of the others that were made of it: progress never goes back.
    rounds: Iterator[int] = field(default_factory=lambda: count(1))
    among: frozenset[int] | None = None  # candidates that are looked at; None: all
    unrepeated: bool = False  # whether no run repeats another: then noise is what a set leaves
    coarse: bool = False  # whether these are a few runs, by which no noise can be told
    rival: float | None = None  # log probability, about the noise at hand, of what these causes stand in for
    tell: Progress = lambda _text, _share: None
    #: Kinds of sets that came to rest about the noise as it is known: their best shapes and sizes, and log probability.
    rested: dict[frozenset[int], tuple[Shaped, float]] = field(default_factory=dict)
    #: Kinds of sets whose late cause was begun where what is usual says about that noise.
    timed: set[frozenset[int]] = field(default_factory=set)
    #: What each candidate that no line leads to gained (log) when it was last asked.
    gained: dict[int, float] = field(default_factory=dict)

    @property
    def laws(self) -> frozenset[int]:
        """What is looked for where laws alone are: of repeats a curve with a name is as good as one."""
        every = enumerate(self.candidates)
        return frozenset(
            i for i, c in every if (c.is_law if self.unrepeated else c.named) or i in self.always
        )

    def afresh(self, among: frozenset[int] | None = None) -> Growth:
        """The same before anything was found, of these causes alone; None: of all."""
        return replace(self, among=among, rested={}, timed=set(), gained={}, rival=None)

    def nothing(self, view: View) -> Settled:
        """The belief with what is always there."""
        always = [absent(self.candidates[i]) for i in self.always]
        return self._nearest(self._settled(view, always))

    def climbed(self, at: Settled, picks: Shaped, *, named: bool = False, fresh: bool = False) -> Climbed:
        """From a set at rest, by one cause more at a time; then by what may stand in its place. `named`: whether it is
        left halfway where something has no name. `fresh`: whether the noise was looked at since something was found.

        Raises TakenLater where a set shows that what a bus holds is taken a sample later.
        """
        growing = True
        while True:  # each round is likelier than the one before, or the last but for a look at the noise
            share = NOISE_SHARE + (1 - NOISE_SHARE) * (1 - _FURTHER ** (next(self.rounds) - 1))
            self.tell(f"Weighing causes beside {len(picks)} found" if picks else "Weighing causes", share)
            search = self._search(at)
            start = search.score(carried(search.data, picks))
            if search.data.work.spent:
                return Climbed(search, start, at)
            if growing:
                taken = self._further(search, start, at)
                if taken is not None:
                    start, at = self._exchanged(search, *taken)
                    start, at = self._play_instead(search, start, at) or (start, at)
                    at = self._nearest(at)
                    if named and is_unnamed(search, start):
                        return Climbed(search, start, at, halfway=True)
                    fresh = self.unrepeated and self._is_loud(at)
                    at = self.renewed(at) if fresh else at
                    picks = kept(search, start, at)
                    shared = not search.candidate(start.picks[-1]).each_run
                    if fresh or shared or self.coarse or at.about.view.ranges.one_motion:
                        continue
                    # it was noise, for repeats do not share it; where all repeat one motion, nothing else tells noise
                if self._is_hopeless(search, start, at):
                    return Climbed(search, start, at)
                if not fresh and not self.coarse:
                    at, fresh = self.renewed(at), True
                    picks = kept(search, start, at)
                    continue
                growing = False
            search.best(start.picks)
            taken = self._timed(search, start, at) or self._instead(search, start, at)
            taken = taken or self._fewer(search, start, at)
            if taken is None:
                if search.data.work.spent:
                    search.forget_beyond(start)
                return Climbed(search, start, at)
            start, at = taken
            if named and is_unnamed(search, start):
                return Climbed(search, start, at, halfway=True)
            picks = kept(search, start, at)

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

    @property
    def has_few(self) -> bool:
        """Whether a few runs are not all, and repeats tell what is noise in them."""
        return not self.unrepeated and len(few_of(self.train)) < len(self.train)

    def by_few(self, view: View) -> Climbed:
        """What a few runs are made of, at rest in all: a few cost less, so that more is tried there, and have fewer
        maxima of the likelihood on the way."""
        some = replace(self.afresh(self.among), train=few_of(self.train), memory=None, coarse=True)
        found = some.climbed(some.nothing(view), ())
        self.gained = some.gained
        return replace(found, at=settled(self.wide.seen(view), found.at.members, self.weighing))

    def renewed(self, at: Settled) -> Settled:
        """At rest about the noise that it leaves: until then it was looked for about something less likely."""
        self._renew(at)
        return self._settled(at.about.view, at.members)

    def _settled(self, view: View, members: Sequence[Member]) -> Settled:
        return settled(self.wide.seen(view), members, self.weighing)

    def _nearest(self, at: Settled) -> Settled:
        """With what a bus holds taken where that is likelier."""
        if self._misses(at) or at.about.view.work.spent:
            return at
        return self.held.nearest(at, self.weighing)

    def _is_loud(self, at: Settled) -> bool:
        """Whether a set leaves so much less than the noise is that it has not been known until now: about that nothing
        small can be told."""
        return bool(at.about.square(self.train) < np.exp(-2 * KNOWN) * at.about.samples(self.train))

    @property
    def weighing(self) -> Weighing:
        """What sets are weighed by."""
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
        if self._misses(at):  # of a load that is unknown, anything that is missed is a line
            named += [one for one in search.inertia_beside(start.picks) if one.log > start.log]
        lines = dict.fromkeys((*promising, *named))
        beyond = [*(one for one in opening if one not in lines), *elsewhere]
        best, top = None, 0.0
        for one in [*(one for one in lines if one not in beyond), *beyond]:
            last = self.gained.get(search.index(one.picks[-1]), np.inf) if one in beyond else np.inf
            # what a cause takes beside more is seldom more: it is not asked again for less than there is already
            fruitless = best is not None and last <= top
            if best is not None and ((fruitless and one not in lines) or search.data.work.spent):
                continue
            everywhere = one in beyond and not fruitless
            tried, gain = self._rested(search, one, start, at, top, everywhere=everywhere)
            if everywhere:
                self.gained[search.index(one.picks[-1])] = gain
            if everywhere or one not in elsewhere:
                search.asked[frozenset(one.picks)] = gain
            if gain > top:
                best, top = (one, tried), gain
        return best

    def _exchanged(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled]:
        """The set, or with another number of the belief in place of one that is further off than is natural, where that
        is likelier at rest: so far off, no line says which of them it is.
        """
        best, top = (start, at), 0.0
        for pick, member in zip(start.picks, at.members[len(at.members) - len(start.picks) :], strict=True):
            if not member.candidate.is_number or np.all(np.abs(member.coefficients) <= member.deviations):
                continue
            others = tuple(other for other in start.picks if other != pick)
            for instead in search.numbers_beside(start.picks):
                one = search.score((*others, instead))
                if search.kind(one.picks) in self.rested or search.data.work.spent:
                    continue
                begun = [
                    without_damping(m)
                    for m in begun_from(at.members, members_of(search, one, self.candidates))
                ]
                least = self._least(search, one, start, at) + top
                tried = settled(at.about.view, begun, self.weighing, least)
                tried, gain = self._noted(search, one, start, at, tried)
                if gain > top:
                    best, top = (one, tried), gain
        return best

    def _timed(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
        """The set with another late cause, or with one where what is usual is further off than a name costs; where that
        is more probable at rest.

        To first order all of them say the same, and where little is noise no line about the one leads to another.
        """
        others = tuple(pick for pick in start.picks if not any(search.candidate(pick).late))
        apart = [m for m in at.members if any(m.candidate.late) and not all(m.candidate.late)]
        off = sum(0.5 * float((m.coefficients[0] / m.deviations[0]) ** 2) for m in apart)
        if len(start.picks) - len(others) > 1 or (len(others) == len(start.picks) and off < -search.odds):
            return None
        for index, candidate in enumerate(self.candidates):
            kind = search.kind(others) | {index}
            begun = timed(at.members, candidate) if candidate.named and any(candidate.late) else None
            if (
                begun is None
                or kind in self.timed
                or kind == search.kind(start.picks)
                or search.data.work.spent
            ):
                continue
            self.timed.add(kind)
            tried = settled(at.about.view, begun, self.weighing)
            one = search.score((*others, search.nearest(index, tried.members[-1].shape)))
            tried, gain = self._noted(search, one, start, at, tried)
            if gain > 0:
                return one, tried
            search.kept[kind] = max(search.kept.get(kind, -np.inf), start.log + gain - one.log)
        return None

    def _play_instead(self, search: Search, start: Scored, at: Settled) -> tuple[Scored, Settled] | None:
        """Play in place of all else by which motor and load give way to each other, where that is likelier at rest:
        together those may do what play does, and beside them there is no room for it."""
        others = tuple(pick for pick in start.picks if not search.candidate(pick).yields)
        play = search.opening() if IS_FAST else None
        if (
            play is None
            or len(others) == len(start.picks)
            or any(search.candidate(pick).opens for pick in start.picks)
        ):
            return None
        one = search.score((*others, play))
        if search.kind(one.picks) in self.rested or search.data.work.spent:
            return None
        members = begun_from(at.members, members_of(search, one, self.candidates))
        about = smoothed(at.about.view, members, self.weighing)
        still = [m.coefficients for m in members]
        least = self._least(search, one, start, at)
        tried = settled_beyond(about, members, still, self.weighing, least)
        tried, gain = self._noted(search, one, start, at, tried)
        if gain > 0:
            return one, tried
        search.kept[search.kind(one.picks)] = start.log + gain - one.log
        return None

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
        """A visited set that is more probable than the one at hand at rest, too; what was only promised is noted, of
        all that promise to be worth telling.
        """
        search.resting = search.kind(start.picks)
        for _ in range(_TRIED):
            if search.data.work.spent:
                break
            rivals = [(one.log + search.unkept(kind), one) for kind, one in search.table.items()]
            untried = [
                pair for pair in rivals if search.kind(pair[1].picks) not in {search.resting, *search.kept}
            ]
            promised, one = max(untried, key=lambda pair: pair[0], default=(-np.inf, start))
            if promised <= start.log + np.log(TOLD):
                break
            gain = search.asked.get(frozenset(one.picks), np.inf)
            if gain > 0:
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
        to_exceed = self._least(search, one, start, at) + least
        if {key_of(m) for m in at.members} <= {key_of(m) for m in members}:
            promised, begun = [m.coefficients for m in members], begun_from(at.members, members)
            tried = settled_beyond(at.about, begun, promised, self.weighing, to_exceed)
            if members[-1].candidate.is_inertia_curve and self._misses(at):
                tried = self._balanced(at, begun, tried)
            far = everywhere and members[-1].candidate.elsewhere
            if far and key_of(members[-1]) not in {key_of(m) for m in at.members}:
                other = settled_elsewhere(at, begun, self.weighing, least)
                tried = tried if other is None or other.log < tried.log else other
        else:
            tried = settled(at.about.view, members, self.weighing, to_exceed)
        return self._noted(search, one, start, at, tried)

    def _balanced(self, at: Settled, begun: Sequence[Member], tried: Settled) -> Settled:
        """A curve of inertia that came to rest, or the same begun where a balance of torque leads, if that is likelier:
        so far off, no line leads there."""
        told = balanced(at.about, at.members, begun[-1], self.train)
        start = [*begun[:-1], replace(begun[-1], coefficients=told)]
        if not moves(at.about.view.known.machine, start, at.about.view.ranges):
            return tried
        found = settled(at.about.view, start, self.weighing)
        return found if found.log > tried.log else tried

    def _misses(self, at: Settled) -> bool:
        """Whether a set misses more than its noise is: then what is missed is no line about it."""
        return bool(at.about.square(self.train) > _FAR**2 * at.about.samples(self.train))

    def _least(self, search: Search, one: Scored, start: Scored, at: Settled) -> float:
        """What a set has to be at rest to be as probable as the one at hand (log)."""
        return at.log + search.prior(start.picks) - search.prior(one.picks)

    def _noted(
        self, search: Search, one: Scored, start: Scored, at: Settled, tried: Settled
    ) -> tuple[Settled, float]:
        """Of a set that was brought to rest the same; it is kept in mind where it is the best of its kind."""
        if any(m.candidate.at_end(m.shape, m.coefficients) for m in tried.members):
            tried = replace(tried, log=-np.inf)  # it stands for what is none of its shapes
        kind, log = search.kind(one.picks), tried.log + search.prior(one.picks)
        if kind not in self.rested or self.rested[kind][1] < log:
            self.rested[kind] = kept(search, one, tried), log
        return tried, tried.log + search.prior(one.picks) - at.log - search.prior(start.picks)

    def recall(self, climbed: Climbed) -> None:
        """Weigh sets that were at rest by what they were worth there: about another set, a linear model may show little
        of it, and of two that explain the same the last would have all."""
        search, best, here = climbed.search, climbed.best, climbed.log
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
            noise = own_noise(at, self.weighing)
            noise = replace(noise, torque_share=max(noise.torque_share, RIGHT_TO))
            self.wide = replace(self.wide, noise=noise)
            self.rested.clear()
            self.timed.clear()
            return
        members = everything(self.candidates, at.members)
        self.wide = wide_fit(at.about.view, members, self.wide.noise, self.train, KNOWN)
        self.rested.clear()
        self.timed.clear()
