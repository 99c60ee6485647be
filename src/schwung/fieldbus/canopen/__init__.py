"""CANopen: bus, driver, scan."""

import schwung.python_can  # noqa: F401  # isort: skip  # first: without what only its MF4 files need
from schwung.fieldbus.canopen.bus import BusOptions, bit_rate, bus_load, open_bus
from schwung.fieldbus.canopen.driver import CanopenDrive
from schwung.fieldbus.canopen.scan import match_profile, scan_bus
from schwung.fieldbus.found import FoundNode

__all__ = [
    "BusOptions",
    "CanopenDrive",
    "FoundNode",
    "bit_rate",
    "bus_load",
    "match_profile",
    "open_bus",
    "scan_bus",
]
