"""`schwung doctor`: what is missing before a drive can be commissioned, and how to mend it. Changes nothing."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import (
    Bitrate,
    BusOption,
    CanLog,
    Channel,
    Interface,
    Json,
    Node,
    Profile,
    bus_options,
)


def doctor(
    eds: Annotated[
        Path | None, typer.Option(help="The vendor's EDS, to compare with the drive; default: the profile's.")
    ] = None,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Also show what is well.")] = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    node: Node = 1,
    profile: Profile = None,
    json_output: Json = False,
) -> None:
    """Say in plain words what is missing before this drive can be commissioned, and how to mend it.

    Reads only: no parameter is written, no command sent, nothing moves. The gravest comes first: ✗ has to be mended,
    ! should be, i is worth knowing.

    Exit code 0: commissioning can start; 3: it cannot.

    [bold]Examples[/]

      schwung doctor -i socketcan -c can0 -n 3

      schwung doctor -i pcan -c PCAN_USBBUS1 -b 500000 -n 3 --eds vendor.eds --verbose

      schwung doctor -i modbus-tcp -c 192.168.0.10:502 -n 1 --json
    """
    from dataclasses import asdict

    from schwung import doctor as examine
    from schwung.cli.console import Terminal, observing
    from schwung.errors import RefusedError

    terminal = Terminal(json_output)
    options = bus_options(interface, channel, bitrate, bus, can_log)
    with observing(terminal) as observer:
        found = examine(options, node=node, profile=profile, eds=eds, progress=observer.phase)
    shown = [c for c in found.checks if verbose or c.severity != "ok"]
    if shown:
        terminal.checks(((c.name, c.severity, c.text, c.remedy) for c in shown), "Findings")
    well = sum(1 for c in found.checks if c.severity == "ok")
    stops = sum(1 for c in found.checks if c.severity == "stop")
    hidden = "" if verbose or not well else f" {well} more things are well (--verbose lists them)."
    if found.can_start:
        terminal.say(f"[green]Commissioning can start.[/]{hidden}")
    else:
        terminal.say(f"[red]Commissioning cannot start: {stops} to mend first.[/]{hidden}")
    terminal.result({
        "can_start": found.can_start, "profile": found.profile,
        "identity": None if found.identity is None else asdict(found.identity),
        "way": None if found.way is None else asdict(found.way),
        "checks": [asdict(check) for check in found.checks],
        "capabilities": [asdict(capability) for capability in found.capabilities],
    })  # fmt: skip
    if not found.can_start:
        sys.exit(RefusedError.exit_code)
