"""Our Modbus client against libmodbus, and our simulated drive read by mbpoll: two other minds on the same protocol.

Debian: libmodbus5 and mbpoll. Skipped where they are not installed.
"""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from libmodbus import LibmodbusServer, load, serial_line

from schwung.clock import WallClock
from schwung.errors import RegisterError
from schwung.fieldbus.modbus import ModbusLink, ModbusOptions
from schwung.fieldbus.modbus.words import decode, encode
from schwung.fieldbus.profile import Modbus
from schwung_sim.modbus_bench import ModbusBench

pytestmark = pytest.mark.posix  # serial lines are pseudo terminals
LIBRARY = load()
libmodbus = pytest.mark.skipif(LIBRARY is None, reason="libmodbus5 is not installed")
MBPOLL = shutil.which("mbpoll")
mbpoll = pytest.mark.skipif(MBPOLL is None, reason="mbpoll is not installed")
BOTH = pytest.mark.parametrize("transport", ["tcp", "rtu"])

# ── our client, libmodbus' server ────────────────────────────────────────────────────────────────────────────────


@contextmanager
def linked(transport: str, **modbus: object) -> Iterator[tuple[LibmodbusServer, ModbusLink]]:
    assert LIBRARY is not None
    drive = Modbus(word_order="high_first", timeout_s=0.5, **modbus)  # type: ignore[arg-type]  # by name
    if transport == "tcp":
        server = LibmodbusServer(LIBRARY)
        link = ModbusLink(
            ModbusOptions("tcp", host="127.0.0.1", port=server.port), 1, drive, clock=WallClock()
        )
        try:
            yield server, link
        finally:
            link.close()
            server.close()
        return
    with serial_line() as (theirs, ours):
        server = LibmodbusServer(LIBRARY, theirs)
        link = ModbusLink(
            ModbusOptions("rtu", device=ours, baudrate=115200, parity="N"), 1, drive, clock=WallClock()
        )
        try:
            yield server, link
        finally:
            link.close()
            server.close()


@libmodbus
@BOTH
def test_what_libmodbus_holds_is_what_we_read(transport: str) -> None:
    with linked(transport) as (server, link):
        for address in range(125):
            server.registers[address] = (address * 7919) & 0xFFFF
        assert link.read(0, 1) == (0,)
        assert link.read(3, 5) == tuple((address * 7919) & 0xFFFF for address in range(3, 8))
        assert link.read(0, 125) == tuple((address * 7919) & 0xFFFF for address in range(125))
        assert [request[0] for request in server.requests] == [3, 3, 3]


@libmodbus
@BOTH
def test_what_we_write_is_what_libmodbus_holds(transport: str) -> None:
    with linked(transport) as (server, link):
        link.write(10, (0xBEEF,))
        link.write(20, (1, 2, 3))
        assert server.registers[10] == 0xBEEF
        assert [server.registers[address] for address in (20, 21, 22)] == [1, 2, 3]
        assert [request[0] for request in server.requests] == [16, 16]


@libmodbus
def test_single_registers_are_written_by_function_6_where_the_drive_wants_it() -> None:
    with linked("tcp", write_function=6) as (server, link):
        link.write(10, (0xBEEF,))
        link.write(20, (1, 2))
        assert server.registers[10] == 0xBEEF
        assert [request[0] for request in server.requests] == [6, 16]


@libmodbus
def test_wide_values_are_as_the_macros_of_libmodbus_have_them() -> None:
    """MODBUS_SET_INT32_TO_INT16 and MODBUS_SET_INT64_TO_INT16 of modbus.h: the high word first."""
    with linked("tcp") as (server, link):
        link.write(0, encode(-123_456_789, "INTEGER32", "high_first"))
        link.write(2, encode(-(1 << 40) - 5, "INTEGER64", "high_first"))
        held = struct.pack(">6H", *(server.registers[address] for address in range(6)))
        assert struct.unpack(">iq", held) == (-123_456_789, -(1 << 40) - 5)
        assert decode(link.read(0, 2), "INTEGER32", "high_first") == -123_456_789
        assert decode(link.read(0, 2)[::-1], "INTEGER32", "low_first") == -123_456_789


@libmodbus
@BOTH
def test_refusals_of_libmodbus_are_told_by_their_code(transport: str) -> None:
    with linked(transport) as (_, link):
        with pytest.raises(RegisterError, match="no such register") as caught:
            link.read(195, 10)
        assert caught.value.code == 2
        with pytest.raises(RegisterError, match="no such register"):
            link.write(199, (1, 2))
        assert link.read(0, 1) == (0,)


# ── mbpoll's client, our drive ───────────────────────────────────────────────────────────────────────────────────


def polled(bench: ModbusBench, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run mbpoll once, with addresses from 0."""
    told = bench.tool_options
    if told["interface"] == "modbus-tcp":
        host, _, port = told["channel"].rpartition(":")
        line, where = ["-m", "tcp", "-p", port], host
    else:
        line, where = ["-m", "rtu", "-b", "115200", "-P", "none"], told["channel"]
    options = [a for a in arguments if not a.startswith("=")]
    values = [a[1:] for a in arguments if a.startswith("=")]
    command = [str(MBPOLL), *line, "-a", "1", "-0", "-1", "-q", *options, "--", where, *values]
    return subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)


def read_by_mbpoll(bench: ModbusBench, address: int, count: int, form: str) -> list[int]:
    """Values as mbpoll prints them; the high word first (-B)."""
    done = polled(bench, "-r", str(address), "-c", str(count), "-t", form, "-B")
    return [int(value) for value in re.findall(r"^\[\d+\]:\s+(-?\d+)", done.stdout, re.MULTILINE)]


@mbpoll
@BOTH
def test_mbpoll_reads_and_writes_the_simulated_drive(transport: str) -> None:
    tcp = ("127.0.0.1", 0) if transport == "tcp" else None
    with ModbusBench(tcp=tcp, seed=1234) as bench:
        assert read_by_mbpoll(bench, 0, 3, "4:int") == [
            0x53574E47,
            0x4D42,
            1234,
        ]  # manufacturer, product, serial
        assert read_by_mbpoll(bench, 300, 2, "4:int") == [-8344303, 8344303]  # the window of ±50 rad
        assert polled(bench, "-r", "210", "-t", "4:int", "-B", "=-77").returncode == 0
        assert read_by_mbpoll(bench, 210, 1, "4:int") == [-77]
        assert bench.servo.registers.cells[210].value == -77


@mbpoll
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-r", "201", "-t", "4"), "Illegal data address"),  # half of a parameter
        (("-r", "200", "-c", "2", "-t", "3"), "Illegal function"),  # input registers: it has none
        (("-r", "104", "-t", "4:int", "-B", "=9"), "Illegal data value"),  # a mode that it does not have
    ],
)
def test_mbpoll_understands_what_the_simulated_drive_refuses(arguments: tuple[str, ...], words: str) -> None:
    with ModbusBench(tcp=("127.0.0.1", 0)) as bench:
        done = polled(bench, *arguments)
    assert words in done.stdout + done.stderr
