"""`schwung convert`: a session in other people's formats, and back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import Json


def convert(
    source: Annotated[Path, typer.Argument(help="A session: *.h5, *.mf4 or *.parquet.")],
    target: Annotated[Path, typer.Argument(help="What to write: *.mf4, *.parquet or *.h5.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file of that name.")] = False,
    json_output: Json = False,
) -> None:
    """Write a session as MDF4 or Parquet for other tools, or make one of those a session again, without loss.

    [bold]Examples[/]

      schwung convert session.h5 session.mf4

      schwung convert session.parquet session.h5
    """
    from rich.markup import escape

    from schwung.api.recordings import FORMATS, read_any, write_any
    from schwung.cli.console import Terminal

    terminal = Terminal(json_output)
    session = read_any(source)
    write_any(session, target, overwrite)
    if session.partial_reasons:
        terminal.say(
            f"[cyan]i[/] {len(session.partial_reasons)} recordings that broke off stay behind: they are no runs"
        )
    kind = FORMATS[target.suffix.lower()]
    terminal.say(f"{len(session.runs)} runs as {kind}: [bold]{escape(str(target))}[/]")
    terminal.result({"written": str(target), "format": kind, "runs": len(session.runs)})
