"""A bus of which every frame is written to a file, in both directions, in any format that python-can writes and reads.

Sending and receiving only note a frame; a task of the clock writes them, so that no disk ever delays the bus. What the
kernel sends by itself (ring.py) is written as its echo is heard.
"""

from __future__ import annotations

import sys
from collections import deque
from pathlib import Path
from typing import Any

import can
from can.io.generic import MessageWriter
from can.io.logger import MESSAGE_WRITERS
from can.io.player import MESSAGE_READERS

from schwung.clock import clock_of
from schwung.errors import InputError
from schwung.extras import require
from schwung.python_can import with_mf4

_WRITE_EVERY_S = 0.05
#: An adapter whose stamps are further off the clock counts from an instant of its own, and is not taken at its word.
_SAME_CLOCK_S = 10.0


def require_log(path: Path) -> None:
    """Raise InputError where no log can be written to this file: its ending, its folder, or because it is there."""
    endings = sorted(MESSAGE_WRITERS.keys() & MESSAGE_READERS.keys())
    if path.suffix.lower() not in endings:
        words = f"{', '.join(endings[:-1])} or {endings[-1]}"
        raise InputError(f"CAN log {path}", f'has the ending "{path.suffix}"', f"Use {words}.")
    if path.exists():
        raise InputError(f"CAN log {path}", "exists already", "Choose another name.")
    if not path.absolute().parent.is_dir():
        raise InputError(
            f"CAN log {path}", "lies in a folder that is not there", "Make it, or choose another."
        )


def free_name(path: Path) -> Path:
    """The name, or where it is taken name-2, name-3, …: a bus that is opened again gets a log of its own."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_stem(f"{path.stem}-{number}")
    return free


class LoggedBus(can.BusABC):
    """A bus, and the log of what goes over it; shutting it down ends both. Raises InputError where there is no log.

    A log that cannot be written on, as on a full disk, disturbs nothing: it is told when the bus is shut down.
    """

    def __init__(self, inner: can.BusABC, path: Path, channel: str = "") -> None:
        # what we send names no channel, and readers would take it for another bus
        self._inner, self.log_path, self._named = inner, free_name(path), "_".join(channel.split()) or None
        self._clock = clock_of(inner)
        self._noted: deque[tuple[float, bool, can.Message]] = deque()  # stamp, whether received, frame
        self._trouble: Exception | None = None
        if self.log_path.suffix.lower() == ".mf4":
            require(f"CAN log {path}", "logs", "asammdf")
            with_mf4()
        try:
            self._writer: MessageWriter = can.Logger(self.log_path)
        except (can.CanError, OSError, ValueError, ImportError) as error:
            problem = str(error).rstrip(". ") or type(error).__name__
            raise InputError(
                f"CAN log {path}", f"cannot be written ({problem})", "Choose another."
            ) from error
        self.channel_info = inner.channel_info
        super().__init__(channel=self.channel_info)
        self._task = self._clock.every(_WRITE_EVERY_S, self._write, "schwung CAN log")

    def __getattr__(self, name: str) -> Any:
        # what an interface has beyond python-can's own: its socket, its clock
        return getattr(self.__dict__["_inner"], name)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """See can.BusABC; a frame that could not be sent is not in the log."""
        stamp_s = self._clock.date()
        self._inner.send(msg, timeout)
        self._noted.append((stamp_s, False, msg))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """See can.BusABC."""
        message = self._inner.recv(timeout)
        if message is not None:
            date_s = self._clock.date()
            stamp_s = message.timestamp if abs(message.timestamp - date_s) < _SAME_CLOCK_S else date_s
            self._noted.append((stamp_s, message.is_rx, message))
        return message

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def shutdown(self) -> None:
        """Shut the bus down and finish the log. Raises InputError where the log could not be written to its end; where
        another error is on its way, that one is told with it."""
        if self._is_shutdown:
            return
        super().shutdown()
        try:
            self._inner.shutdown()
        finally:
            self._task.close()
            self._write()
            self._finish()

    def _write(self) -> None:
        while self._noted:
            stamp_s, is_rx, frame = self._noted.popleft()
            if self._trouble is not None:
                continue
            try:
                self._writer.on_message_received(_stamped(frame, stamp_s, is_rx, self._named))
            except (OSError, ValueError, can.CanError) as error:
                self._trouble = error

    def _finish(self) -> None:
        try:
            self._writer.stop()
        except (OSError, ValueError, can.CanError) as error:
            self._trouble = self._trouble or error
        if self._trouble is None:
            return
        told = InputError(
            f"CAN log {self.log_path}",
            f"is not complete ({self._trouble})",
            "Is the disk full? The bus was not disturbed.",
        )
        under_way = sys.exception()
        if under_way is None:
            raise told
        under_way.add_note(str(told))


def _stamped(frame: can.Message, stamp_s: float, is_rx: bool, channel: str | None) -> can.Message:
    return can.Message(
        timestamp=stamp_s,
        is_rx=is_rx,
        arbitration_id=frame.arbitration_id,
        data=frame.data,
        dlc=frame.dlc,
        channel=channel or frame.channel,
        is_extended_id=frame.is_extended_id,
        is_remote_frame=frame.is_remote_frame,
        is_error_frame=frame.is_error_frame,
        is_fd=frame.is_fd,
        bitrate_switch=frame.bitrate_switch,
        error_state_indicator=frame.error_state_indicator,
    )
