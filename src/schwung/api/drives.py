"""A drive on its bus: connected for as long as a block lasts, found by a scan, looked at by the doctor."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schwung.api.shown import Shown
from schwung.errors import InputError
from schwung.fieldbus.canopen import BusOptions
from schwung.fieldbus.canopen.logged import require_log
from schwung.fieldbus.connecting import Connected, connected, is_modbus
from schwung.fieldbus.connecting import scan as scan_bus
from schwung.fieldbus.drive import ENERGISED, Drive, DriveState
from schwung.fieldbus.found import FoundNode

if TYPE_CHECKING:
    from schwung.commissioning.doctor import Diagnosis

__all__ = [
    "ENERGISED",
    "BusOptions",
    "Connected",
    "Connection",
    "Diagnosis",
    "Drive",
    "DriveState",
    "connect",
    "connected",
    "doctor",
    "is_modbus",
    "scan",
    "with_log",
]


@dataclass(frozen=True)
class Connection(Shown, Connected):
    """A connected drive: `drive` (positions in rad, speeds in rad/s, torques in N·m, samples (n,)) and the `profile` of
    its family. Made by `connect`, of use within its block.

    Raises DriveError and its kind where the bus or the drive lets us down.

    >>> with schwung.connect("stepped", bench) as connection:
    ...     connection.drive.identity.name
    'Schwung bench drive'
    """

    def _facts(self) -> Sequence[tuple[str, str]]:
        identity = self.drive.identity
        return [
            ("drive", f"node {identity.node_id}: {identity.name or 'unnamed'}, serial {identity.serial}"),
            ("profile", self.profile.family),
        ]


@contextmanager
def connect(
    interface: str | BusOptions | None = None,
    channel: str | None = None,
    *,
    bitrate: int | None = None,
    node: int = 1,
    profile: str | None = None,
    **options: Any,
) -> Iterator[Connection]:
    """Connect to a drive, and let go of it at the end of the block whatever happens. Changes and moves nothing.

    Whatever ends the block, an exception or Ctrl-C included, a drive that we have switched on is stopped and switched
    off.

    Args:
        interface: python-can's ("socketcan", "pcan", …), "modbus-tcp" or "modbus-rtu"; None: as python-can is
            configured. Or BusOptions, which hold channel, bit rate and options, too.
        channel: of that interface: "can0", "PCAN_USBBUS1", "/dev/ttyUSB0", "192.168.0.10:502".
        bitrate: bit/s; None: as the interface has it.
        node: CANopen node id or Modbus unit.
        profile: a family's name or the path of a profile.toml; None: by the drive's identity.
        options: any further option of the interface, e.g. host="127.0.0.1"; and can_log, a file for all frames.

    Yields the connection; its drive speaks rad, rad/s and N·m, in arrays of shape (n,).
    Raises InputError where nobody answers or profile and drive disagree, BusError where the bus cannot be opened.

    >>> with schwung.connect("stepped", bench, node=1) as connection:
    ...     connection.profile.family
    'schwung-bench'
    """
    with connected(_bus(interface, channel, bitrate, options), node, profile) as opened:
        yield Connection(opened.drive, opened.profile)


def scan(
    interface: str | BusOptions | None = None,
    channel: str | None = None,
    *,
    bitrate: int | None = None,
    nodes: Iterable[int] = range(1, 128),
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> tuple[FoundNode, ...]:
    """Who is on the bus: identity, state, matching profiles, and what they can do. Reads only.

    Args:
        interface, channel, options: as `connect` takes them.
        bitrate: bit/s.
        nodes: ids that are asked.
        progress: told how many ids are done, and of how many.

    Returns one value per node; it holds no quantities, so that there are neither units nor shapes.
    Raises InputError for options that make no bus, BusError where it cannot be opened.

    >>> [node.name for node in schwung.scan("stepped", bench, nodes=range(1, 3))]
    ['Schwung bench drive']
    """
    return scan_bus(_bus(interface, channel, bitrate, options), nodes, progress)


def doctor(
    interface: str | BusOptions | None = None,
    channel: str | None = None,
    *,
    bitrate: int | None = None,
    node: int = 1,
    profile: str | None = None,
    eds: str | os.PathLike[str] | None = None,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> Diagnosis:
    """What is missing before this drive can be commissioned, and how to mend it. Reads only.

    Args:
        interface, channel, node, profile, options: as `connect` takes them.
        bitrate: bit/s.
        eds: the vendor's EDS, to compare with the drive; None: the profile's. On Modbus nobody asks for it.
        progress: told what is being looked at.

    Returns checks in words, the gravest first, and `can_start`; there are no arrays, so no shapes, and units are
    in words.
    Raises InputError for options that make no bus, BusError where it cannot be opened.

    >>> schwung.doctor("stepped", bench).can_start
    True
    """
    from schwung.commissioning.doctor import examine_connected
    from schwung.commissioning.doctor_canopen import examine

    bus = _bus(interface, channel, bitrate, options)
    tell = progress or (lambda _text: None)
    if is_modbus(bus):
        return examine_connected(bus, node, profile, Path(), tell)
    return examine(bus, node, profile, None if eds is None else Path(eds), Path(), tell)


def _bus(
    interface: str | BusOptions | None, channel: str | None, bitrate: int | None, options: dict[str, Any]
) -> BusOptions:
    if isinstance(interface, BusOptions):
        return interface
    can_log = options.pop("can_log", None)
    return with_log(BusOptions(interface, channel, bitrate, options), can_log)


def with_log(options: BusOptions, path: str | os.PathLike[str] | None) -> BusOptions:
    """The same bus, all frames of which go into a file (candump's format, BLF or ASC, by its name); None: into none.

    Raises InputError where it cannot be written, or where there are no frames.
    """
    if path is None:
        return options
    if is_modbus(options):
        raise InputError("--can-log", "is for CAN; Modbus has no frames of it", "Leave it out.")
    require_log(Path(path))
    return replace(options, log=Path(path))
