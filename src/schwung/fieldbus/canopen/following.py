"""Whether an axis goes where it is sent, as it is seen from here.

A drive watches its own following error (6065). Setpoints that wait in a queue of an adapter make none: it holds what
it has, and when all of them come at once, they are one step. So where it stands is held against what was sent.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schwung.errors import StateError
from schwung.fieldbus.canopen.exchange import SILENT_CYCLES, SILENT_S
from schwung.fieldbus.canopen.pdo import Layout


class Following:
    """Of one playback. `tolerated`: counts that the axis may be off, as the drive tolerates; `patience_s`: how long the
    drive lets it be, which shall be the first to say so."""

    def __init__(
        self,
        layout: Layout,
        position: str,
        demand_counts: NDArray[np.int64],
        rate_hz: float,
        tolerated: float,
        patience_s: float,
    ) -> None:
        # Answers may be late by as much as a drive may be silent.
        late = max(math.ceil(SILENT_S * rate_hz), SILENT_CYCLES) + 2
        before = np.concatenate([np.full(late - 1, demand_counts[0]), demand_counts])
        windows = np.lib.stride_tricks.sliding_window_view(before, late)
        off = math.ceil(tolerated)
        self._low: list[int] = (windows.min(axis=1) - off).tolist()
        self._wide: list[int] = (np.ptp(windows, axis=1) + 2 * off).tolist()
        self._place = layout.place(position)
        self._turn = 1 << 8 * (self._place.stop - self._place.start)  # counts may run over
        self._patience, self._off = math.ceil(patience_s * rate_hz) + 1, 0

    def away(self, setpoint: int, frame: bytes | bytearray) -> bool:
        """Take an answer to the SYNC at which a setpoint was sent; whether the axis has been away for too long.

        Away is what is further than tolerated from every place where it was sent within the time for which a drive may
        be silent.
        """
        if not 0 <= setpoint < len(self._low) or len(frame) < self._place.stop:
            return False
        position = int.from_bytes(frame[self._place], "little", signed=True)
        off = (position - self._low[setpoint]) % self._turn > self._wide[setpoint]
        self._off = self._off + 1 if off else 0
        return self._off > self._patience


def trouble(node_id: int) -> StateError:
    """What is said of an axis that is away."""
    return StateError(
        f"node {node_id}",
        "the axis is not where it was sent, beyond the tolerated following error, and the drive shows no fault",
        "Do setpoints come late (adapter, bus load)? Else look at brake, torque limit and 6065.",
    )
