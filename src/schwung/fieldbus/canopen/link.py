"""Reads the bus and hands frames out by identifier; sending with bounded retries.

canopen.Network does the same with more work per frame, and its notifier dies of the first error on the bus: this
one reports errors to whoever listens, goes on, and always ends within a second of `close`.
"""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import Any

import can

from schwung.clock import clock_of
from schwung.errors import BusError
from schwung.fieldbus.canopen.bus import ASSUMED_BIT_RATE
from schwung.fieldbus.canopen.traffic import Traffic

FrameCallback = Callable[[can.Message], None]
_SEND_PAUSES_S = (0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.032)  # 64 ms in all


class Frame(can.Message):
    """A standard data frame, made without can.Message's questions. python-can's virtual bus deep-copies what it
    delivers; this copy is cheap, because nobody here changes the data of a frame once it was sent."""

    __slots__ = ()

    def __init__(self, can_id: int, data: bytes | bytearray) -> None:
        self.timestamp, self.arbitration_id, self.channel = 0.0, can_id, None
        self.data, self.dlc = data if isinstance(data, bytearray) else bytearray(data), len(data)
        self.is_extended_id = self.is_remote_frame = self.is_error_frame = False
        self.is_fd = self.bitrate_switch = self.error_state_indicator = False
        self.is_rx = True

    def __deepcopy__(self, memo: dict[int, Any] | None) -> Frame:
        copy = Frame.__new__(Frame)
        copy.timestamp, copy.arbitration_id = self.timestamp, self.arbitration_id
        copy.data, copy.dlc, copy.channel = self.data, self.dlc, self.channel
        copy.is_extended_id = copy.is_remote_frame = copy.is_error_frame = False
        copy.is_fd = copy.bitrate_switch = copy.error_state_indicator = False
        copy.is_rx = True
        return copy


class Link:
    """The bus with a reader. Does not own the bus: `close` ends the reading only."""

    def __init__(self, bus: can.BusABC, bits_per_s: float = ASSUMED_BIT_RATE) -> None:
        self.bus, self.clock = bus, clock_of(bus)
        self.traffic = Traffic(bits_per_s)
        self._callbacks: dict[int, tuple[FrameCallback, ...]] = {}
        self._watchers: tuple[FrameCallback, ...] = ()
        self.on_failure: Callable[[BusError], None] | None = None  # reading failed, or bus-off was reported
        self._change, self._send_lock = self.clock.lock(), self.clock.lock()
        self._closing = False
        self._reader = self.clock.read(bus, self._receive, self._failed)

    def subscribe(self, can_id: int, callback: FrameCallback) -> None:
        """Call back from the reader for every data frame with this identifier."""
        with self._change:
            self._callbacks[can_id] = (*self._callbacks.get(can_id, ()), callback)

    def unsubscribe(self, can_id: int, callback: FrameCallback) -> None:
        """Undo `subscribe`."""
        with self._change:
            self._callbacks[can_id] = tuple(c for c in self._callbacks.get(can_id, ()) if c != callback)

    def watch(self, callback: FrameCallback) -> None:
        """Call back for every data frame."""
        with self._change:
            self._watchers = (*self._watchers, callback)

    def send(self, can_id: int, data: bytes) -> None:
        """Send one frame; a full send buffer (ENOBUFS) is tried again for 64 ms. Raises BusError."""
        self.send_frame(Frame(can_id, data))

    def send_frame(self, frame: can.Message, wanted: Callable[[], bool] | None = None) -> bool:
        """Send one frame; see `send`. `wanted`: asked before every further attempt; False where it no longer is."""
        try:
            with self._send_lock:
                self.bus.send(frame)
                self.traffic.send(len(frame.data))
            return True
        except (can.CanError, OSError) as error:
            first = error
        for pause in _SEND_PAUSES_S:
            if not _buffer_full(first):
                break
            self.clock.sleep(pause)
            if wanted is not None and not wanted():
                return False
            try:
                with self._send_lock:
                    self.bus.send(frame)
                    self.traffic.send(len(frame.data))
                return True
            except (can.CanError, OSError) as error:
                first = error
        if _buffer_full(first):
            remedy = "Nobody acknowledges frames: check cable, termination, bit rate and that the drive is powered."
            raise BusError(self.name, "the send buffer stays full", remedy) from first
        raise BusError(self.name, f"cannot send ({first})", "Is the interface up?") from first

    def catch_up(self) -> None:
        """Whoever was held up hears what has come meanwhile before anything is said; not from a callback."""
        self._reader.catch_up()

    @property
    def name(self) -> str:
        """The bus as python-can calls it."""
        return str(self.bus.channel_info)

    @property
    def closed(self) -> bool:
        """True once `close` was called."""
        return self._closing

    def close(self) -> None:
        """End the reading; the bus stays open."""
        self._closing = True
        self._reader.close()

    def _receive(self, message: can.Message) -> None:
        self.traffic.receive(len(message.data))
        if message.is_error_frame:
            self._error_frame(message)
        elif not (
            message.is_remote_frame or message.is_extended_id
        ):  # 29 bits: not CANopen's, whatever they say
            for callback in self._callbacks.get(message.arbitration_id, ()):
                callback(message)
            for callback in self._watchers:
                callback(message)

    def _failed(self, error: Exception) -> None:
        if not self._closing:
            self._fail(f"cannot receive ({error})", "Is the interface up?")

    def _error_frame(self, message: can.Message) -> None:
        if message.arbitration_id & 0x40:  # CAN_ERR_BUSOFF, linux/can/error.h
            self._fail(
                "the controller is bus-off",
                "Check cable, termination and bit rate, then restart the interface.",
            )

    def _fail(self, problem: str, remedy: str) -> None:
        failure = BusError(self.name, problem, remedy)
        if self.on_failure is not None:
            self.on_failure(failure)


def _buffer_full(error: Exception) -> bool:
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return code in (errno.ENOBUFS, errno.EAGAIN) or "buffer full" in str(error).lower()
