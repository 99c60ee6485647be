"""`schwung explain --next` and `schwung commission --until-explained`, as the terminal shows them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from schwung import Connection, Machine, Session, Wishes
    from schwung.cli.console import Terminal


def next_and_show(terminal: Terminal, session: Session, machine: Machine, path: Path) -> dict[str, Any]:
    """Choose the next motion, say what it separates, write its plan; returns it for machines."""
    from rich.markup import escape

    from schwung.api.experiments import next_motion

    terminal.say("Choosing the next motion …")
    found = next_motion(session, machine)
    terminal.say(f"Next motion: {escape(found.sentence)}")
    document = found.to_json()
    if found.experiment is None:
        return document
    wishes = found.experiment.wishes
    found.write(path)
    terminal.say(
        f"{wishes.distance_rad:.4g} rad in {wishes.duration_s * 1e3:.4g} ms from "
        f"{found.setting.start_position_rad:.4g} rad, {wishes.amplitude_nm:.3g} N·m injected at "
        f"{wishes.frequency_hz:.4g} Hz. Make it: [bold]schwung commission -m … --plan {path}[/]"
    )
    return document | {"plan": str(path)}


def until_explained_and_show(
    connection: Connection,
    machine: Machine,
    wishes: Wishes,
    out: Path,
    terminal: Terminal,
    confirm: Callable[[str], bool],
    budget: int,
    dry_run: bool = False,
) -> dict[str, Any]:
    """The whole story on a terminal; returns the machine-readable result. Raises as `commission_and_show`."""
    from rich.markup import escape

    from schwung.api.experiments import commission_until_explained, require_budget, until_explained_json
    from schwung.cli.console import observing
    from schwung.cli.flow import plan_and_show

    require_budget(budget)
    planned = plan_and_show(terminal, connection, machine, wishes)
    if dry_run:
        terminal.say("Dry run: nothing was changed, nothing moved.")
        return planned.to_json()
    with observing(terminal) as observer:
        found = commission_until_explained(
            connection, planned, out, budget=budget, confirm=confirm, observer=observer
        )
    document = until_explained_json(found)
    rows = [
        (
            str(number),
            f"{step.experiment.wishes.distance_rad:.3g} rad, {step.experiment.wishes.duration_s * 1e3:.4g} ms",
            step.experiment.sentence,
            " / ".join(
                f"{' and '.join(one.names) or 'nothing'} {one.probability:.2f}" for one in step.after[:2]
            ),
        )
        for number, step in enumerate(found.steps, start=1)
    ]
    if rows:
        terminal.table("Further motions", ("", "stroke", "separates", "then"), rows)
    answer = found.rivals[0]
    terminal.say(
        f"{escape(' and '.join(answer.names) or 'nothing is left out')}: [bold]{answer.probability:.2f}[/] "
        f"after {len(found.session.runs)} motions; {escape(found.ended)}"
    )
    terminal.say(f"Session: [bold]{found.session_path}[/]")
    return document
