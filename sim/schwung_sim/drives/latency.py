"""When what has come takes effect: a drive's tasks run beside each other, and not all of them with SYNC.

The setpoint task of many drives takes target and torque offset at once, while controlwords are left to a slower task in
the background: then a frame with quick stop and an old target steps first, and stops after. In others it is the other
way round. Neither CiA 301 (7.2.2.2: a synchronous PDO acts with SYNC) nor CiA 402 orders the objects of one frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

Act = Callable[[Any], None]
Time = Callable[[], float]

_ROUNDING_S = 1e-9


class Late:
    """Stands before a writer: what comes acts `delay_s` later, or when a task of that period next looks at it.

    A task sees only the last value. `poll` has to be called as time passes.
    """

    def __init__(self, act: Act, time_s: Time, delay_s: float, *, task: bool = False) -> None:
        self._act, self._time_s, self._delay_s, self._task = act, time_s, delay_s, task
        self._waiting: list[tuple[float, Any]] = []

    def __call__(self, value: Any) -> None:
        now = self._time_s()
        if self._task:
            runs = math.floor(now / self._delay_s + _ROUNDING_S) + 1
            self._waiting = [(runs * self._delay_s, value)]
        else:
            self._waiting.append((now + self._delay_s, value))

    @property
    def waiting(self) -> bool:
        """Something has still to act."""
        return bool(self._waiting)

    def forget(self) -> None:
        """A reset: nothing acts any more."""
        self._waiting.clear()

    def poll(self) -> None:
        """Let act what is due."""
        now = self._time_s() + _ROUNDING_S
        while self._waiting and self._waiting[0][0] <= now:
            self._act(self._waiting.pop(0)[1])


class Watch:
    """Stands before a writer and notes when something came."""

    def __init__(self, act: Act, time_s: Time) -> None:
        self._act, self._time_s = act, time_s
        self.came_s = time_s()

    def __call__(self, value: Any) -> None:
        self.came_s = self._time_s()
        self._act(value)
