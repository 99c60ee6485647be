"""Samples while they come: what the recorder of a motion has so far, in SI, for those who watch. Costs the motion
nothing: nobody is called, who wants to know looks.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from schwung.fieldbus.canopen.pdo import Layouts
from schwung.fieldbus.canopen.playback import Playable
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.drive import LiveSamples
from schwung.fieldbus.profile import CanopenProfile
from schwung.fieldbus.units import Scales
from schwung.motion import Array


class LiveTap:
    """Reads a recorder from another thread than those that write it: it only grows, and is read no further than the
    SYNC before the last, whose answers are there or late. What is late stays out here; the recording has it.
    """

    def __init__(self, profile: CanopenProfile, layouts: Layouts, read_scales: Callable[[], Scales]) -> None:
        self._profile, self._layouts, self._read_scales = profile, layouts, read_scales
        self._motion = 0
        self._present: tuple[Recorder, Playable, float] | None = None
        self._done: tuple[Recorder, Playable, float] | None = (
            None  # of the motion before, until it is read to its end
        )
        self._next_row = 0
        self._next_frames: list[int] = []

    def begin(self, recorder: Recorder, playable: Playable, sample_rate_hz: float) -> None:
        """A motion begins."""
        self._present = (recorder, playable, sample_rate_hz)

    def take(self) -> LiveSamples | None:
        """What came since it was last asked for, of one motion; None: nothing. For one watcher, in one thread."""
        present = self._present
        if present is None:
            return None
        if self._done is not present:
            if self._done is not None and (rest := self._read(self._done, to_its_end=True)) is not None:
                return rest
            self._done, self._next_row, self._motion = present, 0, self._motion + 1
            self._next_frames = [0] * len(self._layouts.tpdos)
        return self._read(present, to_its_end=False)

    def _read(self, source: tuple[Recorder, Playable, float], *, to_its_end: bool) -> LiveSamples | None:
        recorder, playable, rate = source
        first, end = self._next_row, recorder.window + (1 if to_its_end else 0)
        if end <= first:
            return None
        columns = {name: values for number in range(len(recorder.frames)) for name, values in
                   self._columns(recorder, number, first, end).items()}  # fmt: skip
        self._next_row = end
        q, scales = self._profile.quantities, self._read_scales()
        held = np.clip(np.array(recorder.setpoints[first:end]), 0, len(playable.frames) - 1)
        known = q.torque_added is not None and math.isfinite(scales.torque_added_nm)
        added = playable.torque_added_counts[held] * (scales.torque_added_nm if known else 0.0)

        def si(name: str | None, scale: float) -> Array:
            found = None if name is None else columns.get(name)
            return np.full(end - first, np.nan) if found is None else found * scale

        return LiveSamples(
            motion=self._motion,
            time_s=np.arange(first, end) / rate,
            position_rad=si(str(q.position.object), scales.position_rad),
            speed_rad_s=si(str(q.speed.object) if q.speed else None, scales.speed_rad_s),
            torque_nm=si(str(q.torque.object) if q.torque else None, scales.torque_nm),
            position_demand_rad=playable.position_counts[held] * scales.position_rad,
            torque_added_nm=np.asarray(added, dtype=float),
        )

    def _columns(self, recorder: Recorder, number: int, first: int, end: int) -> dict[str, Array]:
        """Counts of each object in a TPDO, one per SYNC, NaN where none came."""
        frames, layout = recorder.frames[number], self._layouts.tpdos[number]
        begin = stop = self._next_frames[number]
        while stop < len(frames) and frames[stop][0] < end:
            stop += 1
        self._next_frames[number] = stop
        new = [frame for frame in frames[begin:stop] if frame[0] >= first]
        records = layout.unpack(data for _, _, data in new)
        rows = np.array([window for window, _, _ in new], dtype=np.int64) - first
        found = {}
        for name in layout.dtype.names or ():
            values = np.full(end - first, np.nan)
            values[rows] = records[name]
            found[name] = values
        return found
