"""What people get of the weighing: names with probabilities and units, curves without a name, the machine, the proof.

One machine is published: that of the most probable set none of whose parameters is at its bound. It is written, read
back, and what was read is what is proven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from schwung.drivetrain.effects import PHYSICS, Key
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.residual import UNITS
from schwung.explain.measured import smooth
from schwung.explain.plausibility import examine
from schwung.explain.publishing import free_run
from schwung.explain.publishing.advice import advice
from schwung.explain.publishing.chosen import Cause, Chosen, residual_of
from schwung.explain.publishing.drawn_formula import formulas_of
from schwung.explain.publishing.formula import Formula
from schwung.explain.publishing.judged import Judged, as_good, judged, surely_lost
from schwung.explain.publishing.learned import Found, learned
from schwung.explain.publishing.places import Acts, overlays, where_of, with_places
from schwung.explain.publishing.plainly import nearest
from schwung.explain.publishing.twin import as_missed_by
from schwung.explain.publishing.values import (
    LITTLE,
    PLAIN,
    Curve,
    Name,
    Plain,
    Proof,
    Published,
    Where,
    merged,
)
from schwung.explain.publishing.written import read_back
from schwung.explain.values import Quantity
from schwung.explain.weighing.growth import Progress
from schwung.explain.weighing.parameters import parameters_of
from schwung.explain.weighing.repeated import lasting
from schwung.explain.weighing.search import Pick, Search
from schwung.explain.weighing.values import Parameter, Weighed
from schwung.explain.weighing.weigh import Posterior, posterior_of
from schwung.explain.weighing.work import Work, on_one_thread
from schwung.explain.words import unit_on
from schwung.session.derived import speed_is_derived
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
_ASTRAY = (
    "driven by the recorded torque alone, with what was fitted over {} the machine goes as much further astray as it "
    "does without: it is not published"
)
_NEEDLESS = (
    "the belief predicts the runs kept aside as well without what was fitted over {}: it is not published"
)


def publish(
    session: Session,
    machine: Machine,
    *,
    twin: Session | None = None,
    progress: Progress | None = None,
    work: Work | None = None,
) -> Published:
    """Weigh what a belief leaves out of a session, and make of it what is published.

    `twin`: what a simulator did along the very runs, for which the machine stands in. `progress`: told what is being
    done, and the share that is done, 0…1. `work`: that may be done; None: the usual. Raises InputError where the
    session cannot be what it says (units, signs, wraps), or where the inertia is unknown.
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
        work=work,
        steady=doubts.steady,
    )
    notes = (*doubts.notes, _STEADY) if doubts.steady else doubts.notes
    return published_of(session, machine, outcome, notes, tell)


@on_one_thread
def published_of(
    session: Session,
    machine: Machine,
    outcome: Posterior,
    notes: Sequence[str] = (),
    tell: Progress = lambda _text, _share: None,
) -> Published:
    """What is published of a session that was weighed about a belief; `notes`: of the session."""
    return _Publishing(session, machine, outcome, tell).published(notes)


class _Publishing:
    """An outcome on its way to people."""

    def __init__(self, session: Session, machine: Machine, outcome: Posterior, tell: Progress) -> None:
        self.session, self.machine, self.outcome, self.tell = session, machine, outcome, tell
        self.weighed: Weighed = outcome.told
        self.search: Search = outcome.grown.search
        self.chosen = Chosen(machine, outcome)

    def published(self, notes: Sequence[str]) -> Published:
        """All of it."""
        self.tell("Writing the machine, and proving what was written", _SEARCH)
        causes, unsaid = self.chosen.sayable()
        machine, before, after = self._judged(causes)
        aside = self.outcome.heldout
        disproved = self._disproved(causes, surely_lost(after, before) if aside else 0.0)
        if disproved:
            outcome = replace(self.outcome, disproved=self.outcome.disproved | disproved)
            return _Publishing(self.session, self.machine, outcome, self.tell).published(notes)
        unnamed = [cause for cause in causes if not cause.found.named]
        needless = bool(unnamed and aside) and as_good(before, after)
        if needless:  # a name stands by its probability: runs kept aside may show nothing of it
            self.chosen.leave_out(unnamed)
            what = ", ".join(dict.fromkeys(map(self.chosen.over, unnamed)))
            causes, more = self.chosen.sayable()
            machine, before, after = self._judged(causes)
            unsaid = (*unsaid, *more, _NEEDLESS.format(what))
        elif unnamed:
            causes, machine, more = self._driven_freely(causes, machine)
            if more:
                after, unsaid = self._judged_as(machine), (*unsaid, *more)
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
        acts = [self.chosen.acts(cause.pick, cause.where) for cause in causes]
        places = {
            cause.pick: where_of(one, before.fitted, self.session.axis)
            for cause, one in zip(causes, acts, strict=True)
        }
        named = [one for cause, one in zip(causes, acts, strict=True) if cause.found.named]
        on_shafts = [one for one in acts if one not in named and one.candidate.coordinate != "wind_up"]
        shown = (before.runs, after.runs) if aside else (before.fitted, after.fitted)
        driven = free_run.told(self.machine, machine, self.session) if causes else ()
        answer = Published(
            axis=self.session.axis,
            effort=self.session.effort,
            names=self._names(causes, formulated, places),
            curves=self._curves(causes, formulated, places, needless),
            runners_up=self._runners_up(),
            noise=self.weighed.noise,
            excess=self.outcome.grown.data.excess,
            timing=self.weighed.timing,
            proof=self._proof(before, after),
            overlays=overlays(*shown, named, aside),
            plain=self._plain([*on_shafts, *self.chosen.of_motion()], after),
            machine=machine,
            lasting=lasting(self.session),
            missed_runs=_plainly_missed(before, after),
            notes=tuple(dict.fromkeys((*notes, *self._notes(causes), *unsaid, *self.weighed.notes, *driven))),
        )
        view = self.outcome.view
        answer = with_places(answer, before.fitted, after.fitted, view.ranges.band_hz)
        self.tell("Done", 1.0)
        return replace(answer, notes=(*answer.notes, *advice(answer, self.machine, view.ranges)))

    def _disproved(self, causes: Sequence[Cause], lost: float) -> frozenset[str]:
        """Names of a set by which the runs kept aside are surely less likely, by so much (log) that they take back all
        that speaks for them."""
        odds = lost / self.outcome.grown.data.excess
        named = (cause.found.law for cause in causes if cause.found.named)
        return frozenset(name for name in named if self.weighed.probability(name) < 1 / (1 + np.exp(-odds)))

    def _driven_freely(
        self, causes: list[Cause], machine: Machine
    ) -> tuple[list[Cause], Machine, tuple[str, ...]]:
        """Without curves by which the machine, driven by the recorded torque alone, goes as much further astray as it
        does without them; and what is to be told of that.

        Each makes the next sample likelier. Several that nearly cancel do so as well, and where they do not, at rest,
        drive the machine away; no run was kept aside that would show it.
        """
        off, notes = free_run.astray(machine, self.session), tuple[str, ...]()
        while True:
            whole, without = self.chosen.set, []
            for cause in (one for one in causes if not one.found.named):
                self.chosen.leave_out([cause])
                fewer, unsaid = self.chosen.sayable()
                other = read_back(learned(self.machine, [one.found for one in fewer]))
                less = free_run.astray(other, self.session)
                if 2 * less**2 < off**2:
                    note = _ASTRAY.format(self.chosen.over(cause))
                    without.append((self.chosen.set, fewer, other, less, (*unsaid, note)))
                self.chosen.set = whole
            if not without:
                return causes, machine, notes
            self.chosen.set, causes, machine, off, more = max(without, key=lambda one: one[0].log)
            notes += more

    def _judged(self, causes: Sequence[Cause]) -> tuple[Machine, Judged, Judged]:
        """The machine of these causes as a file has it; what the belief misses, and what that file does."""
        machine = (
            read_back(learned(self.machine, [cause.found for cause in causes])) if causes else self.machine
        )
        after = self._judged_as(machine)
        return machine, self._judged_as(self.machine) if causes else after, after

    def _judged_as(self, machine: Machine) -> Judged:
        """A machine on the runs kept aside, beside what was found of all that no file says."""
        return judged(self.outcome, smooth(machine), self.outcome.heldout, self.chosen.set)

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

    def _names(
        self,
        causes: Sequence[Cause],
        formulated: Mapping[Pick, tuple[Formula, float]],
        places: Mapping[Pick, Where | None],
    ) -> tuple[Name, ...]:
        inside = {cause.found.law: cause for cause in causes if cause.found.law != "residual"}
        result = []
        for one in self.weighed.names:
            cause = inside.get(one.name)
            given: Mapping[str, Parameter] = one.parameters
            if cause is not None:
                told_values = parameters_of(self.search, self.chosen.set, cause.pick, cause.where)
                given = {key: _wider(value, given.get(key)) for key, value in told_values.items()}
            quantities = {
                key: Quantity(q.value, self._unit(one.name, key), _possible(q, PHYSICS[one.name].get(key)))
                for key, q in given.items()
            }
            if cause is not None and "table" in cause.found.parameters:
                rows = tuple(tuple(row) for row in cause.found.parameters["table"])
                unit = "N·m" if self.search.candidate(cause.pick).inertia is None else "kg·m²"
                quantities["table"] = Quantity(rows, unit_on(unit, self.session.axis), None)
            in_file = cause is not None and cause.found.named
            formula = formulated.get(cause.pick) if cause is not None else None
            text = formula[0].text if formula is not None else ""
            where = places.get(cause.pick) if cause is not None else None
            # the phase of a hum is found in any run, but what it carried is not
            of = self.search.candidate(cause.pick) if cause is not None else None
            own = of is not None and of.each_run and of.heavier is not None
            result.append(Name(one.name, one.probability, quantities, in_file, text, where, own))
        return tuple(result)

    def _unit(self, law: str, key: str) -> str:
        known = PHYSICS[law].get(key)
        unit = known.unit if known is not None else ""
        return unit if key == "phase_rad" else unit_on(unit, self.session.axis)

    def _curves(
        self,
        causes: Sequence[Cause],
        formulated: Mapping[Pick, tuple[Formula, float]],
        places: Mapping[Pick, Where | None],
        needless: bool,
    ) -> tuple[Curve, ...]:
        """What is modelled without a name; where that is `needless`, what is left of it alone."""
        by_name = {self.search.name(cause.pick): cause for cause in causes}
        result = []
        for one in self.weighed.unnamed:
            name = one.like or one.coordinate
            if needless and name not in self.chosen.names:
                continue
            cause = by_name.get(name)
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

    def _formula(self, causes: Sequence[Cause], cause: Cause, after: Judged) -> tuple[Formula, float] | None:
        """The shortest formula that predicts the runs kept aside as well as the curve."""
        curve = cause.curve
        if curve is None or "table" not in cause.found.parameters:
            return None
        for formula, shape in formulas_of(curve):
            if self.outcome.view.work.late:
                break
            instead = Found("residual", False, residual_of(shape), {})
            every = [instead if one is cause else one.found for one in causes]
            tried = self._judged_as(learned(self.machine, every))
            if as_good(tried, after):
                return formula, tried.missed
        return None

    def _told(self, cause: Cause, formulated: Mapping[Pick, tuple[Formula, float]]) -> Found:
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
        bare = all(self.search.candidate(pick).named for pick in self.chosen.set.picks)
        by = self.outcome.sure if bare else self.search
        sets = ((tuple(by.candidate(pick).name for pick in one.picks), share) for share, one in by.shares())
        sets = (one for one in sets if self.outcome.disproved.isdisjoint(one[0]))
        # of a cause of which nothing is told no set holds anything
        return merged(([n for n in names if n not in self.outcome.left_out], share) for names, share in sets)

    def _proof(self, before: Judged, after: Judged) -> Proof | None:
        if not self.outcome.heldout:
            return None
        gain = float(np.sum(after.logs) - np.sum(before.logs)) / after.samples
        return Proof(
            runs=self.outcome.heldout, gain=gain, before=before.missed, after=after.missed,
            before_nm=before.missed_nm, after_nm=after.missed_nm, fitted=tuple(self.outcome.growth.rests.train),
        )  # fmt: skip

    def _notes(self, causes: Sequence[Cause]) -> list[str]:
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
        runs = self.session.runs
        if speed_is_derived(runs) and not any("speed_origin" in run.extra for run in runs):
            notes.append(
                "the drive makes the speed of the angle, whose errors it has: the angle alone was asked"
            )
        if any(self.search.candidate(pick).of_motion for pick in self.chosen.set.picks):
            notes.append(_OF_MOTION)
        notes += self._beyond_file(causes)
        if any(cause.found.law == "torque_filter" for cause in causes):
            notes.append(
                "torque_filter is of what the drive reports: simulations report it, exported models leave it out"
            )
        return notes

    def _beyond_file(self, causes: Sequence[Cause]) -> list[str]:
        """What is found of the published causes and no file can say."""
        notes, unit = [], unit_on("N·m", self.session.axis)
        for cause in causes:
            candidate, atom = self.search.candidate(cause.pick), self.search.data.atoms[cause.pick.atom]
            if candidate.unsaid is not None:
                found, spread = self.chosen.set.exact[cause.where], self.chosen.set.found.spread[cause.where]
                words = candidate.unsaid(found, spread, atom.shape, unit)
                notes += [f"{candidate.name}: machine.toml cannot say {words}"] if words else []
        return notes


def _plainly_missed(before: Judged, after: Judged) -> tuple[tuple[int, float], ...]:
    """Runs that were fitted in which a file plainly misses more than a little of what the belief does, and how (σ)."""
    pairs = zip(before.fitted, after.fitted, strict=True)
    left = [(now, LITTLE * (then.missed**2 - 1)) for then, now in pairs if now.missed > PLAIN]
    return tuple((now.run, now.missed) for now, little in left if now.missed**2 - 1 > little)


def _possible(one: Parameter, key: Key | None) -> tuple[float, float]:
    """An interval without what no machine has: below nothing, where a term cannot be, nothing is."""
    if key is None:
        return one.low, one.high
    least = 0.0 if key.lowest >= 0 else key.lowest
    return min(max(one.low, least), one.value), max(min(one.high, key.highest), one.value)


def _wider(one: Parameter, other: Parameter | None) -> Parameter:
    """A value with the wider of two intervals: how sure it is beside what has no name, and over all sets."""
    if other is None or other.high - other.low <= one.high - one.low:
        return one
    moved = one.value - other.value
    return Parameter(one.value, other.low + moved, other.high + moved)
