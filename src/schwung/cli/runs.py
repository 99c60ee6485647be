"""`schwung runs`: what a service has kept: list, show, compare, prune. Also while it runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schwung.cli.options import Json, Yes

if TYPE_CHECKING:
    from schwung.service.store import Store
    from schwung.service.values import RunView

Data = Annotated[Path, typer.Option(help="The service's folder.")]
_DATA = Path("schwung-service")
_HOW_LONG = 40


def list_(
    data: Data = _DATA,
    kind: Annotated[str | None, typer.Option(help="Only of this kind: commission, estimate, …")] = None,
    state: Annotated[
        str | None, typer.Option(help="Only in this state: done, failed, interrupted, …")
    ] = None,
    limit: Annotated[int, typer.Option(min=1, help="At most so many.")] = 20,
    json_output: Json = False,
) -> None:
    """List the runs that a service has kept, the newest first.

    [bold]Examples[/]

      schwung runs list

      schwung runs list --data axis-lab --kind commission --limit 100 --json
    """
    from dataclasses import asdict

    from schwung.cli.console import Terminal

    terminal = Terminal(json_output)
    with opened(data) as store:
        drives = {drive.id: drive.name for drive in store.drives()}
        found = store.runs(kind=kind, state=state, limit=limit)
        rows = [
            (r.id, r.created[:19], r.kind, drives.get(r.drive_id or "", ""), r.who, r.state, _outcome(r))
            for r in found
        ]
        terminal.table(
            f"{len(rows)} runs", ("id", "asked for (UTC)", "kind", "drive", "who", "state", "outcome"), rows
        )
    terminal.result({"runs": [asdict(run) for run in found]})


def show(
    run: Annotated[str, typer.Argument(help="Id of a run, or its beginning where that names one.")],
    data: Data = _DATA,
    archive: Annotated[
        Path | None, typer.Option(help="Write all of it into one zip: report, recording, machine, trail.")
    ] = None,
    json_output: Json = False,
) -> None:
    """Show one run: what was asked for, what came of it, which files it left and where they lie.

    [bold]Examples[/]

      schwung runs show 3f2a

      schwung runs show 3f2a --archive monday.zip
    """
    from dataclasses import asdict

    from schwung.cli.console import Terminal

    terminal = Terminal(json_output)
    with opened(data) as store:
        found = store.run(_whole_id(store, "run", run))
        files = store.files(found.id)
        facts = [("kind", found.kind), ("state", found.state), ("who", found.who), ("asked for", found.created),
                 ("ended", found.ended or ""), ("outcome", _outcome(found))]  # fmt: skip
        facts += [
            (f"asked: {key}", _short(value)) for key, value in found.request.items() if value is not None
        ]
        terminal.table(f"Run {found.id}", ("", ""), facts)
        folder = store.run_folder(found.id)
        terminal.table(
            "Files", ("file", "bytes", "SHA-256"), [(folder / f.name, f.size, f.sha256[:16]) for f in files]
        )
        if archive is not None:
            _write_archive(store, found.id, archive)
            terminal.say(f"Archive: [bold]{archive}[/]")
    terminal.result(asdict(found) | {"files": [asdict(file) for file in files], "folder": str(folder)})


def compare(
    estimates: Annotated[
        list[str], typer.Argument(help="Ids of runs or estimates (or their beginnings), two or more.")
    ],
    data: Data = _DATA,
    json_output: Json = False,
) -> None:
    """Compare measured inertia curves with the first: drift with wear, payload; and whether the bands allow it.

    [bold]Examples[/]

      schwung runs compare 3f2a 91bc

      schwung runs compare 3f2a 91bc 77d0 --json
    """
    from dataclasses import asdict

    from schwung.cli.console import Terminal
    from schwung.service.comparison import SIGMAS
    from schwung.service.comparison import compare as compare_estimates

    terminal = Terminal(json_output)
    with opened(data) as store:
        found = compare_estimates([_estimate(store, text) for text in estimates])
    terminal.table(
        f"Against {found[0].created[:19]}",
        ("estimated (UTC)", "verdict", "mean, kg·m²", "change", "largest, kg·m²", "at, rad", f"beyond {SIGMAS:g}σ"),
        [
            (c.created[:19], c.verdict or "", f"{c.mean_kgm2:.5g}", _share(c.change, "+.2%"),
             _share(c.largest_kgm2, ".2g"), _share(c.at_rad, ".3g"), _share(c.beyond, ".0%"))
            for c in found
        ],
    )  # fmt: skip
    terminal.result({"compared": [asdict(one) for one in found]})


def prune(
    older_than: Annotated[
        int, typer.Option("--older-than", min=0, metavar="DAYS", help="Only runs that are older.")
    ] = 365,
    data: Data = _DATA,
    kind: Annotated[str | None, typer.Option(help="Only of this kind.")] = None,
    failed: Annotated[
        bool, typer.Option("--failed", help="Only what failed, was cancelled or interrupted.")
    ] = False,
    yes: Yes = False,
    json_output: Json = False,
) -> None:
    """Remove ended runs with their recordings and all that rests on them. The trail keeps what it says of them.

    [bold]Examples[/]

      schwung runs prune --older-than 30 --kind scan -y

      schwung runs prune --older-than 365 --failed
    """
    from datetime import UTC, datetime, timedelta

    from schwung.cli.console import Terminal
    from schwung.errors import InputError, RefusedError
    from schwung.service.audit import Trail
    from schwung.service.values import ENDED

    terminal = Terminal(json_output)
    before = (datetime.now(UTC) - timedelta(days=older_than)).isoformat()
    wanted = ("failed", "cancelled", "interrupted") if failed else ENDED
    with opened(data) as store:
        found = [run for run in store.runs(kind=kind, before=before, limit=1_000_000) if run.state in wanted]
        size = sum(file.size for run in found for file in store.files(run.id))
        terminal.say(f"{len(found)} runs, {size / 1e6:.1f} MB")
        removed, kept = [], []
        if found and not (yes or terminal.ask("Remove them, with their recordings?")):
            raise RefusedError("runs prune", "you said no", "Nothing was removed.")
        for run in found:
            try:
                store.remove_run(run.id)
            except InputError as error:
                kept.append({"run": run.id, "because": error.problem})
                continue
            Trail(store).add(
                "schwung runs prune", "remove run", run.drive_id, run.id, kind=run.kind, created=run.created
            )
            removed.append(run.id)
    for one in kept:
        terminal.say(f"[yellow]kept[/] {one['run']}: {one['because']}")
    terminal.result({"removed": removed, "kept": kept, "bytes": size})


@contextmanager
def opened(data: Path) -> Iterator[Store]:
    """The store of a folder, closed at the end. Raises InputError where there is none: none is made."""
    from schwung.errors import InputError
    from schwung.service.store import Store

    if not (data / "schwung.db").is_file():
        raise InputError(
            str(data), "holds no store of a service", "Give --data, the folder of `schwung serve`."
        )
    store = Store(data)
    try:
        yield store
    finally:
        store.close()


def _whole_id(store: Store, table: str, text: str) -> str:
    """The id that begins so. Raises InputError where none or several do."""
    from schwung.errors import InputError

    begins = text.strip().lower()
    hexadecimal = begins and all(c in "0123456789abcdef" for c in begins)
    found = store.ids_that_begin(table, begins) if hexadecimal else []
    if len(found) == 1:
        return found[0]
    problem = f"{len(found)} {table}s begin so" if found else f"no {table} begins so"
    raise InputError(f"{table} {text}", problem, "`schwung runs list` tells their ids.")


def _estimate(store: Store, text: str) -> Any:
    """An estimate by its own id or by that of the run that made it."""
    from schwung.errors import InputError

    try:
        of_run = store.of_run("estimate", _whole_id(store, "run", text))
    except InputError:
        return store.estimate(_whole_id(store, "estimate", text))
    if not of_run:
        raise InputError(
            f"run {text}", "has made no estimate", "Name a run of the kind commission or estimate."
        )
    return of_run[-1]


def _write_archive(store: Store, run_id: str, target: Path) -> None:
    from schwung.errors import InputError
    from schwung.service.archive import write_archive
    from schwung.service.audit import Trail

    if target.exists():
        raise InputError(str(target), "is there already", "Choose another name.")
    try:
        write_archive(store, Trail(store), run_id, target)
    except OSError as error:
        raise InputError(
            str(target), f"cannot be written: {(error.strerror or str(error)).lower()}"
        ) from error


def _outcome(run: RunView) -> str:
    if run.error is not None and run.state != "done":
        return _short(run.error.get("text", ""))
    return str((run.result or {}).get("verdict") or "")


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= _HOW_LONG else text[: _HOW_LONG - 1] + "…"


def _share(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)
