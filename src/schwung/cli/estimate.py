"""`schwung estimate`: from a recorded session to the inertia table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import Json, Machine, Reference, quantity


def estimate(
    session: Annotated[Path, typer.Argument(help="The recorded session, *.h5.")],
    machine: Machine,
    out: Annotated[Path, typer.Option(help="Folder for inertia.csv, estimate.json, report.html.")] = Path(
        "estimate"
    ),
    method: Annotated[str, typer.Option(help="denoised or former.")] = "denoised",
    inversion: Annotated[str, typer.Option(help="complex or magnitude.")] = "complex",
    frequency: Annotated[
        float | None, typer.Option(parser=quantity, metavar="HZ", help="Default: the injected one.")
    ] = None,
    points: Annotated[int | None, typer.Option(min=4, help="Points of the table.")] = None,
    reference: Reference = None,
    json_output: Json = False,
) -> None:
    """Estimate the load inertia over angle from a session, and write table and report.

    [bold]Examples[/]

      schwung estimate session.h5 -m machine.toml --out result

      schwung estimate session.h5 -m machine.toml --method former --json
    """
    import json

    from schwung.cli.commission import output_folder
    from schwung.cli.console import Terminal
    from schwung.cli.sessions import content_of, standard_of
    from schwung.drivetrain import load_machine, write_inertia_csv
    from schwung.errors import InputError
    from schwung.estimation import estimate as estimate_session
    from schwung.report import write_report
    from schwung.session import read_session

    terminal = Terminal(json_output)
    believed, recorded = load_machine(machine), read_session(session)
    standard = standard_of(believed, reference)
    if inversion not in ("complex", "magnitude"):
        raise InputError("--inversion", f'is "{inversion}"', "Use complex or magnitude.")
    found = estimate_session(
        recorded, believed, method=method, inversion="magnitude" if inversion == "magnitude" else "complex",
        frequency_hz=frequency, points=points,
    )  # fmt: skip
    output_folder(out)
    write_inertia_csv(found.table, out / "inertia.csv")
    document = found.to_json() | {"session": str(session), "machine": str(machine)}
    (out / "estimate.json").write_text(json.dumps(document, indent=2), encoding="utf-8")
    write_report(content_of(recorded, believed, found, standard), out / "report.html")
    table = found.table
    terminal.say(
        f"Load inertia {table.inertia_kgm2.min():.4f} … {table.inertia_kgm2.max():.4f} kg·m² over "
        f"{table.position_rad[0]:.3g} … {table.position_rad[-1]:.3g} rad"
    )
    terminal.verdict(found.trust.verdict, "; ".join(found.trust.reasons))
    terminal.say(f"Table: [bold]{out / 'inertia.csv'}[/]  Report: [bold]{out / 'report.html'}[/]")
    terminal.result(document)
