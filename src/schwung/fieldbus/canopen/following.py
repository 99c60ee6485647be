"""Whether an axis goes where it is sent, as it is seen from here.

A drive watches its own following error (6065). Setpoints that wait in a queue of an adapter make none: it holds what
it has, and when all of them come at once, they are one step. So where it stands is held against what was sent.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schwung.errors import StateError
from schwung.fieldbus.canopen.exchange import SILENT_S
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
        late = math.ceil(SILENT_S * rate_hz) + 1
        before = np.concatenate([np.full(late - 1, demand_counts[0]), demand_counts])
        windows = np.lib.stride_tricks.sliding_window_view(before, late)
        self._low: list[float] = (windows.min(axis=1) - tolerated).tolist()
        self._high: list[float] = (windows.max(axis=1) + tolerated).tolist()
        self._place = layout.place(position)
        self._patience, self._off = math.ceil(patience_s * rate_hz) + 1, 0
        self._tolerated = tolerated

    def away(self, setpoint: int, frame: bytes | bytearray) -> bool:
        """Take an answer to the SYNC at which a setpoint was sent; whether the axis has been away for too long.

        Away is what is further than tolerated from every place where it was sent within the last SILENT_S.
        """
        if setpoint < 0:
            return False
        position = int.from_bytes(frame[self._place], "little", signed=True)
        off = not self._low[setpoint] <= position <= self._high[setpoint]
        self._off = self._off + 1 if off else 0
        return self._off > self._patience


def trouble(node_id: int) -> StateError:
    """What is said of an axis that is away."""
    return StateError(
        f"node {node_id}",
        "the axis is not where it was sent, beyond the tolerated following error, and the drive shows no fault",
        "Do setpoints come late (adapter, bus load)? Else look at brake, torque limit and 6065.",
    )
