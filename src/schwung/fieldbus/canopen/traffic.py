"""What went over a bus and came back from a drive, counted for those who watch over it; no frame is kept.

Each number is written from one thread and may be read from any.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from schwung.fieldbus.canopen.bus import frame_bits

#: Upper edges of the classes of SYNC's jitter (s): from what a kernel's timer does to what no 1 kHz exchange survives.
JITTER_EDGES_S = (10e-6, 20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, 10e-3)
_BITS = tuple(frame_bits(size) for size in range(65))


class Traffic:
    """Counts since the drive was connected."""

    def __init__(self, bits_per_s: float) -> None:
        self.bits_per_s = bits_per_s
        self.sent = self.received = 0  # frames
        self._sent_bits = self._received_bits = 0
        self.samples = self.lost = 0  # rows of recordings, and those of which something did not come
        self.jitter = [0] * (len(JITTER_EDGES_S) + 1)  # intervals of SYNC by class, beyond the last edge too
        self.jitter_sum_s = 0.0

    @property
    def bits(self) -> int:
        """Bits on the wire, both ways, stuffed as in the worst case."""
        return self._sent_bits + self._received_bits

    def send(self, size: int) -> None:
        """A frame with so many data bytes was sent."""
        self.sent += 1
        self._sent_bits += _BITS[size]

    def receive(self, size: int) -> None:
        """A frame with so many data bytes came."""
        self.received += 1
        self._received_bits += _BITS[size]

    def motion(self, sync_time_s: Sequence[float], period_s: float, samples: int, lost: int) -> None:
        """A motion was recorded: when each SYNC went out or was seen, and what came of it."""
        self.samples += samples
        self.lost += lost
        off = np.abs(np.diff(np.asarray(sync_time_s, dtype=float)) - period_s)
        classes = np.bincount(np.searchsorted(JITTER_EDGES_S, off), minlength=len(self.jitter))
        self.jitter = [before + int(more) for before, more in zip(self.jitter, classes, strict=True)]
        self.jitter_sum_s += float(off.sum())


@runtime_checkable
class Counted(Protocol):
    """A drive whose traffic is counted."""

    @property
    def traffic(self) -> Traffic: ...
