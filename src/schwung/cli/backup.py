"""`schwung backup`: a drive's whole configuration into a DCF, a concise DCF or a *.backup.json. Changes nothing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import Bitrate, BusOption, CanLog, Channel, Interface, Json, Node, Profile, connected

if TYPE_CHECKING:
    from schwung.api.configurations import Format


def backup(
    file: Annotated[
        Path | None,
        typer.Argument(
            help="Where to write: *.dcf, *.json, or with --concise anything. Default: by drive and time."
        ),
    ] = None,
    concise: Annotated[
        bool, typer.Option("--concise", help="Write a concise DCF: the bytes of object 1F22, for a manager.")
    ] = False,
    eds: Annotated[
        Path | None,
        typer.Option(help="The vendor's EDS of this drive; default: the profile's, which holds less."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that is there.")] = False,
    verbose: Annotated[
        bool,
        typer.Option(
            "-v", "--verbose", help="Name every parameter that is left out, and what is odd in the EDS."
        ),
    ] = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    node: Node = 1,
    profile: Profile = None,
    json_output: Json = False,
) -> None:
    """Read every parameter that can be read and written into a file. Read-only; the drive may even run.

    What is a command, live or mapped into an RPDO is left out, with the reason. `schwung restore FILE` writes it back.

    [bold]Examples[/]

      schwung backup axis3.dcf -i socketcan -c can0 -n 3

      schwung backup axis3.dcf -i socketcan -c can0 -n 3 --eds vendor.eds

      schwung backup axis3.bin --concise -i pcan -c PCAN_USBBUS1 -b 1000000 -n 3

      schwung backup axis3.backup.json -i socketcan -c can0 -n 3 --json
    """  # fmt: skip
    from rich.markup import escape

    from schwung.api.configurations import Skipped, dictionary_of, read_snapshot, save_configuration, select
    from schwung.cli.configurations import canopen_profile, reasons
    from schwung.cli.console import Terminal, observing

    terminal = Terminal(json_output)
    if file is not None:
        _require_free(file, force)
    with connected(interface, channel, bitrate, bus, node, profile, can_log) as opened:
        family, drive = canopen_profile(opened.profile, "backup"), opened.drive
        dictionary = dictionary_of(eds, family, drive.identity, node)
        selection = select(dictionary, family)
        target = file or _default_name(family.family, node, concise)
        _require_free(target, force)
        with observing(terminal) as observer:
            observer.phase(f"Reading {len(selection.wanted)} parameters of node {node}")
            began_s = drive.clock.now()
            snapshot = read_snapshot(drive.read, selection, observer.progress)
            took_s = drive.clock.now() - began_s
        form = _format(target, concise)
        left_out = save_configuration(
            target, form, dictionary, snapshot.values, drive.identity, drive.describe(), drive.clock
        )
    skipped = [
        *snapshot.skipped,
        *(Skipped(v.parameter, "the format cannot hold its text") for v in left_out),
    ]
    kept = len(snapshot.values) - len(left_out)
    terminal.say(f"{kept} parameters read in {took_s:.1f} s, kept in [bold]{escape(str(target))}[/]")
    if verbose:
        terminal.table("Left out", ("object", "because"), ((s.parameter.label, s.reason) for s in skipped))
        terminal.table(f"Odd in {dictionary.path}", ("",), ((str(w),) for w in dictionary.warnings))
    elif skipped:
        terminal.table(f"{len(skipped)} left out", ("because", "", "objects"), reasons(skipped))
    terminal.say(f"{selection.read_only} others are only read, {selection.write_only} only written.")
    terminal.result({
        "file": str(target), "format": form, "parameters": kept, "duration_s": took_s,
        "left_out": [{"object": s.parameter.label, "because": s.reason} for s in skipped],
        "read_only": selection.read_only, "write_only": selection.write_only, "eds": str(dictionary.path),
        "eds_warnings": [vars(w) for w in dictionary.warnings],
    })  # fmt: skip


def _format(target: Path, concise: bool) -> Format:
    return "concise" if concise else "backup" if target.suffix == ".json" else "dcf"


def _default_name(family: str, node: int, concise: bool) -> Path:
    from datetime import datetime

    return Path(f"{family}-node{node}-{datetime.now():%Y%m%d-%H%M%S}.{'bin' if concise else 'dcf'}")


def _require_free(target: Path, force: bool) -> None:
    from schwung.errors import InputError

    if target.exists() and not force:
        raise InputError(
            str(target), "is there already", "Choose another name, or write over it with --force."
        )
    if not target.absolute().parent.is_dir():
        raise InputError(str(target), "has no folder to lie in", "Make the folder first.")
