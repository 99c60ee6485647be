"""`schwung explain`: which physics the belief leaves out, found in a recorded session."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import Json, Machine

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
    machine: Machine,
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
    """
    from schwung import load_machine, read_session
    from schwung.api.computing import explain as explain_session
    from schwung.api.folders import make_folder, planned_folder
    from schwung.api.reports import write_explanation
    from schwung.cli.console import Terminal, progress_bar
    from schwung.cli.sessions import in_file
    from schwung.files import json_text, replace_file
    from schwung.quantities import document_of, sentences_of

    terminal = Terminal(json_output)
    recorded, believed = read_session(session), load_machine(machine)
    folder = planned_folder(out, beside_session=True)
    learned = folder / "machine.toml"
    _keep_beliefs(learned, machine)
    with in_file(session), progress_bar(terminal) as progress:
        found = explain_session(recorded, believed, progress=progress)
    make_folder(folder)
    words = sentences_of(recorded.effort)
    document = document_of(recorded.effort, found.to_json()) | {
        "session": str(session),
        "machine": str(machine),
    }
    replace_file(folder / "explanation.json", json_text(document))
    write_explanation(found, recorded, believed, folder)
    _tell(terminal, found, words)
    terminal.say(f"Explanation: [bold]{folder / 'explanation.html'}[/]  Learned machine: [bold]{learned}[/]")
    terminal.result(document)


def _keep_beliefs(learned: Path, machine: Path) -> None:
    """Raise InputError where the learned machine would take the place of the given one, or of a stranger's."""
    from schwung.errors import InputError

    if learned.exists() and (learned.samefile(machine) or not learned.with_name("explanation.json").exists()):
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
