"""Who carries the requests: pymodbus, over a socket, a serial port, or a line of a bench within this process.

pymodbus' own clients wait by the wall, which is right where the line is real. On a bench's line the clock decides: a
request that is not answered costs the clock's seconds.
"""

from __future__ import annotations

from typing import Protocol

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.client.base import ModbusBaseSyncClient
from pymodbus.exceptions import ConnectionException
from pymodbus.framer import FramerType
from pymodbus.transport import CommParams, CommType

from schwung.clock import Clock
from schwung.fieldbus.modbus.options import (
    USUAL_BAUDRATE,
    USUAL_PARITY,
    USUAL_STOPBITS,
    ModbusOptions,
)


class Line(Protocol):
    """The tool's end of a line that is neither socket nor serial port of this computer. Nothing here waits."""

    def open(self) -> bool:
        """Connect. False where nobody takes the connection."""
        ...

    def close(self) -> None: ...

    def send(self, data: bytes) -> None: ...

    @property
    def waiting(self) -> bool:
        """Something has come that was not taken."""
        ...

    def take(self) -> bytes:
        """All that has come."""
        ...

    @property
    def hung_up(self) -> bool:
        """The other end has closed the connection."""
        ...


class LineClient(ModbusBaseSyncClient):
    """pymodbus' client with its framing and transactions, on a line in the clock's time."""

    def __init__(self, line: Line, clock: Clock, transport: str, timeout_s: float) -> None:
        framer, kind = (
            (FramerType.SOCKET, CommType.TCP) if transport == "tcp" else (FramerType.RTU, CommType.SERIAL)
        )
        # endless: pymodbus looks at the wall for it, while it is the clock's time that `recv` waits
        super().__init__(
            framer, 0, CommParams(comm_type=kind, timeout_connect=float("inf")), None, None, None
        )
        self.timeout_s = timeout_s
        self._line, self._clock, self._serial = line, clock, kind is CommType.SERIAL
        self._open = False

    @property
    def connected(self) -> bool:
        """As far as we know: that the other end has gone is found out when it is asked."""
        return self._open

    def connect(self) -> bool:
        """Open the line, where it is not open."""
        self._open = self._open or self._line.open()
        return self._open

    def close(self) -> None:
        """Close the line."""
        self._open = False
        self._line.close()

    def send(self, request: bytes, addr: tuple[str, int] | None = None) -> int:
        """Send a frame. On a serial line, what has come before it is no answer to it."""
        if self._serial:
            self._line.take()
        self._line.send(request)
        return len(request)

    def recv(self, size: int | None) -> bytes:
        """What comes within the time-out; nothing: b"". Raises ConnectionException where the other end has gone."""
        line = self._line
        self._clock.wait(lambda: line.waiting or line.hung_up, self.timeout_s)
        if line.hung_up and not line.waiting:
            self.close()
            raise ConnectionException("the other end has closed the connection")
        return line.take()


Client = ModbusTcpClient | ModbusSerialClient | LineClient


def make_client(options: ModbusOptions, timeout_s: float, clock: Clock, line: Line | None) -> Client:
    """The client for a connection, not yet connected; `line`: instead of one of this computer's own."""
    o = options
    if line is not None:
        return LineClient(line, clock, o.transport, timeout_s)
    if o.transport == "tcp":
        return ModbusTcpClient(o.host, port=o.port, timeout=timeout_s, retries=0)
    return ModbusSerialClient(
        o.device, baudrate=o.baudrate or USUAL_BAUDRATE, bytesize=8, parity=o.parity or USUAL_PARITY,
        stopbits=o.stopbits or USUAL_STOPBITS, timeout=timeout_s, retries=0,
    )  # fmt: skip


def set_timeout(client: Client, timeout_s: float) -> None:
    """How long it waits for answers from now on."""
    if isinstance(client, LineClient):
        client.timeout_s = timeout_s
    else:
        client.comm_params.timeout_connect = timeout_s
