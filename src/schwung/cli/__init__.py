"""The command line: one file per command, thin. Heavy libraries are imported by the commands, not here."""

from __future__ import annotations

import functools
import gc
import json
import logging
import os
import signal
import sys
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

from schwung import __version__
from schwung.cli import batch as _batch
from schwung.cli.backup import backup
from schwung.cli.bench import bench
from schwung.cli.bode import bode
from schwung.cli.commission import commission
from schwung.cli.convert import convert
from schwung.cli.demo import demo
from schwung.cli.diff import diff
from schwung.cli.doctor import doctor
from schwung.cli.estimate import estimate
from schwung.cli.explain import explain
from schwung.cli.export import export
from schwung.cli.import_ import import_
from schwung.cli.optimise import optimise
from schwung.cli.profile import check, list_, new, show
from schwung.cli.report import report
from schwung.cli.reproduce import reproduce
from schwung.cli.restore import restore
from schwung.cli.runs import compare, prune
from schwung.cli.runs import list_ as list_runs
from schwung.cli.runs import show as show_run
from schwung.cli.scan import scan
from schwung.cli.serve import serve
from schwung.errors import InputError, InterruptedByUser, SchwungError

#: Our matrices are small: a second thread waits longer for the first than it works, ten times so on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: Libraries make some 400 000 objects that stay: to look through them for cycles, even once, is a fortieth of a short
#: command's time, again and again a tenth.
gc.set_threshold(500_000, 50, 50)

app = typer.Typer(
    name="schwung",
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


_Returned = TypeVar("_Returned")
_Given = ParamSpec("_Given")


def _told_interrupts(command: Callable[_Given, _Returned], group: str = "") -> Callable[_Given, _Returned]:
    """An interrupt in a command becomes one of our errors: the framework would end without a word."""

    @functools.wraps(command)
    def told(*args: _Given.args, **kwargs: _Given.kwargs) -> _Returned:
        try:
            return command(*args, **kwargs)
        except SchwungError:
            raise
        except BaseException as error:
            if (told_before := _interrupted_before(error)) is not None:
                raise told_before from None
            if _is_interrupt(error):
                raise InterruptedByUser(f"schwung {group}{_name(command)}", "interrupted") from error
            raise

    return told


def _name(command: Callable[_Given, _Returned]) -> str:
    """The command's name as typed; a trailing underscore is Python's, not the user's."""
    return command.__name__.removesuffix("_")


def _interrupted_before(error: BaseException | None) -> InterruptedByUser | None:
    """What an earlier interrupt had to say, where a second one came while the first was being dealt with."""
    while error is not None and not isinstance(error, InterruptedByUser):
        error = error.__context__
    return error


def _is_interrupt(error: BaseException | None) -> bool:
    """Also where a library that was loading at that moment has made something else of it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


for _command in (
    demo,
    scan,
    doctor,
    commission,
    estimate,
    explain,
    export,
    backup,
    restore,
    diff,
    report,
    bench,
    bode,
    reproduce,
    import_,
    convert,
    optimise,
    serve,
):
    app.command(_name(_command))(_told_interrupts(_command))

profiles = typer.Typer(help="List, show, check and draft device profiles.", rich_markup_mode="rich")
for _subcommand in (list_, show, check, new):
    profiles.command(_name(_subcommand))(_told_interrupts(_subcommand, "profile "))
app.add_typer(profiles, name="profile")

runs = typer.Typer(help="List, show, compare and prune what a service has kept.", rich_markup_mode="rich")
for _of_runs in (list_runs, show_run, compare, prune):
    runs.command(_name(_of_runs))(_told_interrupts(_of_runs, "runs "))
app.add_typer(runs, name="runs")

batches = typer.Typer(help="Estimate or explain a whole archive of sessions (Dask).", rich_markup_mode="rich")
for _batched in (_batch.estimate, _batch.explain):
    batches.command(_name(_batched))(_told_interrupts(_batched, "batch "))
app.add_typer(batches, name="batch")


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _on_signals(handler: Callable[[int, object], None] | signal.Handlers, *more: str) -> None:
    """What a kill and a closed terminal do; signals that are ignored (nohup) stay so."""
    for name in ("SIGTERM", "SIGHUP", *more):  # SIGHUP: not on Windows
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


def _failure(error: BaseException) -> tuple[str, int]:
    """What to tell the user, and the exit code. Re-raises what is a defect of ours."""
    if isinstance(error, SchwungError):
        return str(error), error.exit_code
    if isinstance(error, KeyboardInterrupt | typer.Abort):
        return "interrupted", InterruptedByUser.exit_code
    if callable(message := getattr(error, "format_message", None)):  # wrong usage, as the framework found it
        context = getattr(error, "ctx", None)
        command = context.command_path if context else app.info.name
        return f"{str(message()).rstrip('.')}. See `{command} --help`.", InputError.exit_code
    if type(error).__module__.startswith("schwung_sim"):
        return str(error), InputError.exit_code
    raise error


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; failures that we understand become one sentence and an exit code."""
    logging.getLogger().addHandler(
        logging.NullHandler()
    )  # libraries' warnings: our own sentences say it better
    _on_signals(_interrupt)  # the same way out as Ctrl-C: quick stop, parameters back
    given = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    try:
        code = app(args=given, standalone_mode=False)
    except (Exception, KeyboardInterrupt) as caught:
        again = isinstance(caught, KeyboardInterrupt | typer.Abort)  # on the way out through the framework
        error = (_interrupted_before(caught) if again else None) or caught
        sentence, code = _failure(error)
        if code == InterruptedByUser.exit_code:
            _on_signals(
                signal.SIG_IGN, "SIGINT"
            )  # what is left to say is said, however often people ask to stop
        notes = list(getattr(error, "__notes__", []))
        if "--json" in given:
            found = getattr(error, "document", {})  # what is known in spite of the failure
            print(json.dumps({"error": sentence, "notes": notes, "exit_code": code, **found}, indent=2))
        typer.secho(f"Error: {sentence}", fg="red", err=True)
        for note in notes:
            typer.secho(f"  {note}", err=True)
    gc.freeze()  # the process ends: what is in a cycle needs not be found first
    sys.exit(code or 0)
