"""Many samples, few columns: the smallest and largest of each, so that no peak is lost; and their frames."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from schwung.api.watching import Array

#: What a frame is: columns that go on, or that begin anew. See scope.js, which reads them.
CONTINUED, BEGUN = 1, 2
_HEAD = struct.Struct("<4I2d")


@dataclass(frozen=True, eq=False)
class Columns:
    """Neighbouring columns: (k, n) lows and highs of k channels; NaN where no sample was."""

    start_s: float
    width_s: float
    low: Array
    high: Array


class Decimator:
    """Takes samples as they come, gives columns as they get full.

    Columns lie on multiples of `width_s`. A gap in time of at most `most` columns becomes columns of NaN; after a
    longer one, or where time runs backwards, the columns begin anew.
    """

    def __init__(self, channels: int, width_s: float, most: int) -> None:
        self.channels, self.width_s, self.most = channels, width_s, most
        self._time = np.empty(0)
        self._values = np.empty((channels, 0))
        self._next: int | None = None  # column that is to be given next

    def feed(self, time_s: Array, values: Array) -> list[Columns]:
        """Samples: times (n,), increasing; values (k, n). Returns what they complete, in order; mostly one or none."""
        if time_s.size == 0:
            return []
        found = []
        if self._time.size and time_s[0] <= self._time[-1]:
            found = self.rest()
            self._next = None
        self._time = np.concatenate([self._time, time_s])
        self._values = np.concatenate([self._values, values], axis=1)
        return found + self._complete(int(np.floor(self._time[-1] / self.width_s + 1e-9)))

    def rest(self) -> list[Columns]:
        """What is there, the last column though it is not full."""
        if not self._time.size:
            return []
        return self._complete(int(np.floor(self._time[-1] / self.width_s + 1e-9)) + 1)

    def _complete(self, until: int) -> list[Columns]:
        """All columns before `until`."""
        column = np.floor(self._time / self.width_s + 1e-9).astype(np.int64)
        full = column < until
        if not full.any():
            return []
        column, values = column[full], self._values[:, full]
        self._time, self._values = self._time[~full], self._values[:, ~full]
        first = int(column[0]) if self._next is None else self._next
        if column[0] - first > self.most:
            first = int(column[0])
        first = max(first, until - self.most)  # nobody sees more
        column, values = column[column >= first], values[:, column >= first]
        low = np.full((self.channels, until - first), np.nan)
        high = low.copy()
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        if column.size:
            low[:, column[starts] - first] = np.fmin.reduceat(values, starts, axis=1)
            high[:, column[starts] - first] = np.fmax.reduceat(values, starts, axis=1)
        self._next = until
        return [Columns(first * self.width_s, self.width_s, low, high)]


def frame(columns: Columns, what: int = CONTINUED, behind: int = 0) -> bytes:
    """Columns as a binary frame; `behind`: samples that were left out because nobody could draw them in time."""
    k, n = columns.low.shape
    head = _HEAD.pack(what, n, k, behind, columns.start_s, columns.width_s)
    both = np.stack([columns.low, columns.high], axis=1)  # per channel: lows, then highs
    return head + both.astype("<f4").tobytes()


def parts(data: bytes) -> tuple[int, int, Columns]:
    """What a frame holds: its kind, samples left out, columns. For tests and other clients."""
    what, n, k, behind, start, width = _HEAD.unpack_from(data)
    both = np.frombuffer(data, "<f4", offset=_HEAD.size).reshape(k, 2, n).astype(float)
    return what, behind, Columns(start, width, both[:, 0], both[:, 1])
