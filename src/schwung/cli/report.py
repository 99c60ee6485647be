"""`schwung report`: draw the report of a session again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import Json, Machine, Reference


def report(
    session: Annotated[Path, typer.Argument(help="The recorded session, *.h5.")],
    machine: Machine,
    out: Annotated[Path, typer.Option(help="The HTML file.")] = Path("report.html"),
    figures: Annotated[
        Path | None, typer.Option(help="Folder for the pictures as PNG files as well.")
    ] = None,
    reference: Reference = None,
    json_output: Json = False,
) -> None:
    """Write the report of a session: one HTML file with its pictures.

    [bold]Examples[/]

      schwung report session.h5 -m machine.toml

      schwung report session.h5 -m machine.toml --out monday.html --figures pictures
    """
    from schwung.cli.console import Terminal
    from schwung.cli.sessions import content_of, in_file, standard_of
    from schwung.drivetrain import load_machine
    from schwung.estimation import estimate
    from schwung.report import save_figures, write_report
    from schwung.session import read_session

    terminal = Terminal(json_output)
    believed, recorded = load_machine(machine), read_session(session)
    standard = standard_of(believed, reference)
    with in_file(session):
        found = estimate(recorded, believed)
    content = content_of(recorded, believed, found, standard, session.parent)
    write_report(content, out)
    files = save_figures(content, figures) if figures else []
    terminal.say(f"Report: [bold]{out}[/]")
    terminal.result({"report": str(out), "figures": [str(file) for file in files]})
