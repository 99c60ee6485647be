"""Whether an axis goes where it is sent, as it is seen from here.

A drive watches its own following error (6065) against what has reached it. Setpoints that wait in a queue of an
adapter, or are lost, make none: it holds what it has, and what comes then is one step. So where it stands is held
against what was sent.
"""

from __future__ import annotations

import math
from collections import deque

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
        self._latest = max(math.ceil(SILENT_S * rate_hz), SILENT_CYCLES) + JITTER_CYCLES
        self._known_lag = lag_cycles
        self._tolerated = math.ceil(tolerated)
        self._place = layout.place(position)
        self._turn = 1 << 8 * (self._place.stop - self._place.start)  # counts may run over
        self._patience, self._off = math.ceil(patience_s * rate_hz) + 1, 0
        self._open = deque[int](maxlen=self._latest)
        self._seen: list[tuple[int, int, int]] = []  # last setpoint sent, SYNCs open then, position

    @property
    def lag_cycles(self) -> int | None:
        """By how many cycles the axis has been behind, on the way and by its loop; the most of all playbacks so far.

        The delay that leaves least of the way unexplained; an offset, or an oscillation about the way, has no part in
        it. What is sent by less than a count within the time by which setpoints jitter tells nothing, nor does an axis
        that does not go along: None while nothing else has been played.
        """
        if len(self._seen) < 2:
            return self._known_lag
        last, still_open, position = np.array(self._seen, dtype=np.int64).T
        # What stays open for longer than an answer may be late is lost, or always on its way.
        ahead = np.append(still_open, np.full(self._latest - 1, still_open[-1]))
        usual = np.lib.stride_tricks.sliding_window_view(ahead, self._latest).min(axis=1)
        answered = last - (still_open - usual)
        demand = np.array(self._demand, dtype=np.int64)

        def sent(cycles_ago: int) -> NDArray[np.int64]:
            places: NDArray[np.int64] = demand[np.maximum(answered - cycles_ago, 0)]
            return places

        behind = sent(0) - position
        if self._turn < 1 << 63:  # else it runs over as these integers do
            half = self._turn >> 1
            behind = (behind + half) % self._turn - half
        unexplained = [float(np.var(behind - (sent(0) - sent(late)))) for late in range(self._latest + 1)]
        lag = int(np.argmin(unexplained))
        jitter = sent(lag) - sent(lag + JITTER_CYCLES)
        if np.mean(jitter**2) < 1 or unexplained[lag] >= np.var(sent(lag)):
            return self._known_lag
        return max(lag, self._known_lag or 0)

    def away(self, setpoint: int, frame: bytes | bytearray, still_open: int = 0) -> bool:
        """Take an answer that came while a setpoint was the last sent; whether the axis has been away for too long.

        `still_open`: by how many SYNCs more than answers came, this one counted. Away is what is further than tolerated
        from every place where it was sent within the time by which an answer and the axis may be late: the answers that
        are missing, and what the axis has been behind before. An answer that has been missing for as long as it may be
        late is lost, and waited for no longer.
        """
        if not 0 <= setpoint < len(self._demand) or len(frame) < self._place.stop:
            return False
        position = int.from_bytes(frame[self._place], "little", signed=True)
        self._open.append(still_open)
        self._seen.append((setpoint, still_open, position))
        late = self._latest
        if self._known_lag is not None:
            late = min(still_open - min(self._open) + self._known_lag + JITTER_CYCLES, late)
        sent = self._demand[max(setpoint - late, 0) : setpoint + 1]
        low, high = min(sent) - self._tolerated, max(sent) + self._tolerated
        off = (position - low) % self._turn > high - low
        self._off = self._off + 1 if off else 0
        return self._off > self._patience

    def leaps(self, setpoint: int, missed: int) -> bool:
        """Whether a drive that may have missed so many setpoints before this one is sent off by more than tolerated."""
        if missed <= JITTER_CYCLES or not 0 <= setpoint < len(self._demand):
            return False
        heard = self._demand[max(setpoint - missed + JITTER_CYCLES, 0)]
        return abs(self._demand[setpoint] - heard) > self._tolerated


def trouble(node_id: int) -> StateError:
    """What is said of an axis that is away."""
    return StateError(
        f"node {node_id}",
        "the axis is not where it was sent, beyond the tolerated following error, and the drive shows no fault",
        "Do setpoints come late (adapter, bus load)? Else look at brake, torque limit and 6065.",
    )
