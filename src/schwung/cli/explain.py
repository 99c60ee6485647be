"""`schwung explain`: which physics the belief leaves out, found in a recorded session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schwung.cli.options import Json

if TYPE_CHECKING:
    from schwung import Explanation, Machine, Session
    from schwung.cli.console import Terminal
    from schwung.quantities import Effort

_COLOURS = {"good": "green", "doubtful": "yellow", "unusable": "red"}


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
    from schwung.api.folders import planned_folder
    from schwung.cli.console import Terminal
    from schwung.cli.next_motion import next_and_show

    terminal = Terminal(json_output)
    _require_sense(machine, belief, next_plan)
    recorded = read_session(session)
    believed = load_machine(machine) if machine is not None else None
    terminal.tell_slow()
    folder = planned_folder(out, beside_session=True)
    learned = folder / "machine.toml"
    _keep_beliefs(learned, machine)
    asked = believed if believed is not None else _with_map(belief, mapped)
    document = _explain(terminal, recorded, asked, (session, machine or belief), folder)
    if next_plan is not None and believed is not None:
        document["next"] = next_and_show(terminal, recorded, believed, next_plan)
    terminal.result(document)


def _require_sense(machine: Path | None, belief: Path | None, plan: Path | None) -> None:
    """Raise InputError where what is asked for does not go together, before anything is worked on."""
    from schwung.errors import InputError

    if (machine is None) == (belief is None):
        raise InputError(
            "schwung explain", "needs one belief", "Give -m machine.toml, or --belief model.fmu."
        )
    if plan is not None and machine is None:
        raise InputError(
            "--next", "simulates the motion, which an FMU's belief cannot", "Give -m machine.toml."
        )
    if plan is not None and not plan.absolute().parent.is_dir():
        raise InputError(str(plan), "its folder is not there", "Make it, or choose another place.")


def _explain(
    terminal: Terminal,
    recorded: Session,
    belief: Machine | tuple[Path, Path],
    places: tuple[Path, Path | None],
    folder: Path,
) -> dict[str, Any]:
    """The answer, written and told; `belief`: a machine, or an FMU and its map; `places`: of session and belief."""
    from schwung.api.explaining import explain as explain_session
    from schwung.api.explaining import write_explanation
    from schwung.api.folders import make_folder
    from schwung.api.simulators import explain_against
    from schwung.cli.console import progress_bar
    from schwung.cli.sessions import in_file
    from schwung.files import json_text, replace_file
    from schwung.quantities import document_of

    with in_file(places[0]), progress_bar(terminal) as progress:
        if isinstance(belief, tuple):
            against = explain_against(recorded, *belief, progress=progress)
            found, believed = against.explanation, against.stand_in
        else:
            found, believed = explain_session(recorded, belief, progress=progress), belief
    make_folder(folder)
    about = {"session": str(places[0]), "machine": str(places[1])}
    document = document_of(recorded.effort, found.to_json()) | about
    replace_file(folder / "explanation.json", json_text(document))
    write_explanation(found, recorded, believed, folder)
    _tell(terminal, found, recorded.effort)
    page, learned = folder / "explanation.html", folder / "machine.toml"
    terminal.say(f"Explanation: [bold]{page}[/]  Learned machine: [bold]{learned}[/]")
    return document


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


def _tell(terminal: Terminal, found: Explanation, effort: Effort) -> None:
    """In one sentence, then every table, then what limits it: for people."""
    from rich.markup import escape

    from schwung.quantities import sentences_of

    words_in = sentences_of(effort)
    terminal.say(f"[bold {_COLOURS[found.tone]}]{escape(words_in(found.headline))}[/]")
    for title, head, rows in found.tables():
        terminal.table(title, head, [tuple(map(words_in, row)) for row in rows])
    for note in found.notes:
        terminal.say(f"[cyan]i[/] {escape(words_in(note))}")
