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
    from schwung import estimate, load_machine, read_session
    from schwung.api.reports import content_of, save_figures, standard_of, write_page
    from schwung.cli.console import Terminal
    from schwung.cli.sessions import in_file

    terminal = Terminal(json_output)
    believed, recorded = load_machine(machine), read_session(session)
    standard = standard_of(believed, reference)
    with in_file(session):
        found = estimate(recorded, believed)
    content = content_of(recorded, believed, found, standard, session.parent)
    write_page(content, out)
    files = save_figures(content, figures) if figures else []
    terminal.say(f"Report: [bold]{out}[/]")
    terminal.result({"report": str(out), "figures": [str(file) for file in files]})
