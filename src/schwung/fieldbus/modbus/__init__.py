"""Modbus: words, connection, driver, scan."""

from schwung.fieldbus.modbus.client import Line
from schwung.fieldbus.modbus.driver import ModbusDrive
from schwung.fieldbus.modbus.link import ModbusLink
from schwung.fieldbus.modbus.options import INTERFACES, ModbusOptions, modbus_options
from schwung.fieldbus.modbus.scan import match_profile, scan_units

__all__ = [
    "INTERFACES",
    "Line",
    "ModbusDrive",
    "ModbusLink",
    "ModbusOptions",
    "match_profile",
    "modbus_options",
    "scan_units",
]
