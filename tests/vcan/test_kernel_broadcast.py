"""What the CANopen driver takes for granted of the kernel's broadcast manager (BCM) and raw sockets.

docs/decisions/0002-setpoints-in-a-kernel-ring.md draws its conclusions from these.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import can
import numpy as np
import pytest
from can.broadcastmanager import ModifiableCyclicTaskABC

from schwung.fieldbus.canopen.bcm import KernelBroadcast, pack

pytestmark = pytest.mark.vcan

OpenBus = Callable[[], can.BusABC]
Measured = Callable[[str, str], None]

PERIOD_S = 0.001
PERIOD_US, SLOW_US = 1000, 20_000
RING = 256  # MAX_NFRAMES of the kernel
RPDO, SYNC = 0x201, 0x80


def frame(value: int, identifier: int = RPDO) -> can.Message:
    return can.Message(arbitration_id=identifier, data=value.to_bytes(2, "little"), is_extended_id=False)


def ring(offset: int = 0) -> list[can.Message]:
    return [frame(offset + position) for position in range(RING)]


def play(bus: can.BusABC) -> ModifiableCyclicTaskABC:
    task = bus.send_periodic(ring(), PERIOD_S)
    assert isinstance(task, ModifiableCyclicTaskABC)
    return task


def receive(bus: can.BusABC, count: int) -> list[can.Message]:
    messages = []
    for received in range(count):
        message = bus.recv(timeout=1.0)
        assert message is not None, f"the bus fell silent after {received} of {count} frames"
        messages.append(message)
    return messages


def until_silent(bus: can.BusABC, silence_s: float = 0.25) -> list[can.Message]:
    messages = []
    while (message := bus.recv(timeout=silence_s)) is not None:
        messages.append(message)
        assert len(messages) < 5000, "the bus does not fall silent"
    return messages


def values(messages: Sequence[can.Message]) -> np.ndarray:
    return np.array([int.from_bytes(message.data, "little") for message in messages])


def intervals_ms(messages: Sequence[can.Message]) -> np.ndarray:
    return np.diff([message.timestamp for message in messages]) * 1e3


def spread(intervals: np.ndarray) -> str:
    median, p99 = np.quantile(intervals, [0.5, 0.99])
    return (
        f"mean {intervals.mean():.3f} ms, median {median:.3f}, p99 {p99:.3f}, max {intervals.max():.3f}, "
        f"rms about the mean {intervals.std() * 1e3:.0f} µs"
    )


@contextmanager
def broadcast(channel: str) -> Iterator[KernelBroadcast]:
    """One operation of the BCM, for what python-can lacks: mixed identifiers, a count that is renewed."""
    operation = KernelBroadcast(channel)
    try:
        yield operation
    finally:
        operation.close()


def packed(frames: Sequence[can.Message]) -> bytes:
    return b"".join(pack(m.arbitration_id, bytes(m.data)) for m in frames)


def test_ring_of_256_plays_in_order_and_wraps(open_bus: OpenBus, measured: Measured) -> None:
    listener = open_bus()
    task = open_bus().send_periodic(ring(), PERIOD_S)
    messages = receive(listener, 4 * RING)
    task.stop()
    np.testing.assert_array_equal(values(messages), np.tile(np.arange(RING), 4))
    intervals = intervals_ms(messages)
    measured("ring at 1 ms", spread(intervals))
    # The BCM waits a period *after* each frame: it may be late, and then stays late, but is never early.
    assert 1.0 <= np.median(intervals) < 1.5
    assert intervals.mean() >= 1.0


def test_more_than_256_frames_are_refused(open_bus: OpenBus) -> None:
    with pytest.raises((OSError, can.CanError, ValueError)):
        open_bus().send_periodic([*ring(), frame(0)], PERIOD_S)


def test_ring_is_rewritten_in_place(open_bus: OpenBus) -> None:
    listener = open_bus()
    task = play(open_bus())
    before = receive(listener, 100)
    task.modify_data(ring(offset=1000))
    after = receive(listener, 2 * RING)
    task.stop()
    played = values([*before, *after])
    assert played[99] < 1000 <= played[-RING], "the new frames were not played"
    renewed = int(np.argmax(played >= 1000))
    assert np.all(played[renewed:] >= 1000), "an old frame was played after a new one"
    np.testing.assert_array_equal(played % 1000, np.arange(played.size) % RING)  # the index goes on
    around = intervals_ms([*before, *after])[renewed - 5 : renewed + 5]
    assert np.median(around) < 1.5  # and so does the clock


def test_rewriting_with_another_length_is_refused(open_bus: OpenBus) -> None:
    task = play(open_bus())
    with pytest.raises(ValueError, match="equal to the number"):
        task.modify_data(ring()[:128])
    task.stop()


def test_ring_with_a_duration_plays_once(open_bus: OpenBus) -> None:
    listener = open_bus()
    open_bus().send_periodic(ring(), PERIOD_S, duration=(RING - 1) * PERIOD_S)
    played = values(until_silent(listener))
    np.testing.assert_array_equal(played, np.arange(played.size))
    assert RING - 1 <= played.size <= RING  # python-can divides floating-point seconds


@contextmanager
def ring_of_another_process(channel: str, listener: can.BusABC) -> Iterator[subprocess.Popen[bytes]]:
    script = f"""
import can, time
message = can.Message(arbitration_id={RPDO}, data=bytes(8), is_extended_id=False)
bus = can.Bus(interface="socketcan", channel="{channel}")
task = bus.send_periodic([message] * {RING}, {PERIOD_S})
time.sleep(60)
"""
    with subprocess.Popen([sys.executable, "-c", script]) as process:
        try:
            assert listener.recv(timeout=30) is not None, "the ring did not start"
            receive(listener, 50)
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_ring_stops_when_its_process_dies(open_bus: OpenBus, vcan_channel: str, how: signal.Signals) -> None:
    listener = open_bus()
    with ring_of_another_process(vcan_channel, listener) as process:
        process.send_signal(how)
        process.wait()
        died = time.time()
        assert [message for message in until_silent(listener) if message.timestamp > died] == []


def test_ring_goes_on_when_its_process_only_hangs(open_bus: OpenBus, vcan_channel: str) -> None:
    """So a ring without a count is no dead man's handle: it replays its frames while the process exists."""
    listener = open_bus()
    with ring_of_another_process(vcan_channel, listener) as process:
        process.send_signal(signal.SIGSTOP)
        stopped = time.time()
        late = [message for message in receive(listener, 2 * RING) if message.timestamp > stopped]
        assert len(late) > RING


def test_a_count_ends_the_ring_unless_it_is_renewed(open_bus: OpenBus, vcan_channel: str) -> None:
    listener = open_bus()
    with broadcast(vcan_channel) as operation:
        operation.write(packed(ring()), PERIOD_US, 200, start=True)
        first = receive(listener, 50)
        operation.write(packed(ring()), PERIOD_US, 300)
        played = values([*first, *until_silent(listener)])
    np.testing.assert_array_equal(played, np.arange(played.size) % RING)  # no gap, index kept
    assert 350 <= played.size <= 500  # 300 from the renewal on, which came after frame 50 and before 200


def test_a_count_counts_from_when_it_is_written(open_bus: OpenBus, vcan_channel: str) -> None:
    """A write that comes late ends the ring so much later: slots behind its end have to stop the drive, too."""
    listener = open_bus()
    with broadcast(vcan_channel) as operation:
        operation.write(packed(ring()), PERIOD_US, 200, start=True)
        first = receive(listener, 40)
        begun = time.time()
        operation.write(packed(ring()), PERIOD_US, 50)
        written = time.time()
        messages = [*first, *until_silent(listener)]
    np.testing.assert_array_equal(values(messages), np.arange(len(messages)))
    stamps = np.array([message.timestamp for message in messages])
    assert np.count_nonzero(stamps > written) <= 50 <= np.count_nonzero(stamps > begun)


def test_a_write_after_the_count_was_used_up_sends_nothing(open_bus: OpenBus, vcan_channel: str) -> None:
    """So a feeder that hung replays nothing, whatever it writes; and a stop starts the ring where it ended."""
    listener = open_bus()
    with broadcast(vcan_channel) as operation:
        operation.write(packed(ring()), PERIOD_US, 20, start=True)
        assert len(until_silent(listener)) == 20
        operation.write(packed(ring(offset=1000)), PERIOD_US, 30)
        operation.write(packed(ring(offset=2000)), PERIOD_US, None)
        assert until_silent(listener) == []
        operation.write(packed(ring(offset=3000)), PERIOD_US, 10, start=True)
        np.testing.assert_array_equal(values(until_silent(listener)), 3020 + np.arange(10))


def test_a_running_ring_is_limited_and_unlimited_without_a_gap(open_bus: OpenBus, vcan_channel: str) -> None:
    listener = open_bus()
    messages: list[can.Message] = []
    with broadcast(vcan_channel) as operation:
        operation.write(packed(ring()), PERIOD_US, None, start=True)
        for turn in range(40):
            messages += receive(listener, 17)
            operation.write(packed(ring()), PERIOD_US, None if turn % 2 else 200)
        messages += receive(listener, 50)
    np.testing.assert_array_equal(values(messages), np.arange(len(messages)) % RING)
    assert intervals_ms(messages).min() > 0.5


def test_start_sends_at_once_and_keeps_the_place(open_bus: OpenBus, vcan_channel: str) -> None:
    """What a stop does where it cannot know whether the ring still runs: one interval is short, no more."""
    listener = open_bus()
    with broadcast(vcan_channel) as operation:
        operation.write(packed(ring()), SLOW_US, None, start=True)
        messages = receive(listener, 20)
        began = time.monotonic()
        operation.write(packed(ring()), SLOW_US, None, start=True)
        messages += receive(listener, 1)
        assert time.monotonic() - began < SLOW_US * 1e-6
        messages += receive(listener, 20)
    np.testing.assert_array_equal(values(messages), np.arange(41))
    assert np.count_nonzero(intervals_ms(messages) < 0.9 * SLOW_US * 1e-3) == 1


def test_setpoints_and_sync_in_one_ring_stay_in_step(
    open_bus: OpenBus, vcan_channel: str, measured: Measured
) -> None:
    listener = open_bus()
    pairs = [frame(i // 2, SYNC if i % 2 else RPDO) for i in range(RING)]
    with broadcast(vcan_channel) as operation:
        operation.write(packed(pairs), PERIOD_US // 2, None, start=True)
        messages = receive(listener, 6 * RING)
    assert [message.arbitration_id for message in messages[0::2]] == [RPDO] * (3 * RING)
    assert [message.arbitration_id for message in messages[1::2]] == [SYNC] * (3 * RING)
    np.testing.assert_array_equal(values(messages[0::2]), values(messages[1::2]))
    measured("SYNC, every other frame of a ring at 0.5 ms", spread(intervals_ms(messages[1::2])))


def test_two_rings_of_one_period_keep_their_own_time(open_bus: OpenBus, measured: Measured) -> None:
    """Two operations share no clock: the distance at which they are started is not kept; their order in each is."""
    listener, player = open_bus(), open_bus()
    setpoints = player.send_periodic(ring(), PERIOD_S)
    time.sleep(20 * PERIOD_S + PERIOD_S / 2)
    sync = player.send_periodic([frame(0, SYNC)], PERIOD_S)
    messages = receive(listener, 3000)
    for task in (setpoints, sync):
        task.stop()
    played = [message for message in messages if message.arbitration_id == RPDO]
    np.testing.assert_array_equal(values(played), np.arange(len(played)) % RING)
    distances, setpoint_s = [], 0.0
    for message in messages:
        if message.arbitration_id == RPDO:
            setpoint_s = message.timestamp
        else:
            distances.append(1e3 * (message.timestamp - setpoint_s))
    begin, end = np.median(distances[:20]), np.median(distances[-20:])
    cycles = len(distances)
    measured("SYNC after its setpoint, two rings", f"{begin:.3f} ms, {cycles} cycles later {end:.3f} ms")


def test_the_period_can_be_trimmed_while_it_plays(open_bus: OpenBus, vcan_channel: str) -> None:
    listener = open_bus()
    with broadcast(vcan_channel) as operation:
        operation.write(packed(ring()), 4 * PERIOD_US, None, start=True)
        slow = receive(listener, 40)
        operation.write(packed(ring()), 2 * PERIOD_US, None)
        receive(listener, 20)
        fast = receive(listener, 40)
    assert np.median(intervals_ms(slow)) == pytest.approx(4, abs=0.5)
    assert np.median(intervals_ms(fast)) == pytest.approx(2, abs=0.5)
    np.testing.assert_array_equal(values(fast), 60 + np.arange(40))


def test_receive_time_is_the_kernels_not_the_readers(open_bus: OpenBus) -> None:
    listener = open_bus()
    begun = time.time()
    task = open_bus().send_periodic([frame(0, SYNC)], PERIOD_S)
    time.sleep(0.2)  # nobody reads meanwhile
    task.stop()
    ended = time.time()
    messages = until_silent(listener, silence_s=0.05)
    stamps = np.array([message.timestamp for message in messages])
    assert stamps.size > 100
    assert begun <= stamps[0] <= stamps[-1] <= ended
    assert 0.9e-3 < np.median(np.diff(stamps)) < 1.5e-3  # read at once, stamped one by one
    assert {message.arbitration_id for message in messages} == {SYNC}


def test_an_unread_socket_drops_frames_without_an_error(
    open_bus: OpenBus, vcan_channel: str, measured: Measured
) -> None:
    """A reader that falls behind loses frames silently: samples must be counted, the buffer enlarged."""
    player, sent = open_bus(), 3000
    with can.Bus(interface="socketcan", channel=vcan_channel) as listener:
        for number in range(sent):
            player.send(frame(number))
        played = values(until_silent(listener, silence_s=0.05))
    measured("frames an unread socket holds", f"{played.size}")
    assert played.size < sent
    np.testing.assert_array_equal(played, np.arange(played.size))  # the newest are the ones that go
