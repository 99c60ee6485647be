"""The Modbus drive on its line: pymodbus serves the registers, the axis follows the computer's clock."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import pty
import time
import tty
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from schwung_sim.drives.modbus.faults import RTU_DROP_S, Fault, FaultSchedule
from schwung_sim.drives.modbus.registers import ILLEGAL_FUNCTION, RefusalError
from schwung_sim.drives.modbus.servo import ModbusServo
from schwung_sim.errors import BenchError
from schwung_sim.plants.two_mass import TICK_S

if TYPE_CHECKING:
    from pymodbus.constants import ExcCodes
    from pymodbus.pdu import ModbusPDU
    from pymodbus.simulator import SimDevice

PERIOD_S = 0.002  # how often time passes when no request comes
BACKLOG_S = 0.25  # an axis that fell further behind than this drops the rest
_CHARACTER_BITS = 11
_WRITES = {6, 16}


class SerialLine:
    """A line between two pseudo-terminals, `drive` and `tool`; paced as a real one where a bit rate is given."""

    def __init__(self, bitrate: int | None = None) -> None:
        self._ends = [pty.openpty(), pty.openpty()]
        for _, slave in self._ends:
            tty.setraw(slave)
        self.drive, self.tool = (os.ttyname(slave) for _, slave in self._ends)
        self._bitrate = bitrate
        self._cut_until_s = 0.0
        self._loop: asyncio.AbstractEventLoop | None = None

    def connect(self, loop: asyncio.AbstractEventLoop) -> None:
        """Carry bytes both ways from now on."""
        self._loop = loop
        (one, _), (other, _) = self._ends
        for source, sink in ((one, other), (other, one)):
            os.set_blocking(source, False)
            loop.add_reader(source, self._carry, source, sink)

    def _carry(self, source: int, sink: int) -> None:
        with contextlib.suppress(BlockingIOError):
            data = os.read(source, 4096)
            if time.monotonic() < self._cut_until_s or self._loop is None:
                return
            delay_s = len(data) * _CHARACTER_BITS / self._bitrate if self._bitrate else 0.0
            self._loop.call_later(delay_s, os.write, sink, data)

    def cut(self, duration_s: float) -> None:
        """Nothing gets through for so long."""
        self._cut_until_s = time.monotonic() + duration_s

    def close(self) -> None:
        """Take the line away."""
        for ends in self._ends:
            for end in ends:
                if self._loop is not None and not self._loop.is_closed():
                    self._loop.remove_reader(end)
                os.close(end)


class ModbusServer:
    """One drive served on TCP, or on a serial line; `run` returns after `stop`. Everything happens in its loop."""

    def __init__(
        self,
        servo: ModbusServo,
        unit: int,
        *,
        tcp: tuple[str, int] | None = None,
        line: SerialLine | None = None,
        faults: tuple[Fault, ...] = (),
        seed: int = 0,
    ) -> None:
        self.servo, self.unit = servo, unit
        self.address = tcp
        self.requests = 0
        self._line = line
        self._faults = FaultSchedule(servo, faults, self._drop, seed)
        self._read_function = int(servo.profile["modbus"].get("read_function", 3))
        self._swallow = False
        self._server: Any = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping: asyncio.Event | None = None
        self._last_s = time.monotonic()
        self._debt_s = 0.0

    # ── life ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def run(self, ready: Callable[[], None]) -> None:
        """Serve until `stop`; `ready` is called when the address is known. Raises BenchError where it is taken."""
        asyncio.run(self._serve(ready))

    def stop(self) -> None:
        """End `run`; from any thread."""
        if self._loop is not None and self._stopping is not None:
            with contextlib.suppress(RuntimeError):  # it ended by itself
                self._loop.call_soon_threadsafe(self._stopping.set)

    async def _serve(self, ready: Callable[[], None]) -> None:
        from pymodbus.server import ModbusSerialServer, ModbusTcpServer

        logging.getLogger("pymodbus").addHandler(logging.NullHandler())
        self._loop, self._stopping = asyncio.get_running_loop(), asyncio.Event()
        hooks: dict[str, Any] = {"trace_packet": self._trace_packet, "trace_pdu": self._trace_pdu}
        if self._line is not None:
            self._line.connect(self._loop)
            self._server = ModbusSerialServer(self._device(), port=self._line.drive, baudrate=115200, **hooks)
        else:
            self._server = ModbusTcpServer(self._device(), address=self.address or ("127.0.0.1", 0), **hooks)
        try:
            await self._server.serve_forever(background=True)
        except RuntimeError as error:
            raise BenchError(
                f"address {self.address}", f"cannot be served ({error})", "Take a free port."
            ) from error
        if self._line is None:
            self.address = self._server.transport.sockets[0].getsockname()[:2]
        ready()
        try:
            self._last_s = time.monotonic()
            while not self._stopping.is_set():
                self._catch_up()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._stopping.wait(), PERIOD_S)
        finally:
            await self._server.shutdown()
            if self._line is not None:
                self._line.close()

    def _catch_up(self) -> None:
        """Let as much time pass for the drive as has passed here."""
        now = time.monotonic()
        self._debt_s = min(self._debt_s + now - self._last_s, BACKLOG_S)
        self._last_s = now
        ticks = int(self._debt_s / TICK_S)
        if ticks:
            self._debt_s -= ticks * TICK_S
            self.servo.advance(ticks * TICK_S)
            self._faults.poll()

    def _dawdle(self, duration_s: float) -> None:
        """Take so long for an answer. Nobody else is served meanwhile: pymodbus would mix up whose answer is whose."""
        end_s = time.monotonic() + duration_s
        while (rest_s := end_s - time.monotonic()) > 0:
            time.sleep(min(rest_s, PERIOD_S))
            self._catch_up()

    def drop(self) -> None:
        """Cut the connection; from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._drop)

    def _drop(self) -> None:
        if self._line is not None:
            self._line.cut(RTU_DROP_S)
        elif self._server is not None:
            for connection in list(self._server.active_connections.values()):
                connection.close()

    # ── requests ─────────────────────────────────────────────────────────────────────────────────────────────────

    def _device(self) -> SimDevice:
        """All registers, as pymodbus wants them: what is not among them it refuses by itself."""
        from pymodbus.simulator import DataType, SimData, SimDevice

        registers = self.servo.registers
        taken = {
            at for cell in registers.cells.values() for at in range(cell.address, cell.address + cell.words)
        }
        addresses = sorted(taken | set(registers.window))
        runs: list[list[int]] = []
        for address in addresses:
            if runs and address == runs[-1][-1] + 1:
                runs[-1].append(address)
            else:
                runs.append([address])
        data = [SimData(run[0], count=len(run), values=0, datatype=DataType.REGISTERS) for run in runs]
        return SimDevice(self.unit, simdata=data, action=self._answer)

    async def _answer(
        self, function: int, start: int, address: int, count: int, current: list[int], new: Any
    ) -> ExcCodes | None:
        """One request. pymodbus answers from `current`, which begins at address `start`."""
        from pymodbus.constants import ExcCodes

        self.requests += 1
        self._catch_up()
        now = self._faults.now
        self._dawdle(now.slow_s)
        touched = range(address, address + count)
        if now.deaf:
            self._swallow = True
            return None
        refused = next((code for at, code in now.refused.items() if at in touched), None)
        try:
            if refused is not None:
                raise RefusalError(refused)
            if new is not None and function in _WRITES:
                self.servo.write(address, list(new))
                self._faults.poll()
            elif new is None and function == self._read_function:
                current[address - start : address - start + count] = self.servo.read(address, count)
            else:
                return ExcCodes(ILLEGAL_FUNCTION)
        except RefusalError as error:
            return ExcCodes(error.code)
        finally:
            self._swallow = now.mute or now.silent.intersection(touched) != set()
        return None

    def _trace_pdu(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        """A request to another unit is not ours to answer, though pymodbus would."""
        if not sending:
            self._swallow = pdu.dev_id != self.unit
        return pdu

    def _trace_packet(self, sending: bool, data: bytes) -> bytes:
        """Between framing and line: answers may get lost."""
        if not sending:
            return data
        if self._swallow:
            self._swallow = False
            return b""
        if self._faults.garbled():
            return b"" if self._line is None else data[:3] + bytes([data[3] ^ 0x40]) + data[4:]
        return data
