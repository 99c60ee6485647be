"""What came back on the bus, and which SYNC each frame answers.

Every SYNC opens a window. A window that holds one of each TPDO is a sample; one that holds none lost it. A window
with one frame too many, after one with one too few, means an answer that came after the following SYNC: a CAN
frame is never doubled, so the frames between belong, in order, to the SYNCs between. What that does not explain
is lost. Nothing is interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.fieldbus.drive import SyncTiming
from schwung.motion import Array


class Recorder:
    """Append-only log of one playback; written from the threads that send and receive, read when they are done."""

    def __init__(self, tpdo_count: int) -> None:
        self.sync_times: list[float] = []
        self.sync_counts: list[int] = []
        self.setpoints: list[int] = []  # index of the setpoint that holds at each SYNC; -1: a held one
        self.frames: list[list[tuple[int, float, bytes | bytearray]]] = [[] for _ in range(tpdo_count)]

    def sync(self, time_s: float, count: int, setpoint: int) -> None:
        """A SYNC goes out (or was seen) now."""
        self.sync_times.append(time_s)
        self.sync_counts.append(count)
        self.setpoints.append(setpoint)

    @property
    def window(self) -> int:
        """Number of the window now open, from 0; -1 before the first SYNC."""
        return len(self.sync_times) - 1

    @property
    def played(self) -> int:
        """Setpoints of which SYNC went out."""
        return max(self.setpoints, default=-1) + 1


@dataclass(frozen=True, eq=False)
class Samples:
    """A log brought in order, one row per SYNC of the motion, (n,)."""

    sync_count: NDArray[np.int64]
    sync_time_s: Array
    receive_time_s: Array  # when the last TPDO of the row came; NaN where lost
    setpoint: NDArray[np.int64]  # which setpoint held
    frames: tuple[tuple[bytes | bytearray | None, ...], ...]  # per TPDO, per row
    lost: NDArray[np.int64]
    late: int  # answers that came after the following SYNC


def arrange(recorder: Recorder, rows: int) -> Samples:
    """Attribute frames to the first `rows` SYNCs of the motion (fewer when it ended early)."""
    setpoints = np.array(recorder.setpoints, dtype=np.int64)
    begin = int(np.argmax(setpoints >= 0)) if np.any(setpoints >= 0) else len(setpoints)
    end = min(begin + rows, len(setpoints))
    columns, times, late = [], [], 0
    for frames in recorder.frames:
        owners = attribute([window for window, _, _ in frames], len(setpoints))
        late = max(late, owners.late)
        chosen = owners.frame_of_window[begin:end]
        columns.append(tuple(frames[i][2] if i >= 0 else None for i in chosen))
        times.append([frames[i][1] if i >= 0 else np.nan for i in chosen])
    received = np.max(np.array(times, dtype=float).reshape(len(times), end - begin), axis=0)
    return Samples(
        sync_count=np.array(recorder.sync_counts[begin:end], dtype=np.int64),
        sync_time_s=np.array(recorder.sync_times[begin:end], dtype=float),
        receive_time_s=received,
        setpoint=setpoints[begin:end],
        frames=tuple(columns),
        lost=np.flatnonzero(~np.isfinite(received)),
        late=late,
    )


@dataclass(frozen=True, eq=False)
class Owners:
    """Index of the frame that answers each window's SYNC, -1 where none does."""

    frame_of_window: NDArray[np.int64]
    late: int


def attribute(windows: Sequence[int], window_count: int) -> Owners:
    """Attribute frames of one TPDO, given the window in which each came (increasing), to the windows' SYNCs."""
    owner = np.full(window_count, -1, dtype=np.int64)
    if not windows:
        return Owners(owner, 0)
    came = np.asarray(windows)
    late = 0
    starts = np.searchsorted(came, np.arange(window_count + 1))
    counts = np.diff(starts)
    owner[counts == 1] = starts[:-1][counts == 1]
    empty: list[int] = []
    for window in np.flatnonzero(counts != 1):
        if counts[window] == 0:
            empty.append(int(window))
            continue
        first = int(window)
        surplus = int(counts[window]) - 1
        while surplus and empty:
            first = empty.pop()
            surplus -= 1
        if surplus:
            owner[window] = -1  # more answers than questions: none of them can be trusted
            continue
        # One frame per SYNC from `first` to here, in order. Frames of windows given up in between stay out.
        members = np.arange(starts[first], starts[window + 1])
        owner[first : window + 1] = members[: window + 1 - first]
        late += int(np.count_nonzero(came[members] != np.arange(first, window + 1)))
    return Owners(owner, late)


def measure_timing(producer: str, period_s: float, sync_time_s: Array) -> SyncTiming:
    """How evenly SYNC came: intervals against their own mean, which is the period that was achieved."""
    if sync_time_s.size < 2:
        return SyncTiming(producer, period_s, 0.0, 0.0, 0.0)
    intervals = np.diff(sync_time_s)
    mean = float(np.mean(intervals))
    off = np.abs(intervals - mean)
    rms = float(np.sqrt(np.mean(off**2)))
    return SyncTiming(producer, mean, rms, float(np.percentile(off, 99)), float(np.max(off)))
