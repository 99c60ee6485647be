"""One suite over both clocks; and what the stepped one promises beyond: order, exact instants, no waiting."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass

import can
import pytest

from schwung.clock import BIT_RATE, EPOCH_S, Clock, SteppedBus, SteppedClock, WallClock, Wire, clock_of


@dataclass
class Room:
    """A clock and two ends of a bus that it can read."""

    clock: Clock
    one: can.BusABC
    other: can.BusABC


@pytest.fixture(params=["wall", "stepped"])
def room(request: pytest.FixtureRequest) -> Iterator[Room]:
    clock: Clock
    if request.param == "wall":
        clock = WallClock()
        ends: list[can.BusABC] = [can.Bus(interface="virtual", channel="test-clock") for _ in range(2)]
    else:
        clock = stepped = SteppedClock()
        wire = Wire(stepped)
        ends = [wire.bus(), wire.bus()]
    yield Room(clock, *ends)
    for end in ends:
        end.shutdown()


def frame(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def test_time_passes_while_somebody_sleeps(room: Room) -> None:
    before, date = room.clock.now(), room.clock.date()
    room.clock.sleep(0.02)
    assert 0.02 <= room.clock.now() - before < 1
    assert 0.019 <= room.clock.date() - date < 1


def test_wait_ends_with_what_is_waited_for_or_in_time(room: Room) -> None:
    event, before = room.clock.event(), room.clock.now()
    room.clock.later(0.01, event.set)
    assert room.clock.wait(event.is_set, 5.0)
    assert 0.009 <= room.clock.now() - before < 4
    event.clear()
    assert not event.wait(0.01)
    assert not room.clock.wait(event.is_set, 0.01)


def test_every_begins_at_once_and_ends_when_closed(room: Room) -> None:
    calls: list[float] = []
    task = room.clock.every(0.01, lambda: calls.append(room.clock.now()))
    assert room.clock.wait(lambda: len(calls) >= 4, 5.0)
    task.close()
    count = len(calls)
    room.clock.sleep(0.05)
    assert len(calls) == count
    assert all(later - earlier > 0.004 for earlier, later in itertools.pairwise(calls))


def test_what_is_closed_in_time_does_not_happen(room: Room) -> None:
    event = room.clock.event()
    room.clock.later(0.02, event.set).close()
    assert not event.wait(0.05)


def test_frames_reach_the_reader_of_the_other_end_in_order(room: Room) -> None:
    came: list[can.Message] = []
    reader = room.clock.read(room.other, came.append, _unexpected)
    for number in range(20):
        room.one.send(frame(0x100 + number, bytes([number])))
    assert room.clock.wait(lambda: len(came) == 20, 5.0)
    reader.close()
    assert [m.arbitration_id for m in came] == list(range(0x100, 0x114))
    assert all(abs(m.timestamp - room.clock.date()) < 5 for m in came)
    room.one.send(frame(0x200))
    kept = room.other.recv(1.0)
    assert kept is not None
    assert kept.arbitration_id == 0x200
    assert len(came) == 20


def test_frames_that_came_before_the_reader_are_not_lost(room: Room) -> None:
    room.one.send(frame(0x123))
    room.clock.sleep(0.01)
    came: list[can.Message] = []
    reader = room.clock.read(room.other, came.append, _unexpected)
    assert room.clock.wait(lambda: len(came) == 1, 5.0)
    reader.close()


@pytest.mark.parametrize("waiting", [0, 3])
def test_who_catches_up_has_heard_what_came(room: Room, waiting: int) -> None:
    """Reading goes on afterwards, and nobody waits who catches up from what he is called with."""
    came, inner = list[int](), list[float]()

    def receive(message: can.Message) -> None:
        room.clock.sleep(0.002)  # as a thread that is held up
        came.append(message.arbitration_id)
        if message.arbitration_id == 9:
            before = room.clock.now()
            reader.catch_up()
            inner.append(room.clock.now() - before)

    for number in range(waiting):
        room.one.send(frame(number))
    reader = room.clock.read(room.other, receive, pytest.fail)
    try:
        before = room.clock.now()
        reader.catch_up()
        if not room.clock.simulated:  # there, frames come while time passes
            assert came == list(range(waiting))
        assert room.clock.now() - before < 0.9
        room.one.send(frame(9))
        assert room.clock.wait(lambda: bool(inner), 1.0)
        assert inner[0] < 0.5
    finally:
        reader.close()


@pytest.mark.parametrize(
    ("ahead_s", "waits"), [(0.0, False), (3600.0, True)], ids=["kernel", "another clock"]
)
def test_who_catches_up_on_a_full_bus_is_not_kept_from_going_on(ahead_s: float, waits: bool) -> None:
    """Each frame takes as long to read as the next one takes to come: a motion's feeder waited here until it was late.

    By the stamps of an adapter whose clock is ahead of ours, all would have come later: nobody goes by those.
    """

    class Full(can.BusABC):
        def __init__(self) -> None:
            self.sent = 0
            super().__init__(channel="full")

        def send(self, msg: can.Message, timeout: float | None = None) -> None: ...

        def recv(self, timeout: float | None = None) -> can.Message | None:
            self.sent += 1
            message = frame(self.sent & 0x7FF)
            message.timestamp = time.time() + ahead_s - (0.05 if self.sent <= 20 else 0.0)  # 20 that wait
            return message

        def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
            return None, True

    came = list[int]()

    def receive(message: can.Message) -> None:
        time.sleep(0.001)
        came.append(message.arbitration_id)

    clock, bus = WallClock(), Full()
    reader = clock.read(bus, receive, pytest.fail)
    try:
        before = clock.now()
        reader.catch_up()
        assert (clock.now() - before > 0.8) == waits
        assert len(came) > 20
    finally:
        reader.close()
        bus.shutdown()


def test_failures_of_the_bus_are_handed_over_and_reading_goes_on() -> None:
    clock = WallClock()

    class Broken(can.BusABC):
        def __init__(self) -> None:
            self.calls = 0
            super().__init__(channel="broken")

        def recv(self, timeout: float | None = None) -> can.Message | None:
            self.calls += 1
            raise can.CanOperationError("no such device")

        def send(self, msg: can.Message, timeout: float | None = None) -> None: ...

        def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
            return None, True

    bus, failures = Broken(), list[Exception]()
    reader = clock.read(bus, _unexpected, failures.append)
    assert clock.wait(lambda: len(failures) >= 2, 5.0)
    reader.close()
    bus.shutdown()


def test_a_reader_goes_on_behind_a_mistake_in_what_it_calls_and_says_so() -> None:
    """It ended, and whoever held a drive heard nothing more, neither of faults nor the answers to a stop."""
    came, failures = list[int](), list[Exception]()

    def receive(message: can.Message) -> None:
        came.append(message.arbitration_id)
        if message.arbitration_id == 1:
            raise IndexError("a mistake")

    with (
        can.Bus(interface="virtual", channel="mistake") as one,
        can.Bus(interface="virtual", channel="mistake") as other,
    ):
        clock = WallClock()
        reader = clock.read(other, receive, failures.append)
        for can_id in (1, 2):
            one.send(frame(can_id))
        assert clock.wait(lambda: came == [1, 2], 5.0)
        reader.close()
    assert [type(error) for error in failures] == [IndexError]


@pytest.mark.parametrize("kind", [IndexError, TypeError, AttributeError, RuntimeError])
def test_a_reader_goes_on_whatever_an_adapter_raises(kind: type[Exception]) -> None:
    """Some stumble over a line that is cut short; the thread ended, and nobody was told."""
    came, failures = list[int](), list[Exception]()
    with (
        can.Bus(interface="virtual", channel="stumbles") as one,
        can.Bus(interface="virtual", channel="stumbles") as other,
    ):
        recv, stumbles = other.recv, [True]

        def stumble(timeout: float | None = None) -> can.Message | None:
            if stumbles.pop() if stumbles else False:
                raise kind("a line cut short")
            return recv(timeout)

        other.recv = stumble  # type: ignore[method-assign]
        clock = WallClock()
        reader = clock.read(other, lambda message: came.append(message.arbitration_id), failures.append)
        one.send(frame(1))
        assert clock.wait(lambda: came == [1], 5.0)
        reader.close()
    assert [type(error) for error in failures] == [kind]


def _unexpected(what: object) -> None:
    pytest.fail(f"unexpected {what}")


# ── the stepped one alone ────────────────────────────────────────────────────────────────────────────────────────────


def test_an_hour_takes_no_time() -> None:
    clock, calls, began = SteppedClock(), list[float](), time.monotonic()
    clock.every(1.0, lambda: calls.append(clock.now()))
    clock.sleep(3600.0)
    assert clock.now() == 3600.0
    assert calls == [float(n) for n in range(3601)]
    assert clock.date() == EPOCH_S + 3600.0
    assert time.monotonic() - began < 5


def test_what_is_due_at_one_instant_happens_as_it_was_asked_for() -> None:
    clock, order = SteppedClock(), list[str]()
    for name in "abc":
        clock.later(0.5, lambda name=name: order.append(name))  # type: ignore[misc]  # a default binds it now
    clock.later(0.2, lambda: order.append("first"))
    clock.sleep(1.0)
    assert order == ["first", "a", "b", "c"]


def test_a_frame_takes_its_bits_and_frames_take_turns() -> None:
    clock = SteppedClock()
    wire = Wire(clock)
    one, other = wire.bus(), wire.bus()
    came: list[float] = []
    clock.read(other, lambda _: came.append(clock.now()), _unexpected)
    one.send(frame(0x200, bytes(8)))
    one.send(frame(0x80))
    assert not came  # what is sent arrives later, never within the call
    clock.sleep(0.01)
    assert came == pytest.approx([(47 + 64) / BIT_RATE, (2 * 47 + 64) / BIT_RATE])


def test_a_frame_that_comes_while_one_is_received_has_to_wait() -> None:
    """A callback that lets time pass is not entered by the next frame: a drive's processor does one thing at a time."""
    clock = SteppedClock()
    wire = Wire(clock)
    one, other = wire.bus(), wire.bus()
    log: list[str] = []

    def receive(message: can.Message) -> None:
        log.append(f"begin {message.arbitration_id}")
        clock.sleep(0.001)
        log.append(f"end {message.arbitration_id}")

    clock.read(other, receive, _unexpected)
    one.send(frame(1))
    one.send(frame(2))
    clock.sleep(0.01)
    assert log == ["begin 1", "end 1", "begin 2", "end 2"]


def test_a_timer_that_waits_is_not_entered_by_itself() -> None:
    clock, depth, deepest = SteppedClock(), [0], [0]

    def call() -> None:
        depth[0] += 1
        deepest[0] = max(deepest[0], depth[0])
        clock.sleep(0.025)
        depth[0] -= 1

    clock.every(0.01, call)
    clock.sleep(0.2)
    assert deepest == [1]


def test_recv_lets_time_pass() -> None:
    clock = SteppedClock()
    wire = Wire(clock)
    one, other = wire.bus(), wire.bus()
    clock.later(0.5, lambda: one.send(frame(0x321)))
    message = other.recv(1.0)
    assert message is not None
    assert message.timestamp == EPOCH_S + clock.now()
    assert clock.now() == pytest.approx(0.5, abs=1e-3)
    assert other.recv(0.25) is None
    assert clock.now() == pytest.approx(0.75, abs=1e-3)


def test_an_interrupted_timer_goes_on() -> None:
    """Ctrl-C gets through wherever the one thread is; what it hit is not ended for ever by it."""
    clock, calls = SteppedClock(), list[float]()

    def call() -> None:
        calls.append(clock.now())
        if len(calls) == 3:
            raise KeyboardInterrupt

    clock.every(0.1, call)
    with pytest.raises(KeyboardInterrupt):
        clock.sleep(1.0)
    clock.sleep(0.3)
    assert len(calls) == 6


@pytest.mark.parametrize(
    ("delays", "expected"), [((), 0), ((0.0, 0.001), 2), ((0.2,), 1)], ids=["lost", "doubled", "late"]
)
def test_weather_loses_doubles_and_delays(delays: tuple[float, ...], expected: int) -> None:
    clock = SteppedClock()
    wire = Wire(clock)
    one, other = wire.bus(), wire.bus()
    one.wire.weather = lambda sender, receiver, message: delays
    one.send(frame(1))
    came = list[float]()
    clock.read(other, lambda _: came.append(clock.now()), _unexpected)
    clock.sleep(0.1)
    assert len(came) == (0 if delays == (0.2,) else expected)
    clock.sleep(0.5)
    assert len(came) == expected


def test_a_bus_that_has_left_neither_hears_nor_speaks() -> None:
    clock = SteppedClock()
    wire = Wire(clock)
    ends: list[SteppedBus] = [wire.bus() for _ in range(3)]
    ends[0].shutdown()
    ends[0].send(frame(1))
    ends[1].send(frame(2))
    clock.sleep(0.1)
    assert not ends[0].waiting
    assert [m.arbitration_id for m in ends[2].waiting] == [2]
    for end in ends:
        end.shutdown()


def test_own_messages_come_back_where_wished() -> None:
    talker = Wire(SteppedClock()).bus(receive_own_messages=True)
    talker.send(frame(7))
    assert talker.recv(0.1) is not None
    talker.shutdown()


def test_only_its_own_buses_can_be_read() -> None:
    with (
        can.Bus(interface="virtual", channel="foreign") as bus,
        pytest.raises(TypeError, match="stepped clock"),
    ):
        SteppedClock().read(bus, _unexpected, _unexpected)


def test_who_names_a_channel_meets_there_by_python_can_s_own_means() -> None:
    one, other = (can.Bus(interface="stepped", channel="hall", bitrate=500_000) for _ in range(2))
    elsewhere = can.Bus(interface="stepped", channel="yard")
    assert clock_of(one) is clock_of(other)
    assert clock_of(one) is not clock_of(elsewhere)
    one.send(frame(0x123))
    message = other.recv(1.0)
    assert message is not None
    assert message.timestamp == pytest.approx(EPOCH_S + 47 / 500_000, abs=1e-6)
    before = clock_of(one)
    for end in (one, other, elsewhere):
        end.shutdown()
    with can.Bus(interface="stepped", channel="hall") as again:
        assert clock_of(again) is not before  # an empty hall is forgotten


def test_every_other_bus_runs_by_the_wall() -> None:
    with can.Bus(interface="virtual", channel="any") as bus:
        assert isinstance(clock_of(bus), WallClock)
