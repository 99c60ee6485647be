"""SDO client of one node: one lock, transfers repeated on time-out, block transfer with fall-back, errors in words.

The protocol work is canopen's but for block upload (block.py); its client is not thread-safe and confuses late answers
with current ones, so none of it is reachable but through here.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import can
import canopen
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError

from schwung.errors import InputError, SdoError
from schwung.fieldbus import eds
from schwung.fieldbus.canopen.block import BlockAbortedError, BlockError, BlockUpload
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.drive import Parameter, ParameterValue, RawValue

T = TypeVar("T")

#: Abort codes of CiA 301 table 22.
ABORT_CODES = {
    0x05030000: "toggle bit not alternated", 0x05040000: "SDO protocol timed out",
    0x05040001: "command specifier unknown", 0x05040002: "invalid block size",
    0x05040003: "invalid sequence number", 0x05040004: "CRC error", 0x05040005: "out of memory",
    0x06010000: "unsupported access", 0x06010001: "cannot be read: it is write-only",
    0x06010002: "cannot be written: it is read-only", 0x06020000: "object does not exist",
    0x06040041: "object cannot be mapped to a PDO", 0x06040042: "mapped objects exceed the PDO length",
    0x06040043: "parameter incompatibility", 0x06040047: "internal incompatibility",
    0x06060000: "hardware error", 0x06070010: "data type or length does not match",
    0x06070012: "data too long", 0x06070013: "data too short", 0x06090011: "sub-index does not exist",
    0x06090030: "value out of range", 0x06090031: "value too high", 0x06090032: "value too low",
    0x06090036: "maximum is less than minimum", 0x060A0023: "resource not available",
    0x08000000: "general error", 0x08000020: "data cannot be transferred or stored",
    0x08000021: "data cannot be stored because of local control",
    0x08000022: "data cannot be stored in the present device state",
    0x08000023: "object dictionary generation failed", 0x08000024: "no data available",
}  # fmt: skip
_SILENT_TIMEOUT_S = 0.2  # for a node that did not answer last time: the way out shall be short
_ABSENT = (0x06020000, 0x06090011)
_TIMED_OUT = "No SDO response"  # how canopen's error says so
_TRANSIENT = (0x05030000, 0x05040000)  # toggle bit, time-out: a frame was lost or late, so try again
_UNKNOWN_COMMAND = 0x05040001  # what a server without block transfer answers
_BLOCK_ATTEMPTS = 2
_BLOCK_PATIENCE = 2.0  # times the time-out: a server may have a whole sub-block to get ready
_DRAINED_S = 3.0  # the rest of a broken block has passed by at the latest
_REMEDIES = {
    0x08000022: "Disable the drive, or put the node in pre-operational, and try again.",
    0x06010002: "Leave it out of what is written.",
    0x06020000: "Is this the EDS of this drive and of its firmware?",
    0x06090011: "Is this the EDS of this drive and of its firmware?",
}


class _Client(SdoClient):  # type: ignore[misc]  # canopen is not followed by mypy
    """canopen's client, deaf to answers that belong to an earlier request."""

    MAX_RETRIES = (
        1  # a repeated segment request would upset the toggle bit: the whole transfer is repeated instead
    )

    def __init__(self, link: Link, node_id: int) -> None:
        super().__init__(0x600 + node_id, 0x580 + node_id, canopen.ObjectDictionary())
        self.network = _Sender(link)
        self.multiplexer: bytes | None = None  # index and sub-index of the transfer under way
        self.in_block = False

    def on_frame(self, message: can.Message) -> None:
        data = bytes(message.data).ljust(8, b"\0")
        names_object = data[0] == 0x80 or (not self.in_block and data[0] & 0xE0 in (0x40, 0x60))
        if self.multiplexer is None or (names_object and data[1:4] not in (self.multiplexer, b"\0\0\0")):
            return
        self.responses.put(data)

    def clear(self) -> None:
        self.responses = _Responses(self.network._link.clock)

    def wait(self, timeout_s: float) -> bytes | None:
        """The next frame of the server; None where none comes in time."""
        try:
            return self.responses.get(timeout=timeout_s)
        except queue.Empty:
            return None


class _Responses:
    def __init__(self, clock: Any) -> None:
        self._came: list[bytes] = []
        self._clock, self._event = clock, clock.event()

    def empty(self) -> bool:
        return not self._came

    def put(self, data: bytes) -> None:
        self._came.append(data)
        self._event.set()

    def get(self, block: bool = True, timeout: float = 0.0) -> bytes:
        end = self._clock.now() + timeout
        while not self._came:
            self._event.clear()
            if not self._came and not self._event.wait(end - self._clock.now()):
                raise queue.Empty
        return self._came.pop(0)


class _Sender:
    """The one method of a canopen network that its SDO client uses."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._link.send(can_id, bytes(data))


class _AbortedError(Exception):
    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


class SdoChannel:
    """Reads and writes objects of one node; may be used from several threads."""

    def __init__(self, link: Link, node_id: int, timeout_s: float = 0.5, attempts: int = 3) -> None:
        self.node_id, self.timeout_s, self.attempts = node_id, timeout_s, attempts
        self._link = link
        self._client = _Client(link, node_id)
        self._lock = threading.RLock()
        self._silent = False  # nobody answered last time: one attempt is enough until somebody does
        self.serves_blocks = True  # until the server says otherwise
        link.subscribe(0x580 + node_id, self._client.on_frame)

    def close(self) -> None:
        """Stop listening."""
        self._link.unsubscribe(0x580 + self.node_id, self._client.on_frame)

    def read(self, parameter: Parameter) -> ParameterValue:
        """Read a parameter. Raises SdoError, and InputError when the answer does not fit the type."""
        data = self.upload(parameter, block=parameter.type == "DOMAIN")
        return ParameterValue(parameter, eds.decode(parameter, data))

    def write(self, value: ParameterValue, timeout_s: float | None = None) -> None:
        """Write a parameter. Raises SdoError, and InputError when the value does not fit the type."""
        self.download(value.parameter, eds.encode(value.parameter, value.raw), timeout_s=timeout_s)

    def read_integer(self, index: int, subindex: int, type_name: str) -> int | None:
        """Read an integer; None where the drive does not have the object (or will not show it)."""
        parameter = Parameter(index, subindex, type_name)
        try:
            raw: RawValue = self.read(parameter).raw
        except InputError:
            return None
        except SdoError as error:
            if error.__cause__ is not None and getattr(error.__cause__, "code", None) is not None:
                return None
            raise
        return raw if isinstance(raw, int) else None

    def upload(self, parameter: Parameter, block: bool = False) -> bytes:
        """Bytes of an object; by block transfer where asked for and the server can, else segmented or expedited."""

        def plain() -> bytes:
            with self._client.open(parameter.index, parameter.subindex, "rb", buffering=0) as stream:
                return bytes(stream.read())

        if block:
            for _ in range(_BLOCK_ATTEMPTS):
                found = None
                if not self._silent and self.serves_blocks:
                    found = self._try_block(parameter, lambda: self._block_upload(parameter))
                if found is not None:
                    return found
        return self._repeat("read", parameter, plain)

    def download(
        self, parameter: Parameter, data: bytes, block: bool = False, timeout_s: float | None = None
    ) -> None:
        """Write bytes to an object; by block transfer where asked for and the server can."""

        def plain() -> bool:
            self._client.download(
                parameter.index, parameter.subindex, data, force_segment=parameter.type == "DOMAIN"
            )
            return True

        if block and self._try_block(parameter, lambda: self._block_download(parameter, data)):
            return
        self._repeat("write", parameter, plain, timeout_s)

    def write_once(self, parameter: Parameter, raw: int, lock_timeout_s: float, timeout_s: float) -> bool:
        """One attempt, soon over, for stopping: False where the channel is busy or nobody answers. Never raises."""
        if not self._lock.acquire(timeout=lock_timeout_s):
            return False
        try:
            self._transfer(parameter, lambda: self._client.download(
                parameter.index, parameter.subindex, eds.encode(parameter, raw)), timeout_s)  # fmt: skip
        except Exception:
            return False
        finally:
            self._lock.release()
        return True

    def assume_silent(self) -> None:
        """The node answers nothing at all, by other evidence: ask only once, briefly, until it does."""
        self._silent = True

    def _block_upload(self, parameter: Parameter) -> bytes:
        client = self._client
        return BlockUpload(
            lambda data: client.network.send_message(client.rx_cobid, data),
            client.wait,
            parameter.index,
            parameter.subindex,
            _BLOCK_PATIENCE * self.timeout_s,
        ).run()

    def _block_download(self, parameter: Parameter, data: bytes) -> bool:
        with self._client.open(
            parameter.index, parameter.subindex, "wb", buffering=7, size=len(data), block_transfer=True
        ) as stream:
            stream.write(data)
        return True

    def _try_block(self, parameter: Parameter, action: Callable[[], T]) -> T | None:
        """None where block transfer is refused or breaks, in whatever way: the plain transfer then decides."""
        with self._lock:
            self._client.in_block = True
            try:
                return self._transfer(parameter, action, self.timeout_s)
            except (
                _AbortedError,
                BlockAbortedError,
                BlockError,
                SdoCommunicationError,
                AttributeError,
                AssertionError,
                RuntimeError,
                OSError,
                ValueError,
            ) as error:
                if getattr(error, "code", None) == _UNKNOWN_COMMAND:
                    self.serves_blocks = False
                else:
                    self._drain(parameter)
                return None
            except BaseException:  # Ctrl-C: the next transfer may be the quick stop
                self._drain(parameter)
                raise
            finally:
                self._client.in_block = False

    def _drain(self, parameter: Parameter) -> None:
        """Let the rest of a broken block pass by: its segments could be taken for the answers to what follows."""
        client, deadline = self._client, self._link.clock.now() + _DRAINED_S
        client.multiplexer = _multiplexer(parameter)
        while client.wait(self.timeout_s) is not None and self._link.clock.now() < deadline:
            pass
        client.multiplexer = None
        client.clear()

    def _repeat(
        self, verb: str, parameter: Parameter, action: Callable[[], T], timeout_s: float | None = None
    ) -> T:
        place = f"node {self.node_id}, {parameter.label}"
        with self._lock:
            attempts = 1 if self._silent else self.attempts
            patience = timeout_s or (
                min(self.timeout_s, _SILENT_TIMEOUT_S) if self._silent else self.timeout_s
            )
            for attempt in range(attempts):
                try:
                    result = self._transfer(parameter, action, patience)
                    self._silent = False
                    return result
                except _AbortedError as error:
                    self._silent = False
                    if error.code in _TRANSIENT and attempt + 1 < attempts:
                        self._drain(parameter)
                        continue
                    words = ABORT_CODES.get(error.code, "unknown abort code")
                    raise SdoError(
                        place,
                        f"the drive refused to {verb} it: {words} (0x{error.code:08X})",
                        _REMEDIES.get(error.code, ""),
                    ) from error
                except (SdoCommunicationError, RuntimeError) as error:
                    if attempt + 1 == attempts:
                        self._silent = True
                        raise SdoError(
                            place,
                            f"no answer to {verb} it ({error})",
                            "Check power, cable, bit rate and node id.",
                        ) from error
                    if _TIMED_OUT in str(error):
                        self._link.clock.sleep(
                            0.02
                        )  # whatever answers now is late: without a multiplexer it is dropped
                    else:  # something else answered: the rest of an earlier transfer
                        self._drain(parameter)
        raise AssertionError("unreachable: attempts is at least 1")

    def _transfer(self, parameter: Parameter, action: Callable[[], T], timeout_s: float) -> T:
        client = self._client
        client.RESPONSE_TIMEOUT = timeout_s
        client.clear()
        client.multiplexer = _multiplexer(parameter)
        try:
            return action()
        except SdoAbortedError as error:
            raise _AbortedError(error.code) from error
        finally:
            client.multiplexer = None


def _multiplexer(parameter: Parameter) -> bytes:
    return parameter.index.to_bytes(2, "little") + bytes([parameter.subindex])


def is_absent(error: SdoError) -> bool:
    """True where the drive said that the object or sub-index does not exist."""
    return getattr(error.__cause__, "code", None) in _ABSENT
