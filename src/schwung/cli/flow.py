"""Commissioning as a command shows it: checks, question, progress, verdict, export, report. Shared with the demo."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schwung.api.folders import make_folder
from schwung.cli.console import Terminal, describe_table, observing
from schwung.cli.sessions import change_row, following
from schwung.commissioning import (
    Commissioned,
    ExportChoice,
    Exported,
    Plan,
    Prepared,
    Wishes,
    carry_out,
    export_table,
    following_error_rms,
    host_played,
    prepare,
    repeat_reference,
)
from schwung.commissioning.commission import settings_of
from schwung.drivetrain import InertiaTable, Machine, write_inertia_csv, write_machine
from schwung.errors import RefusedError
from schwung.fieldbus.drive import Drive
from schwung.fieldbus.profile import DeviceProfile
from schwung.files import json_text, replace_file
from schwung.report import ReportContent, SyncRow, write_report
from schwung.report.content import deviation
from schwung.session import Run


class PreflightRefusedError(RefusedError):
    """Preflight said no; `document` holds plan and checks for machines."""

    def __init__(self, refusal: RefusedError, document: Mapping[str, Any]) -> None:
        super().__init__(refusal.place, refusal.problem, refusal.remedy)
        self.document = document


@dataclass(frozen=True)
class Ending:
    """What shall happen after the estimate."""

    export: ExportChoice | None = None
    store: bool = True
    reference: InertiaTable | None = None  # what the curve is held against, where something better is known
    reference_label: str = "believed"


@dataclass(frozen=True, eq=False)
class Verification:
    """The same motion before and after the export."""

    exported: Exported
    before: Run
    after: Run

    @property
    def before_rms_rad(self) -> float | None:
        """RMS following error before (rad)."""
        return following_error_rms(self.before)

    @property
    def after_rms_rad(self) -> float | None:
        """RMS following error after (rad)."""
        return following_error_rms(self.after)


def commission_and_show(
    drive: Drive,
    profile: DeviceProfile,
    machine: Machine,
    wishes: Wishes,
    out: Path,
    terminal: Terminal,
    confirm: Callable[[str], bool],
    ending: Ending,
    dry_run: bool = False,
) -> dict[str, Any]:
    """The whole story on a terminal; returns the machine-readable result.

    Raises RefusedError where preflight or the user say no, and what the procedure raises.
    """
    prepared = prepare(drive, profile, machine, wishes)
    show_plan(terminal, prepared)
    result: dict[str, Any] = {
        "plan": _plan(prepared.plan),
        "preflight": [vars(check) for check in prepared.preflight.checks],
    }
    try:
        prepared.preflight.require()
    except RefusedError as refusal:
        raise PreflightRefusedError(refusal, result) from None
    if dry_run:
        terminal.say("Dry run: nothing was changed, nothing moved.")
        return result
    if not confirm("The machine will move. Is it clear?"):
        raise RefusedError("commission", "you said no", "Nothing was changed, nothing moved.")
    make_folder(out)
    with observing(terminal) as observer:
        done = carry_out(drive, prepared, out, observer, wishes.max_jitter_share)
    write_inertia_csv(done.estimate.table, out / "inertia.csv")
    write_machine(_as_measured(done), out / "measured.toml")
    show_estimate(terminal, done, ending)
    verification = None
    if ending.export is not None:
        verification = _export_and_verify(drive, profile, done, ending, out, terminal)
    content = report_content(done, ending, verification)
    write_report(content, out / "report.html")
    result |= _summary(done, ending, verification, out)
    replace_file(out / "estimate.json", json_text(result))
    terminal.say(f"Report: [bold]{out / 'report.html'}[/]")
    explain = f"schwung explain {done.session_path} -m {out / 'measured.toml'} --out {out / 'explanation'}"
    terminal.say(f"What the machine has beyond inertia, coupling and viscous friction: [bold]{explain}[/]")
    return result


def _as_measured(done: Commissioned) -> Machine:
    """The belief with the measured inertia in the place of the guessed one."""
    machine = done.prepared.machine
    load = machine.load.model_copy(
        update={
            "inertia_kgm2": None,
            "inertia_table": done.estimate.table,
            "trust": done.estimate.trust.verdict,
        }
    )
    return machine.model_copy(update={"load": load})


def finish(terminal: Terminal, result: Mapping[str, Any]) -> None:
    """Print the result for machines; end with the code of a refusal where a wished export was not made."""
    terminal.result(result)
    if "refused" in result.get("export", {}):
        sys.exit(RefusedError.exit_code)


def _export_and_verify(
    drive: Drive, profile: DeviceProfile, done: Commissioned, ending: Ending, out: Path, terminal: Terminal
) -> Verification | None:
    assert ending.export is not None
    if done.estimate.trust.verdict == "unusable":
        terminal.say("[yellow]Not exported:[/] an unusable table does not go into a drive.")
        return None
    backup, motor = out / "export.backup.json", done.prepared.machine.motor.inertia_kgm2
    played = None
    if ending.export.form == "host":
        played = host_played(profile, done.estimate.table, motor, done.prepared.plan.acquisition.mode)
        exported = Exported((), backup, stored=False)
        terminal.say("Nothing is written: the torque is played beside the setpoints, one value per SYNC")
    else:
        exported = export_table(
            drive, profile, done.estimate.table, ending.export,
            backup_path=backup, store=ending.store, motor_inertia_kgm2=motor,
        )  # fmt: skip
        terminal.say(
            f"{len(exported.changes)} parameters written, read back equal"
            f"{', stored' if exported.stored else ''}; the old values are in {exported.backup_path}"
        )
    with observing(terminal) as observer:
        after = repeat_reference(drive, done.prepared, out, "verification", observer, played)
    verification = Verification(exported, done.recorded.runs[0], after)
    show_verification(terminal, verification)
    return verification


def show_verification(terminal: Terminal, verification: Verification) -> None:
    """What the export did to the following error."""
    before_rms, after_rms = verification.before_rms_rad, verification.after_rms_rad
    if before_rms and after_rms:
        terminal.say(
            f"Following error RMS: {before_rms * 1e3:.3f} mrad before, {after_rms * 1e3:.3f} mrad after the export, "
            f"[bold]{before_rms / after_rms:.1f}[/] times smaller"
        )


def show_plan(terminal: Terminal, prepared: Prepared) -> None:
    """Plan and preflight as people read them."""
    plan = prepared.plan
    motion, excitation, limits = plan.motion, plan.excitation, plan.limits
    back = " and back" if motion.returns else ""
    times = ", then ".join(f"{m.duration_s * 1e3:g}" for m in (motion, *plan.slower))
    terminal.table(
        "Plan",
        ("", ""),
        (
            ("motion", f"{motion.kind} profile, {motion.distance_rad:.4g} rad in {times} ms{back}, "
                       f"from {plan.start_position_rad:.4g} rad"),
            ("injection", f"{excitation.amplitude_nm:.3g} N·m at {excitation.frequency_hz:g} Hz"),
            ("recording", f"{len(tuple(plan.runs()))} motions at {plan.recorded_rate_hz:g} Hz, "
                          f"{plan.way_text}, {plan.duration_s:.1f} s of bus time"),
            ("limits", f"{limits.position_min_rad:.4g} … {limits.position_max_rad:.4g} rad, "
                       f"{limits.speed_max_rad_s:.4g} rad/s, {limits.torque_max_nm:.4g} N·m, "
                       f"following error {limits.following_error_rad:.3g} rad"),
            *(("because", reason) for reason in plan.reasons),
        ),
    )  # fmt: skip
    terminal.checks((c.name, c.severity, c.text, c.remedy) for c in prepared.preflight.checks)


def show_estimate(terminal: Terminal, done: Commissioned, ending: Ending) -> None:
    """The curve in numbers, and the verdict."""
    table, trust = done.estimate.table, done.estimate.trust
    terminal.say(describe_table(table, done.session.axis))
    off = deviation(table, ending.reference)
    if off is not None:
        former = deviation(done.contrast.table, ending.reference) if done.contrast else None
        against = f", former method {former.rmse_kgm2:.4f}" if former else ""
        terminal.say(
            f"Against the {ending.reference_label}: RMSE [bold]{off.rmse_kgm2:.2g}[/] kg·m², "
            f"largest {off.max_kgm2:.2g}{against}"
        )
    if done.reach is not None:
        terminal.say(done.reach.text)
    terminal.verdict(trust.verdict, "; ".join(trust.reasons))


def report_content(done: Commissioned, ending: Ending, verification: Verification | None) -> ReportContent:
    """Everything that the report shows of a commissioning."""
    prepared, plan = done.prepared, done.prepared.plan
    rows = [change_row(change, "put back") for change in done.changes]
    if verification is not None:
        rows += [change_row(change, "exported, read back equal") for change in verification.exported.changes]
    return ReportContent(
        title=f"{prepared.machine.name}: load inertia over angle",
        session=done.session,
        machine=prepared.machine,
        estimate=done.estimate,
        reach=done.reach,
        contrast=done.contrast,
        reference=ending.reference,
        reference_label=ending.reference_label,
        preflight=prepared.preflight.checks,
        changes=rows,
        following_error=following(verification.before, verification.after) if verification else None,
        sync=[
            SyncRow(f"run {number:04d}", t.producer, t.period_s, t.rms_s, t.p99_s, t.max_s)
            for number, t in enumerate(done.recorded.timing)
        ],
        settings={
            "speed taken from": prepared.preflight.speed_source,
            "motions made again because of lost samples": str(done.recorded.retries),
        },
        notes=[*plan.reasons, *done.estimate.notes],
    )


def _summary(
    done: Commissioned, ending: Ending, verification: Verification | None, out: Path
) -> dict[str, Any]:
    off = deviation(done.estimate.table, ending.reference)
    former = deviation(done.contrast.table, ending.reference) if done.contrast else None
    summary: dict[str, Any] = {
        "estimate": done.estimate.to_json(),
        "reach": done.reach and done.reach.to_json(),
        "reference": ending.reference_label if off else None,
        "rmse_kgm2": off.rmse_kgm2 if off else None,
        "max_error_kgm2": off.max_kgm2 if off else None,
        "former_rmse_kgm2": former.rmse_kgm2 if former else None,
        "files": {
            "session": str(done.session_path),
            "inertia": str(out / "inertia.csv"),
            "machine": str(out / "measured.toml"),
            "report": str(out / "report.html"),
        },
    }
    if verification is not None:
        summary["export"] = export_summary(verification)
    elif ending.export is not None:
        summary["export"] = {"refused": "an unusable table does not go into a drive"}
    return summary


def _plan(plan: Plan) -> dict[str, Any]:
    """The plan for machines."""
    return {
        "motion": plan.motion.model_dump(),
        "excitation": plan.excitation.model_dump(),
        "repeats": plan.repeats,
        "phases": plan.phases,
        "also_s": [motion.duration_s for motion in plan.slower],
        "sample_rate_hz": plan.acquisition.sample_rate_hz,
        "duration_s": plan.duration_s,
        **settings_of(plan),
    }


def export_summary(verification: Verification) -> dict[str, Any]:
    """An export and its effect, for machines."""
    before, after = verification.before_rms_rad, verification.after_rms_rad
    return {
        "parameters": len(verification.exported.changes),
        "stored": verification.exported.stored,
        "backup": str(verification.exported.backup_path),
        "following_error_rms_before_rad": before,
        "following_error_rms_after_rad": after,
        "improvement": before / after if before and after else None,
    }
