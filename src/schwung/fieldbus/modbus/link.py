"""The connection to one Modbus drive: requests one at a time, with pauses, time-outs, and failures in words.

A read may be asked again; a write never: whether a lost one was carried out is not known, and a start command that is
sent twice moves twice. After a lost connection the next request opens a new one, and before anything else is sent on
it `on_reconnect` is called: the driver halts there what it had set moving.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable, Iterator

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ModbusPDU

from schwung.errors import BusError, NodeLostError, RegisterError
from schwung.fieldbus.modbus.options import (
    USUAL_BAUDRATE,
    USUAL_PARITY,
    USUAL_STOPBITS,
    ModbusOptions,
    silence_s,
)
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
READ_ATTEMPTS = 2


class ModbusLink:
    """Holding registers of one unit. All methods may be called from any thread; requests never overlap."""

    def __init__(self, options: ModbusOptions, unit: int, drive: Modbus) -> None:
        """Open the connection, as the drive's profile wants it. Raises BusError where there is nobody."""
        self.options, self.unit, self.drive = options.completed(drive), unit, drive
        self.on_reconnect: Callable[[], None] | None = None
        self.losses = 0  # how often the connection was lost
        self.requests = 0
        self._timeout_s = self.options.timeout_s or drive.timeout_s
        self._pause_s = max(drive.silence_s, silence_s(self.options))
        self._lock = threading.RLock()
        self._quiet_until_s = 0.0
        self._closed = False
        self._greeting_due = self._greeting = False
        logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # we say it ourselves, once
        self._client = self._make_client()
        self._open()

    @property
    def name(self) -> str:
        """For people: modbus-tcp 127.0.0.1:502."""
        return self.options.name

    # ── requests ─────────────────────────────────────────────────────────────────────────────────────────────────

    def read(self, address: int, count: int) -> tuple[int, ...]:
        """Registers `address` … `address + count - 1`.

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

        response = self._request(place, ask, READ_ATTEMPTS)
        registers = tuple(int(word) for word in response.registers)
        if len(registers) != count:
            self._wait_for_stragglers()
            raise RegisterError(
                place, f"were asked for, {len(registers)} came", "Look for another master on the line."
            )
        return registers

    def write(self, address: int, words: tuple[int, ...]) -> None:
        """Write registers in one request, once. Raises RegisterError, NodeLostError."""

        def ask() -> ModbusPDU:
            if self.drive.write_function == 6 and len(words) == 1:
                return self._client.write_register(address, words[0], device_id=self.unit)
            return self._client.write_registers(address, list(words), device_id=self.unit)

        self._request(_place(address, len(words)), ask, 1)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Nobody else asks inside the block, and it begins connected: `losses` tells whether that is a new connection.

        Raises BusError where there is nobody.
        """
        with self._lock:
            self._ready()
            yield

    def _request(self, place: str, ask: Callable[[], ModbusPDU], attempts: int) -> ModbusPDU:
        with self._lock:
            for attempt in range(1, attempts + 1):
                try:
                    self._ready()
                    self.requests += 1
                    response = ask()
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
                    self._wait_for_stragglers()
                    if attempt == attempts:
                        raise RegisterError(
                            place,
                            f"unit {self.unit} did not answer within {self._timeout_s:g} s",
                            "Check unit, wiring, bit rate and parity; a slow drive needs --bus timeout=SECONDS.",
                        ) from error
                    continue
                finally:
                    self._quiet_until_s = max(self._quiet_until_s, time.monotonic() + self._pause_s)
                if response.isError():
                    raise _refusal(place, int(response.exception_code))
                return response
        raise AssertionError("unreachable")  # the last attempt returns or raises

    def _ready(self) -> None:
        """Connected, and the line silent for long enough."""
        if self._closed:
            raise BusError(self.name, "is closed", "Connect again.")
        if not self._client.connected:
            self._open()
            self._greeting_due = True
        self._greet()
        rest = self._quiet_until_s - time.monotonic()
        if rest > 0:
            time.sleep(rest)

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

    def _wait_for_stragglers(self) -> None:
        """On a serial line an answer that comes late would be taken for that to the next request."""
        if self.options.transport == "rtu":
            self._quiet_until_s = time.monotonic() + self._timeout_s

    # ── the client ───────────────────────────────────────────────────────────────────────────────────────────────

    def _make_client(self) -> ModbusTcpClient | ModbusSerialClient:
        o = self.options
        if o.transport == "tcp":
            return ModbusTcpClient(o.host, port=o.port, timeout=self._timeout_s, retries=0)
        return ModbusSerialClient(
            o.device, baudrate=o.baudrate or USUAL_BAUDRATE, bytesize=8, parity=o.parity or USUAL_PARITY,
            stopbits=o.stopbits or USUAL_STOPBITS, timeout=self._timeout_s, retries=0,
        )  # fmt: skip

    def _open(self) -> None:
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
            params, usual = self._client.comm_params, self._timeout_s
            self._timeout_s = max(usual, timeout_s)
            params.timeout_connect = self._timeout_s
            try:
                yield
            finally:
                self._timeout_s = params.timeout_connect = usual


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
