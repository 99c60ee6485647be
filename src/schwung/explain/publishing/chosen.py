"""The one set that is published: causes that a file can hold, each with what the file says of it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.drivetrain.residual import OVER, TABLES, UNDIRECTED
from schwung.drivetrain.residual_plane import Plane
from schwung.explain.publishing.drawn import Drawn, drawn
from schwung.explain.publishing.drawn_plane import PLANES, drawn_plane
from schwung.explain.publishing.learned import Found, table
from schwung.explain.publishing.places import Acts
from schwung.explain.publishing.values import over_words
from schwung.explain.publishing.written import sayable
from schwung.explain.weighing.contact import damped, with_damping
from schwung.explain.weighing.search import Pick, Scored, Search, slices
from schwung.explain.weighing.told import as_told
from schwung.explain.weighing.values import NAMED
from schwung.explain.weighing.weigh import Posterior, at_bound

#: So many times as far as a coupling was wound up its curve is written: a faster motion winds it up further, and where
#: the curve ends it would be as stiff again as it is believed.
_BEYOND = 1.5


@dataclass(frozen=True, eq=False)
class Cause:
    """A cause of the published set."""

    pick: Pick
    where: slice
    found: Found
    curve: Drawn | None
    plane: Plane | None = None


class Chosen:
    """The set of an outcome that is published about a belief; it grows smaller by what no file can say."""

    def __init__(self, machine: Machine, outcome: Posterior) -> None:
        self.machine, self.outcome = machine, outcome
        self.search: Search = outcome.grown.search
        first = self._first()
        if damped(self.search, first).off > NAMED:  # the file has one damping, for contacts as well
            first = with_damping(self.search, first)
        self.set = as_told(self.search, first)

    @property
    def names(self) -> frozenset[str]:
        """Of its causes."""
        return frozenset(map(self.search.name, self.set.picks))

    def leave_out(self, causes: Collection[Cause]) -> None:
        """Be the set without them."""
        without = {cause.pick for cause in causes}
        kept = tuple(pick for pick in self.set.picks if pick not in without)
        self.set = as_told(self.search, self.search.score(kept))

    def sayable(self) -> tuple[list[Cause], tuple[str, ...]]:
        """The set's causes as far as a file can hold them, and a note for each other one.

        Without one the others are others: curves that cancelled it would be left alone.
        """
        of, notes = self.outcome.view.ranges, tuple[str, ...]()
        while True:
            every = self._causes()
            over = [self.over(cause) for cause in every]
            found = [cause.found for cause in every]
            kept, unsaid = sayable(self.machine, found, over, (of.low_rad, of.high_rad))
            notes = (*notes, *unsaid)
            if len(kept) == len(every):
                return every, notes
            self.leave_out([cause for i, cause in enumerate(every) if i not in kept])

    def over(self, cause: Cause) -> str:
        """What it is over, in words."""
        return over_words(self.search.candidate(cause.pick).coordinate)

    def acts(self, pick: Pick, where: slice) -> Acts:
        """How one of its causes, whose coefficients are at these places, acts along a run."""
        candidate, shape = self.search.candidate(pick), self.search.data.atoms[pick.atom].shape
        return Acts(candidate.name, candidate, shape, self.set.exact[where])

    def of_motion(self) -> list[Acts]:
        """What the one motion has of its own: a part of what laws come near to."""
        own = zip(self.set.picks, slices(self.search, self.set), strict=True)
        return [self.acts(pick, where) for pick, where in own if self.search.candidate(pick).of_motion]

    def _first(self) -> Scored:
        """The most probable set without a parameter at its bound that holds all names, or as many as any does, without
        what does not hold elsewhere, without changes that are no larger than is usual, and without what is negligible:
        so far what is believed stays.

        Names are told by evidence that is tempered by what has no name, which would leave that out here; so a set that
        is likelier by it may hold others.
        """
        outcome, shares = self.outcome, self.search.shares()
        sound = [one for _, one in shares if all(self._publishable(one, pick) for pick in one.picks)]
        told = {one.name for one in outcome.told.names if one.probability > NAMED}
        held = [len(told.intersection(map(self.search.name, one.picks))) for one in sound]
        best = sound[held.index(max(held))] if sound else self.search.score(())
        usual = {name for name, p in outcome.stands.usual.items() if p > NAMED}
        left_out = usual | outcome.left_out
        kept = tuple(pick for pick in best.picks if self.search.name(pick) not in left_out)
        return self.search.score(kept)

    def _publishable(self, of: Scored, pick: Pick) -> bool:
        """Whether a file can say a cause of a set, inside its bounds."""
        candidate = self.search.candidate(pick)
        told = candidate.named or candidate.coordinate in OVER or candidate.coordinate in PLANES
        return told and not at_bound(self.search, of, pick)

    def _causes(self) -> list[Cause]:
        wound = max(float(np.max(np.abs(along.wound))) for along in self.search.data.about.alongs)
        of, places = (
            replace(self.outcome.view.ranges, wound_rad=_BEYOND * wound),
            slices(self.search, self.set),
        )
        result = []
        for pick, where in zip(self.set.picks, places, strict=True):
            if self.search.candidate(pick).of_motion:
                continue
            candidate, shape = self.search.candidate(pick), self.search.data.atoms[pick.atom].shape
            coefficients, found = self.set.exact[where], self.set.found
            curve = drawn(candidate, shape, coefficients, found.covariance[where, where], of)
            plane = None if candidate.named else drawn_plane(candidate, shape, coefficients, of)
            result.append(Cause(pick, where, self._found(pick, where, curve, plane), curve, plane))
        return result

    def _found(self, pick: Pick, where: slice, curve: Drawn | None, plane: Plane | None) -> Found:
        candidate, shape = self.search.candidate(pick), self.search.data.atoms[pick.atom].shape
        p = (
            self.outcome.told.probability(candidate.name)
            if candidate.named
            else self._unnamed(candidate.coordinate)
        )
        named = candidate.named and p > NAMED
        beside = {"probability": round(float(p), 4)} if named or not candidate.named else {}
        sampled = None if curve is None else lambda: residual_of(curve)
        if plane is not None:
            return Found("residual", False, plane.parameters(), beside)
        if not candidate.named:
            assert curve is not None
            return Found("residual", False, residual_of(curve), beside, sampled)
        if len(candidate.scales) > 1:
            return Found(candidate.name, named, self._table(pick, where, curve), beside, sampled)
        coefficients = self.set.exact[where]
        values = {key: float(value) for key, value in candidate.keys(coefficients, shape).items()}
        return Found(candidate.name, named, values, beside, sampled)

    def _table(self, pick: Pick, where: slice, curve: Drawn | None) -> dict[str, Any]:
        """Of a name whose numbers are a curve."""
        candidate, shape = self.search.candidate(pick), self.search.data.atoms[pick.atom].shape
        if candidate.inertia is not None:
            of = self.outcome.view.ranges
            angle = np.linspace(of.low_rad, of.high_rad, 129)
            added = candidate.inertia(angle, shape) @ self.set.exact[where]
            return {"table": table(angle, added)}
        assert curve is not None
        if candidate.name == "friction_over_angle":
            return {"table": table(curve.x, -curve.forward_nm)}
        if TABLES[candidate.name] == (2,):
            return {"table": table(curve.x, curve.forward_nm)}
        return {"table": table(curve.x, curve.forward_nm, curve.backward_nm)}

    def _unnamed(self, coordinate: str) -> float:
        every = (
            one.probability
            for one in self.outcome.told.unnamed
            if one.coordinate == coordinate and not one.like
        )
        return max(every, default=0.0)


def residual_of(curve: Drawn) -> dict[str, Any]:
    """A curve as the file's `residual`."""
    columns = (
        [curve.x, curve.forward_nm]
        if curve.over in UNDIRECTED
        else [curve.x, curve.forward_nm, curve.backward_nm]
    )
    return {"coordinate": curve.over, "table": table(*columns)}
