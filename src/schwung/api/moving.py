"""What moves a machine, from a program: planned and looked at first, asked before it moves, and every way out of the
procedure kept: limits, preflight, creep, quick stop, parameters put back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schwung import commissioning as procedure
from schwung import drivetrain
from schwung.api.drives import Connection
from schwung.api.folders import make_folder, planned_folder
from schwung.api.shown import Shown, as_shown, number
from schwung.api.values import Estimate, Machine, Session, estimate_shown, machine_shown, session_shown
from schwung.commissioning import Change, Check, ExportChoice, Observer, Wishes, wishes_of
from schwung.commissioning.commission import settings_of
from schwung.errors import InputError, RefusedError
from schwung.session import Run as RecordedRun

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "Commissioned",
    "Confirm",
    "Exported",
    "Plan",
    "Silent",
    "ask",
    "commission",
    "export",
    "plan",
    "plan_export",
    "wishes_of",
]

#: Asked before a machine moves or a drive is written to: gets the question, says whether to go on.
Confirm = Callable[[str], bool]


class Silent:
    """An observer that nobody listens to. Has no units, no shapes, raises nothing.

    >>> Silent().phase("Creep")
    """

    def phase(self, text: str) -> None:
        """What is done next."""

    def progress(self, done: int, total: int) -> None:
        """Samples done of all."""

    def note(self, text: str) -> None:
        """Something worth knowing."""


def ask(question: str) -> bool:
    """Ask whoever sits in front; anything but y or yes is a no. Raises RefusedError where nobody is there to answer."""
    try:
        answer = input(f"{question} [y/N] ")
    except (EOFError, OSError, NotImplementedError, RuntimeError):  # no terminal, no notebook
        raise RefusedError(
            "confirmation", f'"{question}" found nobody to answer', "Give confirm=, a function that answers."
        ) from None
    return answer.strip().lower() in ("y", "yes")


class Plan(Shown, procedure.Prepared):
    """Everything that is known before the power stage is switched on: what `commission` will do, and the checks of it.

    Attributes: `plan` (motion in rad and s, injection in N·m and Hz, `limits` in rad, rad/s and N·m), `checks` in words
    (`severity` "ok", "note", "warning" or "stop"), `can_start`, `preflight` (with the simulated motions, arrays (n,)),
    `machine`, `survey` (what the drive said), `wishes`.

    Raises RefusedError from `require()`, where a check says stop.

    >>> with schwung.connect("stepped", bench) as connection:
    ...     wishes = schwung.Wishes(distance_rad=3.14, duration_s=0.25)
    ...     made = schwung.plan(connection, schwung.example_machine(), wishes)
    >>> made.can_start, made.plan.excitation.frequency_hz
    (True, 50.0)
    """

    @property
    def checks(self) -> tuple[Check, ...]:
        """What preflight found."""
        return self.preflight.checks

    @property
    def can_start(self) -> bool:
        """Whether no check forbids the motion."""
        return not self.preflight.stops

    def require(self) -> None:
        """Raise RefusedError naming the first check that forbids the motion."""
        self.preflight.require()

    def rows(self) -> list[tuple[str, str]]:
        """The plan in words: motion, injection, recording, limits, and why."""
        plan = self.plan
        motion, excitation, limits = plan.motion, plan.excitation, plan.limits
        back = " and back" if motion.returns else ""
        times = ", then ".join(f"{m.duration_s * 1e3:g}" for m in (motion, *plan.slower))
        return [
            ("motion", f"{motion.kind} profile, {motion.distance_rad:.4g} rad in {times} ms{back}, "
                       f"from {plan.start_position_rad:.4g} rad"),
            ("injection", f"{excitation.amplitude_nm:.3g} N·m at {excitation.frequency_hz:g} Hz"),
            ("recording", f"{len(tuple(plan.runs()))} motions at {plan.recorded_rate_hz:g} Hz, "
                          f"{plan.way_text}, {plan.duration_s:.1f} s of bus time"),
            ("limits", f"{limits.position_min_rad:.4g} … {limits.position_max_rad:.4g} rad, "
                       f"{limits.speed_max_rad_s:.4g} rad/s, {limits.torque_max_nm:.4g} N·m, "
                       f"following error {limits.following_error_rad:.3g} rad"),
            *(("because", reason) for reason in plan.reasons),
        ]  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        """The plan and its checks, JSON-ready."""
        plan = self.plan
        return {
            "plan": {
                "motion": plan.motion.model_dump(),
                "excitation": plan.excitation.model_dump(),
                "repeats": plan.repeats,
                "phases": plan.phases,
                "also_s": [motion.duration_s for motion in plan.slower],
                "sample_rate_hz": plan.acquisition.sample_rate_hz,
                "duration_s": plan.duration_s,
                **settings_of(plan),
            },
            "preflight": [vars(check) for check in self.checks],
        }

    def _facts(self) -> Sequence[tuple[str, str]]:
        told = [
            (f"{c.severity}: {c.name}", f"{c.text}. {c.remedy}") for c in self.checks if c.severity != "ok"
        ]
        well = sum(1 for check in self.checks if check.severity == "ok")
        return [*self.rows(), *told, ("preflight", f"{well} of {len(self.checks)} checks are well")]

    def _draw(self, axes: Axes) -> None:
        from schwung.report.axes import draw_torques

        both = (("with injection", self.preflight.excited), ("without", self.preflight.reference))
        curves = tuple((label, s.time_s, s.torque_nm) for label, s in both)
        draw_torques(axes, curves, self.plan.limits.torque_max_nm)


class Commissioned(Shown, procedure.Commissioned):
    """What commissioning found.

    Attributes: `estimate` (with `table` in rad and kg·m², (n,), and `trust`), `session` (the runs, arrays (n,)),
    `machine` (the belief with the measured table in it), `session_path`, `folder`, `changes` (parameters that were
    changed, and are back), `prepared` (the plan as carried out), `reach` (what the recording allows at best, kg·m²).

    Raises what `commission` does.

    >>> done.estimate.trust.verdict, done.machine.load.trust
    ('good', 'good')
    """

    estimate: Estimate
    session: Session
    prepared: Plan

    @property
    def folder(self) -> Path:
        """Where session, table, machine and backups lie."""
        return self.session_path.parent

    @property
    def machine(self) -> Machine:
        """The belief with the measured inertia in the place of the guessed one."""
        believed = self.prepared.machine
        measured = {
            "inertia_kgm2": None,
            "inertia_table": self.estimate.table,
            "trust": self.estimate.trust.verdict,
        }
        return machine_shown(believed.model_copy(update={"load": believed.load.model_copy(update=measured)}))

    def _facts(self) -> Sequence[tuple[str, str]]:
        return [*self.estimate._facts(), ("session", str(self.session_path))]

    def _draw(self, axes: Axes) -> None:
        self.estimate._draw(axes)

    def _columns(self) -> Mapping[str, Any]:
        return self.estimate._columns()


@dataclass(frozen=True)
class Exported(Shown, procedure.Exported):
    """What was written into a drive, and what that did to the same motion.

    Attributes: `changes` (parameters with old and new raw value), `backup_path` (for `schwung restore`), `stored`,
    `before` and `after` (the reference motion, arrays (n,); None: not made), `before_rms_rad` and `after_rms_rad` (RMS
    following error, rad).

    Raises what `export` does.

    >>> written.before_rms_rad > 5 * written.after_rms_rad
    True
    """

    before: RecordedRun | None = None
    after: RecordedRun | None = None

    @property
    def before_rms_rad(self) -> float | None:
        """RMS following error before (rad)."""
        return None if self.before is None else procedure.following_error_rms(self.before)

    @property
    def after_rms_rad(self) -> float | None:
        """RMS following error after (rad)."""
        return None if self.after is None else procedure.following_error_rms(self.after)

    @property
    def improvement(self) -> float | None:
        """How many times smaller the following error has become."""
        before, after = self.before_rms_rad, self.after_rms_rad
        return before / after if before and after else None

    def to_json(self) -> dict[str, Any]:
        """Everything but the samples, JSON-ready."""
        return {
            "parameters": len(self.changes),
            "stored": self.stored,
            "backup": str(self.backup_path),
            "following_error_rms_before_rad": self.before_rms_rad,
            "following_error_rms_after_rad": self.after_rms_rad,
            "improvement": self.improvement,
        }

    def _facts(self) -> Sequence[tuple[str, str]]:
        times = self.improvement
        return [
            ("written", f"{len(self.changes)} parameters{', stored' if self.stored else ''}"),
            ("old values", str(self.backup_path)),
            *((("following error", f"{number(times)} times smaller"),) if times else ()),
        ]

    def _columns(self) -> Mapping[str, Any]:
        return {
            "parameter": [change.parameter.label for change in self.changes],
            "old": [change.old for change in self.changes],
            "new": [change.new for change in self.changes],
        }


def plan(connection: Connection, machine: drivetrain.Machine, wishes: Wishes) -> Plan:
    """Plan a commissioning from where the axis stands, and check it. Reads the drive; changes and moves nothing.

    Args:
        connection: as `connect` yields it.
        machine: the belief; gains that the drive can tell are the drive's.
        wishes: stroke (rad), time (s), limits (rad, rad/s, N·m) and so on; what is None is proposed.

    Returns what `commission` would do, the motions as simulated (arrays (n,)) and the checks. Look at it.
    Raises InputError where limits or beliefs are missing or a wish cannot be fulfilled, DriveError where the drive
    fails.

    >>> with schwung.connect("stepped", bench) as connection:
    ...     wishes = schwung.Wishes(distance_rad=3.14, duration_s=0.25)
    ...     made = schwung.plan(connection, schwung.example_machine(), wishes)
    >>> made.rows()[1]
    ('injection', '46.6 N·m at 50 Hz')
    """
    return as_shown(Plan, procedure.prepare(connection.drive, connection.profile, machine, wishes))


def commission(
    connection: Connection,
    plan: Plan,
    out: str | Path | None = None,
    *,
    confirm: Confirm = ask,
    observer: Observer | None = None,
) -> Commissioned:
    """Carry out a plan: the machine moves, without and with the injected torque, and the load inertia is estimated.

    Drive and axis are looked at again first: where the axis has been moved meanwhile, the plan is refused. Whatever
    happens then (an exception, Ctrl-C, a lost node), the drive is stopped and switched off by its own means, and its
    parameters are put back. Every motion is on disk before the next one starts.

    Args:
        connection: the one that the plan was made with.
        plan: as `plan` returned it, and as you have looked at it.
        out: folder for session.h5, inertia.csv and measured.toml, which must not hold a session; None: schwung-<time>.
        confirm: gets the question whether the machine may move; default: asks whoever sits in front.
        observer: told phases, samples done and notes.

    Returns table (rad, kg·m², (n,)), verdict, session and the machine as measured.
    Raises RefusedError before anything moves where a check says stop, the answer is no, nobody answers, or the axis was
    moved; after the creep where it does not prove signs and units; DriveError or InterruptedByUser after the drive has
    been stopped; InputError where the folder cannot be written, or the recording allows no estimate (it is kept).

    >>> with schwung.connect("stepped", bench) as connection:
    ...     wishes = schwung.Wishes(distance_rad=3.14, duration_s=0.25)
    ...     made = schwung.plan(connection, schwung.example_machine(), wishes)
    ...     schwung.commission(connection, made, folder / "refused", confirm=lambda question: False)
    Traceback (most recent call last):
    schwung.errors.RefusedError: commission: you said no. Nothing was changed, nothing moved.
    """
    plan.require()
    folder = planned_folder(None if out is None else Path(out))
    _agreed(
        confirm, "commission", "The machine will move. Is it clear?", "Nothing was changed, nothing moved."
    )
    current = as_shown(Plan, procedure.renewed(connection.drive, connection.profile, plan))
    current.require()
    make_folder(folder)
    watching = observer or Silent()
    found = procedure.carry_out(connection.drive, current, folder, watching, current.max_jitter_share)
    done = as_shown(
        Commissioned,
        found,
        estimate=estimate_shown(found.estimate),
        session=session_shown(found.session),
        prepared=current,
    )
    drivetrain.write_inertia_csv(done.estimate.table, folder / "inertia.csv")
    drivetrain.write_machine(done.machine, folder / "measured.toml")
    return done


def plan_export(
    connection: Connection,
    table: drivetrain.InertiaTable,
    form: str | ExportChoice = "table",
    *,
    machine: drivetrain.Machine | None = None,
) -> tuple[Change, ...]:
    """What `export` would write: parameters with the raw values that they have, and would get. Changes nothing.

    Args:
        connection: as `connect` yields it.
        table: rad and kg·m², (n,).
        form: "table", "harmonics", "mean", "max" or "at=1.57" (rad).
        machine: for drives that want motor and load in one number.

    Raises InputError where the drive's profile has no such target, or a value does not fit it.

    >>> with schwung.connect("stepped", bench) as connection:
    ...     [change.new for change in schwung.plan_export(connection, table, "mean")][:1]
    [2250000]
    """
    motor = None if machine is None else machine.motor.inertia_kgm2
    values = procedure.export_values(
        connection.drive.parameter, connection.profile, table, _choice(form),
        read=connection.drive.read, motor_inertia_kgm2=motor,
    )  # fmt: skip
    return tuple(Change(v.parameter, connection.drive.read(v.parameter).raw, v.raw, when="") for v in values)


def export(
    connection: Connection,
    found: Commissioned | drivetrain.InertiaTable,
    form: str | ExportChoice = "table",
    out: str | Path | None = None,
    *,
    machine: drivetrain.Machine | None = None,
    verify: Plan | None = None,
    store: bool = True,
    confirm: Confirm = ask,
    observer: Observer | None = None,
) -> Exported:
    """Write an inertia table into the drive: written, read back, compared, stored; the old values are backed up first.

    Args:
        connection: as `connect` yields it.
        found: what `commission` returned, or a table (rad, kg·m², (n,)).
        form: "table", "harmonics", "mean", "max", "at=1.57" (rad), or "host": nothing is written, the torque is played.
        out: folder for export.backup.json; None: where the commissioning lies, else schwung-<time>.
        machine: with a table alone: for drives that want motor and load in one number.
        verify: with a table alone: a plan whose reference motion is made before and after. A commissioning is verified
            by its own.
        store: in the drive's memory (1010), to last beyond power-off.
        confirm: gets the question whether to write and to move; default: asks whoever sits in front.
        observer: told phases, samples done and notes.

    Returns what was written and the following error (rad) before and after.
    Raises RefusedError where the table is unusable, the answer is no, or the drive is on; InputError as `plan_export`;
    DriveError where a value reads back otherwise, and the old ones have been put back.

    >>> with schwung.connect("stepped", bench) as connection:
    ...     len(schwung.export(connection, table, "mean", folder / "export", confirm=lambda question: True).changes)
    2
    """
    choice, watching = _choice(form), observer or Silent()
    before: RecordedRun | None = None
    if isinstance(found, Commissioned):
        if found.estimate.trust.verdict == "unusable":
            raise RefusedError("export", "an unusable table does not go into a drive", "Measure again.")
        table: drivetrain.InertiaTable = found.estimate.table
        machine, verify, before = found.prepared.machine, found.prepared, found.recorded.runs[0]
        folder = found.folder if out is None else Path(out)
    else:
        table, folder = found, planned_folder(None if out is None else Path(out))
    motor = None if machine is None else machine.motor.inertia_kgm2
    if choice.form == "host" and (verify is None or motor is None):
        raise InputError("host", "writes nothing: the torque is played beside the setpoints",
                         "Export what commission returned.")  # fmt: skip
    if verify is not None:
        verify.require()
    question = "Write these parameters, and move the machine?" if verify else "Write these parameters?"
    _agreed(confirm, "export", question, "Nothing was written, nothing moved.")
    make_folder(folder)
    drive, backup, played = connection.drive, folder / "export.backup.json", None
    if verify is not None:
        verify = as_shown(Plan, procedure.renewed(drive, connection.profile, verify, estimates=False))
        verify.require()
        if before is None:
            before = procedure.repeat_reference(drive, verify, folder, "before", watching)
    if choice.form == "host" and verify is not None and motor is not None:
        played = procedure.host_played(connection.profile, table, motor, verify.plan.acquisition.mode)
        written = procedure.Exported((), backup, stored=False)
    else:
        watching.phase("Writing the parameters")
        written = procedure.export_table(
            drive,
            connection.profile,
            table,
            choice,
            backup_path=backup,
            store=store,
            motor_inertia_kgm2=motor,
        )
    after = None
    if verify is not None:
        name = "verification" if isinstance(found, Commissioned) else "after"
        procedure.await_rest(drive)
        verify = as_shown(Plan, procedure.renewed(drive, connection.profile, verify, estimates=False))
        verify.require()
        after = procedure.repeat_reference(drive, verify, folder, name, watching, played)
    return Exported(written.changes, written.backup_path, written.stored, before, after)


def _choice(form: str | ExportChoice) -> ExportChoice:
    return procedure.parse_choice(form) if isinstance(form, str) else form


def _agreed(confirm: Confirm, place: str, question: str, nothing: str) -> None:
    """Raise RefusedError where the answer is anything but yes."""
    if not confirm(question):
        raise RefusedError(place, "you said no", nothing)
