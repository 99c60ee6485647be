"""What a clock is asked for; one protocol for the wall's and the stepped one's."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, Protocol

import can

Receive = Callable[[can.Message], None]
Failed = Callable[[Exception], None]


class Task(Protocol):
    """Something that goes on until it is closed."""

    def close(self) -> None:
        """End it; what it does at this moment is waited for, but for a second at most. From any thread, or itself."""
        ...


class Reader(Task, Protocol):
    """Hands over what comes."""

    def catch_up(self) -> None:
        """All that has come so far is handed over when this returns, for who was held up; waits a second at most."""
        ...


class Event(Protocol):
    """What one side sets and the other waits for; as threading.Event."""

    def is_set(self) -> bool: ...

    def set(self) -> None: ...

    def clear(self) -> None: ...

    def wait(self, timeout: float) -> bool: ...


class Clock(Protocol):
    """What time it is, and how it passes. All times are in seconds.

    Whoever sleeps or waits, in the main thread, hears of an interrupt that was noted: see `INTERRUPTION`.
    """

    @property
    def simulated(self) -> bool:
        """Every deadline is kept by construction."""
        ...

    def now(self) -> float:
        """Monotonic; its zero means nothing."""
        ...

    def date(self) -> float:
        """Since 1970-01-01 UTC, as frames are stamped."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Let time pass."""
        ...

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """Let time pass until `ready`, which is looked at often; False where it is not in time."""
        ...

    def event(self) -> Event: ...

    def lock(self) -> contextlib.AbstractContextManager[Any]:
        """Keeps threads out, where there are any; may be entered again by the one that is in."""
        ...

    def every(self, period_s: float, call: Callable[[], None], name: str = "") -> Task:
        """Call at once and then every period, to absolute deadlines; one that was missed is caught up with by at most
        half a period each time."""
        ...

    def later(self, delay_s: float, call: Callable[[], None]) -> Task:
        """Call once, after so long, unless it is closed before."""
        ...

    def read(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Reader:
        """Hand over every frame that comes; `failed` gets what receiving raises, and reading goes on."""
        ...
