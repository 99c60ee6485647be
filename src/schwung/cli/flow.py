"""Commissioning as a command shows it: checks, question, progress, verdict, export, report. Shared with the demo."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from schwung import Commissioned, Connection, Exported, Machine, Plan, Wishes, commission, export, plan
from schwung.api.choices import ExportChoice
from schwung.api.moving import Confirm
from schwung.api.reports import Standard, deviation, write_results
from schwung.cli.console import Terminal, describe_shown, describe_table, observing
from schwung.errors import RefusedError


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
    standard: Standard = field(
        default_factory=Standard
    )  # what the curve is held against, where something better is known


def plan_and_show(terminal: Terminal, connection: Connection, machine: Machine, wishes: Wishes) -> Plan:
    """The plan, shown. Raises PreflightRefusedError, with the plan, where it may not be carried out."""
    planned = plan(connection, machine, wishes)
    show_plan(terminal, planned)
    try:
        planned.require()
    except RefusedError as refusal:
        raise PreflightRefusedError(refusal, planned.to_json()) from None
    return planned


def commission_and_show(
    connection: Connection,
    machine: Machine,
    wishes: Wishes,
    out: Path,
    terminal: Terminal,
    confirm: Confirm,
    ending: Ending,
    dry_run: bool = False,
) -> dict[str, Any]:
    """The whole story on a terminal; returns the machine-readable result.

    Raises RefusedError where preflight or the user say no, and what the procedure raises.
    """
    planned = plan_and_show(terminal, connection, machine, wishes)
    if dry_run:
        terminal.say("Dry run: nothing was changed, nothing moved.")
        return planned.to_json()
    with observing(terminal) as observer:
        done = commission(connection, planned, out, confirm=confirm, observer=observer)
    show_estimate(terminal, done, ending)
    exported, refused = None, {}
    if ending.export is not None and done.estimate.trust.verdict == "unusable":
        terminal.say("[yellow]Not exported:[/] an unusable table does not go into a drive.")
        refused = {"export": {"refused": "an unusable table does not go into a drive"}}
    elif ending.export is not None:
        with observing(terminal) as observer:
            exported = export(
                connection, done, ending.export, store=ending.store, observer=observer,
                confirm=lambda _question: True,  # it was asked for with the motion
            )  # fmt: skip
        show_export(terminal, exported)
    result = write_results(done, ending.standard, exported) | refused
    terminal.say(f"Report: [bold]{out / 'report.html'}[/]")
    explain = f"schwung explain {done.session_path} -m {out / 'measured.toml'} --out {out / 'explanation'}"
    terminal.say(f"What the machine has beyond inertia, coupling and viscous friction: [bold]{explain}[/]")
    return result


def finish(terminal: Terminal, result: Mapping[str, Any]) -> None:
    """Print the result for machines; end with the code of a refusal where a wished export was not made."""
    terminal.result(result)
    if "refused" in result.get("export", {}):
        sys.exit(RefusedError.exit_code)


def show_export(terminal: Terminal, exported: Exported) -> None:
    """What was written, and what it did to the following error."""
    if exported.changes:
        terminal.say(
            f"{len(exported.changes)} parameters written, read back equal"
            f"{', stored' if exported.stored else ''}; the old values are in [bold]{exported.backup_path}[/]"
        )
    else:
        terminal.say("Nothing is written: the torque is played beside the setpoints, one value per SYNC")
    before, after = exported.before_rms_rad, exported.after_rms_rad
    if before and after:
        terminal.say(
            f"Following error RMS: {before * 1e3:.3f} mrad before, {after * 1e3:.3f} mrad after the export, "
            f"[bold]{before / after:.1f}[/] times smaller"
        )


def show_plan(terminal: Terminal, planned: Plan) -> None:
    """Plan and preflight as people read them."""
    terminal.table("Plan", ("", ""), planned.rows())
    terminal.checks((c.name, c.severity, c.text, c.remedy) for c in planned.checks)


def show_estimate(terminal: Terminal, done: Commissioned, ending: Ending) -> None:
    """The curve in numbers, and the verdict."""
    table, trust = done.estimate.table, done.estimate.trust
    terminal.say(describe_table(table, done.session.axis))
    off = deviation(table, ending.standard.table)
    if off is not None:
        former = deviation(done.contrast.table, ending.standard.table) if done.contrast else None
        against = f", former method {former.rmse_kgm2:.4f}" if former else ""
        terminal.say(
            f"Against the {ending.standard.label}: RMSE [bold]{off.rmse_kgm2:.2g}[/] kg·m², "
            f"largest {off.max_kgm2:.2g}{against}"
        )
    if done.reach is not None:
        terminal.say(done.reach.text)
    if done.estimate.shown:
        terminal.say(describe_shown(done.estimate.shown))
    terminal.verdict(trust.verdict, "; ".join(trust.reasons))
