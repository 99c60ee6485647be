"""`schwung estimate`: from a recorded session to the inertia table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import Json, Machine, Reference, measured


def estimate(
    session: Annotated[Path, typer.Argument(help="The recorded session, *.h5.")],
    machine: Machine,
    out: Annotated[Path, typer.Option(help="Folder for inertia.csv, estimate.json, report.html.")] = Path(
        "estimate"
    ),
    method: Annotated[
        str,
        typer.Option(
            help="auto: the best that the session allows; multiphase, trajectory, denoised, former or a rival."
        ),
    ] = "auto",
    inversion: Annotated[str, typer.Option(help="complex or magnitude.")] = "complex",
    frequency: Annotated[
        float | None,
        typer.Option(parser=measured("frequency"), metavar="HZ", help="Default: the injected one."),
    ] = None,
    points: Annotated[int | None, typer.Option(min=4, max=1000, help="Points of the table.")] = None,
    reference: Reference = None,
    json_output: Json = False,
) -> None:
    """Estimate the load inertia over angle from a session, and write table and report.

    [bold]Examples[/]

      schwung estimate session.h5 -m machine.toml --out result

      schwung estimate session.h5 -m machine.toml --method former --json
    """
    from schwung import estimate as estimate_session
    from schwung import load_machine, read_session, write_inertia
    from schwung.api.folders import make_folder, planned_folder
    from schwung.api.reports import content_of, standard_of, write_page
    from schwung.cli.console import Terminal, describe_shown, describe_table
    from schwung.cli.sessions import in_file
    from schwung.errors import InputError
    from schwung.files import json_text, replace_file
    from schwung.quantities import document_of, sentences_of

    terminal = Terminal(json_output)
    believed, recorded = load_machine(machine), read_session(session)
    standard = standard_of(believed, reference)
    if inversion not in ("complex", "magnitude"):
        raise InputError("--inversion", f'is "{inversion}"', "Use complex or magnitude.")
    folder = planned_folder(out)
    with in_file(session):
        found = estimate_session(
            recorded, believed, method=method, inversion="magnitude" if inversion == "magnitude" else "complex",
            frequency_hz=frequency, points=points,
        )  # fmt: skip
    content = content_of(recorded, believed, found, standard, session.parent)
    reach = content.reach
    make_folder(folder)
    write_inertia(found.table, folder / "inertia.csv")
    words = sentences_of(recorded.effort)
    document = document_of(recorded.effort, found.to_json() | {"reach": reach and reach.to_json()}) | {
        "session": str(session), "machine": str(machine),
    }  # fmt: skip
    replace_file(folder / "estimate.json", json_text(document))
    write_page(content, folder / "report.html")
    terminal.say(words(describe_table(found.table, recorded.axis)))
    if reach is not None:
        terminal.say(words(reach.text))
    if found.shown:
        terminal.say(describe_shown(found.shown))
    terminal.verdict(found.trust.verdict, words("; ".join(found.trust.reasons)))
    terminal.say(f"Table: [bold]{folder / 'inertia.csv'}[/]  Report: [bold]{folder / 'report.html'}[/]")
    terminal.result(document)
