"""Modbus: words, connection, driver."""

from schwung.fieldbus.modbus.driver import ModbusDrive
from schwung.fieldbus.modbus.link import ModbusLink
from schwung.fieldbus.modbus.options import INTERFACES, ModbusOptions, modbus_options

__all__ = ["INTERFACES", "ModbusDrive", "ModbusLink", "ModbusOptions", "modbus_options"]
