"""From where sets are grown: from what all causes, or laws alone, make of a few runs, or from nothing in all.

A pair of laws explains together what one curve does: beside the curve neither is missed, and none takes its place; so
where a curve is found in a few runs, with a name or without, laws without curves are looked for as well. And laws take
what they can of what is none of them. So where something without a name is found in all runs, laws alone, and curves
with names, are looked for as well. The likelier counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from schwung.explain.weighing.data import Data
from schwung.explain.weighing.growth import Climbed, Growth
from schwung.explain.weighing.round import View
from schwung.explain.weighing.search import HOPELESS, TOLD, Scored, Search
from schwung.explain.weighing.sets import is_unnamed
from schwung.explain.weighing.settling import Settled

#: Of the work, what all causes may take in a few runs; and what laws alone may take beside it, each time.
_FEW, _LAWS = 0.3, 0.4


@dataclass(frozen=True, eq=False)
class Grown:
    """The most probable set and all that were visited, linearised about it."""

    growth: Growth  # that came to it
    climbed: Climbed
    view: View  # of the belief, with what is always there at rest

    @property
    def search(self) -> Search:
        """The table of visited sets."""
        return self.climbed.search

    @property
    def data(self) -> Data:
        """Its columns."""
        return self.search.data

    @property
    def best(self) -> Scored:
        """The most probable set."""
        return self.climbed.best

    @cached_property
    def nothing(self) -> Settled:
        """The belief with what is always there, about the noise that was found."""
        return self.growth.nothing(self.view)

    def tempered(self, ratio: float) -> Search:
        """All sets as so many times fewer samples tell them apart, those of them at rest that are worth telling, or the
        likeliest alone where the work is over: far from the most probable one, a line promises what may be nothing."""
        search, at = self.search, self.climbed.at
        known = {search.kind(self.best.picks), *search.kept}
        while True:
            sure = search.tempered(ratio)
            told = [sure.kind(one.picks) for share, one in sure.shares() if share > TOLD]
            asked = told[:1] if search.data.work.spent else told
            kind = next((kind for kind in asked if kind not in known), None)
            if kind is None or (search.data.work.late and kind not in search.doubts):
                return sure
            one = search.table[kind]
            _, gain = self.growth.rests.rest(search, one, self.best, at)
            search.note(kind, self.best.log + gain, one.log)
            known.add(kind)


@dataclass(frozen=True, eq=False)
class _Found:
    """What was found, by which causes, about which noise."""

    growth: Growth
    climbed: Climbed
    fresh: bool = False  # whether the noise was looked at since

    @property
    def named(self) -> bool:
        """Whether all of it has a name."""
        return not is_unnamed(self.climbed.search, self.climbed.best)

    @property
    def without_curves(self) -> bool:
        """Whether all of it is laws of a few numbers."""
        search = self.climbed.search
        return all(search.candidate(pick).is_law for pick in self.climbed.best.picks)

    def renewed(self, nothing: Settled) -> _Found:
        """About the noise that it leaves in all runs; `nothing`, where that is likelier there."""
        climbed = self.climbed
        if climbed.fresh and self.growth.rests.misses(climbed.at):
            nothing = self.growth.nothing(nothing.about.view)
        if climbed.at.about.noise is nothing.about.noise and climbed.log <= nothing.log:
            climbed = replace(climbed, at=nothing, best=climbed.search.score(()))
        if climbed.fresh:
            return replace(self, climbed=climbed, fresh=True)
        best, at = self.growth.renewed(climbed.search, climbed.best, climbed.at)
        return replace(self, climbed=replace(climbed, at=at, best=best), fresh=True)

    def further(self, *, named: bool = False) -> _Found:
        """With all causes from there; `named`: until one has no name."""
        growth = replace(self.growth, among=None, rival=None)
        at, picks = self.climbed.at, self.climbed.picks
        climbed = growth.climbed(at, picks, named=named, fresh=self.fresh)
        return _Found(growth, replace(climbed, beats_laws=climbed.beats_laws or self.climbed.beats_laws))

    def is_beyond(self, laws: _Found) -> bool:
        """Whether it grew from these laws, beside which no other gained enough to be of use, and is so much likelier
        that nothing makes up for it."""
        kind = laws.climbed.search.kind(laws.climbed.best.picks)
        gained = self.growth.rests.named.get(kind, np.inf)
        same = laws.climbed.at.about.noise is self.growth.rests.wide.noise
        return same and gained < HOPELESS and self.climbed.log > laws.climbed.log + HOPELESS

    def about(self, other: _Found) -> Climbed:
        """At rest about another's noise, and as probable as there so many causes are."""
        climbed, rests = self.climbed, other.growth.rests
        search = replace(climbed.search, inexact=rests.inexact)
        if self.growth.rests.wide is rests.wide:
            return replace(climbed, search=search)
        return replace(climbed, search=search, at=rests.settled(climbed.at.about.view, climbed.at.members))

    def or_else(self, other: _Found) -> _Found:
        """This, or another set, where that is likelier about the same noise in a few runs."""
        return other if other.about(self).log > self.climbed.log else self

    def beats(self, other: _Found) -> bool:
        """Whether laws alone are likelier than another set about the same noise; which of them is less likely is noted
        as such."""
        theirs = other.about(self)
        # of two about as likely, laws say more
        slack = np.log(2) if self.growth.unrepeated else 0.0
        if self.climbed.log > theirs.log - slack:
            self.growth.rests.rested[other.climbed.search.kind(other.climbed.best.picks)] = (
                theirs.picks,
                theirs.log,
            )
            return True
        if self.growth.rests.wide is other.growth.rests.wide:
            other.growth.rests.rested = self.growth.rests.rested | other.growth.rests.rested
        return False


def grown(growth: Growth, view: View) -> Grown:
    """The sets of a session."""
    nothing = growth.nothing(view)
    found = _from_few(growth, view, nothing) if growth.has_few else _from_nothing(growth, view, nothing)
    climbed = found.growth.alike(found.climbed)
    return Grown(found.growth, climbed, nothing.about.view)


def _from_nothing(growth: Growth, view: View, nothing: Settled) -> _Found:
    """All causes in all runs, or laws alone, or without curves."""
    every = growth.afresh()
    found = _or_laws(_Found(every, every.climbed(nothing, ())), view)
    return _or_else(found, growth.without_curves, view) if found.named and not found.without_curves else found


def _from_few(growth: Growth, view: View, nothing: Settled) -> _Found:
    """From what all causes make of a few runs; or laws without curves, where that holds a curve."""
    every = growth.afresh()
    # as recorded, no shaft is wound up: what bends it much in a few runs did not come to rest in all from there
    view = nothing.about.view
    few = _Found(every, every.by_few(view, view.work.within(_FEW)))
    if few.without_curves or few.climbed.beats_laws:
        few = few.renewed(nothing)
        return _or_laws(few.further(), view, few if few.named else None)
    alone = _without_curves(every, few, view)
    if few.named:
        return _or_without_curves(few, alone, view, nothing)
    if not alone.climbed.log > few.about(alone).log:
        found = few.renewed(nothing).further()
        # what is far from likely in a few runs is so in all
        return found if alone.climbed.hopeless else _or_laws(found, view, alone)
    alone = alone.renewed(nothing)
    beside = alone.further(named=True)
    if beside.named:
        return beside
    found = few.renewed(nothing).further()
    if not found.named and alone.beats(found):
        return beside.further()
    return _or_laws(found, view, alone)


def _without_curves(every: Growth, few: _Found, view: View) -> _Found:
    """Laws without curves in a few runs, grown from those that were found beside a curve there, for they may be right;
    where those leave more than noise, they may make up for what the curve does wrong: the likelier of what grows so and
    from nothing."""

    def asked(rival: _Found, beside: Climbed | None) -> _Found:
        laws = every.afresh(every.without_curves)
        return _Found(laws, laws.by_few(view, view.work.apart(_LAWS), rival.climbed, beside))

    alone = asked(few, few.climbed)
    if not alone.growth.rests.leaves(alone.climbed.at):
        return alone
    return alone.or_else(asked(alone.or_else(few), None))


def _or_without_curves(few: _Found, alone: _Found, view: View, nothing: Settled) -> _Found:
    """What comes of names of a few runs, or of laws without curves, where those are likelier in all."""
    if alone.climbed.log > few.about(alone).log - HOPELESS:
        alone = alone.renewed(nothing)
        found = alone.further()
        if found.beats(few):
            return _or_laws(found, view, alone)
    few = few.renewed(nothing)
    return _or_laws(few.further(), view, few)


def _or_laws(found: _Found, view: View, few: _Found | None = None) -> _Found:
    """What was found, where all of it has a name or is known to be likelier than laws alone; or from those in all
    runs, where they are likelier; `few`: laws that are likeliest in a few runs, None: there are none."""
    if found.named or found.climbed.beats_laws or (few is not None and found.is_beyond(few)):
        return found
    return _or_else(found, found.growth.laws, view, few)


def _or_else(found: _Found, among: frozenset[int], view: View, few: _Found | None = None) -> _Found:
    """What was found, or, where that is likelier, what all causes make of what these alone do, grown from those that
    are likeliest in a few runs, or from nothing: where a curve was likelier there, they are what it is not."""
    # what was found keeps its columns
    laws = replace(found.growth.afresh(among), rival=found.climbed.log, memory=None)
    with view.work.apart(_LAWS):
        alone = _Found(laws, laws.climbed(*laws.begun(view, None if few is None else few.climbed)))
    return alone.further() if alone.beats(found) else found
