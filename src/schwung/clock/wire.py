"""The stepped clock's own bus: a frame takes as long as its bits do.

It is an interface of python-can's, "stepped": who names a channel first makes a clock for it, and everybody who names
it in the same process meets there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import can

from schwung.clock.protocol import Failed, Reader, Receive
from schwung.clock.stepped import EPOCH_S, Call, SteppedClock

BIT_RATE = 1_000_000


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
        self.catch_up()

    def catch_up(self) -> None:
        """See clock.Reader."""
        if self.busy:
            return
        self.busy, inner, waiting = True, self.inner, self.inner.waiting
        try:
            while waiting and inner.reader is self:
                try:
                    message = self.bus.recv(0)
                except (can.CanError, OSError) as error:
                    waiting.clear()
                    self.failed(error)
                    return
                if message is not None:
                    self.receive(message)
        finally:
            self.busy = False

    def take(self, message: can.Message) -> None:
        """Receive a frame for which nobody waits in line, and what comes meanwhile."""
        self.busy = True
        try:
            self.receive(message)
        finally:
            self.busy = False
        if self.inner.waiting:
            self.catch_up()

    def close(self) -> None:
        if self.inner.reader is self:
            self.inner.reader = None


#: Bits of a frame with 11-bit identifier, without data and with interframe space (ISO 11898-1), without stuffing.
_EMPTY_FRAME_BITS = 47
#: What becomes of a frame on its way from one end to another: the delays (s) after which it arrives; none: it is lost,
#: two: it is doubled.
Weather = Callable[["SteppedBus", "SteppedBus", can.Message], Sequence[float]]


class Wire:
    """What the ends of a stepped bus share. Frames take turns in the order in which they are sent; not modelled:
    arbitration, errors, acknowledgement."""

    def __init__(self, clock: SteppedClock, bit_rate: int = BIT_RATE) -> None:
        self.clock, self.bit_rate = clock, bit_rate
        self.ends: list[SteppedBus] = []
        self.weather: Weather | None = None
        self._free_s = 0.0

    def bus(self, channel: str = "bench", *, receive_own_messages: bool = False) -> SteppedBus:
        """One more end of it."""
        return SteppedBus(channel, wire=self, receive_own_messages=receive_own_messages)

    def carry(self, sender: SteppedBus, message: can.Message) -> None:
        """Deliver a frame to all other ends when it has passed the wire; each gets a copy of its own."""
        clock, weather = self.clock, self.weather
        now = clock.now()
        begins = now if now > self._free_s else self._free_s
        self._free_s = free = begins + (_EMPTY_FRAME_BITS + 8 * len(message.data)) / self.bit_rate
        for end in self.ends:
            if end is sender and not end.receive_own_messages:
                continue
            if weather is None:
                clock.put(free, _Arrival(end, _copy(message)))
                continue
            for delay in weather(sender, end, message):
                clock.put(free + delay, _Arrival(end, _copy(message)))


class _Arrival(Call):
    def __init__(self, end: SteppedBus, message: can.Message) -> None:
        self.closed, self._end, self._message = False, end, message

    def carry_out(self, at_s: float) -> None:
        self._end.arrived(self._message, EPOCH_S + at_s)


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
        self.left = False  # the wire
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

    def give_to(self, bus: can.BusABC, receive: Receive, failed: Failed) -> Reader:
        """Hand over every frame that comes, through `bus`: itself, or the one that wraps it (Clock.read)."""
        return _Reader(self, bus, receive, failed)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """See can.BusABC; never fails, and the frame may be changed afterwards."""
        if not self.left:
            self.wire.carry(self, msg)

    def arrived(self, message: can.Message, stamp_s: float) -> None:
        """A frame has come; given to the reader where there is one, else kept for `recv`."""
        if self.left:
            return
        message.timestamp, message.channel = stamp_s, self.channel
        reader = self.reader
        if reader is not None and reader.bus is self and not reader.busy and not self.waiting:
            reader.take(message)  # as `catch_up` would, without putting it down first
            return
        self.waiting.append(message)
        if reader is not None:
            reader.catch_up()

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
        self.left = True
        if self in self.wire.ends:  # who only talks is not
            self.wire.ends.remove(self)
        if not self.wire.ends and _named.get(self.channel) is self.wire:
            del _named[self.channel]
        self.waiting.clear()


#: Wires that were made by naming a channel, for as long as anybody is on them.
_named: dict[str, Wire] = {}


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
