"""Session and belief -> explanation: what is missed, where, which physics, how sure, and the proof."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from schwung.drivetrain.machine import Machine
from schwung.explain import free_run, naming
from schwung.explain.choice import AT_FLOOR, SEEN, WORSE, missed, needed, searched
from schwung.explain.fit import TIMING, Fitted, Model, Problem
from schwung.explain.intervals import parameters
from schwung.explain.kept_aside import Split, split
from schwung.explain.location import Residual, locate
from schwung.explain.measured import measured
from schwung.explain.noise import whitener
from schwung.explain.plausibility import examine
from schwung.explain.proof import misfit, missed_nm, remainder, usable
from schwung.explain.residual import Residuals, Unknowns
from schwung.explain.scale import scale_note
from schwung.explain.search import CONSISTENT, Found, Progress, reduced
from schwung.explain.sharpened import sharpened
from schwung.explain.signals import Prepared, prepare, prepare_twin
from schwung.explain.timing import Shift, Times, shift
from schwung.explain.values import (
    Explanation,
    Finding,
    HeldOut,
    Located,
    NoiseFloor,
    Verdict,
)
from schwung.session.effort import require_alike
from schwung.session.model import Session

#: RMS over the floor: explained up to the first (on the runs kept aside for the proof), at the floor for all that a
#: floor from few repeats is worth up to the second (on those that check what was chosen, like all that follows); named
#: beyond that where the excess falls below the third's share of what it was.
EXPLAINED, NEARLY, NAMED_SHARE = 1.2, 1.35, 0.02
#: The same where the believed inertia was measured: what a table is off by bends with every term that turns it.
NAMED_SHARE_MEASURED = 0.05
#: Beyond the floor's neighbourhood the torque's own excess falls below this share, too, slow as it may be.
SLOW_SHARE = 0.1
#: In whitened residuals, which weigh what is slow less, the floor's share is another: so many floors RMS are too much.
TOO_MUCH = 1.6
#: Where unseen runs miss something, named physics takes so much of it.
SEEN_ASIDE = 0.5
#: A proof in which more is left than this proves nothing.
HARDLY = 0.75
#: Where the floor is not reached, what several terms carry beyond each other sums up to this part of the mismatch.
TOGETHER = 0.2
#: What every axis has, and what long strokes at one speed cannot tell apart from each other well.
USUAL = ("coulomb_friction", "asymmetric_friction", "viscous_friction", "cogging")

#: What shows in nothing but acceleration; a session without much of that can name none of them.
OF_ACCELERATION = (
    "load_inertia", "inertia_profile_shift", "torque_constant", "torque_lag", "measurement_delay", "coupling_stiffness",
    "coupling_damping", "nonlinear_stiffness", "backlash", "extra_compliance",
)  # fmt: skip


def explain(
    session: Session, machine: Machine, *, twin: Session | None = None, progress: Progress | None = None
) -> Explanation:
    """Say what the belief leaves out of a recorded session.

    `twin`: what a simulator did along the very runs, sample for sample, for which the machine stands in: what the
    machine misses of the twin is not missed of the recording, so that the simulator is what is judged. `progress`: told
    what is being done, and the share that is done, 0…1. Raises InputError where the session cannot be
    what it says (units, signs, wraps), or has nothing that could be compared.
    """
    tell = progress or (lambda _text, _share: None)
    tell("Looking at the recordings", 0.0)
    require_alike(session, machine)
    doubts = examine(session, machine)
    doubts.require(session.source or "session")
    curve = measured(machine)
    believed = machine if curve is None else curve.machine
    parts = split(session)
    prepared = prepare(session, believed, parts.seen)
    parts = usable(parts, prepared)
    tell("Simulating the belief (at its first use it is compiled)", 0.02)
    residuals = Residuals(prepared, believed)
    if twin is not None:
        residuals.take_off(prepare_twin(twin, prepared))
    numbers = range(len(session.runs))
    noise = whitener(prepared, believed, residuals.all(numbers, Unknowns()), parts.seen)
    if curve is not None:
        residuals.soften(curve, noise.torque_nm)
    problem = Problem(residuals, noise, parts.train)
    tell("Trying physics terms", 0.05)
    found, best = searched(problem, parts, lambda text, share: tell(text, 0.05 + 0.6 * share))
    found, best = sharpened(found, best, believed, parts.seen)
    slim = needed(found, best)
    if slim is not best:
        found, best = sharpened(found, slim, believed, parts.seen)
    tell("Weighing alternatives", 0.7)
    told = _Explained(session, machine, prepared, parts, residuals, found, best).result(
        tell, doubts.notes, noise.how
    )
    return _half_tested(told, machine) if "inertia_undetermined" in doubts.kinds() else told


def _half_tested(told: Explanation, machine: Machine) -> Explanation:
    """An explanation of a session that never accelerates enough: it neither confirms the inertia nor refutes it."""
    note = (
        "whatever is named here holds for the steady part of the motion alone: no inertia, scale of the torque, lag or "
        "coupling can be judged by this session"
    )
    notes = (*told.notes, note)
    if any(finding.physics in OF_ACCELERATION for finding in told.findings):
        fit = replace(told.fit, after=told.fit.before)
        return replace(told, verdict="unexplained", findings=(), fit=fit, machine=machine, notes=notes)
    verdict: Verdict = "partly_explained" if told.verdict == "explained" else told.verdict
    return replace(told, verdict=verdict, notes=notes)


def _share(before: float, after: float) -> float:
    """What is left of a mean square beyond the noise's own."""
    return (after - 1) / max(before - 1, 1e-9)


class _Explained:
    """The search's outcome on its way to an explanation."""

    def __init__(
        self,
        session: Session,
        machine: Machine,
        prepared: Prepared,
        parts: Split,
        residuals: Residuals,
        found: Found,
        best: Fitted,
    ) -> None:
        self.session, self.machine, self.prepared = session, machine, prepared
        self.parts, self.residuals, self.found, self.best = parts, residuals, found, best
        self.judged = parts.heldout or parts.train
        self.floor = found.problem.whitener.torque_nm

    def result(self, tell: Progress, notes: tuple[str, ...], how: str) -> Explanation:
        """All of it."""
        best, bare = self.best, self.found.bare
        moved = self._shift()
        late = (
            -bare.model.unknowns.timing_s
            if moved.name is None
            else self.prepared.speed_delay_s - moved.seconds
        )
        before = misfit(self.session, self.residuals, self.judged, bare.model, late)
        after = misfit(self.session, self.residuals, self.judged, best.told, self.prepared.speed_delay_s)
        verdict = self._verdict(before.torque_rmse_nm, after.torque_rmse_nm, moved)
        findings: tuple[Finding, ...] = ()
        if verdict in ("explained", "partly_explained"):
            tell("Intervals of the parameters", 0.75)
            findings = self._findings(moved)
            if verdict == "partly_explained" and self._only_together(findings, after.torque_rmse_nm):
                verdict, findings = "unexplained", ()
        model = best.told if findings else bare.model
        if not findings:
            after = before
        tell("Locating what was missed", 0.9)
        left = (
            locate(self._residuals(model), self.session.axis)
            if verdict not in ("consistent", "explained")
            else ()
        )
        mismatch = self._mismatch(findings, verdict)
        learned = naming.learned(self.machine, findings)
        driven = free_run.told(self.machine, learned, self.session) if findings else ()
        tell("Done", 1.0)
        return Explanation(
            verdict=verdict,
            axis=self.session.axis,
            noise_floor=NoiseFloor(self.floor, how),
            mismatch=mismatch,
            findings=findings,
            fit=HeldOut(self.parts.seen, self.parts.heldout, before, after),
            machine=learned,
            overlays=naming.overlays(self.residuals, self.parts, bare.model, model),
            notes=tuple(
                dict.fromkeys((*notes, *self._notes(moved, verdict), *self._scales(findings), *driven))
            ),
            remainder=left,
        )

    def _verdict(self, before_nm: float, after_nm: float, moved: Shift) -> Verdict:
        """By the runs kept aside; with a wrong name worse than none."""
        bare, best = self.found.bare, self.best
        if not best.model.terms:
            if bare.misfit > CONSISTENT or before_nm > NEARLY * self.floor:
                return "unexplained"
            return "explained" if moved.name else "consistent"
        return self._of_terms(before_nm, after_nm)

    def _of_terms(self, before_nm: float, after_nm: float) -> Verdict:
        """What the named terms are worth: whether they may be named the seen runs say, how good they are the others."""
        if not self._nameable():
            return "unexplained"
        bare, best, problem = self.found.bare, self.best, self.found.problem
        before, after = (missed(problem, fitted.told, self.judged) for fitted in (bare, best))
        if after > WORSE * before or self._left(before_nm, after_nm) > HARDLY:
            return "unexplained"
        shown = before >= AT_FLOOR
        explained = after_nm <= EXPLAINED * self.floor and (not shown or _share(before, after) <= SEEN_ASIDE)
        return "explained" if explained else "partly_explained"

    def _nameable(self) -> bool:
        """Whether the terms take enough of the mismatch for their names to be told."""
        bare, best, problem = self.found.bare, self.best, self.found.problem
        runs = self.parts.check or self.parts.train
        before, after = (missed(problem, fitted.told, runs) for fitted in (bare, best))
        if before < AT_FLOOR:  # the runs that check it do not show it
            if after > WORSE * before:
                return False
            before, after = bare.misfit, best.misfit
        share, everywhere = _share(before, after), _share(bare.misfit, best.misfit)
        before_nm, after_nm = (missed_nm(self.residuals, runs, fitted.told) for fitted in (bare, best))
        if self._left(before_nm, after_nm) > SEEN_ASIDE:
            return False
        fitted_nm = missed_nm(self.residuals, self.parts.train, best.told)
        at_floor = max(fitted_nm, after_nm) <= NEARLY * self.floor or (
            after <= NEARLY**2 and max(fitted_nm, after_nm) <= TOO_MUCH * self.floor
        )
        little = NAMED_SHARE_MEASURED if self.residuals.softened else NAMED_SHARE
        return (at_floor and share < SEEN_ASIDE) or (
            max(share, everywhere) < little and self._left(before_nm, after_nm) < SLOW_SHARE
        )

    def _left(self, before_nm: float, after_nm: float) -> float:
        """What is left of a torque's mean square beyond the noise's; 0 where the belief misses nothing that shows."""
        if before_nm <= SEEN * self.floor:
            return 0.0
        return _share((before_nm / self.floor) ** 2, (after_nm / self.floor) ** 2)

    def _only_together(self, findings: tuple[Finding, ...], after_nm: float) -> bool:
        """Whether several terms stand in for a shape that the library lacks: none can be spared, none carries much."""
        alone = sum(finding.where.share_of_energy for finding in findings)
        usual = all(finding.physics in USUAL for finding in findings)
        return len(findings) > 1 and not usual and alone < TOGETHER and after_nm > NEARLY * self.floor

    def _shift(self) -> Shift:
        """Late speed or torque, judged about the best model."""
        best = self.best
        names = best.model.names
        spread = np.sqrt(np.maximum(np.diag(best.covariance()), 0.0))
        lag = best.model.effects.torque_lag_s
        lag_spread = float(spread[names.index("torque_lag_s")]) if "torque_lag_s" in names else 0.0
        timing_spread = float(spread[names.index(TIMING)])
        times = Times(best.model.value(TIMING), timing_spread, lag, lag_spread, best.misfit)
        return shift(self.prepared, self.machine, times)

    def _scales(self, findings: tuple[Finding, ...]) -> tuple[str, ...]:
        note = scale_note(self.found, self.best) if findings and self.best.model.terms else None
        return (note,) if note else ()

    def _findings(self, moved: Shift) -> tuple[Finding, ...]:
        best, found = self.best, self.found
        spared = reduced(found, best) if best.model.terms else []
        named = []
        for term, without in zip(best.model.terms, spared, strict=True):
            gain = (without.chi2 - best.chi2) / found.level
            p_value = float(chi2_distribution.sf(gain, len(parameters(term))))
            share = min(1.0, (without.misfit - best.misfit) / max(found.bare.misfit - 1.0, 1e-300))
            named.append(
                naming.finding(
                    self.session.axis, found, best, term, max(share, 0.0), p_value, self.parts.train
                )
            )
        if moved.name and moved.name not in best.model.terms:
            named.append(
                naming.late(self.session.axis, self.prepared, moved, self.residuals, self.parts.train)
            )
        return tuple(sorted(named, key=lambda one: -one.where.share_of_energy))

    def _mismatch(self, findings: tuple[Finding, ...], verdict: Verdict) -> tuple[Located, ...]:
        """Where the belief misses: by the named physics first, then what the recording itself shows."""
        if verdict == "consistent":
            return ()
        named = {finding.where.coordinate: finding.where for finding in reversed(findings)}
        listed = sorted(named.values(), key=lambda one: -one.share_of_energy)
        lost = verdict == "unexplained"
        shown = (
            locate(self._residuals(self.found.bare.model), self.session.axis, surely=not lost)
            if lost or self.found.bare.misfit > CONSISTENT
            else ()
        )
        return (*listed, *(one for one in shown if one.coordinate not in named))

    def _residuals(self, model: Model) -> list[Residual]:
        """What a model misses in the runs that may be looked at."""
        result = []
        for number in self.parts.train:
            run, every = self.prepared.runs[number], self.prepared.every
            at = slice(None, None, every)
            result.append(
                Residual(
                    run=number,
                    rate_hz=self.prepared.rate_hz / every,
                    time_in_motion_s=run.motion_time_s[at],
                    position_rad=run.position_rad[at],
                    speed_rad_s=run.speed_rad_s[at],
                    acceleration_rad_s2=run.acceleration_rad_s2[at],
                    torque_nm=run.torque_nm[at],
                    residual_nm=remainder(self.residuals, number, model),
                    considered=self.residuals.valid(number),
                    noise_nm=self.floor,
                    repeat_of=run.group,
                )
            )
        return result

    def _notes(self, moved: Shift, verdict: Verdict) -> list[str]:
        notes = [moved.note] if moved.note else []
        constant = self.machine.load.inertia_table is None and self.session.axis == "rotary"
        if constant and verdict == "unexplained":
            notes.append(
                "the load inertia is believed to be alike at all angles; where it is not, everything else drowns in "
                "that: measure it first (schwung commission writes measured.toml)"
            )
        if not self.parts.heldout:
            notes.append(
                "no run could be kept aside, so that the fit is not proven: record more runs, of two motion times"
            )
        else:
            notes.append(f"kept aside for the proof: {self.parts.how}")
        return notes
