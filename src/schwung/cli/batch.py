"""`schwung batch estimate|explain`: a whole archive of sessions, on all cores or on a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schwung.cli.options import Json, measured
from schwung.errors import InputError, InterruptedByUser, SchwungError

if TYPE_CHECKING:
    from schwung.batch import Batch, Row, Wish
    from schwung.batch.archive import Kind
    from schwung.cli.console import Terminal

Patterns = Annotated[
    list[str],
    typer.Argument(
        metavar="PATTERN…", help="Sessions: files, quoted patterns as 'plant/**/*.h5', or folders."
    ),
]
OneMachine = Annotated[
    Path | None,
    typer.Option(
        "-m",
        "--machine",
        help="machine.toml of all sessions; default: the measured.toml or machine.toml beside each.",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS", help="A Dask scheduler, e.g. tcp://10.0.0.5:8786; default: this computer."
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option("-j", "--jobs", min=1, max=1024, help="Processes of this computer; default: one per core."),
]
Again = Annotated[bool, typer.Option("--again", help="Do all of them, also those that have a result.")]

_MOST_ROWS = 60  # of the table on the terminal; the files have all


def estimate(
    patterns: Patterns,
    machine: OneMachine = None,
    out: Annotated[Path, typer.Option(help="Folder for results, summary and pictures.")] = Path(
        "batch-estimate"
    ),
    method: Annotated[str, typer.Option(help="As of `schwung estimate`.")] = "auto",
    inversion: Annotated[str, typer.Option(help="complex or magnitude.")] = "complex",
    frequency: Annotated[
        float | None,
        typer.Option(parser=measured("frequency"), metavar="HZ", help="Default: the injected one."),
    ] = None,
    points: Annotated[int | None, typer.Option(min=4, max=1000, help="Points of the table.")] = None,
    scheduler: Scheduler = None,
    jobs: Jobs = None,
    again: Again = False,
    json_output: Json = False,
) -> None:
    """Estimate every session of an archive anew; a second call does only what is missing.

    [bold]Examples[/]

      schwung batch estimate /archive --out monday

      schwung batch estimate 'line-*/**/session.h5' -m machine.toml --jobs 4

      schwung batch estimate /archive --scheduler tcp://10.0.0.5:8786 --json
    """
    from schwung.cli.options import one_of
    from schwung.extras import require

    require("schwung batch", "batch")
    from schwung.api.choices import AUTO, Inversion, method_named
    from schwung.batch import Wish

    if method != AUTO:
        method_named(method)  # refused here once, not by every session
    wish = Wish("estimate", method, one_of("--inversion", inversion, Inversion), frequency, points)
    _carry_out(patterns, machine, out, wish, scheduler, jobs, again, json_output)


def explain(
    patterns: Patterns,
    machine: OneMachine = None,
    out: Annotated[Path, typer.Option(help="Folder for results, summary and pictures.")] = Path(
        "batch-explain"
    ),
    scheduler: Scheduler = None,
    jobs: Jobs = None,
    again: Again = False,
    json_output: Json = False,
) -> None:
    """Explain every session of an archive: what each belief leaves out; a second call does only what is missing.

    [bold]Examples[/]

      schwung batch explain /archive --out monday

      schwung batch explain 'line-*/**/session.h5' -m machine.toml --scheduler tcp://10.0.0.5:8786
    """
    from schwung.extras import require

    require("schwung batch", "batch")
    from schwung.batch import Wish

    _carry_out(patterns, machine, out, Wish("explain"), scheduler, jobs, again, json_output)


def _carry_out(
    patterns: list[str],
    machine: Path | None,
    out: Path,
    wish: Wish,
    scheduler: str | None,
    jobs: int | None,
    again: bool,
    json_output: bool,
) -> None:
    from rich.markup import escape

    from schwung import load_machine
    from schwung.api.folders import make_folder, planned_folder
    from schwung.batch import Results, items_of, run_batch, write_summary
    from schwung.batch.picture import write_pictures
    from schwung.batch.summary import document_of
    from schwung.cli.console import Terminal, progress_bar

    terminal = Terminal(json_output)
    if wish.kind == "explain":
        terminal.tell_slow()
    if scheduler is not None and jobs is not None:
        raise InputError(
            "--jobs", "is for this computer's processes", "Leave it out: a scheduler has its own."
        )
    if machine is not None:
        load_machine(machine)  # refused here once, not by every session
    items = items_of(patterns, machine)
    folder = planned_folder(out, beside_session=True)
    make_folder(folder / "results")
    with progress_bar(terminal) as progress:
        done = run_batch(
            items, wish, Results(folder / "results"), scheduler=scheduler, jobs=jobs, again=again,
            progress=progress, tell=lambda sentence: terminal.say(f"[yellow]![/] {escape(sentence)}"),
        )  # fmt: skip
    write_summary(done.rows, wish.kind, folder)
    pictures = write_pictures(done.rows, wish.kind, folder)
    _show(terminal, done, wish.kind, folder, pictures)
    document = document_of(done.rows, wish.kind)
    if done.missing:
        raise _InterruptedError(done.missing, len(items), document)
    if done.failures:
        raise _FailuresError(len(done.failures), len(items), document)
    terminal.result(document)


class _InterruptedError(InterruptedByUser):
    def __init__(self, missing: int, of: int, document: dict[str, Any]) -> None:
        problem = f"interrupted; {of - missing} of {of} sessions are done and kept"
        super().__init__("schwung batch", problem, "The same command does the rest.")
        self.document = document


class _FailuresError(SchwungError):
    def __init__(self, failures: int, of: int, document: dict[str, Any]) -> None:
        super().__init__(
            "schwung batch", f"{failures} of {of} sessions gave no result", "The table says why of each."
        )
        self.document = document


def _show(terminal: Terminal, done: Batch, kind: Kind, folder: Path, pictures: Sequence[Path]) -> None:
    """The table: of a large archive what failed, and the newest of the rest."""
    good = [row for row in done.rows if not row.error]
    shown = good[-_MOST_ROWS:]
    estimated = kind == "estimate"
    head = (
        ("J_l min", "mean", "max", "MIV", "deviation", "drift")
        if estimated
        else ("left out", "before", "after")
    )
    cells = _estimated if estimated else _explained
    if shown:
        title = "Sessions" if len(shown) == len(good) else f"The newest {len(shown)} of {len(good)} sessions"
        names = _short([row.file for row in shown])
        rows = [
            (name, row.created[:10], row.verdict, *cells(row)) for name, row in zip(names, shown, strict=True)
        ]
        terminal.table(title, ("file", "created", "verdict", *head), rows)
    if done.failures:
        failures = done.failures[:_MOST_ROWS]
        more = f", the first {len(failures)}" if len(failures) < len(done.failures) else ""
        terminal.table(f"No result: {len(done.failures)}{more}", ("",), [(row.error,) for row in failures])
    there = f", {done.found} of them were there already" if done.found else ""
    terminal.say(f"{len(good)} sessions have a result{there}. All rows: [bold]{folder / 'summary.csv'}[/]")
    for picture in pictures:
        terminal.say(f"Picture: [bold]{picture}[/]")


def _estimated(row: Row) -> tuple[str, ...]:
    figures = (
        row.inertia_min_kgm2,
        row.inertia_mean_kgm2,
        row.inertia_max_kgm2,
        row.miv_kgm2,
        row.deviation_kgm2,
    )
    return (*map(_figure, figures), "" if row.drift is None else f"{100 * row.drift:+.1f} %")


def _explained(row: Row) -> tuple[str, ...]:
    return row.physics.replace("_", " "), _figure(row.rmse_before_nm), _figure(row.rmse_after_nm)


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _short(files: Sequence[Path]) -> list[str]:
    """Paths without the folders that all of them share."""
    shared = Path(os.path.commonpath([path.parent for path in files]))
    return [str(path.relative_to(shared)) for path in files]
