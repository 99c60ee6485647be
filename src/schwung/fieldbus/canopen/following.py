"""Whether an axis goes where it is sent, as it is seen from here.

A drive watches its own following error (6065) against what has reached it. Setpoints that wait in a queue of an
adapter, or are lost, make none: it holds what it has, and what comes then is one step. So where it stands is held
against what was sent.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schwung.errors import StateError
from schwung.fieldbus.canopen.exchange import SILENT_CYCLES, SILENT_S
from schwung.fieldbus.canopen.pdo import Layout

#: Cycles by which setpoints and answers jitter: one that misses its SYNC acts with the next, on either way.
JITTER_CYCLES = 2


class Following:
    """Of one playback. `tolerated`: counts that the axis may be off, as the drive tolerates; `patience_s`: how long the
    drive lets it be, which shall be the first to say so; `lag_cycles`: by how much it came behind its setpoints
    before, None: not known yet, so that it may be as late as a drive may be silent."""

    def __init__(
        self,
        layout: Layout,
        position: str,
        demand_counts: NDArray[np.int64],
        rate_hz: float,
        tolerated: float,
        patience_s: float,
        lag_cycles: int | None = None,
    ) -> None:
        self._demand: list[int] = demand_counts.tolist()
        self._steps: list[int] = np.diff(demand_counts, prepend=demand_counts[:1]).tolist()
        self._latest = max(math.ceil(SILENT_S * rate_hz), SILENT_CYCLES) + JITTER_CYCLES
        self._known_lag = lag_cycles
        self._tolerated = math.ceil(tolerated)
        self._place = layout.place(position)
        self._turn = 1 << 8 * (self._place.stop - self._place.start)  # counts may run over
        self._patience, self._off = math.ceil(patience_s * rate_hz) + 1, 0
        self._behind = self._moved = 0  # sums: how far it was behind, by steps; and steps squared

    @property
    def lag_cycles(self) -> int | None:
        """By how many cycles the axis has been behind, on the way and by its loop; the most of all playbacks so far.

        By least squares over all that moved: an oscillation about the way has no part in it. None while nothing moved.
        """
        if self._moved == 0:
            return self._known_lag
        return max(math.ceil(self._behind / self._moved), self._known_lag or 0, 0)

    def away(self, setpoint: int, frame: bytes | bytearray, unanswered: int = 1) -> bool:
        """Take an answer that came while a setpoint was the last sent; whether the axis has been away for too long.

        `unanswered`: so many SYNCs had no answer yet, the one that this frame answers among them. Away is what is
        further than tolerated from every place where it was sent within the time by which an answer and the axis may be
        late: the answers that are missing, and what the axis has been behind before.
        """
        if not 0 <= setpoint < len(self._demand) or len(frame) < self._place.stop:
            return False
        position = int.from_bytes(frame[self._place], "little", signed=True)
        missing = max(unanswered, 1) - 1
        late = self._latest
        if self._known_lag is not None:
            late = min(missing + self._known_lag + JITTER_CYCLES, late)
        sent = self._demand[max(setpoint - late, 0) : setpoint + 1]
        low, high = min(sent) - self._tolerated, max(sent) + self._tolerated
        self._weigh(max(setpoint - missing, 0), position)
        off = (position - low) % self._turn > high - low
        self._off = self._off + 1 if off else 0
        return self._off > self._patience

    def _weigh(self, answered: int, position: int) -> None:
        step = self._steps[answered]
        if step:
            half = self._turn >> 1
            self._behind += ((self._demand[answered] - position + half) % self._turn - half) * step
            self._moved += step * step


def trouble(node_id: int) -> StateError:
    """What is said of an axis that is away."""
    return StateError(
        f"node {node_id}",
        "the axis is not where it was sent, beyond the tolerated following error, and the drive shows no fault",
        "Do setpoints come late (adapter, bus load)? Else look at brake, torque limit and 6065.",
    )
