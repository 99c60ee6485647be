"""`schwung explain`: which physics the belief leaves out, found in a recorded session."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import Json

if TYPE_CHECKING:
    from schwung import Explanation
    from schwung.cli.console import Terminal

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
    next_plan: Annotated[
        Path | None,
        typer.Option(
            "--next",
            metavar="PLAN",
            help="Choose the motion that best tells apart what is still confused, within the session's limits, and "
            "write it there, for schwung commission --plan.",
        ),
    ] = None,
    json_output: Json = False,
) -> None:
    """Locate where a recording departs from the belief, name the physics left out, and prove it on runs kept aside.

    The machine.toml that it writes has the named physics in it: use it in place of the one given.

    [bold]Examples[/]

      schwung explain session.h5 -m machine.toml

      schwung explain session.h5 -m machine.toml --out monday --json

      schwung explain session.h5 --belief model.fmu --map map.toml

      schwung explain session.h5 -m machine.toml --next next.json
    """
    from schwung import load_machine, read_session
    from schwung.api.computing import explain as explain_session
    from schwung.api.folders import make_folder, planned_folder
    from schwung.api.reports import write_explanation
    from schwung.api.simulators import explain_against
    from schwung.cli.console import Terminal, progress_bar
    from schwung.cli.next_motion import next_and_show
    from schwung.cli.sessions import in_file
    from schwung.errors import InputError
    from schwung.files import json_text, replace_file
    from schwung.quantities import document_of, sentences_of

    terminal = Terminal(json_output)
    if (machine is None) == (belief is None):
        raise InputError(
            "schwung explain", "needs one belief", "Give -m machine.toml, or --belief model.fmu."
        )
    if next_plan is not None and machine is None:
        raise InputError(
            "--next", "simulates the motion, which an FMU's belief cannot", "Give -m machine.toml."
        )
    recorded = read_session(session)
    believed = load_machine(machine) if machine is not None else None
    terminal.tell_slow()
    folder = planned_folder(out, beside_session=True)
    learned = folder / "machine.toml"
    _keep_beliefs(learned, machine)
    with in_file(session), progress_bar(terminal) as progress:
        if believed is not None:
            found = explain_session(recorded, believed, progress=progress)
        else:
            against = explain_against(recorded, *_with_map(belief, mapped), progress=progress)
            found, believed = against.explanation, against.stand_in
    make_folder(folder)
    words = sentences_of(recorded.effort)
    document = document_of(recorded.effort, found.to_json()) | {
        "session": str(session),
        "machine": str(machine or belief),
    }
    replace_file(folder / "explanation.json", json_text(document))
    write_explanation(found, recorded, believed, folder)
    _tell(terminal, found, words)
    terminal.say(f"Explanation: [bold]{folder / 'explanation.html'}[/]  Learned machine: [bold]{learned}[/]")
    if next_plan is not None:
        document["next"] = next_and_show(terminal, recorded, believed, next_plan)
    terminal.result(document)


def _with_map(belief: Path | None, mapped: Path | None) -> tuple[Path, Path]:
    """The FMU and its map. Raises InputError where there is no map."""
    from schwung.errors import InputError

    assert belief is not None
    if mapped is None:
        remedy = "Give --map map.toml: which of the FMU's variables are torque, position and speed."
        raise InputError("--belief", "is of no use without a map", remedy)
    return belief, mapped


def _keep_beliefs(learned: Path, machine: Path | None) -> None:
    """Raise InputError where the learned machine would take the place of the given one, or of a stranger's."""
    from schwung.errors import InputError

    same = machine is not None and learned.exists() and learned.samefile(machine)
    if learned.exists() and (same or not learned.with_name("explanation.json").exists()):
        raise InputError(str(learned), "is a machine file that would be lost", "Choose another --out.")


def _tell(terminal: Terminal, found: Explanation, words_in: Callable[[str], str]) -> None:
    """Verdict, findings, proof and notes for people."""
    from rich.markup import escape

    words = found.verdict.replace("_", " ")
    terminal.say(f"[bold {_COLOURS[found.verdict]}]{words}[/]: {escape(words_in(found.headline))}")
    if found.findings:
        rows = [
            (name, words_in(given), words_in(where.partition("\n")[0]), others)
            for name, given, where, others in found.rows()
        ]
        terminal.table("Left out", ("physics", "parameters (95 %)", "where", "could as well be"), rows)
    missed = found.missed()
    head = (f"on runs {missed.runs}, kept aside", words_in(f"RMS, {missed.unit}"))
    terminal.table("Error", head, [(name, f"{value:.3g}") for name, value in missed.rows])
    for note in found.cautions():
        terminal.say(f"[cyan]i[/] {escape(words_in(note))}")
