"""A Modbus drive made of literal frames: what is sent, and what comes back. It knows no profile.

A request that is not in the table is answered with exception 2, illegal data address (Modbus Application Protocol
1.1b3, 7).
"""

from __future__ import annotations

import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest
import serial

from schwung.fieldbus.modbus import ModbusDrive, ModbusLink
from schwung.fieldbus.modbus.options import ModbusOptions
from schwung.fieldbus.profile import ModbusProfile


@dataclass(frozen=True)
class Exchange:
    """One request and its response, what it reads or writes, and who says so. On TCP the frames begin with the function
    code: the header is the protocol's; on RTU they are whole, with address and CRC."""

    request: str
    response: str
    register: int
    value: int
    source: str


class GoldenLine:
    """Looks like a serial port, or like a connected socket."""

    def __init__(self, frames: Mapping[str, str], *, tcp: bool) -> None:
        self.frames = {bytes.fromhex(a): bytes.fromhex(b) for a, b in frames.items()}
        self.requests: list[bytes] = []
        self.inter_byte_timeout = 0.0
        self._tcp, self._waiting = tcp, b""
        self._near, self._far = socket.socketpair()  # what `select` looks at

    # ── a serial port ────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def in_waiting(self) -> int:
        return len(self._waiting)

    def write(self, data: bytes) -> int:
        self.requests.append(data)
        self._waiting += self.frames.get(data, b"")
        return len(data)

    def read(self, size: int) -> bytes:
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    # ── a socket ─────────────────────────────────────────────────────────────────────────────────────────────────

    def fileno(self) -> int:
        return self._near.fileno()

    def getsockname(self) -> Any:
        return self._near.getsockname()

    def setblocking(self, blocking: bool) -> None:
        self._near.setblocking(blocking)

    def send(self, data: bytes) -> int:
        header, unit, asked = data[:4], data[6:7], data[7:]  # transaction and protocol; length; unit
        self.requests.append(asked)
        answer = unit + self.frames.get(asked, bytes([asked[0] | 0x80, 2]))
        self._far.send(header + len(answer).to_bytes(2, "big") + answer)
        return len(data)

    def recv(self, size: int) -> bytes:
        return self._near.recv(size)

    def close(self) -> None:
        self._near.close()
        self._far.close()


@contextmanager
def connected(
    line: GoldenLine, profile: ModbusProfile, monkeypatch: pytest.MonkeyPatch, *, tcp: bool
) -> Iterator[ModbusDrive]:
    """The tool's own driver, connected to it."""
    with monkeypatch.context() as patch:
        patch.setattr(socket, "create_connection", lambda *_, **__: line)
        patch.setattr(serial, "serial_for_url", lambda *_, **__: line)
        options = ModbusOptions("tcp", host="golden") if tcp else ModbusOptions("rtu", device="golden")
        with ModbusDrive(ModbusLink(options, 1, profile.modbus), profile) as drive:
            yield drive
