"""The connection to one Modbus drive: requests one at a time, with pauses, time-outs, and failures in words.

A read may be asked again; a write never, unless the drive has said that it did not take it: whether a lost one was
carried out is not known, and a start command that is sent twice moves twice. After a lost connection the next request
opens a new one, and before anything else is sent on it `on_reconnect` is called: the driver halts there what it had set
moving.

Two refusals are none (Modbus Application Protocol 1.1b3, chapter 7). 6, busy: the client "should retransmit the message
later", so that nothing was carried out. 5, acknowledge: "has accepted the request and is processing it"; that is waited
out, and nothing is written again.
"""

from __future__ import annotations

import contextlib
import logging
from collections import deque
from collections.abc import Callable, Iterator

from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ModbusPDU

from schwung.clock import Clock
from schwung.errors import BusError, NodeLostError, RegisterError
from schwung.fieldbus.modbus.client import Line, make_client, set_timeout
from schwung.fieldbus.modbus.options import ModbusOptions, silence_s
from schwung.fieldbus.profile import Modbus

#: Modbus Application Protocol 1.1b3, chapter 7.
EXCEPTIONS = {
    1: "it does not know this function code",
    2: "it has no such register",
    3: "it does not take this value, or not so many registers at once",
    4: "it failed while carrying it out",
    5: "it accepted the request but needs more time",
    6: "it is busy",
    7: "it cannot carry it out now",
    8: "its memory has a parity error",
    10: "the gateway has no path to it",
    11: "it does not answer the gateway",
}
ACKNOWLEDGE, BUSY = 5, 6
READ_ATTEMPTS = 2
#: A drive that is busy for longer than this is stuck (s), unless it was given more time; how often it is asked.
BUSY_S, _BUSY_PAUSE_S = 2.0, 0.02


class ModbusLink:
    """Holding registers of one unit. All methods may be called from any thread; requests never overlap."""

    def __init__(
        self, options: ModbusOptions, unit: int, drive: Modbus, *, clock: Clock, line: Line | None = None
    ) -> None:
        """Open the connection, as the drive's profile wants it. `line`: not one of this computer's, but a bench's.

        Raises BusError where there is nobody.
        """
        self.options, self.unit, self.drive, self.clock = options.completed(drive), unit, drive, clock
        self.on_reconnect: Callable[[], None] | None = None
        self.losses = 0  # how often the connection was lost
        self.requests = 0
        self.asked_s = clock.now()  # when the last one was sent
        self._timeout_s = self.options.timeout_s or drive.timeout_s
        self._pause_s = max(drive.silence_s, silence_s(self.options))
        self._serial = self.options.transport == "rtu"  # answers say of no request whose they are
        self._lock = clock.lock()
        self._asking = False
        self._when_free: deque[Callable[[], None]] = deque()
        self._quiet_until_s = clock.now()
        self._straggler_due = self._closed = False
        self._greeting_due = self._greeting = False
        logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # we say it ourselves, once
        self._client = make_client(self.options, self._timeout_s, clock, line)
        self._open()

    @property
    def name(self) -> str:
        """For people: modbus-tcp 127.0.0.1:502."""
        return self.options.name

    @property
    def asking(self) -> bool:
        """A request is under way."""
        return self._asking

    # ── requests ─────────────────────────────────────────────────────────────────────────────────────────────────

    def read(self, address: int, count: int, *, again: bool = True) -> tuple[int, ...]:
        """Registers `address` … `address + count - 1`. `again`: asked once more where no answer comes.

        Raises RegisterError where the drive refuses or does not answer, NodeLostError where the connection is gone.
        """
        place = _place(address, count)

        def ask() -> ModbusPDU:
            read = (
                self._client.read_holding_registers
                if self.drive.read_function == 3
                else self._client.read_input_registers
            )
            return read(address, count=count, device_id=self.unit)

        end_s = self._busy_until_s()
        while True:
            try:
                response = self._request(place, ask, READ_ATTEMPTS if again else 1)
            except RegisterError as error:
                if error.code not in (ACKNOWLEDGE, BUSY) or self.clock.now() >= end_s:
                    raise
                self.clock.sleep(_BUSY_PAUSE_S)
                continue
            registers = tuple(int(word) for word in response.registers)
            if len(registers) != count:
                self._straggler_due = self._serial
                raise RegisterError(
                    place, f"were asked for, {len(registers)} came", "Look for another master on the line."
                )
            return registers

    def write(self, address: int, words: tuple[int, ...], permit: Callable[[], None] | None = None) -> bool:
        """Write registers in one request, once; again only where the drive was busy and has not taken it. False where
        the drive has accepted it and does not tell what became of it.

        `permit` is called right before it is sent, when nobody else can come between; it raises what forbids it.
        Raises RegisterError, NodeLostError.
        """
        place = _place(address, len(words))

        def ask() -> ModbusPDU:
            if self.drive.write_function == 6 and len(words) == 1:
                return self._client.write_register(address, words[0], device_id=self.unit)
            return self._client.write_registers(address, list(words), device_id=self.unit)

        end_s = self._busy_until_s()
        while True:
            try:
                self._request(place, ask, 1, permit)
                return True
            except RegisterError as error:
                if error.code == ACKNOWLEDGE:
                    self._await_carried_out(address, len(words))
                    return False
                if error.code != BUSY or self.clock.now() >= end_s:
                    raise
            self.clock.sleep(_BUSY_PAUSE_S)  # nothing is held meanwhile: a stop may come between

    def _await_carried_out(self, address: int, count: int) -> None:
        """A write was accepted, and takes its time: asked until the drive answers as usual. Raises RegisterError.

        A register that cannot be read is an answer as good as any.
        """
        try:
            self.read(address, count)
        except RegisterError as error:
            if error.code in (None, ACKNOWLEDGE, BUSY):
                raise RegisterError(
                    _place(address, count),
                    "was accepted, but whether it was carried out the drive does not tell",
                    "Look at the drive; it may still be at it.",
                    ACKNOWLEDGE,
                ) from error

    def _busy_until_s(self) -> float:
        return self.clock.now() + max(BUSY_S, self._timeout_s)

    def when_free(self, call: Callable[[], None]) -> None:
        """Call now; asked for from within a request that is under way (a callback of the clock), right after it."""
        with self._lock:  # another thread's request is over when we come in
            if self._asking:
                self._when_free.append(call)
                return
        call()

    def _request(
        self,
        place: str,
        ask: Callable[[], ModbusPDU],
        attempts: int,
        permit: Callable[[], None] | None = None,
    ) -> ModbusPDU:
        with self._lock:
            try:
                return self._attempts(place, ask, attempts, permit)
            finally:
                while self._when_free:
                    self._when_free.popleft()()

    def _attempts(
        self, place: str, ask: Callable[[], ModbusPDU], attempts: int, permit: Callable[[], None] | None
    ) -> ModbusPDU:
        for attempt in range(1, attempts + 1):
            try:
                response = self._once(ask, permit)
            except (ConnectionException, OSError) as error:  # pymodbus lets a reset by the peer through
                self._lost()
                if attempt == attempts or self._greeting:
                    raise NodeLostError(
                        f"{self.name}, unit {self.unit}",
                        f"the connection was lost (at {place})",
                        "Check cable and network; the drive stops by its own watchdog where it has one.",
                    ) from error
                continue
            except ModbusException as error:
                if attempt == attempts:
                    raise RegisterError(
                        place,
                        f"unit {self.unit} did not answer within {self._timeout_s:g} s",
                        "Check unit, wiring, bit rate and parity; a slow drive needs --bus timeout=SECONDS.",
                    ) from error
                continue
            if response.isError():
                raise _refusal(place, int(response.exception_code))
            return response
        raise AssertionError("unreachable")  # the last attempt returns or raises

    def _once(self, ask: Callable[[], ModbusPDU], permit: Callable[[], None] | None) -> ModbusPDU:
        """One request on a line that is ready. Raises what pymodbus and `permit` do."""
        if self._asking:
            raise RuntimeError(f"{self.name} is asked from within a request; see when_free")
        self._connect()
        self._asking = True
        try:
            self._await_silence()
            if permit is not None:
                permit()
            self.requests += 1
            self.asked_s = self.clock.now()
            return self._sent(ask)
        finally:
            self._asking = False

    def _sent(self, ask: Callable[[], ModbusPDU]) -> ModbusPDU:
        try:
            return ask()
        except BaseException:  # Ctrl-C, too: the answer is still to come
            self._straggler_due = self._serial
            raise
        finally:
            self._quiet_until_s = self.clock.now() + self._pause_s

    def _connect(self) -> None:
        """Connected, and what had been set moving over a lost connection halted."""
        if self._closed:
            raise BusError(self.name, "is closed", "Connect again.")
        if not self._client.connected:
            self._open()
            self._greeting_due = True
        self._greet()

    def _await_silence(self) -> None:
        """The pause between two requests; and before it a late answer, which would be taken for that to the next."""
        if self._straggler_due:
            self._straggler_due = False
            with contextlib.suppress(ConnectionException, OSError):  # whoever asks next finds out
                self._client.recv(None)
            self._quiet_until_s = self.clock.now() + self._pause_s
        self.clock.sleep(max(self._quiet_until_s - self.clock.now(), 0.0))

    def _greet(self) -> None:
        """On a new connection nothing may be sent before the driver has halted what it had set moving."""
        if not self._greeting_due or self._greeting:
            return
        self._greeting = True
        try:
            if self.on_reconnect is not None:
                self.on_reconnect()
            self._greeting_due = False
        finally:
            self._greeting = False

    def _lost(self) -> None:
        self.losses += 1
        with contextlib.suppress(Exception):
            self._close_client()

    # ── the client ───────────────────────────────────────────────────────────────────────────────────────────────

    def _open(self) -> None:
        self._straggler_due = False
        if not self._client.connect():
            raise BusError(
                self.name,
                "cannot be opened",
                "Is the drive on, the address right and the network up?"
                if self.options.transport == "tcp"
                else "Is the adapter plugged in, and may you use it?",
            )

    def close(self) -> None:
        """Close the connection; nothing is sent."""
        with self._lock:
            self._closed = True
            self._close_client()

    def _close_client(self) -> None:
        close: Callable[[], None] = self._client.close  # untyped in pymodbus
        close()

    @contextlib.contextmanager
    def patience(self, timeout_s: float) -> Iterator[None]:
        """Wait longer for answers inside the block: a drive may take seconds to save its parameters."""
        with self._lock:
            usual = self._timeout_s
            self._timeout_s = max(usual, timeout_s)
            set_timeout(self._client, self._timeout_s)
            try:
                yield
            finally:
                self._timeout_s = usual
                set_timeout(self._client, usual)


def _place(address: int, count: int) -> str:
    return f"register {address}" if count == 1 else f"registers {address} to {address + count - 1}"


def _refusal(place: str, code: int) -> RegisterError:
    reason = EXCEPTIONS.get(code, "of its own kind")
    return RegisterError(
        place,
        f"the drive refuses: {reason} (exception {code})",
        "Check profile, firmware and the drive's state.",
        code,
    )
