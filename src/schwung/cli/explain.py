"""`schwung explain`: which physics the belief leaves out, found in a recorded session."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import Json

if TYPE_CHECKING:
    from schwung.cli.console import Terminal
    from schwung.explain.values import Explanation
    from schwung.session import Session
    from schwung.simulators.belief import FmuBelief

_COLOURS = {
    "consistent": "green",
    "explained": "green",
    "partly_explained": "yellow",
    "unexplained": "red",
}


def explain(
    session: Annotated[Path, typer.Argument(help="The recorded session, *.h5.")],
    machine: Annotated[
        Path | None,
        typer.Option("-m", "--machine", help="What is believed about the machine: machine.toml."),
    ] = None,
    belief: Annotated[
        Path | None, typer.Option(metavar="FMU", help="Your own simulator as the belief: an FMU, FMI 2 or 3.")
    ] = None,
    mapped: Annotated[
        Path | None, typer.Option("--map", metavar="TOML", help="Which variables of the FMU are which.")
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for explanation.json, explanation.html and the learned machine.toml.")
    ] = Path("explanation"),
    json_output: Json = False,
) -> None:
    """Locate where a recording departs from the belief, name the physics left out, and prove it on runs kept aside.

    The machine.toml that it writes has the named physics in it: use it in place of the one given.

    [bold]Examples[/]

      schwung explain session.h5 -m machine.toml

      schwung explain session.h5 -m machine.toml --out monday --json

      schwung explain session.h5 --belief model.fmu --map map.toml
    """
    from schwung.api.folders import make_folder, planned_folder
    from schwung.cli.console import Terminal, json_text, progress_bar
    from schwung.cli.sessions import in_file
    from schwung.commissioning.bode import with_recorded_gains
    from schwung.drivetrain import load_machine, write_machine
    from schwung.errors import InputError
    from schwung.explain.explain import explain as explain_session
    from schwung.files import replace_file
    from schwung.report.explanation import ExplanationContent, write_explanation
    from schwung.session import read_session

    terminal = Terminal(json_output)
    if (machine is None) == (belief is None):
        raise InputError(
            "schwung explain", "needs one belief", "Give -m machine.toml, or --belief model.fmu."
        )
    recorded = read_session(session)
    given = load_machine(machine) if machine is not None else None
    folder = planned_folder(out, beside_session=True)
    learned = folder / "machine.toml"
    _keep_beliefs(learned, machine)
    with in_file(session), progress_bar(terminal) as progress:
        if given is not None:
            believed = with_recorded_gains(given, recorded)
            found = explain_session(recorded, believed, progress=progress)
        else:
            measured = _measured(recorded, belief, mapped, lambda text, share: progress(text, 0.5 * share))
            believed = with_recorded_gains(measured.machine, recorded)
            found = explain_session(
                recorded,
                believed,
                twin=measured.twin,
                progress=lambda text, share: progress(text, 0.5 + 0.5 * share),
            )
            found = replace(found, notes=(*found.notes, *measured.notes))
    make_folder(folder)
    document = found.to_json() | {"session": str(session), "machine": str(machine or belief)}
    replace_file(folder / "explanation.json", json_text(document))
    write_machine(found.machine, learned)
    content = ExplanationContent(
        title=f"{believed.name}: what the belief leaves out",
        explanation=found,
        believed=believed,
        session=recorded,
        machine_file=learned.read_text(encoding="utf-8"),
    )
    write_explanation(content, folder / "explanation.html")
    _tell(terminal, found)
    terminal.say(f"Explanation: [bold]{folder / 'explanation.html'}[/]  Learned machine: [bold]{learned}[/]")
    terminal.result(document)


def _measured(
    session: Session, belief: Path | None, mapped: Path | None, progress: Callable[[str, float], None]
) -> FmuBelief:
    """The FMU as it was played along the session."""
    from schwung.errors import InputError
    from schwung.simulators.belief import fmu_belief

    assert belief is not None
    if mapped is None:
        remedy = "Give --map map.toml: which of the FMU's variables are torque, position and speed."
        raise InputError("--belief", "is of no use without a map", remedy)
    return fmu_belief(session, belief, mapped, progress=progress)


def _keep_beliefs(learned: Path, machine: Path | None) -> None:
    """Raise InputError where the learned machine would take the place of the given one, or of a stranger's."""
    from schwung.errors import InputError

    same = machine is not None and learned.exists() and learned.samefile(machine)
    if learned.exists() and (same or not learned.with_name("explanation.json").exists()):
        raise InputError(str(learned), "is a machine file that would be lost", "Choose another --out.")


def _tell(terminal: Terminal, found: Explanation) -> None:
    """Verdict, findings, proof and notes for people."""
    from rich.markup import escape

    from schwung.report.content import LINEAR, ROTARY
    from schwung.report.explanation import finding_row, headline, runs_text, separations

    linear = found.axis == "linear"
    unit = (LINEAR if linear else ROTARY).torque
    words = found.verdict.replace("_", " ")
    terminal.say(f"[bold {_COLOURS[found.verdict]}]{words}[/]: {escape(headline(found))}")
    if found.findings:
        rows = [
            (name, parameters, where.partition("\n")[0], others)
            for name, parameters, where, others in (finding_row(f, linear=linear) for f in found.findings)
        ]
        terminal.table("Left out", ("physics", "parameters (95 %)", "where", "could as well be"), rows)
    error = [("belief", found.fit.before.torque_rmse_nm)]
    error += [("belief + physics", found.fit.after.torque_rmse_nm)] if found.findings else []
    error += [("noise floor", found.noise_floor.torque_nm)]
    head = (f"on runs {runs_text(found.fit.heldout_runs)}, kept aside", f"RMS, {unit}")
    terminal.table("Error", head, [(name, f"{value:.3g}") for name, value in error])
    for note in dict.fromkeys((*separations(found), *found.notes)):
        terminal.say(f"[cyan]i[/] {escape(note)}")
