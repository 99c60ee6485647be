"""The kernel's broadcast manager on a stepped bus, and a drive's end of the wire that notes what it sees."""

from __future__ import annotations

from collections.abc import Callable

import can

from schwung.clock import Failed, Receive, SteppedBus, SteppedClock, Task
from schwung.errors import BusError
from schwung.fieldbus.canopen.bcm import OpenBroadcast, unpack


class SteppedBroadcast:
    """What net/can/bcm.c does, as measured in tests/vcan/test_kernel_broadcast.py.

    Each frame goes out `latency_s` later than the interval says. `delay_s` is how long the next write takes to arrive.
    """

    def __init__(self, clock: SteppedClock, bus: SteppedBus, latency_s: float = 0.0) -> None:
        self.clock, self.bus, self.latency_s = clock, bus, latency_s
        self.frames: list[tuple[int, bytes]] = []
        self.index, self.count, self.interval_s = 0, 0, 0.0
        self.delay_s, self.broken, self.writes = 0.0, False, 0
        self._timer: Task | None = None

    @property
    def opener(self) -> OpenBroadcast:
        """Hands this one out, whatever the channel."""
        return lambda _channel: self

    def write(self, frames: bytes, interval_us: int, count: int | None, *, start: bool = False) -> None:
        if self.broken:
            raise BusError("bus stepped", "the kernel's broadcast manager refuses", "Mend it.")
        if self.delay_s:
            self.delay_s, delay_s = 0.0, self.delay_s
            self.clock.sleep(delay_s)
        self.frames, self.writes = list(unpack(frames)), self.writes + 1
        self.count, self.interval_s = 0x7FFFFFFF if count is None else count, interval_us * 1e-6
        if start:
            self.close()
            self._send()

    def close(self) -> None:
        if self._timer is not None:
            self._timer.close()
        self._timer = None

    @property
    def running(self) -> bool:
        return self._timer is not None

    def _send(self) -> None:
        can_id, data = self.frames[self.index]
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        self.index, self.count = (self.index + 1) % len(self.frames), self.count - 1
        self._timer = self.clock.later(self.interval_s + self.latency_s, self._send) if self.count else None


class StallingClock(SteppedClock):
    """Time whose threads hang when they are told to: the reader, what comes `every` so often, or whoever waits."""

    def __init__(self) -> None:
        super().__init__()
        self._until = {"reader": 0.0, "feeder": 0.0, "caller": 0.0}

    def stall(self, duration_s: float, *who: str) -> None:
        """Let them hang from now on."""
        for name in who or ("reader", "feeder", "caller"):
            self._until[name] = self.now() + duration_s

    def stalls(self, who: str) -> bool:
        return self.now() < self._until[who]

    def wait(self, ready: Callable[[], bool], timeout_s: float) -> bool:
        came = super().wait(ready, timeout_s)
        if self.stalls("caller"):
            super().wait(lambda: not self.stalls("caller"), float("inf"))
        return came

    def every(self, period_s: float, call: Callable[[], None], name: str = "") -> Task:
        return super().every(period_s, lambda: None if self.stalls("feeder") else call(), name)

    def read(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Task:
        waiting: list[can.Message] = []

        def take() -> None:
            if waiting and not self.stalls("reader"):
                taken, waiting[:] = list(waiting), []
                for message in taken:
                    receive(message)

        def came(message: can.Message) -> None:
            waiting.append(message)
            if self.stalls("reader"):
                self.later(self._until["reader"] - self.now(), take)
            else:
                take()

        return super().read(bus, came, failed)


class Seen:
    """A drive's end of the wire: which RPDO it held at each SYNC. It answers every SYNC with its TPDOs."""

    def __init__(
        self,
        clock: SteppedClock,
        bus: SteppedBus,
        rpdo_id: int,
        answers: dict[int, bytes],
        sync_id: int = 0x080,
    ) -> None:
        self.clock, self.bus, self.answers = clock, bus, answers
        self.rpdo_id, self.sync_id = rpdo_id, sync_id
        self.rpdos: list[bytes] = []
        self.at_sync: list[bytes] = []
        self.heard: list[bytes] = []  # of these, the ones while it was not deaf
        self.sync_s: list[float] = []
        self.counters: list[bytes] = []
        self.deaf = False
        self.deaf_during = range(0)  # SYNCs, counted from the first that found an RPDO
        SteppedClock.read(clock, bus, self._received, print)  # it never hangs

    def _received(self, message: can.Message) -> None:
        if message.arbitration_id == self.rpdo_id:
            self.rpdos.append(bytes(message.data))
        elif message.arbitration_id == self.sync_id and self.rpdos:
            deaf = self.deaf or len(self.at_sync) in self.deaf_during
            self.at_sync.append(self.rpdos[-1])
            if not deaf:
                self.heard.append(self.rpdos[-1])
            self.sync_s.append(message.timestamp)
            self.counters.append(bytes(message.data))
            for can_id, data in self.answers.items():
                if not deaf:
                    self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
