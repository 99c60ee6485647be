"""Time has one room: the wall for real buses, stepped for the bench. Nothing else asks the time, sleeps or has threads.

    WallClock      `every` and `read` are threads; what waits, waits in the kernel
    SteppedClock   one thread, no waiting: whoever sleeps or waits carries out what is due meanwhile, frames among it;
                   where nothing is due the clock jumps to the next thing that will be. Same calls, same bytes,
                   however busy the computer is. A frame on its own bus takes as long as its bits do. That bus is an
                   interface of python-can's, "stepped": who names a channel first makes a clock for it, and everybody
                   who names it in the same process meets there

Whoever has a bus has its clock: `clock_of`.

Callbacks of `every`, `read` and `later` note what came and do not wait: under the wall they would hold up a thread.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import can

Receive = Callable[[can.Message], None]
Failed = Callable[[Exception], None]


class Task(Protocol):
    """Something that goes on until it is closed."""

    def close(self) -> None:
        """End it; what it does at this moment is waited for, but for a second at most. From any thread, or itself."""
        ...


class Event(Protocol):
    """What one side sets and the other waits for; as threading.Event."""

    def is_set(self) -> bool: ...

    def set(self) -> None: ...

    def clear(self) -> None: ...

    def wait(self, timeout: float) -> bool: ...


class Clock(Protocol):
    """What time it is, and how it passes. All times are in seconds."""

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

    def read(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Task:
        """Hand over every frame that comes; `failed` gets what receiving raises, and reading goes on."""
        ...


# ── the wall ─────────────────────────────────────────────────────────────────────────────────────────────────────────

_POLL_S = 0.001  # how often `wait` looks
_READ_TIMEOUT_S = 0.02  # on a silent bus, `close` waits for the reader so long
_FAILURE_PAUSE_S = 0.1
_ENDED_WITHIN_S = 1.0


class WallClock:
    """The computer's own time. It has no state: two of them are as good as one."""

    simulated = False

    now = staticmethod(time.monotonic)
    date = staticmethod(time.time)
    sleep = staticmethod(time.sleep)

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        """See Clock."""
        end = time.monotonic() + timeout_s
        while not ready():
            if time.monotonic() >= end:
                return ready()
            time.sleep(_POLL_S)
        return True

    def event(self) -> Event:
        """See Clock."""
        return threading.Event()

    def lock(self) -> contextlib.AbstractContextManager[Any]:
        """See Clock."""
        return threading.RLock()

    def every(self, period_s: float, call: Callable[[], None], name: str = "") -> Task:
        """See Clock."""

        def run(ending: threading.Event) -> None:
            due = time.monotonic()
            while not ending.is_set():
                began = time.monotonic()
                call()
                due = max(due + period_s, began + period_s / 2)
                left = due - time.monotonic()
                if left > 0:
                    ending.wait(left)

        return _Thread(run, name or "schwung timer")

    def later(self, delay_s: float, call: Callable[[], None]) -> Task:
        """See Clock."""

        def run(ending: threading.Event) -> None:
            if not ending.wait(delay_s):
                call()

        return _Thread(run, "schwung timer")

    def read(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Task:
        """See Clock."""

        def run(ending: threading.Event) -> None:
            while not ending.is_set():
                try:
                    message = bus.recv(_READ_TIMEOUT_S)
                except (
                    can.CanError,
                    OSError,
                    ValueError,
                ) as error:  # ValueError: the socket was closed under us
                    if not ending.is_set():
                        failed(error)
                        ending.wait(_FAILURE_PAUSE_S)
                    continue
                if message is not None:
                    receive(message)

        return _Thread(run, "schwung bus reader")


class _Thread:
    def __init__(self, run: Callable[[threading.Event], None], name: str) -> None:
        self._ending = threading.Event()
        self._thread = threading.Thread(target=run, args=(self._ending,), name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(_ENDED_WITHIN_S)


# ── stepped ──────────────────────────────────────────────────────────────────────────────────────────────────────────

#: 2000-01-01 UTC: simulated time says a simulated date.
EPOCH_S = 946_684_800.0
BIT_RATE = 1_000_000


class SteppedClock:
    """Simulated time; see the module. Everything happens in the thread that sleeps or waits, in the order in which it
    is due, and in the order in which it was asked for where that is the same."""

    simulated = True

    def __init__(self) -> None:
        self._now = 0.0
        self._order = itertools.count()
        self._due: list[tuple[float, int, _Call]] = []
        self._wires: dict[str, Wire] = {}

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
        end, due = self._now + max(timeout_s, 0.0), self._due
        while not ready():
            if not due or due[0][0] > end:
                self._now = max(self._now, end)
                return ready()
            at, _, call = heapq.heappop(due)
            if not call.closed:
                self._now = max(self._now, at)
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
        return self._at(self._now + delay_s, _Call(call))

    def read(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Task:
        """See Clock; `bus` is one of this clock's, or wraps one and says so by its attribute `stepped`.

        A frame that comes while one is being received has to wait.
        """
        inner = getattr(bus, "stepped", None)
        if not isinstance(inner, SteppedBus):
            raise TypeError(f"{bus} is no bus of a stepped clock")
        return _Reader(inner, bus, receive, failed)

    def bus(
        self, channel: str = "bench", *, bit_rate: int = BIT_RATE, receive_own_messages: bool = False
    ) -> SteppedBus:
        """One more end of a wire of this clock's own; the first one makes it."""
        wire = self._wires.setdefault(channel, Wire(self, bit_rate))
        return SteppedBus(channel, wire=wire, receive_own_messages=receive_own_messages)

    def _at(self, when: float, call: _Call) -> _Call:
        heapq.heappush(self._due, (when, next(self._order), call))
        return call


def _never() -> bool:
    return False


class _Call:
    """Something to be done once."""

    def __init__(self, call: Callable[[], None]) -> None:
        self.closed = False
        self._call = call

    def carry_out(self, at: float) -> None:
        self._call()

    def close(self) -> None:
        self.closed = True


class _Periodic(_Call):
    """Something to be done again and again; not while it is being done."""

    def __init__(self, clock: SteppedClock, period_s: float, call: Callable[[], None]) -> None:
        super().__init__(call)
        self._clock, self._period_s, self._busy = clock, period_s, False
        clock._at(clock.now(), self)

    def carry_out(self, at: float) -> None:
        self._clock._at(
            at + self._period_s, self
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


@dataclass(eq=False)
class _Reader:
    """Gets every frame of an end of a wire, through the bus that wraps it where there is one."""

    inner: SteppedBus
    bus: can.BusABC
    receive: Receive
    failed: Failed
    busy: bool = False

    def __post_init__(self) -> None:
        self.inner.reader = self
        self.take()

    def take(self) -> None:
        """Receive all that waits."""
        if self.busy:
            return
        self.busy = True
        try:
            while self.inner.waiting and self.inner.reader is self:
                try:
                    message = self.bus.recv(0)
                except (can.CanError, OSError) as error:
                    self.inner.waiting.clear()
                    self.failed(error)
                    return
                if message is not None:
                    self.receive(message)
        finally:
            self.busy = False

    def close(self) -> None:
        if self.inner.reader is self:
            self.inner.reader = None


#: What becomes of a frame on its way from one end to another: the delays (s) after which it arrives; none: it is lost,
#: two: it is doubled.
Weather = Callable[["SteppedBus", "SteppedBus", can.Message], Sequence[float]]


class Wire:
    """What the ends of a stepped bus share. Frames take turns in the order in which they are sent; not modelled:
    arbitration, errors, acknowledgement."""

    def __init__(self, clock: SteppedClock, bit_rate: int) -> None:
        self.clock, self.bit_rate = clock, bit_rate
        self.ends: list[SteppedBus] = []
        self.weather: Weather | None = None
        self._free_s = 0.0

    def carry(self, sender: SteppedBus, message: can.Message) -> None:
        """Deliver a frame to all other ends when it has passed the wire."""
        clock = self.clock
        self._free_s = max(self._free_s, clock._now) + _frame_bits(message) / self.bit_rate
        for end in self.ends:
            if end is sender and not end.receive_own_messages:
                continue
            for delay in (0.0,) if self.weather is None else self.weather(sender, end, message):
                clock._at(self._free_s + delay, _Arrival(end, message))


def _frame_bits(message: can.Message) -> int:
    """Bits of a frame with 11-bit identifier and interframe space (ISO 11898-1), without stuffing."""
    return 47 + 8 * len(message.data)


class _Arrival(_Call):
    def __init__(self, end: SteppedBus, message: can.Message) -> None:
        self.closed, self._end, self._message = False, end, message

    def carry_out(self, at: float) -> None:
        self._end.arrived(self._message, EPOCH_S + at)


class SteppedBus(can.BusABC):
    """One end of a stepped wire, as python-can has it. `recv` lets the clock's time pass."""

    def __init__(
        self,
        channel: str = "bench",
        *,
        wire: Wire | None = None,
        bitrate: int = BIT_RATE,
        receive_own_messages: bool = False,
        **_: Any,
    ) -> None:
        if wire is None:
            wire = _named.get(channel)
            if wire is None:
                wire = _named[channel] = Wire(SteppedClock(), bitrate)
        self.wire, self.receive_own_messages = wire, receive_own_messages
        self.channel_info, self.channel = f"stepped {channel}", channel
        self.waiting: deque[can.Message] = deque()
        self.reader: _Reader | None = None
        wire.ends.append(self)
        super().__init__(channel=channel)

    @property
    def clock(self) -> SteppedClock:
        """The clock by which it runs."""
        return self.wire.clock

    @property
    def stepped(self) -> SteppedBus:
        """Itself: a bus that wraps this one hands it on."""
        return self

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """See can.BusABC; never fails, and the frame may be changed afterwards."""
        if self in self.wire.ends:
            self.wire.carry(self, _copy(msg))

    def arrived(self, message: can.Message, stamp_s: float) -> None:
        """A frame has come; given to the reader where there is one, else kept for `recv`."""
        if self not in self.wire.ends:
            return
        message = _copy(message)
        message.timestamp, message.channel = stamp_s, self.channel
        self.waiting.append(message)
        if self.reader is not None:
            self.reader.take()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """See can.BusABC, whose own would look at the wall's clock; filters are not modelled."""
        waiting = self.waiting
        if not waiting and timeout != 0:
            self.wire.clock.wait(lambda: bool(waiting), float("inf") if timeout is None else timeout)
        return waiting.popleft() if waiting else None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self.recv(timeout), True

    def shutdown(self) -> None:
        """Leave the wire."""
        super().shutdown()
        if self in self.wire.ends:
            self.wire.ends.remove(self)
        if not self.wire.ends and _named.get(self.channel) is self.wire:
            del _named[self.channel]
        self.waiting.clear()


#: Wires that were made by naming a channel, for as long as anybody is on them.
_named: dict[str, Wire] = {}


def clock_of(bus: can.BusABC) -> Clock:
    """The clock by which a bus runs: its own where it is stepped, or wraps one that is; else the wall's."""
    inner = getattr(bus, "stepped", None)
    if not isinstance(inner, SteppedBus):
        return WallClock()
    clock: Clock = getattr(bus, "clock", inner.clock)
    return clock


def _copy(message: can.Message) -> can.Message:
    """A cheap copy: can.Message's own looks at every field twice."""
    twin = can.Message.__new__(can.Message)
    twin.timestamp, twin.arbitration_id = message.timestamp, message.arbitration_id
    twin.data, twin.dlc, twin.channel = bytearray(message.data), message.dlc, message.channel
    twin.is_extended_id, twin.is_remote_frame = message.is_extended_id, message.is_remote_frame
    twin.is_error_frame, twin.is_fd = message.is_error_frame, message.is_fd
    twin.bitrate_switch, twin.error_state_indicator = message.bitrate_switch, message.error_state_indicator
    twin.is_rx = True
    return twin
