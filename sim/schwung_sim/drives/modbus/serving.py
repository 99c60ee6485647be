"""The Modbus drive on lines of this computer: a TCP socket, or a pseudo-terminal that is a serial line to the tool.
One event loop carries the bytes and keeps the drive's time, which is the wall's."""

from __future__ import annotations

import asyncio
import contextlib
import os
from abc import ABC, abstractmethod
from collections.abc import Callable

from schwung_sim.drives.modbus.faults import RTU_DROP_S
from schwung_sim.drives.modbus.server import ModbusServer
from schwung_sim.errors import BenchError

_CHARACTER_BITS = 11


class LoopClock:
    """The time of an event loop, as the drive takes it."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self.now = loop, loop.time

    def later(self, delay_s: float, call: Callable[[], None]) -> _Timer:
        """Call once."""
        timer = _Timer()
        timer.handle = self._loop.call_later(delay_s, call)
        return timer

    def every(self, period_s: float, call: Callable[[], None]) -> _Timer:
        """Call again and again."""
        timer = _Timer()

        def again() -> None:
            timer.handle = self._loop.call_later(period_s, again)
            call()

        again()
        return timer


class _Timer:
    handle: asyncio.TimerHandle | None = None

    def close(self) -> None:
        if self.handle is not None:
            self.handle.cancel()


class Serving(ABC):
    """A server on a line of this computer, for as long as `run` runs."""

    def __init__(self, server: ModbusServer) -> None:
        self._server = server
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping: asyncio.Event | None = None

    def run(self, ready: Callable[[], None]) -> None:
        """Serve until `stop`; `ready` is called when the drive answers. Raises BenchError where the line is taken."""
        asyncio.run(self._serve(ready))

    def stop(self) -> None:
        """End `run`; from any thread."""
        if self._loop is not None and self._stopping is not None:
            with contextlib.suppress(RuntimeError):  # it ended by itself
                self._loop.call_soon_threadsafe(self._stopping.set)

    async def _serve(self, ready: Callable[[], None]) -> None:
        self._loop, self._stopping = asyncio.get_running_loop(), asyncio.Event()
        self._server.drop = self._drop
        self._server.begin(LoopClock(self._loop))
        try:
            await self._open(self._loop)
            ready()
            await self._stopping.wait()
        finally:
            self._server.end()
            await self._close()

    @abstractmethod
    async def _open(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the line."""

    @abstractmethod
    async def _close(self) -> None:
        """Let go of it."""

    @abstractmethod
    def _drop(self) -> None:
        """Cut whoever is connected off."""


class TcpServing(Serving):
    """On a TCP socket; port 0: any, `address` tells which."""

    def __init__(self, server: ModbusServer, address: tuple[str, int]) -> None:
        super().__init__(server)
        self.address = address
        self._listening: asyncio.Server | None = None
        self.connections: set[asyncio.Transport] = set()

    async def _open(self, loop: asyncio.AbstractEventLoop) -> None:
        try:
            self._listening = await loop.create_server(
                lambda: _Connection(self._server, self.connections), *self.address
            )
        except OSError as error:
            raise BenchError(
                f"address {self.address}", f"cannot be served ({error})", "Take a free port."
            ) from error
        self.address = self._listening.sockets[0].getsockname()[:2]

    async def _close(self) -> None:
        if self._listening is not None:
            self._listening.close()
        self._drop()

    def _drop(self) -> None:
        for connection in list(self.connections):
            connection.close()


class _Connection(asyncio.Protocol):
    def __init__(self, server: ModbusServer, connections: set[asyncio.Transport]) -> None:
        self._server, self._connections = server, connections

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._connections.add(transport)
        self._session = self._server.session(self._reply)

    def _reply(self, data: bytes) -> None:
        if not self._transport.is_closing():
            self._transport.write(data)

    def data_received(self, data: bytes) -> None:
        self._session.receive(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._connections.discard(self._transport)


class SerialServing(Serving):
    """On a pseudo-terminal, whose other end, `tool`, is a serial device; paced as a real one where a rate is given."""

    def __init__(self, server: ModbusServer, bitrate: int | None = None) -> None:
        super().__init__(server)
        try:
            import pty  # not on Windows
            import tty
        except ImportError:
            raise BenchError(
                "serial line", "this system has no pseudo-terminals", "Serve Modbus TCP instead."
            ) from None
        self._end, self._tool_end = pty.openpty()
        tty.setraw(self._tool_end)
        self.tool = os.ttyname(self._tool_end)
        self._bitrate = bitrate
        self._cut_until_s = 0.0
        self._session = server.session(self._send)

    async def _open(self, loop: asyncio.AbstractEventLoop) -> None:
        os.set_blocking(self._end, False)
        loop.add_reader(self._end, self._came)

    def _came(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._carry(os.read(self._end, 4096), self._session.receive)

    def _send(self, data: bytes) -> None:
        self._carry(data, self._write)

    def _write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):  # nobody reads: what does not fit is lost
            os.write(self._end, data)

    def _carry(self, data: bytes, deliver: Callable[[bytes], None]) -> None:
        if self._loop is None or self._loop.time() < self._cut_until_s:
            return
        delay_s = len(data) * _CHARACTER_BITS / self._bitrate if self._bitrate else 0.0
        self._loop.call_later(delay_s, deliver, data)

    async def _close(self) -> None:
        if self._loop is not None:
            self._loop.remove_reader(self._end)
        os.close(self._end)
        os.close(self._tool_end)

    def _drop(self) -> None:
        if self._loop is not None:
            self._cut_until_s = self._loop.time() + RTU_DROP_S
