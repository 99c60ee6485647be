"""Opening the drive that the options name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from schwung.fieldbus.canopen import BusOptions, CanopenDrive, bit_rate, match_profile, open_bus
from schwung.fieldbus.profile import DeviceProfile, load_canopen_profile


@dataclass(frozen=True)
class OpenDrive:
    """A connected drive and the profile that describes it."""

    drive: CanopenDrive
    profile: DeviceProfile


@contextmanager
def open_drive(options: BusOptions, node_id: int, profile_name: str | None) -> Iterator[OpenDrive]:
    """Open bus and drive, the profile as named or else by the drive's identity; closed again whatever happens."""
    bus = open_bus(options)
    try:
        profile = load_canopen_profile(profile_name) if profile_name else match_profile(bus, node_id)
        drive = CanopenDrive(bus, node_id, profile, bit_rate=bit_rate(options), bus_options=options)
        try:
            yield OpenDrive(drive, profile)
        finally:
            drive.close()
    finally:
        bus.shutdown()
