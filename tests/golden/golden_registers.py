"""A Modbus drive made of literal frames: what is sent, and what comes back. It knows no profile.

A request that is not in the table is answered with exception 2, illegal data address (Modbus Application Protocol
1.1b3, 7); on a serial line, with silence.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from schwung.clock import SteppedClock
from schwung.fieldbus.modbus import ModbusDrive, ModbusLink, ModbusOptions
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
    """The drive's end of a line within this process (schwung.fieldbus.modbus.client.Line)."""

    hung_up = False

    def __init__(self, frames: Mapping[str, str], *, tcp: bool) -> None:
        self.frames = {bytes.fromhex(a): bytes.fromhex(b) for a, b in frames.items()}
        self.tcp = tcp
        self.requests: list[bytes] = []
        self._answer = b""

    def open(self) -> bool:
        return True

    def close(self) -> None:
        self._answer = b""

    def send(self, data: bytes) -> None:
        if self.tcp:  # transaction, protocol and length; unit
            head, unit, data = data[:4], data[6:7], data[7:]
            answer = unit + self.frames.get(data, bytes([data[0] | 0x80, 2]))
            self._answer += head + len(answer).to_bytes(2, "big") + answer
        else:
            self._answer += self.frames.get(data, b"")
        self.requests.append(data)

    @property
    def waiting(self) -> bool:
        return bool(self._answer)

    def take(self) -> bytes:
        answer, self._answer = self._answer, b""
        return answer


@contextmanager
def connected(line: GoldenLine, profile: ModbusProfile) -> Iterator[ModbusDrive]:
    """The tool's own driver, connected to it; no time passes but its."""
    options = ModbusOptions("tcp", host="golden") if line.tcp else ModbusOptions("rtu", device="golden")
    link = ModbusLink(options, 1, profile.modbus, clock=SteppedClock(), line=line)
    with ModbusDrive(link, profile) as drive:
        yield drive
