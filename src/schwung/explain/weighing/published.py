"""What people get of the weighing: names with probabilities and units, curves without a name, the machine, the proof.

One machine is published: that of the most probable set none of whose parameters is at its bound. It is written, read
back, and what was read is what is proven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from schwung.drivetrain.effects import PHYSICS
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.residual import OVER, TABLES, UNDIRECTED, UNITS
from schwung.drivetrain.residual_plane import Plane
from schwung.explain import free_run
from schwung.explain.measured import smooth
from schwung.explain.plausibility import examine
from schwung.explain.values import Quantity
from schwung.explain.weighing.advice import advice
from schwung.explain.weighing.drawn import Drawn, drawn
from schwung.explain.weighing.drawn_formula import formulas_of
from schwung.explain.weighing.drawn_plane import PLANES, drawn_plane
from schwung.explain.weighing.formula import Formula
from schwung.explain.weighing.growth import Progress
from schwung.explain.weighing.judged import Judged, as_good, judged
from schwung.explain.weighing.learned import Found, learned, table
from schwung.explain.weighing.places import Acts, overlays, where_of, with_places
from schwung.explain.weighing.plainly import nearest
from schwung.explain.weighing.publication import (
    NAMED,
    Curve,
    Name,
    Plain,
    Published,
    Where,
    merged,
    over_words,
)
from schwung.explain.weighing.search import Pick, Scored, Search, slices
from schwung.explain.weighing.twin import as_missed_by
from schwung.explain.weighing.values import Parameter, Proof, Weighed
from schwung.explain.weighing.weigh import Posterior, at_bound, parameters_of, posterior_of
from schwung.explain.weighing.written import read_back, sayable
from schwung.explain.words import unit_on
from schwung.session.effort import require_alike
from schwung.session.imports import repeats
from schwung.session.model import Session

#: The share of the work that the search takes.
_SEARCH, _LOCATING = 0.85, 0.97
#: Units of the coordinates; the direction of motion has none.
_UNITS: Mapping[str, str] = {
    **{str(over): unit for over, unit in UNITS.items()},
    "direction": "",
    "frequency": "Hz",
}
_STEADY = "nothing is told of inertia, coupling, lag or scale of the torque: hardly anything accelerates here"
_OF_MOTION = (
    "all runs repeat one motion: what it has of its own over its time is told, and not in machine.toml, for another "
    "motion has another: record motions of several times or distances"
)
_NEEDLESS = (
    "the belief predicts the runs kept aside as well without what was fitted over {}: it is not published"
)


def publish(
    session: Session, machine: Machine, *, twin: Session | None = None, progress: Progress | None = None
) -> Published:
    """Weigh what a belief leaves out of a session, and make of it what is published.

    `twin`: what a simulator did along the very runs, for which the machine stands in. `progress`: told what is being
    done, and the share that is done, 0…1. Raises InputError where the session cannot be what it says (units, signs,
    wraps), or where the inertia is unknown.
    """
    tell = progress or (lambda _text, _share: None)
    tell("Looking at the recordings", 0.0)
    require_alike(session, machine)
    doubts = examine(session, machine)
    doubts.require(session.source or "session")
    if twin is not None:
        session = as_missed_by(session, smooth(machine), twin)
    outcome = posterior_of(
        session,
        smooth(machine),
        tell=lambda text, share: tell(text, 0.02 + (_SEARCH - 0.02) * share),
        steady=doubts.steady,
    )
    notes = (*doubts.notes, _STEADY) if doubts.steady else doubts.notes
    return published_of(session, machine, outcome, notes, tell)


def published_of(
    session: Session,
    machine: Machine,
    outcome: Posterior,
    notes: Sequence[str] = (),
    tell: Progress = lambda _text, _share: None,
) -> Published:
    """What is published of a session that was weighed about a belief; `notes`: of the session."""
    return _Publishing(session, machine, outcome, tell).published(notes)


@dataclass(frozen=True, eq=False)
class _Cause:
    """A cause of the published set."""

    pick: Pick
    where: slice
    found: Found
    curve: Drawn | None
    plane: Plane | None = None


class _Publishing:
    """An outcome on its way to people."""

    def __init__(self, session: Session, machine: Machine, outcome: Posterior, tell: Progress) -> None:
        self.session, self.machine, self.outcome, self.tell = session, machine, outcome, tell
        self.weighed: Weighed = outcome.told
        self.search: Search = outcome.grown.search
        self.set = self._set()

    def published(self, notes: Sequence[str]) -> Published:
        """All of it."""
        self.tell("Writing the machine, and proving what was written", _SEARCH)
        causes, unsaid = self._sayable()
        machine, before, after = self._judged(causes)
        aside = self.outcome.heldout
        unnamed = [cause for cause in causes if not cause.found.named]
        needless = bool(unnamed and aside) and as_good(before, after)
        if needless:  # a name stands by its probability: runs kept aside may show nothing of it
            without = {cause.pick for cause in unnamed}
            self.set = self.search.score(tuple(pick for pick in self.set.picks if pick not in without))
            what = ", ".join(dict.fromkeys(map(self._over, unnamed)))
            causes, more = self._sayable()
            machine, before, after = self._judged(causes)
            unsaid = (*unsaid, *more, _NEEDLESS.format(what))
        formulated = {}
        if aside:
            for number, cause in enumerate(causes):
                self.tell(
                    "Looking for formulas", _SEARCH + (1 - _SEARCH) * (0.3 + 0.7 * number / len(causes))
                )
                found = self._formula(causes, cause, after)
                if found is not None:
                    formulated[cause.pick] = found
        if formulated:
            machine = read_back(learned(self.machine, [self._told(cause, formulated) for cause in causes]))
        self.tell("Locating what was missed", _LOCATING)
        acts = [self._acts(cause.pick, cause.where) for cause in causes]
        places = {
            cause.pick: where_of(one, before.fitted, self.session.axis)
            for cause, one in zip(causes, acts, strict=True)
        }
        named = [one for cause, one in zip(causes, acts, strict=True) if cause.found.named]
        shown = (before.runs, after.runs) if aside else (before.fitted, after.fitted)
        driven = free_run.told(self.machine, machine, self.session) if causes else ()
        answer = Published(
            axis=self.session.axis,
            effort=self.session.effort,
            names=self._names(causes, formulated, places),
            curves=() if needless else self._curves(causes, formulated, places),
            runners_up=self._runners_up(),
            noise=self.weighed.noise,
            excess=self.outcome.grown.data.excess,
            proof=self._proof(before, after),
            overlays=overlays(*shown, named, aside),
            plain=self._plain([*(one for one in acts if one not in named), *self._of_motion()], after),
            machine=machine,
            notes=tuple(dict.fromkeys((*notes, *self._notes(causes), *unsaid, *self.weighed.notes, *driven))),
        )
        view = self.outcome.view
        answer = with_places(answer, before.fitted, after.fitted, view.ranges.band_hz)
        self.tell("Done", 1.0)
        return replace(answer, notes=(*answer.notes, *advice(answer, self.machine, view.ranges)))

    def _judged(self, causes: Sequence[_Cause]) -> tuple[Machine, Judged, Judged]:
        """The machine of these causes as a file has it; what the belief misses, and what that file does."""
        machine = (
            read_back(learned(self.machine, [cause.found for cause in causes])) if causes else self.machine
        )
        after = self._judged_as(machine)
        return machine, self._judged_as(self.machine) if causes else after, after

    def _judged_as(self, machine: Machine) -> Judged:
        """A machine on the runs kept aside, beside what was found of all that no file says."""
        return judged(self.outcome, smooth(machine), self.outcome.heldout, self.set)

    def _plain(self, curves: Sequence[Acts], after: Judged) -> Plain | None:
        """What comes near to all that is published without a name."""
        found = nearest(curves, self.search.data.candidates, after.fitted)
        if found is None:
            return None
        laws = {
            law: {key: Quantity(value, self._unit(law, key), None) for key, value in numbers.items()}
            for law, numbers in found.laws.items()
        }
        return Plain(laws, found.share)

    def _acts(self, pick: Pick, where: slice) -> Acts:
        candidate, shape = self.search.candidate(pick), self.search.data.atoms[pick.atom].shape
        return Acts(candidate.name, candidate, shape, self.set.exact[where])

    def _of_motion(self) -> list[Acts]:
        """What the one motion has of its own: a part of what laws come near to."""
        own = zip(self.set.picks, slices(self.search, self.set), strict=True)
        return [self._acts(pick, where) for pick, where in own if self.search.candidate(pick).of_motion]

    def _sayable(self) -> tuple[list[_Cause], tuple[str, ...]]:
        """The set's causes as far as a file can hold them, and a note for each other one.

        Without one the others are others: curves that cancelled it would be left alone.
        """
        of, notes = self.outcome.view.ranges, tuple[str, ...]()
        while True:
            every = self._causes()
            over = [self._over(cause) for cause in every]
            found = [cause.found for cause in every]
            kept, unsaid = sayable(self.machine, found, over, (of.low_rad, of.high_rad))
            notes = (*notes, *unsaid)
            if len(kept) == len(every):
                return every, notes
            self.set = self.search.score(tuple(every[i].pick for i in kept))

    def _over(self, cause: _Cause) -> str:
        return over_words(self.search.candidate(cause.pick).coordinate)

    def _set(self) -> Scored:
        """The most probable set without a parameter at its bound, without what does not hold elsewhere, and without
        changes that are no larger than is usual: so far what is believed stays.
        """
        shares = self.search.shares()  # tempered by what has no name, they would leave out what has none
        sound = (one for _, one in shares if all(self._publishable(one, pick) for pick in one.picks))
        best = next(sound, self.search.score(()))
        usual = {name for name, p in self.outcome.stands.usual.items() if p > NAMED}
        left_out = usual | self.outcome.refuted
        kept = tuple(pick for pick in best.picks if self.search.name(pick) not in left_out)
        return self.search.score(kept)

    def _publishable(self, of: Scored, pick: Pick) -> bool:
        """Whether a file can say a cause of a set, inside its bounds."""
        candidate = self.search.candidate(pick)
        told = candidate.named or candidate.coordinate in OVER or candidate.coordinate in PLANES
        return told and not at_bound(self.search, of, pick)

    def _causes(self) -> list[_Cause]:
        of, places = self.outcome.view.ranges, slices(self.search, self.set)
        result = []
        for pick, where in zip(self.set.picks, places, strict=True):
            if self.search.candidate(pick).of_motion:
                continue
            candidate, shape = self.search.candidate(pick), self.search.data.atoms[pick.atom].shape
            coefficients, found = self.set.exact[where], self.set.found
            curve = drawn(candidate, shape, coefficients, found.covariance[where, where], of)
            plane = None if candidate.named else drawn_plane(candidate, shape, coefficients, of)
            result.append(_Cause(pick, where, self._found(pick, where, curve, plane), curve, plane))
        return result

    def _found(self, pick: Pick, where: slice, curve: Drawn | None, plane: Plane | None) -> Found:
        candidate, shape = self.search.candidate(pick), self.search.data.atoms[pick.atom].shape
        p = (
            self.weighed.probability(candidate.name)
            if candidate.named
            else self._unnamed(candidate.coordinate)
        )
        named = candidate.named and p > NAMED
        beside = {"probability": round(float(p), 4)} if named or not candidate.named else {}
        sampled = None if curve is None else lambda: _residual(curve)
        if plane is not None:
            return Found("residual", False, plane.parameters(), beside)
        if not candidate.named:
            assert curve is not None
            return Found("residual", False, _residual(curve), beside, sampled)
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
            one.probability for one in self.weighed.unnamed if one.coordinate == coordinate and not one.like
        )
        return max(every, default=0.0)

    def _names(
        self,
        causes: Sequence[_Cause],
        formulated: Mapping[Pick, tuple[Formula, float]],
        places: Mapping[Pick, Where | None],
    ) -> tuple[Name, ...]:
        inside = {cause.found.law: cause for cause in causes if cause.found.law != "residual"}
        result = []
        for one in self.weighed.names:
            cause = inside.get(one.name)
            given: Mapping[str, Parameter] = one.parameters
            if cause is not None:
                told_values = parameters_of(self.search, self.set, cause.pick, cause.where)
                given = {key: _wider(value, given.get(key)) for key, value in told_values.items()}
            quantities = {
                key: Quantity(q.value, self._unit(one.name, key), (q.low, q.high)) for key, q in given.items()
            }
            if cause is not None and "table" in cause.found.parameters:
                rows = tuple(tuple(row) for row in cause.found.parameters["table"])
                unit = "N·m" if self.search.candidate(cause.pick).inertia is None else "kg·m²"
                quantities["table"] = Quantity(rows, unit_on(unit, self.session.axis), None)
            in_file = cause is not None and cause.found.named
            formula = formulated.get(cause.pick) if cause is not None else None
            text = formula[0].text if formula is not None else ""
            where = places.get(cause.pick) if cause is not None else None
            result.append(Name(one.name, one.probability, quantities, in_file, text, where))
        return tuple(result)

    def _unit(self, law: str, key: str) -> str:
        known = PHYSICS[law].get(key)
        unit = known.unit if known is not None else ""
        return unit if key == "phase_rad" else unit_on(unit, self.session.axis)

    def _curves(
        self,
        causes: Sequence[_Cause],
        formulated: Mapping[Pick, tuple[Formula, float]],
        places: Mapping[Pick, Where | None],
    ) -> tuple[Curve, ...]:
        by_name = {self.search.candidate(cause.pick).name: cause for cause in causes}
        result = []
        for one in self.weighed.unnamed:
            cause = by_name.get(one.like or one.coordinate)
            formula = formulated.get(cause.pick) if cause is not None else None
            over = one.coordinate
            unit = ", ".join(unit_on(_UNITS.get(part, ""), self.session.axis) for part in over.split(", "))
            in_file = cause is not None and not (one.like and cause.found.named)
            result.append(
                Curve(
                    over, unit, one.probability, one.torque_nm, one.like, in_file,
                    cause.curve if cause is not None else None,
                    formula[0].text if formula else "", formula[1] if formula else None,
                    cause.plane if cause is not None else None,
                    places.get(cause.pick) if cause is not None else None,
                )
            )  # fmt: skip
        return tuple(result)

    def _formula(
        self, causes: Sequence[_Cause], cause: _Cause, after: Judged
    ) -> tuple[Formula, float] | None:
        """The shortest formula that predicts the runs kept aside as well as the curve."""
        curve = cause.curve
        if curve is None or "table" not in cause.found.parameters:
            return None
        for formula, shape in formulas_of(curve):
            if self.outcome.view.work.late:
                break
            instead = Found("residual", False, _residual(shape), {})
            every = [instead if one is cause else one.found for one in causes]
            tried = self._judged_as(learned(self.machine, every))
            if as_good(tried, after):
                return formula, tried.missed
        return None

    def _told(self, cause: _Cause, formulated: Mapping[Pick, tuple[Formula, float]]) -> Found:
        """With its formula as a remark: what is simulated is the table."""
        had = {term.parameters.get("coordinate") for term in self.machine.physics}
        if (
            cause.found.law != "residual"
            or cause.pick not in formulated
            or cause.found.parameters.get("coordinate") in had
        ):
            return cause.found
        return replace(cause.found, beside={**cause.found.beside, "formula": formulated[cause.pick][0].text})

    def _runners_up(self) -> tuple[tuple[tuple[str, ...], float], ...]:
        # a curve counts to what has no name, beside which no set that holds it stands out
        bare = all(self.search.candidate(pick).named for pick in self.set.picks)
        by = self.outcome.sure if bare else self.search
        every = by.shares()
        return merged((tuple(by.candidate(pick).name for pick in one.picks), share) for share, one in every)

    def _proof(self, before: Judged, after: Judged) -> Proof | None:
        if not self.outcome.heldout:
            return None
        gain = float(np.sum(after.logs) - np.sum(before.logs)) / after.samples
        return Proof(
            runs=self.outcome.heldout, gain=gain, before=before.missed, after=after.missed,
            before_nm=before.missed_nm, after_nm=after.missed_nm, fitted=tuple(self.outcome.growth.train),
        )  # fmt: skip

    def _notes(self, causes: Sequence[_Cause]) -> list[str]:
        notes = []
        if self.outcome.view.work.late and any(cause.curve is not None for cause in causes):
            notes.append("formulas were looked for no further than the work that a session may cost")
        if not self.outcome.heldout:
            notes.append("no run could be kept aside, so that nothing is proven: record repeats")
        if not any(len(group) > 1 for group in self.outcome.view.repeats):
            repeated = any(len(group) > 1 for group in repeats(self.session))
            notes.append(
                "repeats are the same to the count, so that the noise is what no smooth curve explains"
                if repeated
                else "no motion was repeated, so that the noise is what no smooth curve explains: record repeats"
            )
        if any(self.search.candidate(pick).of_motion for pick in self.set.picks):
            notes.append(_OF_MOTION)
        notes += self._beyond_file(causes)
        if any(cause.found.law == "torque_filter" for cause in causes):
            notes.append(
                "torque_filter is of what the drive reports: simulations report it, exported models leave it out"
            )
        return notes

    def _beyond_file(self, causes: Sequence[_Cause]) -> list[str]:
        """What is found of the published causes and no file can say."""
        notes, unit = [], unit_on("N·m", self.session.axis)
        for cause in causes:
            candidate, atom = self.search.candidate(cause.pick), self.search.data.atoms[cause.pick.atom]
            if candidate.unsaid is not None:
                found, spread = self.set.exact[cause.where], self.set.found.spread[cause.where]
                words = candidate.unsaid(found, spread, atom.shape, unit)
                notes += [f"{candidate.name}: machine.toml cannot say {words}"] if words else []
        return notes


def _wider(one: Parameter, other: Parameter | None) -> Parameter:
    """A value with the wider of two intervals: how sure it is beside what has no name."""
    if other is None or other.high - other.low <= one.high - one.low:
        return one
    half = (other.high - other.low) / 2
    return Parameter(one.value, one.value - half, one.value + half)


def _residual(curve: Drawn) -> dict[str, Any]:
    """A curve as the file's `residual`."""
    columns = (
        [curve.x, curve.forward_nm]
        if curve.over in UNDIRECTED
        else [curve.x, curve.forward_nm, curve.backward_nm]
    )
    return {"coordinate": curve.over, "table": table(*columns)}
