"""The command line: one file per command, thin. Heavy libraries are imported by the commands, not here."""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
from typing import Any

import typer

from schwung import __version__
from schwung.cli.bench import bench
from schwung.cli.commission import commission
from schwung.cli.demo import demo
from schwung.cli.estimate import estimate
from schwung.cli.export import export
from schwung.cli.report import report
from schwung.cli.reproduce import reproduce
from schwung.cli.restore import restore
from schwung.cli.scan import scan
from schwung.errors import SchwungError

app = typer.Typer(
    name="schwung",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Measure the load inertia of a machine over its angle, through its own drive, and write it back.\n\n"
    "Start with [bold]schwung demo[/]: a simulated drive on a virtual CAN bus, commissioned end to end.",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"schwung {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version."
    ),
) -> None:
    pass


for _command in (demo, scan, commission, estimate, export, restore, report, bench, reproduce):
    app.command()(_command)


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _failure(error: BaseException) -> tuple[str, int]:
    """What to tell the user, and the exit code. Re-raises what is a defect of ours."""
    if isinstance(error, SchwungError):
        return str(error), error.exit_code
    if isinstance(error, KeyboardInterrupt):
        return "Interrupted.", 130
    if type(error).__module__.startswith("schwung_sim"):
        return str(error), 2
    raise error


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; failures that we understand become one sentence and an exit code."""
    logging.getLogger().addHandler(
        logging.NullHandler()
    )  # libraries' warnings: our own sentences say it better
    signal.signal(signal.SIGTERM, _interrupt)  # the same way out as Ctrl-C: quick stop, parameters back
    given = sys.argv[1:] if arguments is None else arguments
    try:
        app(args=given, standalone_mode=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # a closed pipe is no failure of ours
        sys.exit(0)
    except (Exception, KeyboardInterrupt) as error:
        sentence, code = _failure(error)
        notes = list(getattr(error, "__notes__", []))
        if "--json" in given:
            document: dict[str, Any] = {"error": sentence, "notes": notes, "exit_code": code}
            print(json.dumps(document, indent=2))
        typer.secho(f"Error: {sentence}", fg="red", err=True)
        for note in notes:
            typer.secho(f"  {note}", err=True)
        sys.exit(code)
