"""From the options of a bus to a connected drive: which protocol, which profile, which driver.

-i modbus-tcp and -i modbus-rtu are Modbus; everything else is a python-can interface with CANopen on it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from schwung.clock import Clock, WallClock
from schwung.errors import InputError
from schwung.fieldbus.canopen import BusOptions, CanopenDrive, bit_rate, open_bus, scan_bus
from schwung.fieldbus.canopen import match_profile as match_node
from schwung.fieldbus.drive import Drive, Progress
from schwung.fieldbus.found import FoundNode
from schwung.fieldbus.profile import DeviceProfile, ModbusProfile, load_canopen_profile, load_profile

if TYPE_CHECKING:
    from schwung.fieldbus.modbus import Line


@dataclass(frozen=True)
class Connected:
    """A connected drive and the profile that describes it."""

    drive: Drive
    profile: DeviceProfile


def is_modbus(options: BusOptions) -> bool:
    """Whether the interface names a Modbus connection."""
    return (options.interface or "").startswith("modbus")


@contextmanager
def connected(
    options: BusOptions,
    node_id: int,
    profile_name: str | None,
    *,
    clock: Clock | None = None,
    line: Line | None = None,
) -> Iterator[Connected]:
    """Open bus and drive, the profile as named or else by the drive's identity; closed again whatever happens.

    `clock`: whose time it is; default: the wall's. `line`: on Modbus, not one of this computer's, but a bench's.
    Raises InputError where nobody answers or profile and drive disagree, BusError where the bus cannot be opened.
    """
    with (
        _modbus(options, node_id, profile_name, clock or WallClock(), line)
        if is_modbus(options)
        else _canopen(options, node_id, profile_name) as found
    ):
        yield found


@contextmanager
def _canopen(options: BusOptions, node_id: int, profile_name: str | None) -> Iterator[Connected]:
    bus = open_bus(options)
    try:
        profile = load_canopen_profile(profile_name) if profile_name else match_node(bus, node_id)
        drive = CanopenDrive(bus, node_id, profile, bit_rate=bit_rate(options), bus_options=options)
        try:
            yield Connected(drive, profile)
        finally:
            drive.close()
    finally:
        bus.shutdown()


@contextmanager
def _modbus(
    options: BusOptions, unit: int, profile_name: str | None, clock: Clock, bench: Line | None
) -> Iterator[Connected]:
    from schwung.fieldbus.modbus import (  # noqa: PLC0415  (slow to import, and most drives are on CAN)
        ModbusDrive,
        ModbusLink,
        match_profile,
        modbus_options,
    )

    line = modbus_options(options.interface or "", options.channel, options.bitrate, options.extra)
    profile = (
        load_profile(profile_name) if profile_name else match_profile(line, unit, clock=clock, line=bench)
    )
    if not isinstance(profile, ModbusProfile):
        raise InputError(
            f"profile {profile.family}", "is not for Modbus", "Name a Modbus family, or connect by its bus."
        )
    if line.transport not in profile.modbus.transports:
        raise InputError(
            f"profile {profile.family}",
            f"knows no Modbus {line.transport.upper()}",
            f"Use -i modbus-{profile.modbus.transports[0]}.",
        )
    link = ModbusLink(line, unit, profile.modbus, clock=clock, line=bench)
    try:
        drive = ModbusDrive(link, profile, bus=options.named())
    except BaseException:
        link.close()
        raise
    try:
        yield Connected(drive, profile)
    finally:
        drive.close()


def scan(
    options: BusOptions, nodes: Iterable[int], progress: Progress | None = None
) -> tuple[FoundNode, ...]:
    """Who is on the bus. Reads only. Raises InputError, BusError."""
    if is_modbus(options):
        from schwung.fieldbus.modbus import modbus_options, scan_units  # noqa: PLC0415  (as above)

        line = modbus_options(options.interface or "", options.channel, options.bitrate, options.extra)
        return scan_units(line, nodes, progress, clock=WallClock())
    bus = open_bus(options)
    try:
        return scan_bus(bus, nodes, progress)
    finally:
        bus.shutdown()
