"""`schwung scan`: who is on the bus, in which state, and what its profile can do with it. Changes nothing."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from schwung.cli.options import Bitrate, BusOption, CanLog, Channel, Interface, Json, bus_options


def scan(
    interface: Interface = None,
    channel: Channel = None,
    bitrate: Bitrate = None,
    bus: BusOption = None,
    can_log: CanLog = None,
    nodes: Annotated[
        str, typer.Option("--nodes", metavar="FIRST-LAST", help="Node ids that are asked.")
    ] = "1-127",
    json_output: Json = False,
) -> None:
    """List the nodes on a bus: identity, state, matching profiles, and what they can and cannot do. Read-only.

    [bold]Examples[/]

      schwung scan -i socketcan -c can0

      schwung scan -i pcan -c PCAN_USBBUS1 -b 1000000 --nodes 1-16

      schwung scan -i socketcand -c vcan0 --bus host=127.0.0.1 --bus port=29536

      schwung scan -i modbus-tcp -c 192.168.0.10:502 --nodes 1

      schwung scan -i modbus-rtu -c /dev/ttyUSB0 -b 115200 --bus parity=N --nodes 1-8
    """
    from schwung import scan as scan_all
    from schwung.api.drives import is_modbus
    from schwung.cli.console import Terminal, observing
    from schwung.errors import InputError

    first, _, last = nodes.partition("-")
    if (
        not (first.isdigit() and (last or first).isdigit())
        or not 1 <= int(first) <= int(last or first) <= 127
    ):
        raise InputError("--nodes", f'"{nodes}" is no range of node ids', "Write for instance --nodes 1-16.")
    wanted = range(int(first), int(last or first) + 1)
    terminal = Terminal(json_output)
    options = bus_options(interface, channel, bitrate, bus, can_log)
    with observing(terminal) as observer:
        observer.phase(f"Asking nodes {wanted[0]} to {wanted[-1]}")
        found = scan_all(options, nodes=wanted, progress=observer.progress)
    if not found:
        what = "bit rate and parity" if is_modbus(options) else "bit rate"
        terminal.say(f"No node answered. Is the bus powered and terminated, and the {what} right?")
    for node in found:
        terminal.table(
            f"Node {node.node_id}: {node.name or 'unnamed'}",
            ("", ""),
            (
                ("identity", f"vendor {node.vendor_id:#010x}, product {node.product_code:#010x}, "
                             f"revision {node.revision:#010x}, serial {node.serial}"),
                ("state", ", ".join(word.lower() for word in (node.nmt, node.cia402) if word and word != "UNKNOWN")),
                ("profiles", ", ".join(node.profiles) or "none: use --profile"),
                *((f"{'can' if c.available else 'cannot'}", f"{c.name}: {c.reason}") for c in node.capabilities),
            ),
        )  # fmt: skip
    terminal.result({"nodes": [asdict(node) for node in found]})
