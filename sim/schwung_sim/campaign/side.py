"""One side of a stepped bus that may stall, be interrupted or be killed while everybody else goes on.

`Side` is a clock for one side: all that this side asked for passes through it. `SideBus` is that side's end of the bus.
Of a stepped clock only its public calls are used (now, date, wait, later, read).
"""

from __future__ import annotations

import contextlib
import errno
import signal
from collections import deque
from collections.abc import Callable
from typing import Any

import can

_ROUNDING_S = 1e-12


class Killed(BaseException):
    """The process of this side is gone; nothing of it may run any more, however it tries to clean up."""


class Overdue(BaseException):
    """This side still waits after a time in which everything must have come to an end."""


class Side:
    """A view of a stepped clock: what this side asked for is put off, in order, while it stalls.

    Timers that were put off are caught up with as threads do: by at most half a period each time. A signal reaches the
    main flow only, where it waits or sends: what is called back stands for other threads.
    """

    simulated = True

    def __init__(self, clock: Any, overdue_s: float = float("inf")) -> None:
        self.dead = False
        self._clock, self._overdue_s = clock, overdue_s
        self._alarmed = False  # `here` has something to see to
        self._resume_s = 0.0
        self._signals = 0
        self._called_back = 0  # how deep we are in what was called back
        self._put_off: deque[Callable[[], None]] = deque()
        self.on_wait: Callable[[], None] | None = None  # called whenever the main flow begins to wait

    # What befalls it -------------------------------------------------------------------------------------

    def stall(self, duration_s: float) -> None:
        """Nothing of this side runs from now on, for so long."""
        if not self.stalled:
            self._clock.later(duration_s, self._resume)
        self._alarmed = True
        self._resume_s = max(self._resume_s, self._clock.now() + duration_s)

    def interrupt(self) -> None:
        """A SIGINT, which the main flow gets where it is next waiting or sending."""
        self._signals += 1

    def kill(self) -> None:
        """SIGKILL."""
        self.dead = self._alarmed = True

    @property
    def stalled(self) -> bool:
        return bool(self._clock.now() < self._resume_s)

    def here(self) -> None:
        """A place at which this side may be held up: sit out a stall, and notice what has befallen it."""
        while True:
            if self.dead:
                raise Killed
            if not self.stalled:
                break
            self._clock.wait(lambda: self.dead, self._resume_s - self._clock.now())
        self._alarmed = False
        if self._clock.now() > self._overdue_s:
            raise Overdue
        if self._signals and not self._called_back:
            self._signals -= 1
            handler = signal.getsignal(signal.SIGINT)
            if callable(handler):
                handler(signal.SIGINT, None)

    # A clock ---------------------------------------------------------------------------------------------

    def now(self) -> float:
        return float(self._clock.now())

    def date(self) -> float:
        return float(self._clock.date())

    def sleep(self, duration_s: float) -> None:
        self.wait(lambda: False, duration_s)

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        if self.on_wait is not None and not self._called_back:
            self.on_wait()
        end, main = self._clock.now() + timeout_s, not self._called_back
        while True:
            self.here()
            if ready():
                return True
            left = end - self._clock.now()
            if left <= _ROUNDING_S:
                return False
            self._clock.wait(lambda: self._alarmed or (main and self._signals > 0) or ready(), left)

    def event(self) -> SideEvent:
        return SideEvent(self)

    def lock(self) -> contextlib.AbstractContextManager[Any]:
        return contextlib.nullcontext()

    def every(self, period_s: float, call: Callable[[], None], name: str = "") -> SideTask:
        return SideTask(self, call, period_s)

    def later(self, delay_s: float, call: Callable[[], None]) -> SideTask:
        return SideTask(self, call, None, delay_s)

    def read(self, bus: Any, receive: Callable[[Any], None], failed: Callable[[Exception], None]) -> Any:
        return SideReader(self, bus, receive, failed)

    def read_beneath(
        self, bus: Any, receive: Callable[[Any], None], failed: Callable[[Exception], None]
    ) -> Any:
        """As `read`, but for stalls."""
        return self._clock.read(bus, receive, failed)

    def run(self, call: Callable[[], None]) -> None:
        """Carry out what is due, once this side does not stall any more."""
        if self.dead:
            return
        if self.stalled:
            self._put_off.append(call)
            return
        self._called_back += 1
        try:
            call()
        except (Killed, Overdue):
            pass  # the main flow finds out by itself
        finally:
            self._called_back -= 1

    def _resume(self) -> None:
        if self.stalled:
            self._clock.later(self._resume_s - self._clock.now(), self._resume)
            return
        while self._put_off and not self.stalled:
            self.run(self._put_off.popleft())

    def at(self, delay_s: float, call: Callable[[], None]) -> None:
        """For the tasks of this side: call after so long, but for stalls."""
        self._clock.later(delay_s, lambda: self.run(call))


class SideTask:
    """Something that a side does later, or again and again."""

    def __init__(
        self, side: Side, call: Callable[[], None], period_s: float | None, delay_s: float = 0.0
    ) -> None:
        self._side, self._call, self._period_s = side, call, period_s
        self._closed = False
        self._due = side.now() + delay_s
        side.at(delay_s, self._carry_out)

    def _carry_out(self) -> None:
        if self._closed:
            return
        began = self._side.now()
        try:
            self._call()
        finally:
            if self._period_s is not None:
                self._due = max(self._due + self._period_s, began + self._period_s / 2)
                self._side.at(max(self._due - self._side.now(), 0.0), self._carry_out)

    def close(self) -> None:
        self._closed = True


class SideReader:
    """What reads a bus for a side: what comes while it stalls has to wait."""

    def __init__(
        self, side: Side, bus: Any, receive: Callable[[Any], None], failed: Callable[[Exception], None]
    ) -> None:
        self._side = side
        self._waiting: deque[Callable[[], None]] = deque()
        self._task = side.read_beneath(
            bus,
            lambda message: self._came(lambda: receive(message)),
            lambda error: self._came(lambda: failed(error)),
        )

    def _came(self, call: Callable[[], None]) -> None:
        self._waiting.append(call)
        self._side.run(self._take)

    def _take(self) -> None:
        if self._waiting:  # else somebody has caught up
            self._waiting.popleft()()

    def catch_up(self) -> None:
        while self._waiting and not self._side.dead and not self._side.stalled:
            self._side.run(self._take)

    def close(self) -> None:
        self._task.close()


class SideEvent:
    """As threading.Event."""

    def __init__(self, side: Side) -> None:
        self._side, self._set = side, False

    def is_set(self) -> bool:
        return self._set

    def set(self) -> None:
        self._set = True

    def clear(self) -> None:
        self._set = False

    def wait(self, timeout: float) -> bool:
        return self._side.wait(self.is_set, timeout)


class SideBus(can.BusABC):
    """A side's end of a stepped bus, whose adapter may fail; `alter` changes what it receives (None: nothing does)."""

    def __init__(self, inner: Any, side: Side) -> None:
        self.stepped, self.clock = inner, side
        self.alter: Callable[[can.Message], can.Message] | None = None
        self.on_received: Callable[[can.Message], None] | None = None
        self.bus_off = self.buffer_full = False
        self.channel_info = inner.channel_info
        super().__init__(channel=inner.channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """See can.BusABC."""
        self.clock.here()
        self._check()
        if self.buffer_full:
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        self.stepped.send(msg, timeout)
        self.clock.here()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """See can.BusABC."""
        self._check()
        message: can.Message | None = self.stepped.recv(timeout)
        if message is None:
            return None
        if self.on_received is not None:
            self.on_received(message)
        return message if self.alter is None else self.alter(message)

    def _check(self) -> None:
        if self.bus_off:
            raise can.CanOperationError("Failed to transmit: bus-off")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def shutdown(self) -> None:
        """Leave the wire."""
        super().shutdown()
        self.stepped.shutdown()
