"""One operation of Linux' CAN broadcast manager (BCM): a ring of frames that the kernel sends one after another.

python-can's cyclic tasks hold frames of one identifier; here RPDO and SYNC alternate, each with its own. What is taken
for granted of the kernel is measured in tests/vcan/test_kernel_broadcast.py:

    write         frames change in place: the index goes on, and so does the running timer
    count         so many frames from when the write arrives, and then no more, until a write with `start`
    late write    where the count was used up, frames and count change and nothing is sent

Source: Linux, Documentation/networking/can.rst, "Broadcast Manager"; net/can/bcm.c.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Callable, Sequence
from typing import Protocol

from schwung.errors import BusError

_TX_SETUP, _SETTIMER, _STARTTIMER = 1, 0x0001, 0x0002
#: Opcode, flags, count; two intervals as seconds and microseconds; identifier, number of frames. Native: `long` is.
_HEAD = struct.Struct("@IIIllllII")
_HEAD_BYTES = -(-_HEAD.size // 8) * 8  # the frames behind it are aligned to 8 bytes
_FRAME = struct.Struct("=IB3x8s")
_ENDLESS = (
    0x7FFFFFFF  # frames: a week and more. A count of 0 would let the timer end if it fell due between the two
)
_KEY = 0x080  # names the operation; each frame has an identifier of its own


class Broadcast(Protocol):
    """A ring of frames that somebody sends at an interval."""

    def write(self, frames: bytes, interval_us: int, count: int | None, *, start: bool = False) -> None:
        """Replace all frames, and send `count` of them from now on (None: without end), one each interval.

        With `start` the next one goes out at once and the interval begins there; without, the timer goes on as it ran,
        if it runs. The ring keeps its place. Raises BusError.
        """
        ...

    def close(self) -> None:
        """Send no more."""
        ...


OpenBroadcast = Callable[[str], Broadcast]


def pack(can_id: int, data: bytes) -> bytes:
    """One frame as the kernel keeps it (struct can_frame, 16 bytes)."""
    return _FRAME.pack(can_id, len(data), data)


def unpack(frames: bytes) -> Sequence[tuple[int, bytes]]:
    """Identifier and data of packed frames, (n,)."""
    return [(can_id, data[:size]) for can_id, size, data in _FRAME.iter_unpack(frames)]


class KernelBroadcast:
    """The kernel's, on a SocketCAN interface. It ends with this process, however that ends.

    Raises BusError where the interface or the kernel's module (can-bcm) is not there.
    """

    def __init__(self, channel: str) -> None:
        self._channel = channel
        if not hasattr(socket, "CAN_BCM"):
            raise self._failed(OSError("this system has none"))
        try:
            self._socket = socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_BCM)
            self._socket.connect((channel,))
        except OSError as error:
            raise self._failed(error) from error

    def write(self, frames: bytes, interval_us: int, count: int | None, *, start: bool = False) -> None:
        """See Broadcast."""
        interval = divmod(interval_us, 1_000_000)
        then = interval if count is None else (0, 0)
        flags = _SETTIMER | (_STARTTIMER if start else 0)
        number = _ENDLESS if count is None else count
        head = _HEAD.pack(_TX_SETUP, flags, number, *interval, *then, _KEY, len(frames) // _FRAME.size)
        try:
            self._socket.send(head.ljust(_HEAD_BYTES, b"\0") + frames)
        except OSError as error:
            raise self._failed(error) from error

    def close(self) -> None:
        """See Broadcast."""
        self._socket.close()

    def _failed(self, error: OSError) -> BusError:
        return BusError(
            f"bus {self._channel}",
            f"the kernel's broadcast manager refuses ({error.strerror or error})",
            "Is the interface up and the module can-bcm there? Else take another producer of SYNC.",
        )
