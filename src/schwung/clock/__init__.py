"""Time has one room: the wall for real buses, stepped for the bench. Nothing else asks the time, sleeps or has threads.

Whoever has a bus has its clock: `clock_of`.

Callbacks of `every`, `read` and `later` note what came and do not wait: under the wall they would hold up a thread.
"""

from __future__ import annotations

from schwung.python_can import can  # isort: skip  # first: see there
from schwung.clock.interruption import INTERRUPTION
from schwung.clock.protocol import Clock, Event, Failed, Reader, Receive, Task
from schwung.clock.stepped import EPOCH_S, SteppedClock
from schwung.clock.wall import WallClock
from schwung.clock.wire import BIT_RATE, SteppedBus, Wire

__all__ = [
    "BIT_RATE",
    "EPOCH_S",
    "INTERRUPTION",
    "Clock",
    "Event",
    "Failed",
    "Reader",
    "Receive",
    "SteppedBus",
    "SteppedClock",
    "Task",
    "WallClock",
    "Wire",
    "clock_of",
]


def clock_of(bus: can.BusABC) -> Clock:
    """The clock by which a bus runs: its own where it is stepped, or wraps one that is; else the wall's."""
    inner = getattr(bus, "stepped", None)
    if not isinstance(inner, SteppedBus):
        return WallClock()
    clock: Clock = getattr(bus, "clock", inner.clock)
    return clock
