"""Modbus: words, connection, driver, scan."""
