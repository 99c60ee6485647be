"""Commissioning until it is explained: record, weigh, choose the next motion, record that, and so on.

Every motion is made by the very procedure that a commissioning is: planned from where the axis stands, checked, proven
by a creep, recorded, and the drive left off and as it was. While the session is weighed nothing is switched on.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from schwung.commissioning.commission import Prepared, prepare, record_prepared
from schwung.commissioning.experiments import SURE, Experiment, Setting, faint, next_experiments, told_apart
from schwung.commissioning.procedure import Observer
from schwung.errors import InputError, InterruptedByUser, RefusedError, SchwungError
from schwung.explain.kept_aside import kept_aside
from schwung.explain.plausibility import examine
from schwung.explain.weighing.experiment import Rival, Rivals
from schwung.explain.weighing.values import Weighed
from schwung.explain.weighing.weigh import posterior_of
from schwung.fieldbus.drive import Drive
from schwung.fieldbus.profile import DeviceProfile
from schwung.session import Run, Session, read_session
from schwung.session.writing import write_session

#: Motions beyond the first plan, unless somebody says otherwise; one experiment takes two.
BUDGET, LEAST_BUDGET = 12, 2
#: Experiments that preflight refuses before the next best is not looked at any more.
_REFUSALS = 5


@dataclass(frozen=True)
class Step:
    """One experiment that was made, and what is likely after it."""

    experiment: Experiment
    after: tuple[Rival, ...]


@dataclass(frozen=True, eq=False)
class UntilExplained:
    """All that was recorded, in one session, what it says, and why it ended."""

    session_path: Path
    session: Session
    weighed: Weighed
    rivals: tuple[Rival, ...]
    steps: tuple[Step, ...]
    ended: str

    @property
    def sure(self) -> bool:
        """Whether one set of names has 95 %, and so has each of its names beside what has none."""
        return self.rivals[0].probability >= SURE and not faint(self.weighed, self.rivals)


def require_budget(budget: int) -> None:
    """Raise InputError for a budget that no experiment fits in."""
    if budget < LEAST_BUDGET:
        raise InputError(
            "--budget",
            f"is {budget}; a motion is made without and with the injected torque",
            f"Give {LEAST_BUDGET} motions or more.",
        )


def record_until_explained(
    drive: Drive,
    profile: DeviceProfile,
    prepared: Prepared,
    out: Path,
    observer: Observer,
    budget: int = BUDGET,
    agreed: Callable[[Prepared, Experiment], bool] = lambda _prepared, _experiment: True,
) -> UntilExplained:
    """Carry out a plan and then the motions that tell most, `budget` of them (runs) at most.

    `agreed`: asked before each further motion; where it says no, that is the end. The session of all motions lies in
    `out`, each recording beside it. Raises as `record` does; what was recorded until then is in the session.
    """
    require_budget(budget)
    journey = _Journey(drive, profile, out, observer)
    try:
        return journey.go(prepared, budget, agreed)
    except KeyboardInterrupt as error:  # while nothing is switched on: the procedure makes its own of it
        raise InterruptedByUser(
            "interrupted", f"nothing was moving; {len(journey.runs)} motions are in {journey.path}"
        ) from error


@dataclass(eq=False)
class _Journey:
    drive: Drive
    profile: DeviceProfile
    out: Path
    observer: Observer
    runs: tuple[Run, ...] = ()
    first: Session | None = None
    recordings: int = 0

    @property
    def path(self) -> Path:
        """Of the session of all motions."""
        return self.out / "session.h5"

    def go(
        self, prepared: Prepared, budget: int, agreed: Callable[[Prepared, Experiment], bool]
    ) -> UntilExplained:
        self.record(prepared)
        aside = kept_aside(self.session)  # stays aside: what is recorded later is there to be fitted
        setting, steps, ended = _setting(prepared), list[Step](), ""
        while True:
            self.observer.phase(f"Weighing {len(self.runs)} motions")
            steady = examine(self.session, prepared.machine).steady
            posterior = posterior_of(self.session, prepared.machine, aside, steady=steady)
            rivals = Rivals.of(posterior)
            if steps:
                steps[-1] = replace(steps[-1], after=rivals.rivals)
            self.observer.note(told_apart(rivals.rivals))
            if rivals.best >= SURE:
                weak = faint(posterior.told, rivals.rivals)
                ended = f"one answer leads, but {weak}" if weak else "one answer has 95 %"
                break
            left = budget - sum(step.experiment.motions for step in steps)
            if left < LEAST_BUDGET:
                ended = f"the budget of {budget} motions is spent"
                break
            self.observer.phase("Choosing the next motion")
            found = self.allowed(next_experiments(rivals, setting), prepared)
            if found is None:
                ended = "no motion within the limits would tell more"
                break
            planned, experiment = found
            self.observer.note(experiment.sentence)
            if not agreed(planned, experiment):
                ended = "you said no to the next motion"
                break
            self.record(planned)
            steps.append(Step(experiment, ()))
        return UntilExplained(self.path, self.session, posterior.told, rivals.rivals, tuple(steps), ended)

    @property
    def session(self) -> Session:
        """All motions so far."""
        assert self.first is not None
        return replace(self.first, runs=self.runs)

    def allowed(
        self, experiments: list[Experiment], prepared: Prepared
    ) -> tuple[Prepared, Experiment] | None:
        """The best experiment that preflight lets pass, planned for the drive.

        Raises InputError or RefusedError where it refuses all.
        """
        refused: SchwungError | None = None
        for experiment in experiments[:_REFUSALS]:
            wishes = replace(
                prepared.wishes,
                distance_rad=experiment.wishes.distance_rad,
                duration_s=experiment.wishes.duration_s,
                frequency_hz=experiment.wishes.frequency_hz,
                amplitude_nm=experiment.wishes.amplitude_nm,
                repeats=experiment.wishes.repeats,
                phases=1,
                also_s=(),
                because=(experiment.sentence,),
            )
            try:
                planned = prepare(self.drive, self.profile, prepared.machine, wishes)
                planned.preflight.require()
            except (InputError, RefusedError) as error:
                self.observer.note(f"not made: {error}")
                refused = error
                continue
            return planned, experiment
        if refused is not None:
            raise refused
        return None

    def record(self, prepared: Prepared) -> None:
        """Record a plan in a folder of its own, and add its motions to the session, however it ends."""
        folder = self.out / f"{self.recordings:02d}"
        folder.mkdir(parents=True, exist_ok=False)
        self.recordings += 1
        recorded = folder / "session.h5"
        try:
            record_prepared(self.drive, prepared, folder, self.observer, prepared.max_jitter_share)
        except BaseException as error:
            with suppress(SchwungError):
                self.keep(recorded)
            error.add_note(f"{len(self.runs)} motions in all are in {self.path}")
            raise
        self.keep(recorded)

    def keep(self, recorded: Path) -> None:
        """Add what was recorded; runs that repeat an earlier one are counted on."""
        session = read_session(recorded)
        self.first = self.first or session
        for run in session.runs:
            same = [one for one in self.runs if (one.role, one.motion) == (run.role, run.motion)]
            self.runs = (*self.runs, replace(run, repeat=len(same)))
        write_session(self.session, self.path, overwrite=True)


def _setting(prepared: Prepared) -> Setting:
    """Where the next motions are looked for: within the limits of the first plan, from where it starts."""
    plan = prepared.plan
    done = replace(
        prepared.wishes,
        sample_rate_hz=plan.grid_rate_hz,
        frequency_hz=plan.excitation.frequency_hz,
        amplitude_nm=plan.excitation.amplitude_nm,
        returns=plan.motion.returns,
        repeats=1,
        phases=1,
        also_s=(),
    )
    return Setting(
        done,
        plan.limits,
        plan.start_position_rad,
        prepared.machine,
        torque_held=plan.excitation.hold_s is not None,
        feed_forward=prepared.feed_forward,
    )
