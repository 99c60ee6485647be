"""Modbus connections by the flags of python-can's buses."""

from typing import Any

import pytest

from schwung.errors import InputError
from schwung.fieldbus.modbus.options import ModbusOptions, modbus_options, silence_s
from schwung.fieldbus.profile import Modbus


@pytest.mark.parametrize(
    ("channel", "host", "port"),
    [
        ("192.168.0.10", "192.168.0.10", 502),
        ("drive.local:1502", "drive.local", 1502),
        ("[::1]:502", "::1", 502),
    ],
)
def test_a_channel_is_host_and_port(channel: str, host: str, port: int) -> None:
    options = modbus_options("modbus-tcp", channel, None, {"timeout": 2})
    assert (options.host, options.port, options.timeout_s) == (host, port, 2.0)


def test_what_is_not_given_is_as_the_drive_has_it_and_else_as_the_standard() -> None:
    given = modbus_options("modbus-rtu", "/dev/ttyUSB0", 38400, {"parity": "o"})
    drive = Modbus(word_order="low_first", baudrate=115200, parity="N", stopbits=2, timeout_s=0.7)
    done = given.completed(drive)
    assert (done.baudrate, done.parity, done.stopbits, done.timeout_s) == (38400, "O", 2, 0.7)
    plain = modbus_options("modbus-rtu", "/dev/ttyUSB0", None, {}).completed(Modbus(word_order="high_first"))
    assert (plain.baudrate, plain.parity, plain.stopbits) == (
        19200,
        "E",
        1,
    )  # Modbus over Serial Line 1.02, 2.5


@pytest.mark.parametrize(
    ("interface", "channel", "bitrate", "extra", "words"),
    [
        ("modbus-tcp", None, None, {}, "--channel"),
        ("modbus-tcp", "host:nine", None, {}, "no address"),
        ("modbus-tcp", "host:70000", None, {}, "no address"),
        ("modbus-tcp", "host", None, {"parity": "N"}, "parity"),
        ("modbus-rtu", None, None, {}, "--channel"),
        ("modbus-rtu", "/dev/ttyS0", -1, {}, "--bitrate"),
        ("modbus-rtu", "/dev/ttyS0", None, {"parity": "X"}, "parity"),
        ("modbus-rtu", "/dev/ttyS0", None, {"stopbits": 3}, "stopbits"),
        ("modbus-rtu", "/dev/ttyS0", None, {"timeout": 0}, "timeout"),
        ("modbus-rtu", "/dev/ttyS0", None, {"timeout": True}, "timeout"),
        ("modbus-rtu", "/dev/ttyS0", None, {"speed": 1}, "speed"),
        ("modbus-ascii", "/dev/ttyS0", None, {}, "modbus-rtu"),
    ],
)
def test_wrong_flags_are_named(
    interface: str, channel: str | None, bitrate: int | None, extra: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        modbus_options(interface, channel, bitrate, extra)


def test_the_pause_between_frames_is_three_and_a_half_characters() -> None:
    """Modbus over Serial Line 1.02, 2.5.1.1: 11 bits a character; fixed above 19200 bit/s."""
    assert silence_s(ModbusOptions("rtu", device="x", baudrate=9600)) == pytest.approx(3.5 * 11 / 9600)
    assert silence_s(ModbusOptions("rtu", device="x", baudrate=115200)) == 1.75e-3
    assert silence_s(ModbusOptions("tcp", host="x")) == 0.0
