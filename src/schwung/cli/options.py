"""Options that several commands share, named as python-can names them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from schwung.errors import InputError
from schwung.extras import require
from schwung.quantities import parse_quantity

if TYPE_CHECKING:
    from schwung import Connection
    from schwung.api.choices import ExportChoice
    from schwung.api.drives import BusOptions


def measured(what: str, signed: bool = False) -> Callable[[str], float]:
    """A parser for one kind of quantity: a number in SI units, or with a unit of that kind (180deg, 250ms, 1kHz).

    Raises typer.BadParameter for anything else; unless `signed`, also for zero and below.
    """

    def parse(text: str) -> float:
        try:
            return parse_quantity(text, what, "", signed=signed)
        except InputError as error:
            remedy = f"; {error.remedy[0].lower()}{error.remedy[1:]}" if error.remedy else "."
            raise typer.BadParameter(error.problem + remedy) from None

    return parse


def quantity(what: str, metavar: str, text: str, panel: str | None = None, *, signed: bool = False) -> Any:
    """The declaration of an option that takes one measured quantity."""
    return typer.Option(parser=measured(what, signed), metavar=metavar, help=text, rich_help_panel=panel)


def one_of(option: str, text: str, choices: Any) -> Any:
    """The text where it is one of the values of a Literal. Raises InputError that lists them."""
    names = get_args(choices)
    if text not in names:
        raise InputError(option, f'is "{text}"', f"Use {', '.join(names[:-1])} or {names[-1]}.")
    return text


def export_choice(text: str) -> ExportChoice:
    """table, harmonics, mean, max, host or at=ANGLE, the angle with its unit. Raises InputError for anything else."""
    from schwung.api.choices import parse_choice

    form, _, where = text.partition("=")
    if form == "at" and where:
        text = f"at={measured('angle', signed=True)(where)!r}"
    return parse_choice(text)


def require_plant(place: str, plant: str) -> None:
    """Raise MissingLibraryError where a simulated drive with this plant needs what is not installed."""
    require(place, "bench", *(("numba",) if plant == "two-mass" else ()))


Interface = Annotated[
    str | None,
    typer.Option("-i", "--interface", help="python-can interface: socketcan, pcan, …; or modbus-tcp, modbus-rtu.",
                 rich_help_panel="Bus"),
]  # fmt: skip
Channel = Annotated[
    str | None,
    typer.Option("-c", "--channel", help="Channel of that interface: can0, PCAN_USBBUS1, /dev/ttyUSB0, HOST:PORT, …",
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
CanLog = Annotated[
    Path | None,
    typer.Option("--can-log", metavar="FILE", rich_help_panel="Bus",
                 help="Write every frame of the bus there, both ways: .blf, .asc, .log, .csv, .trc, … by its ending."),
]  # fmt: skip
Node = Annotated[
    int,
    typer.Option(
        "-n", "--node", min=1, max=247, help="CANopen node id, or Modbus unit.", rich_help_panel="Bus"
    ),
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
Out = Annotated[
    Path | None, typer.Option(help="Folder for what is recorded and found; default: schwung-<time>.")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Plan and check; change and move nothing.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Yes = Annotated[bool, typer.Option("-y", "--yes", help="Do not ask before the machine moves.")]


_LIMITS = "Limits"
MinPosition = Annotated[
    float | None, quantity("angle", "RAD", "Lower end of the window.", _LIMITS, signed=True)
]
MaxPosition = Annotated[
    float | None, quantity("angle", "RAD", "Upper end of the window.", _LIMITS, signed=True)
]
MaxSpeed = Annotated[float | None, quantity("speed", "RAD/S", "Speed limit.", _LIMITS)]
MaxTorque = Annotated[float | None, quantity("torque", "NM", "Torque limit.", _LIMITS)]
FollowingError = Annotated[float | None, quantity("angle", "RAD", "Tolerated following error.", _LIMITS)]

INJECTION = "Injection and recording"
Amplitude = Annotated[float | None, quantity("torque", "NM", "Peak of the injected torque.", INJECTION)]
Rate = Annotated[float, quantity("frequency", "HZ", "SYNC rate.", INJECTION)]
Misses = Annotated[
    int,
    typer.Option(
        "--misses",
        min=1,
        help="Heartbeats (10 a second) that may be missing before drive and program give each other up.",
        rich_help_panel=INJECTION,
    ),
]
MaxJitter = Annotated[
    float | None,
    quantity("time", "S", "Tolerated SYNC jitter (p99); default: a tenth of the period.", INJECTION),
]


def connected(
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    extra: list[str] | None,
    node: int,
    profile: str | None,
    can_log: Path | None = None,
) -> AbstractContextManager[Connection]:
    """The drive that the options name, for as long as the block lasts."""
    from schwung import connect

    return connect(bus_options(interface, channel, bitrate, extra, can_log), node=node, profile=profile)


def bus_options(
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    extra: list[str] | None,
    can_log: Path | None = None,
) -> BusOptions:
    """The bus as given; what is not given is left to python-can's configuration files and environment.

    Raises InputError for a log that cannot be written.
    """
    from schwung.api.drives import BusOptions, with_log

    return with_log(BusOptions.from_flags(interface, channel, bitrate, extra or ()), can_log)
