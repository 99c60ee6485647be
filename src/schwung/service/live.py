"""Samples as they come, for those who watch: kept for a minute per drive, thinned to what a picture can show.

One thread looks at the connected drives 60 times a second, twice as often as is drawn, so that no picture waits; what
a drive has is appended to its `Scope`. A watcher asks a scope for all since he asked last, as at most so many points:
pairs of smallest and largest value (`thinned`), so that no peak is lost, and a watcher who is slow gets coarser
pictures instead of falling behind.

    scope = service.live.scope(drive_id)
    view = scope.since(cursor, points=200)      # view.cursor for the next time, view.columns["torque_nm"]
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from schwung.api.drives import Drive
from schwung.api.watching import Array, LiveSamples, Watched

_log = logging.getLogger("schwung.service")

SIGNALS = ("position_rad", "position_demand_rad", "speed_rad_s", "torque_nm", "torque_added_nm")
PERIOD_S = 1 / 60
KEPT_ROWS = 65_536
_GAP_S = 0.05  # between two motions on the scope's time


@dataclass(frozen=True, eq=False)
class ScopeView:
    """What came since a cursor. Columns are (n,); `lost` rows came and are no longer kept."""

    cursor: int
    motion: int
    lost: int
    columns: dict[str, Array]


class Scope:
    """The last minute of one drive, at 1 kHz; its time goes on from motion to motion. From any thread."""

    def __init__(self) -> None:
        self._rows = np.full((len(SIGNALS) + 1, KEPT_ROWS), np.nan)
        self._count = 0  # rows that ever came
        self._motion, self._offset_s, self._last_s = -1, 0.0, 0.0
        self._lock = threading.Lock()

    @property
    def cursor(self) -> int:
        """Where those begin who want only what comes from now on."""
        return self._count

    def append(self, samples: LiveSamples) -> None:
        """Take samples of a motion."""
        with self._lock:
            if samples.motion != self._motion:
                self._motion = samples.motion
                self._offset_s = self._last_s + _GAP_S - float(samples.time_s[0])
            time_s = samples.time_s + self._offset_s
            self._last_s = float(time_s[-1])
            block = np.vstack([time_s, *(getattr(samples, name) for name in SIGNALS)])[:, -KEPT_ROWS:]
            skipped = samples.time_s.size - block.shape[1]
            places = (self._count + skipped + np.arange(block.shape[1])) % KEPT_ROWS
            self._rows[:, places] = block
            self._count += samples.time_s.size

    def since(self, cursor: int, points: int) -> ScopeView:
        """All since `cursor`, as at most `points` rows (rounded down to pairs)."""
        with self._lock:
            first = max(cursor, self._count - KEPT_ROWS, 0)
            places = np.arange(first, self._count) % KEPT_ROWS
            rows = self._rows[:, places]
            count, motion = self._count, self._motion
        time_s, signals = thinned(rows[0], rows[1:], points)
        columns = dict(zip(("time_s", *SIGNALS), (time_s, *signals), strict=True))
        return ScopeView(count, motion, max(0, first - cursor) if cursor >= 0 else 0, columns)


def thinned(time_s: Array, signals: Array, points: int) -> tuple[Array, Array]:
    """Signals (k, n) over time (n,) as at most `points` columns: of even pieces the smallest and the largest value.

    The two of a piece stand at its first and last instant, the smallest first where the signal rises along the piece: a
    line through them covers what a line through all would.
    """
    count, pieces = time_s.size, max(1, points // 2)
    if count <= 2 * pieces:
        return time_s, signals
    edges = np.linspace(0, count, pieces + 1).astype(int)
    starts, ends = edges[:-1], edges[1:] - 1
    low = np.fmin.reduceat(signals, starts, axis=1)
    high = np.fmax.reduceat(signals, starts, axis=1)
    falls = signals[:, ends] < signals[:, starts]
    both = np.empty((signals.shape[0], 2 * pieces))
    both[:, 0::2], both[:, 1::2] = np.where(falls, high, low), np.where(falls, low, high)
    times = np.empty(2 * pieces)
    times[0::2], times[1::2] = time_s[starts], time_s[ends]
    return times, both


class Live:
    """All scopes, and the thread that fills them."""

    def __init__(self, drives: Callable[[], Iterable[tuple[str, Drive]]]) -> None:
        self._drives = drives
        self._scopes: dict[str, Scope] = {}
        self._ending = threading.Event()
        self._look = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="schwung live", daemon=True)
        self._thread.start()

    def scope(self, drive_id: str) -> Scope:
        """The scope of a drive; an empty one where nothing has come yet."""
        return self._scopes.setdefault(drive_id, Scope())

    def look(self) -> None:
        """Take what the drives have, now."""
        with self._look:
            for drive_id, drive in self._drives():
                if isinstance(drive, Watched):
                    while (samples := drive.live()) is not None:
                        self.scope(drive_id).append(samples)

    def close(self) -> None:
        """End the thread."""
        self._ending.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ending.wait(max(due - time.monotonic(), 0.0)):
            due = max(
                due + PERIOD_S, time.monotonic()
            )  # what looking takes does not make the next look later
            try:
                self.look()
            except Exception:  # a picture that fails may not end the pictures
                _log.exception("live samples")
