"""`schwung restore`: put back the drive parameters that a crashed run had changed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from schwung.cli.options import Bitrate, BusOption, Channel, Interface, Json, bus_options


def restore(
    backup: Annotated[Path, typer.Argument(help="The *.backup.json of the run.")],
    force: Annotated[
        bool, typer.Option("--force", help="Also on a drive with another identity, and twice.")
    ] = False,
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    node: Annotated[
        int | None, typer.Option("-n", "--node", min=1, max=127, help="Default: the node that was backed up.")
    ] = None,
    profile: Annotated[str | None, typer.Option(help="Default: the profile that was used.")] = None,
    json_output: Json = False,
) -> None:
    """Put back the parameters that a run had changed, after a crash or a power loss.

    The bus and the node are those of the backup file unless options say otherwise.

    [bold]Examples[/]

      schwung restore schwung-20260314-101500/setup.backup.json

      schwung restore setup.backup.json -i socketcan -c can1 -n 3
    """
    from schwung.cli.console import Terminal
    from schwung.cli.drives import open_drive
    from schwung.commissioning import read_backup, restore_backup
    from schwung.fieldbus.canopen import BusOptions

    terminal = Terminal(json_output)
    content = read_backup(backup)
    if content.restored and not force:
        terminal.say(
            f"{backup} was put back on {content.restored} already; nothing to do (--force does it again)."
        )
        terminal.result({"restored": 0, "when": content.restored})
        return
    record = content.drive
    options = bus_options(interface, channel, bitrate, bus)
    known = record.get("bus") or {}
    if interface is None and channel is None and "interface" in known:
        options = BusOptions(
            known["interface"], known.get("channel"), known.get("bitrate"), known.get("extra") or {}
        )
    was, family = record.get("identity") or {}, record.get("profile")
    with open_drive(options, node or int(was.get("node_id", 1)), profile or family) as opened:
        values = restore_backup(opened.drive, backup, force)
    terminal.table("Put back", ("object", "value"), ((v.parameter.label, v.raw) for v in values))
    terminal.say(f"{len(values)} parameters put back.")
    terminal.result({"restored": len(values)})
