"""Options that several commands share, named as python-can names them."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from schwung.fieldbus.canopen import BusOptions

_UNITS = {
    "": 1.0, "rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180, "rev": 2 * math.pi,
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "hz": 1.0, "khz": 1e3, "nm": 1.0, "mnm": 1e-3,
    "rad/s": 1.0, "rpm": 2 * math.pi / 60, "deg/s": math.pi / 180,
}  # fmt: skip


def quantity(text: str) -> float:
    """A number in SI units, or with a unit behind it: 180deg, 250ms, 3000rpm, 1kHz.

    Raises typer.BadParameter where it is none.
    """
    match = re.fullmatch(r"\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-zA-Z°/]*)\s*", str(text))
    unit = match[2].lower() if match else None
    try:
        if match is None or unit not in _UNITS:
            raise ValueError(text)
        return float(match[1]) * _UNITS[unit]
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not a quantity; write a number in SI units, or with one of {', '.join(filter(None, _UNITS))}"
        ) from None


Interface = Annotated[
    str | None,
    typer.Option("-i", "--interface", help="python-can interface: socketcan, pcan, kvaser, slcan, socketcand, …",
                 rich_help_panel="Bus"),
]  # fmt: skip
Channel = Annotated[
    str | None,
    typer.Option("-c", "--channel", help="Channel of that interface: can0, PCAN_USBBUS1, /dev/ttyUSB0, …",
                 rich_help_panel="Bus"),
]  # fmt: skip
Bitrate = Annotated[
    int | None, typer.Option("-b", "--bitrate", help="Bit rate, bit/s.", rich_help_panel="Bus")
]
BusOption = Annotated[
    list[str] | None,
    typer.Option("--bus", metavar="KEY=VALUE", rich_help_panel="Bus",
                 help="Any further option of the interface, e.g. --bus host=127.0.0.1. Repeatable."),
]  # fmt: skip
Node = Annotated[
    int, typer.Option("-n", "--node", min=1, max=127, help="CANopen node id.", rich_help_panel="Bus")
]
Profile = Annotated[
    str | None,
    typer.Option("--profile", help="Device profile: a family's name or a profile.toml; default: by identity.",
                 rich_help_panel="Bus"),
]  # fmt: skip
Machine = Annotated[
    Path, typer.Option("-m", "--machine", help="What is believed about the machine: machine.toml.")
]
Reference = Annotated[
    Path | None,
    typer.Option(
        "--reference", metavar="CSV", help="An inertia table to hold the result against, e.g. from CAD."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Yes = Annotated[bool, typer.Option("-y", "--yes", help="Do not ask before the machine moves.")]


def bus_options(
    interface: str | None, channel: str | None, bitrate: int | None, extra: list[str] | None
) -> BusOptions:
    """The bus as given; what is not given is left to python-can's configuration files and environment."""
    from schwung.fieldbus.canopen import BusOptions

    return BusOptions.from_flags(interface, channel, bitrate, extra or ())
