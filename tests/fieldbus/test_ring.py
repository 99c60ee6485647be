"""The ring of frames in the kernel as a pure model, played by a model of the kernel: whatever comes late."""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.output import StopFrame
from schwung.fieldbus.canopen.ring import CYCLES, SPARE, Ring, Write

STOP = StopFrame(slice(0, 2), slice(6, 8))
GUARD, LEAD = 20, 60
FEED_EVERY = 8  # half cycles, as kernel.py has it: half of what is refilled at once
HELD = 100  # target


def rpdo(target: int, torque: int = 7, word: int = cia402.ENABLE_OPERATION) -> bytes:
    """Controlword, target, injected torque, as the bench's own drive has them."""
    return struct.pack("<Hih", word, target, torque)


def motion(length: int) -> list[bytes]:
    """Setpoints that can be told apart, one count from each other."""
    return [rpdo(HELD + 1 + index) for index in range(length)]


def parts(frame: bytes) -> tuple[int, int, int]:
    """Controlword, target, torque."""
    word, target, torque = struct.unpack("<Hih", frame)
    return word, target, torque


def energises(frame: bytes) -> bool:
    return parts(frame)[0] & 0x0F == cia402.ENABLE_OPERATION


class Kernel:
    """What net/can/bcm.c does with a ring of RPDO and SYNC in turn, one frame per half cycle."""

    def __init__(self, write: Write) -> None:
        self.index, self.sent = 0, list[bytes]()
        self.running = True
        self._take(write)

    def take(self, write: Write) -> None:
        self._take(write)
        if write.start:
            self.running = True
            self.tick()

    def _take(self, write: Write) -> None:
        assert len(write.slots) == CYCLES
        self.slots, self.count = write.slots, write.frames

    def tick(self) -> bytes | None:
        """Half a cycle later; the RPDO that is sent, if it is one's turn."""
        if not self.running:
            return None
        frame = None if self.index % 2 else self.slots[self.index // 2 % CYCLES]
        if frame is not None:
            self.sent.append(frame)
        self.index += 1
        if self.count is not None:
            self.count -= 1
            self.running = self.count > 0
        return frame


@dataclass(frozen=True)
class Stall:
    """From `at` on, for so many half cycles: the feeder hangs, echoes are not read, or both from within a write."""

    who: str  # "feeder", "reader", "both", "write"
    at: int
    length: int

    def covers(self, tick: int, *who: str) -> bool:
        return self.who in who and self.at <= tick < self.at + self.length


class World:
    """Kernel, ring, and a feeder and a reader that hang when they are told to."""

    def __init__(self, stalls: list[Stall], guard: int = GUARD, lead: int = LEAD) -> None:
        self.ring = Ring(STOP, rpdo(HELD, 0), guard, lead)
        self.kernel = Kernel(self.ring.again())
        self.stalls, self.echoes, self.tick = stalls, deque[tuple[int, bytes]](), 0
        self.last_echo = 0
        self.held_up_at: int | None = None  # RPDO count
        self.run(11)

    def position(self) -> int:
        return self.ring.played + (self.tick - self.last_echo) // 2

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.kernel_goes_on()
            self.read()
            if self.tick % FEED_EVERY == 0 and not self.stalled("feeder", "both"):
                self.feed()

    def kernel_goes_on(self) -> None:
        self.tick += 1
        frame = self.kernel.tick()
        if frame is not None:
            self.echoes.append((self.tick, frame))

    def read(self) -> None:
        while self.echoes and not self.stalled("reader", "both"):
            self.last_echo, data = self.echoes.popleft()
            assert self.ring.sent(data), "an echo of ours was taken for a stranger's"
            if self.ring.met_guard:
                self.write(self.ring.give_up(self.position()))

    def feed(self) -> None:
        self.write(self.ring.refill(self.position()))

    def write(self, write: Write | None) -> None:
        """As kernel.py: the write may take long to arrive, and is looked after when it has."""
        if write is not None:
            while self.stalled("write"):
                self.kernel_goes_on()
            self.kernel.take(write)
            undone = self.ring.landed(self.position())
            if undone is not None:
                self.kernel.take(undone)
        if self.ring.held_up:
            self.ring.held_up = False
            self.held_up_at = len(self.kernel.sent)

    def stalled(self, *who: str) -> bool:
        return any(stall.covers(self.tick, *who) for stall in self.stalls)


def check(sent: list[bytes], length: int) -> None:
    """What a drive may see: setpoints in order, none twice, no step, and nothing that energises behind a stop."""
    targets = [parts(frame)[1] for frame in sent]
    steps = [after - before for before, after in pairwise(targets)]
    assert all(0 <= step <= 1 for step in steps), "a target went back, or skipped some"
    stopped = next((i for i, frame in enumerate(sent) if not energises(frame)), len(sent))
    assert not any(energises(frame) for frame in sent[stopped:]), "a stop was undone"
    assert len(set(targets[stopped:])) <= 1, "a target moved behind a stop"
    assert all(parts(frame)[2] == 0 for frame in sent[stopped:]), "torque was injected behind a stop"
    played = [
        target for target, frame in zip(targets, sent, strict=True) if energises(frame) and parts(frame)[2]
    ]
    assert played == sorted(set(played)), "a setpoint was played twice"
    if stopped == len(sent):
        assert played == list(range(HELD + 1, HELD + 1 + length)), "setpoints are missing"


def play(world: World, length: int) -> None:
    world.write(world.ring.play(motion(length), rpdo(HELD + length, 0)))


@pytest.mark.parametrize("length", [1, 2, 7, 8, 9, 63, 64, 91, 92, 93, 127, 128, 129, 256, 1000])
def test_every_setpoint_is_played_once_however_often_the_ring_wraps(length: int) -> None:
    world = World([])
    play(world, length)
    world.run(2 * (length + LEAD + 40))
    check(world.kernel.sent, length)
    assert all(map(energises, world.kernel.sent))
    assert world.ring.over
    assert world.kernel.count is None, "what comes after is held without end"


@pytest.mark.parametrize("who", ["feeder", "reader", "both"])
@pytest.mark.parametrize("at", range(12, 700, 23))
def test_a_feeder_that_hangs_ends_in_quick_stop_and_silence(who: str, at: int) -> None:
    """For ever, before and behind the ring's wraps. Where only one of the two hangs the other one sees it."""
    length = 250
    world = World([Stall(who, at, 10**9)])
    play(world, length)
    world.run(2 * (length + LEAD + 300))
    check(world.kernel.sent, length)
    stops = [parts(frame)[0] for frame in world.kernel.sent if not energises(frame)]
    if world.kernel.running:  # the motion had ended, or the one that still runs has seen it, and holds a stop
        assert world.held_up_at is not None or world.ring.over
    else:
        assert who == "both"
        assert GUARD <= len(stops) <= GUARD + 1
    assert set(stops) <= {cia402.QUICK_STOP}


@settings(max_examples=200, deadline=None)
@given(
    length=st.integers(1, 600),
    stalls=st.lists(
        st.builds(
            Stall, st.sampled_from(["feeder", "reader", "both"]), st.integers(12, 1400), st.integers(1, 400)
        ),
        max_size=6,
    ),
    latch_at=st.none() | st.integers(12, 1500),
)
@example(length=600, stalls=[Stall("both", 300, 500)], latch_at=None)
def test_nothing_goes_back_repeats_steps_or_moves_behind_a_stop(
    length: int, stalls: list[Stall], latch_at: int | None
) -> None:
    world = World(stalls)
    play(world, length)
    end = 2 * (length + LEAD + 40) + 500
    if latch_at is not None and latch_at < end:
        world.run(latch_at - world.tick)
        before = len(world.kernel.sent)
        going_out = world.kernel.sent[-1]
        world.write(world.ring.latch(cia402.QUICK_STOP, world.position()))
        world.run(4)
        assert not any(energises(frame) for frame in world.kernel.sent[before:])
        assert len(world.kernel.sent) > before, "the stop is not sent"
        assert parts(world.kernel.sent[-1])[1] == parts(going_out)[1]
        assert not world.ring.admits(rpdo(0))
        assert world.ring.admits(rpdo(0, 0, cia402.SHUTDOWN))
    world.run(end - world.tick)
    check(world.kernel.sent, length)


@settings(max_examples=200, deadline=None)
@given(length=st.integers(1, 600), at=st.integers(12, 1400), late=st.integers(1, 2 * CYCLES))
@example(length=500, at=400, late=2 * SPARE)
def test_a_write_that_comes_late_is_seen_and_stopped_at_once(length: int, at: int, late: int) -> None:
    """It hangs between deciding and the kernel's taking it. Where it met the guard meanwhile it undoes a stop, which
    nothing can prevent: the frame behind it is the stop again."""
    world = World([Stall("write", at, late)])
    play(world, length)
    world.run(2 * (length + LEAD + 40) + 500)
    sent = world.kernel.sent
    stops = [i for i, frame in enumerate(sent) if not energises(frame)]
    undone = [i for i in range(stops[0], len(sent)) if energises(sent[i])] if stops else []
    assert undone == []
    check(sent, length)
    assert world.kernel.running, "the stop is not held"


def test_a_program_that_hangs_behind_a_late_write_finds_the_drive_off_before_a_frame_is_repeated() -> None:
    """Hangs within a write, and for ever right after it: the kernel's end lies too far by as much."""
    for late in range(2, 2 * CYCLES, 3):
        world = World([Stall("write", 300, late), Stall("both", 301 + late, 10**9)])
        play(world, 600)
        world.run(1500)
        assert not world.kernel.running or world.held_up_at is not None
        words = [parts(frame)[0] for frame in world.kernel.sent]
        stop = next(i for i, word in enumerate(words) if word != cia402.ENABLE_OPERATION)
        again = [i for i in range(stop, len(words)) if words[i] == cia402.ENABLE_OPERATION]
        if again:
            assert late > 2 * SPARE
            assert cia402.DISABLE_VOLTAGE in words[stop : again[0]]


@pytest.mark.parametrize("lag", range(4, 160, 4))
def test_old_echoes_do_not_put_the_end_too_far(lag: int) -> None:
    """All of it hangs; when it is back the feeder is first, with echoes that are old; and then it hangs for ever."""
    for at in range(240, 272, 3):
        feeder_back = at + max(lag - FEED_EVERY, 0)
        stalls = [
            Stall("reader", at, 10**9),
            Stall("feeder", at, feeder_back - at),
            Stall("feeder", at + lag, 10**9),
        ]
        world = World(stalls)
        play(world, 600)
        world.run(1500)
        sent = world.kernel.sent
        assert cia402.DISABLE_VOLTAGE not in [parts(frame)[0] for frame in sent], "the end was too far"
        check(sent, 600)


def test_behind_a_write_that_came_late_the_next_refill_comes_at_once() -> None:
    ring = Ring(STOP, rpdo(HELD, 0), GUARD, LEAD)
    assert ring.sent(rpdo(HELD, 0))
    ring.play(motion(600), rpdo(HELD))
    for _ in range(8):
        assert ring.refill(ring.played) is None
        assert ring.sent(rpdo(HELD, 0))
    assert ring.refill(ring.played) is not None
    assert ring.sent(rpdo(HELD, 0))
    assert ring.refill(ring.played) is None
    assert ring.landed(ring.played + SPARE + 1) is None
    assert ring.refill(ring.played) is not None


def test_a_stop_that_finds_the_ring_ended_starts_it_again() -> None:
    world = World([Stall("feeder", 100, 10**9), Stall("reader", 100, 10**9)])
    play(world, 400)
    world.run(600)
    assert not world.kernel.running
    before = len(world.kernel.sent)
    world.stalls.clear()
    world.run(1)
    assert world.held_up_at is not None
    world.run(40)
    assert len(world.kernel.sent) >= before + 15
    check(world.kernel.sent, 400)


def test_echoes_that_were_lost_are_skipped_and_a_strangers_frame_is_told() -> None:
    ring = Ring(STOP, rpdo(HELD, 0), GUARD, 4)
    for _ in range(3):
        assert ring.sent(rpdo(HELD, 0))
    ring.play(motion(50), rpdo(HELD + 50, 0))
    for _ in range(4):
        assert ring.sent(rpdo(HELD, 0))
    assert ring.setpoint == -1
    assert not ring.sent(rpdo(HELD - 30)), "nobody of ours"
    ring.refill(ring.played)  # too soon for a refill: the guard would be met
    assert ring.latched


def test_a_latched_stop_survives_what_is_held_meanwhile_until_it_is_released() -> None:
    ring = Ring(STOP, rpdo(HELD, 0), GUARD, LEAD)
    assert ring.sent(rpdo(HELD, 0))
    stop = ring.latch(cia402.QUICK_STOP, 0)
    assert set(stop.slots) == {rpdo(HELD, 0, cia402.QUICK_STOP)}
    off = ring.latch(cia402.DISABLE_VOLTAGE, 0)
    assert set(off.slots) == {rpdo(HELD, 0, cia402.DISABLE_VOLTAGE)}
    assert not ring.admits(rpdo(HELD, 0, cia402.ENABLE_OPERATION | cia402.NEW_SET_POINT))
    ring.latched = False
    assert ring.admits(rpdo(HELD))
