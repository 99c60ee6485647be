"""`schwung restore`: put back what a run had changed, or bring a drive to a configuration that was kept."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from schwung.cli.options import Bitrate, BusOption, CanLog, Channel, Interface, Json, bus_options

if TYPE_CHECKING:
    from schwung.api.configurations import Configuration, Written
    from schwung.api.drives import BusOptions
    from schwung.cli.console import Terminal
    from schwung.errors import DriveError


def restore(
    file: Annotated[
        Path, typer.Argument(help="The *.backup.json of a run, or a DCF or concise DCF of `schwung backup`.")
    ],
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Also on a drive with another identity, twice, and while its power stage is on."
        ),
    ] = False,
    store: Annotated[
        bool, typer.Option("--store", help="DCF: save in the drive's memory (1010) when all is written.")
    ] = False,
    eds: Annotated[
        Path | None,
        typer.Option(
            help="The vendor's EDS; default: what a DCF says of its objects; concise: the profile's EDS."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="DCF: folder for the way back; default: schwung-<time>.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what would be written; write nothing.")
    ] = False,
    yes: Annotated[bool, typer.Option("-y", "--yes", help="DCF: do not ask before writing.")] = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    node: Annotated[
        int | None, typer.Option("-n", "--node", min=1, max=247, help="Default: the node that was backed up.")
    ] = None,
    profile: Annotated[str | None, typer.Option(help="Default: the profile that was used.")] = None,
    json_output: Json = False,
) -> None:
    """Put back the parameters that a run had changed, or bring a drive to the configuration in a DCF.

    A *.backup.json knows bus and node itself unless options say otherwise. A DCF is compared with the drive first:
    what differs is shown, you are asked, the power stage has to be off, the present values go to a *.backup.json,
    and only then is anything written, read back, and named where the drive refuses it.

    [bold]Examples[/]

      schwung restore schwung-20260314-101500/setup.backup.json

      schwung restore setup.backup.json -i socketcan -c can1 -n 3

      schwung restore axis3.dcf -i socketcan -c can0 -n 3 --dry-run

      schwung restore axis3.dcf -i socketcan -c can0 -n 3 --store
    """
    from schwung.api.comparing import dictionary_of, known_profile
    from schwung.api.configurations import load_configuration
    from schwung.cli.console import Terminal

    terminal = Terminal(json_output)
    dictionary = dictionary_of(eds, known_profile(profile, ()), node or 1)
    wanted = load_configuration(file, node, dictionary)
    options = bus_options(interface, channel, bitrate, bus, can_log)
    if wanted.kind == "backup":
        given = interface is not None or channel is not None
        _put_back(file, force, options, given, node, profile, terminal, dry_run)
        return
    ask = None if yes else terminal
    _configure(
        wanted, options, node or wanted.node_id or 1, profile, eds, out, terminal, ask, force, store, dry_run
    )


def _put_back(
    file: Path,
    force: bool,
    options: BusOptions,
    given: bool,
    node: int | None,
    profile: str | None,
    terminal: Terminal,
    dry_run: bool,
) -> None:
    """The old values of a *.backup.json."""
    from rich.markup import escape

    from schwung import connect
    from schwung.api.configurations import first_values, read_backup, restore_backup
    from schwung.api.drives import BusOptions

    content = read_backup(file)
    if content.restored and not force:
        terminal.say(
            f"{escape(str(file))} was put back on {content.restored} already; nothing to do (--force does it again)."
        )
        terminal.result({"restored": 0, "when": content.restored})
        return
    record = content.drive
    known = record.get("bus") or {}
    if not given and "interface" in known:
        options = BusOptions(
            known["interface"],
            known.get("channel"),
            known.get("bitrate"),
            known.get("extra") or {},
            options.log,
        )
    was, family = record.get("identity") or {}, record.get("profile")
    if dry_run:
        planned = first_values(content.changes)
        terminal.table(
            "Would be put back", ("object", "value"), ((v.parameter.label, v.raw) for v in planned)
        )
        terminal.say("Dry run: nothing was written.")
        terminal.result({"restored": 0, "would_restore": len(planned)})
        return
    with connect(options, node=node or int(was.get("node_id", 1)), profile=profile or family) as opened:
        values = restore_backup(opened.drive, file, force)
    terminal.table("Put back", ("object", "value"), ((v.parameter.label, v.raw) for v in values))
    terminal.say(f"{len(values)} parameters put back.")
    terminal.result({"restored": len(values)})


def _configure(
    wanted: Configuration,
    options: BusOptions,
    node: int,
    profile: str | None,
    eds: Path | None,
    out: Path | None,
    terminal: Terminal,
    ask: Terminal | None,
    force: bool,
    store: bool,
    dry_run: bool,
) -> None:
    """Bring a drive to a configuration."""
    from rich.markup import escape

    from schwung import connect
    from schwung.api.comparing import scales_of
    from schwung.api.configurations import (
        ParameterJournal,
        fitting_dictionary,
        for_this_drive,
        plan_restore,
        require_power_off,
        write_plan,
    )
    from schwung.api.folders import make_folder, planned_folder
    from schwung.cli.configurations import canopen_profile, cells, reasons
    from schwung.cli.console import observing

    folder = planned_folder(out)
    with connect(options, node=node, profile=profile) as opened:
        drive = opened.drive
        family = canopen_profile(opened.profile, "restore")
        dictionary = fitting_dictionary(wanted, eds, family, drive.identity, node)
        fitted = for_this_drive(wanted, dictionary, family, drive.identity, force)
        with observing(terminal) as observer:
            observer.phase(f"Comparing {len(fitted.values)} parameters with node {node}")
            plan = plan_restore(drive, fitted.values, observer.progress)
        scales = scales_of(family, (wanted,), dictionary)
        rows = [(now.parameter.label, *cells(now, scales), *cells(new, scales)) for now, new in plan.changes]
        left = [*fitted.skipped, *plan.absent]
        document: dict[str, Any] = {
            "file": wanted.source, "equal": plan.equal,
            "changes": [{"parameter": row[0], "old": row[1], "new": row[3]} for row in rows],
            "left_out": [{"object": s.parameter.label, "because": s.reason} for s in left],
        }  # fmt: skip
        terminal.table(f"{len(rows)} differ", ("object", "now", "in SI", "new", "in SI"), rows)
        terminal.say(f"{plan.equal} parameters are as in {escape(wanted.source)}.")
        if left:
            terminal.table(f"{len(left)} of it are left out", ("because", "", "objects"), reasons(left))
        if dry_run or not rows:
            terminal.say("Dry run: nothing was written." if dry_run else "Nothing to write.")
            terminal.result(document | {"written": 0})
            return
        if not force:
            require_power_off(drive, dictionary.find(0x6041))
        _agree(ask, len(rows))
        make_folder(folder)
        journal = ParameterJournal(drive, folder / "restore.backup.json", drive.describe())
        with observing(terminal) as observer:
            observer.phase(f"Writing {len(rows)} parameters")
            try:
                written = write_plan(drive, plan, journal, observer.progress)
            except BaseException as error:
                way_back = f"what was written so far can be put back: schwung restore {journal.path}"
                error.add_note(way_back if journal.path.exists() else "nothing was written")
                raise
        document |= {
            "written": len(rows) - len(written.refused), "backup": str(journal.path),
            "refused": [{"parameter": r.value.parameter.label, "because": r.reason} for r in written.refused],
        }  # fmt: skip
        if written.refused:
            raise _refusal(written, len(rows), journal.path, document, terminal)
        journal.keep(stored=store)
        if store:
            drive.store()
    terminal.say(
        f"{len(rows)} parameters written and read back equal{', stored' if store else ''}; "
        f"the way back: [bold]schwung restore {escape(str(journal.path))}[/]"
    )
    terminal.result(document | {"stored": store})


def _agree(ask: Terminal | None, count: int) -> None:
    """Raises RefusedError where somebody is asked, and says no."""
    from schwung.errors import RefusedError

    if ask is not None and not ask.ask(f"Write {count} parameters?"):
        raise RefusedError("restore", "you said no", "Nothing was written.")


def _refusal(
    written: Written, total: int, way_back: Path, document: dict[str, Any], terminal: Terminal
) -> DriveError:
    """What the drive did not take, all of it shown and the first of it told."""
    from schwung.cli.configurations import shown
    from schwung.errors import DriveError

    terminal.table(
        "Not taken", ("object", "value", "because"),
        ((r.value.parameter.label, shown(r.value), r.reason) for r in written.refused),
    )  # fmt: skip
    first, count = written.refused[0], len(written.refused)
    failure = DriveError(
        first.value.parameter.label,
        f"{first.reason}; {total - count} of {total} parameters were written and read back, {count} were not taken",
        f"Nothing was stored. The way back: schwung restore {way_back}",
    )
    vars(failure)["document"] = document
    return failure
