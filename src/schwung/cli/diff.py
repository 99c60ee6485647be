"""`schwung diff`: two configurations side by side: files, or the drive itself. Changes nothing."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from schwung.cli.options import Bitrate, BusOption, CanLog, Channel, Interface, Json, Profile, bus_options

if TYPE_CHECKING:
    from schwung.api.configurations import Comparison, Configuration, Difference
    from schwung.cli.console import Terminal

DIFFERENT = 1  # exit code, as diff has it

_SIDE = "A DCF, an EDS (its defaults), a concise DCF, a *.backup.json, or the word drive."


def diff(
    first: Annotated[str, typer.Argument(metavar="A", help=_SIDE)],
    second: Annotated[str, typer.Argument(metavar="B", help=_SIDE)],
    everything: Annotated[bool, typer.Option("--all", help="Also list what only one of them has.")] = False,
    eds: Annotated[
        Path | None,
        typer.Option(
            help="Names and types for a concise DCF and for the drive; default: a DCF's own, else the profile's."
        ),
    ] = None,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    node: Annotated[
        int | None,
        typer.Option(
            "-n",
            "--node",
            min=1,
            max=247,
            help="Node id of the drive, and for $NODEID; default: the file's, else 1.",
            rich_help_panel="Bus",
        ),
    ] = None,
    profile: Profile = None,
    json_output: Json = False,
) -> None:
    """Show which parameters differ, raw and in SI where it is known what a count is worth. Read-only.

    Only what both sides have is compared; what one of them has alone is counted (--all lists it). Of a DCF only its
    ParameterValues count, where it has any; the drive is asked for what the other side has.

    Exit code 0: equal; 1: something differs; 2 and above: it could not be found out, as where nothing is in common.

    [bold]Examples[/]

      schwung diff axis3.dcf drive -i socketcan -c can0 -n 3

      schwung diff axis3.dcf axis4.dcf

      schwung diff vendor.eds axis3.dcf --all

      schwung diff axis3.bin axis3.dcf --profile maxon-epos4 --json
    """  # fmt: skip
    from schwung import connect
    from schwung.api.comparing import (
        compared,
        comparison_document,
        dictionary_of,
        held_by_drive,
        known_profile,
    )
    from schwung.api.configurations import load_both
    from schwung.cli.console import Terminal, observing
    from schwung.errors import InputError

    terminal = Terminal(json_output)
    if first == second == "drive":
        raise InputError("schwung diff", "compares the drive with itself", "Give a file for A or for B.")
    family = known_profile(profile, ())
    dictionary = dictionary_of(eds, family, node or 1)
    files = load_both([Path(name) for name in (first, second) if name != "drive"], node, dictionary)
    if len(files) == 1:
        options = bus_options(interface, channel, bitrate, bus, can_log)
        at = node or files[0].node_id or 1
        with connect(options, node=at, profile=profile) as opened, observing(terminal) as observer:
            live = held_by_drive(opened, files[0], eds, at, observer.phase, observer.progress)
        family, dictionary = live.family, live.dictionary
        held = live.configuration
        sides = (held, files[0]) if first == "drive" else (files[0], held)
    else:
        sides = (files[0], files[1])
    found = compared(sides, family, dictionary, node or 1)
    _show(terminal, sides, found, everything)
    terminal.result(comparison_document(sides, found))
    if found.differences:
        sys.exit(DIFFERENT)


def _show(
    terminal: Terminal, sides: tuple[Configuration, Configuration], found: Comparison, everything: bool
) -> None:
    from rich.markup import escape

    from schwung.api.configurations import ParameterValue
    from schwung.cli.configurations import shown

    def row(d: Difference) -> tuple[str, ...]:
        held = [None if raw is None else ParameterValue(d.parameter, raw) for raw in (d.first, d.second)]
        si = [str(x or "") for x in (d.first_si, d.second_si)]
        register = d.parameter.space == "register"
        name = f"@{d.parameter.index}" if register else f"{d.parameter.index:04X}:{d.parameter.subindex:02X}"
        return name, d.parameter.name, shown(held[0]), si[0], shown(held[1]), si[1]

    for letter, side in zip("AB", sides, strict=True):
        terminal.say(escape(f"{letter}: {side.words}"))
    columns = ("object", "name", "A", "A in SI", "B", "B in SI")
    if found.differences:
        terminal.table(f"{len(found.differences)} differ", columns, map(row, found.differences))
    alone = (("A", found.only_first), ("B", found.only_second))
    if everything:
        for letter, rows in alone:
            if rows:
                terminal.table(f"{len(rows)} only in {letter}", columns, map(row, rows))
    terminal.say(
        f"{len(found.differences)} differ, {found.equal} are equal; "
        f"{len(found.only_first)} only in A, {len(found.only_second)} only in B."
    )
