"""Simulated time: one thread, no waiting. Whoever sleeps or waits carries out what is due meanwhile, frames among it;
where nothing is due the clock jumps to the next thing that will be. Same calls, same bytes, however busy the computer
is.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
from collections.abc import Callable
from typing import Any

import can

from schwung.clock.interruption import INTERRUPTION
from schwung.clock.protocol import Event, Failed, Reader, Receive, Task

#: 2000-01-01 UTC: simulated time says a simulated date.
EPOCH_S = 946_684_800.0


class SteppedClock:
    """Simulated time; see the module. Everything happens in the thread that sleeps or waits, in the order in which it
    is due, and in the order in which it was asked for where that is the same."""

    simulated = True

    def __init__(self) -> None:
        self._now = 0.0
        self._order = itertools.count()
        self._due: list[tuple[float, int, Call]] = []

    def now(self) -> float:
        """See Clock; begins at 0."""
        return self._now

    def date(self) -> float:
        """See Clock; begins at EPOCH_S."""
        return EPOCH_S + self._now

    def sleep(self, duration_s: float) -> None:
        """See Clock."""
        self.wait(_never, duration_s)

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """See Clock. May be called from a callback: what it waits for goes on."""
        end, due, pop = self._now + max(timeout_s, 0.0), self._due, heapq.heappop
        if INTERRUPTION.noted:
            INTERRUPTION.let_through()
        while not ready():
            if not due or due[0][0] > end:
                self._now = max(self._now, end)
                return ready()
            at, _, call = pop(due)
            if not call.closed:
                now = self._now  # `max` would take as long as the rest of it
                self._now = at if at > now else now
                call.carry_out(at)
        return True

    def event(self) -> Event:
        """See Clock."""
        return _SteppedEvent(self)

    def lock(self) -> contextlib.AbstractContextManager[Any]:
        """See Clock; there is but one thread."""
        return contextlib.nullcontext()

    def every(self, period_s: float, call: Callable[[], None], name: str = "") -> Task:
        """See Clock; never late."""
        return _Periodic(self, period_s, call)

    def later(self, delay_s: float, call: Callable[[], None]) -> Task:
        """See Clock."""
        return self.put(self._now + delay_s, Call(call))

    def read(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Reader:
        """See Clock; `bus` is one of this clock's, or wraps one and says so by its attribute `stepped`.

        A frame that comes while one is being received has to wait.
        """
        inner = getattr(bus, "stepped", None)
        if inner is None:
            raise TypeError(f"{bus} is no bus of a stepped clock")
        reader: Reader = inner.give_to(bus, receive, failed)
        return reader

    def put(self, when_s: float, call: Call) -> Call:
        """Have `call` carried out at that time."""
        heapq.heappush(self._due, (when_s, next(self._order), call))
        return call


def _never() -> bool:
    return False


class Call:
    """Something to be done once, unless it is closed before."""

    def __init__(self, call: Callable[[], None]) -> None:
        self.closed = False
        self._call = call

    def carry_out(self, at_s: float) -> None:
        """Do it; `at_s` is when it was due."""
        self._call()

    def close(self) -> None:
        """Do it no more."""
        self.closed = True


class _Periodic(Call):
    """Something to be done again and again; not while it is being done."""

    def __init__(self, clock: SteppedClock, period_s: float, call: Callable[[], None]) -> None:
        super().__init__(call)
        self._clock, self._period_s, self._busy = clock, period_s, False
        clock.put(clock.now(), self)

    def carry_out(self, at_s: float) -> None:
        self._clock.put(
            at_s + self._period_s, self
        )  # first: what interrupts the call shall not end it for ever
        if self._busy:
            return
        self._busy = True
        try:
            self._call()
        finally:
            self._busy = False


class _SteppedEvent:
    def __init__(self, clock: SteppedClock) -> None:
        self._clock, self._set = clock, False

    def is_set(self) -> bool:
        return self._set

    def set(self) -> None:
        self._set = True

    def clear(self) -> None:
        self._set = False

    def wait(self, timeout: float) -> bool:
        return self._clock.wait(self.is_set, timeout)
