"""What an SDO channel uses of a Link, on a stepped bus."""

from __future__ import annotations

from collections.abc import Callable

import can

from schwung.clock import SteppedBus, SteppedClock

FrameCallback = Callable[[can.Message], None]


class SteppedLink:
    """Frames by identifier."""

    def __init__(self, bus: SteppedBus, clock: SteppedClock) -> None:
        self.bus = bus
        self._callbacks: dict[int, FrameCallback] = {}
        self._reader = clock.read(bus, self._receive, unexpected)

    def subscribe(self, can_id: int, callback: FrameCallback) -> None:
        self._callbacks[can_id] = callback

    def unsubscribe(self, can_id: int, callback: FrameCallback) -> None:
        assert self._callbacks[can_id] == callback
        del self._callbacks[can_id]

    def send(self, can_id: int, data: bytes) -> None:
        assert len(data) == 8
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def _receive(self, message: can.Message) -> None:
        if message.arbitration_id in self._callbacks:
            self._callbacks[message.arbitration_id](message)


def unexpected(error: Exception) -> None:
    raise error
