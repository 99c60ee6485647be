"""The Modbus drive behind its line: requests in, answers out, and time that passes for it. Which line, and whose time,
is not its matter: stepped.py has bytes that travel in simulated time, serving.py sockets and pseudo-terminals."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, Protocol

from schwung_sim.drives.modbus.faults import Fault, FaultSchedule
from schwung_sim.drives.modbus.registers import (
    ACKNOWLEDGE,
    BUSY,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    RefusalError,
)
from schwung_sim.drives.modbus.servo import ModbusServo
from schwung_sim.plants.two_mass import TICK_S

if TYPE_CHECKING:
    from pymodbus.pdu import ModbusPDU

PERIOD_S = 0.002  # how often time passes when no request comes
BACKLOG_S = 0.25  # an axis that fell further behind than this drops the rest
#: Registers in one request (Modbus Application Protocol 1.1b3, 6.12).
_MOST_WRITTEN = 123

Transport = Literal["tcp", "rtu"]


class Timer(Protocol):
    """Something due, or due again and again, until it is closed."""

    def close(self) -> None: ...


class Clock(Protocol):
    """The time that the drive lives in (s): a stepped clock, or that of an event loop."""

    def now(self) -> float: ...

    def every(self, period_s: float, call: Callable[[], None]) -> Timer: ...

    def later(self, delay_s: float, call: Callable[[], None]) -> Timer: ...


class ModbusServer:
    """One drive as it answers on a line. `begin` lets its time pass; `drop`, which belongs to the line, cuts it.

    Everything happens in the thread in which the clock calls and `Session.receive` is called.
    """

    def __init__(
        self,
        servo: ModbusServo,
        unit: int,
        transport: Transport,
        *,
        faults: tuple[Fault, ...] = (),
        seed: int = 0,
    ) -> None:
        self.servo, self.unit, self.transport = servo, unit, transport
        self.requests = 0
        self.drop: Callable[[], None] = lambda: None
        self.faults = FaultSchedule(servo, faults, self._cut, seed)
        self._read_function = int(servo.profile["modbus"].get("read_function", 3))
        self._clock: Clock | None = None
        self._ticker: Timer | None = None
        self._last_s = self._debt_s = self._free_s = 0.0

    def _cut(self) -> None:
        self.drop()

    def begin(self, clock: Clock) -> None:
        """Time passes for the drive from now on."""
        self._clock, self._last_s, self._free_s = clock, clock.now(), clock.now()
        self._ticker = clock.every(PERIOD_S, self._catch_up)

    def end(self) -> None:
        """Time stands still."""
        if self._ticker is not None:
            self._ticker.close()
            self._ticker = None

    def session(self, reply: Callable[[bytes], object]) -> Session:
        """One connection; `reply` sends bytes back on it."""
        return Session(self, reply)

    @property
    def clock(self) -> Clock:
        """The drive's time. Raises RuntimeError before `begin`."""
        if self._clock is None:
            raise RuntimeError("the drive is not switched on")
        return self._clock

    def _catch_up(self) -> None:
        """Let as much time pass for the drive as has passed outside."""
        now = self.clock.now()
        self._debt_s = min(self._debt_s + now - self._last_s, BACKLOG_S)
        self._last_s = now
        ticks = int(self._debt_s / TICK_S + 1e-9)
        if ticks:
            self._debt_s -= ticks * TICK_S
            self.servo.advance(ticks * TICK_S)
            self.faults.poll()

    # ── requests ─────────────────────────────────────────────────────────────────────────────────────────────────

    def take(self, request: ModbusPDU, answer: Callable[[ModbusPDU], None]) -> None:
        """Carry a request out and answer it: now, or when those before it are done where the drive is slow."""
        if request.dev_id != self.unit:
            return  # it is not ours
        self._catch_up()
        clock, now = self.clock, self.clock.now()
        self._free_s = max(self._free_s, now) + self.faults.now.slow_s

        def respond() -> None:
            response = self._respond(request)
            if response is not None:
                response.dev_id, response.transaction_id = request.dev_id, request.transaction_id
                answer(response)

        if self._free_s > now:
            clock.later(self._free_s - now, respond)
        else:
            respond()

    def _respond(self, request: ModbusPDU) -> ModbusPDU | None:
        """The answer to a request, which has been carried out; None: there is none."""
        from pymodbus.pdu import ExceptionResponse

        self.requests += 1
        self._catch_up()
        now = self.faults.now
        if now.deaf:
            return None
        touched = range(request.address, request.address + max(request.count, len(request.registers), 1))
        refused = next((code for at, code in now.refused.items() if at in touched), None)
        try:
            if refused is not None:
                raise RefusalError(refused)
            if self.servo.axis.time_s < now.busy_until_s:
                raise RefusalError(BUSY)
            if now.acknowledge_s and request.function_code != self._read_function:
                now.busy_until_s = self.servo.axis.time_s + now.acknowledge_s
                self.clock.later(now.acknowledge_s, lambda: self._carried_out_late(request))
                raise RefusalError(ACKNOWLEDGE)
            response = self._carried_out(request)
        except RefusalError as error:
            response = ExceptionResponse(request.function_code, error.code)
        return None if now.mute or now.silent.intersection(touched) else response

    def _carried_out_late(self, request: ModbusPDU) -> None:
        self._catch_up()
        try:
            self._carried_out(request)
        except RefusalError:
            return  # it was acknowledged; nobody is told any more

    def _carried_out(self, request: ModbusPDU) -> ModbusPDU:
        """The answer to a request that the drive carries out. Raises RefusalError for one that it does not."""
        from pymodbus.pdu import register_message as pdu

        code, address = request.function_code, request.address
        if code == self._read_function:
            registers = self.servo.read(address, request.count)
            readers = {3: pdu.ReadHoldingRegistersResponse, 4: pdu.ReadInputRegistersResponse}
            return readers[code](registers=registers)
        words = list(request.registers)
        if isinstance(request, pdu.WriteSingleRegisterRequest):
            self.servo.write(address, words)
            self.faults.poll()
            return pdu.WriteSingleRegisterResponse(address=address, registers=words)
        if isinstance(request, pdu.WriteMultipleRegistersRequest):
            if not 1 <= request.count <= _MOST_WRITTEN or request.byte_count != 2 * len(words):
                raise RefusalError(ILLEGAL_VALUE)
            self.servo.write(address, words)
            self.faults.poll()
            return pdu.WriteMultipleRegistersResponse(address=address, count=request.count)
        raise RefusalError(ILLEGAL_FUNCTION)

    def spoilt(self, frame: bytes) -> bytes:
        """An answer as it arrives: with a wrong byte on a serial line, or lost, where the line is bad."""
        if not self.faults.garbled():
            return frame
        return b"" if self.transport == "tcp" else frame[:3] + bytes([frame[3] ^ 0x40]) + frame[4:]


class Session:
    """One connection to a server: bytes that come, whole requests out of them, answers framed."""

    def __init__(self, server: ModbusServer, reply: Callable[[bytes], object]) -> None:
        from pymodbus.framer import FramerRTU, FramerSocket
        from pymodbus.pdu import DecodePDU

        self._server, self._reply = server, reply
        framer: Any = FramerSocket if server.transport == "tcp" else FramerRTU
        self._framer = framer(DecodePDU(True))
        self._function_at = 7 if server.transport == "tcp" else 1  # behind MBAP header, or address
        self._buffer = b""

    def receive(self, data: bytes) -> None:
        """Bytes have come. What makes no frame is thrown away, and so is what cannot be read as one."""
        from pymodbus.exceptions import ModbusIOException
        from pymodbus.pdu import ExceptionResponse

        self._buffer += data
        while self._buffer:
            try:
                used, request = self._framer.handleFrame(self._buffer, 0, 0)
            except ModbusIOException as error:
                refusal = ExceptionResponse(self._buffer[self._function_at] & 0x7F, ILLEGAL_FUNCTION)
                refusal.dev_id, refusal.transaction_id = error.dev_id, error.transaction_id
                self._buffer = b""
                if refusal.dev_id == self._server.unit:
                    self._answer(refusal)
                return
            if not used:
                return
            self._buffer = self._buffer[used:]
            if request is not None:
                self._server.take(request, self._answer)

    def _answer(self, response: ModbusPDU) -> None:
        frame = self._server.spoilt(self._framer.buildFrame(response))
        if frame:
            self._reply(frame)
