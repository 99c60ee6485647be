"""`schwung reproduce`: the paper's figures and table again, from its simulated machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import Json


def reproduce(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            help="figure-4, -5, -6, -9, -10, -12, -13, -14, table-2, gdft, or all.", metavar="[WHAT]..."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for reproduction.md and its pictures.")] = Path(
        "reproduction"
    ),
    json_output: Json = False,
) -> None:
    """Reproduce the paper: its figures and Table 2 from the simulated machine, beside what it reports.

    [bold]Examples[/]

      schwung reproduce

      schwung reproduce figure-9 table-2 --out docs
    """
    from rich.markup import escape

    from schwung.api.reproduction import Reproduced
    from schwung.api.reproduction import reproduce as reproduce_all
    from schwung.cli.console import Terminal

    terminal = Terminal(json_output)
    terminal.tell_slow()

    def tell(_: str, made: Reproduced) -> None:
        terminal.say(f"[bold]{escape(made.title)}[/]")
        terminal.say(escape(f"  paper: {made.paper}\n  here:  {made.here}"))

    written = reproduce_all(what or ["all"], out, tell)
    terminal.say(f"Document: [bold]{written.document}[/]")
    terminal.result(
        {
            "document": str(written.document),
            "pictures": [str(path) for path in written.pictures],
            "reproduced": written.lines,
        }
    )
