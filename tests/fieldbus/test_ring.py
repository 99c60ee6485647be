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
from schwung.fieldbus.canopen.ring import CYCLES, OFF, SPARE, Ring, Write

STOP = StopFrame(slice(0, 2), slice(6, 8))
GUARD, LEAD, HOLD = 8, 60, 400
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
    """From `at` on, for so many half cycles: the feeder hangs, echoes are not read, or both; or both from within a
    write, while it is packed or while the kernel is given it."""

    who: str  # "feeder", "reader", "both", "packing", "write"
    at: int
    length: int

    def covers(self, tick: int, *who: str) -> bool:
        return self.who in who and self.at <= tick < self.at + self.length


@dataclass(frozen=True)
class Death:
    """The program goes no further than a write, counted from 0: that arrives so many half cycles late, or not."""

    at: int
    late: int = 0
    arrives: bool = True


class World:
    """Kernel, ring, and a feeder and a reader that hang when they are told to."""

    def __init__(self, stalls: list[Stall], death: Death | None = None) -> None:
        self.ring = Ring(STOP, rpdo(HELD, 0), GUARD, LEAD, HOLD)
        self.kernel = Kernel(self.ring.again())
        self.stalls, self.echoes, self.tick = stalls, deque[tuple[int, bytes]](), 0
        self.death, self.dead, self.writes = death, False, 0
        self.last_echo = 0
        self.held_up_at: int | None = None  # RPDO count
        self.run(11)

    def position(self) -> int:
        return self.ring.played + (self.tick - self.last_echo) // 2

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.kernel_goes_on()
            self.read()
            if self.tick % FEED_EVERY == 0 and not self.dead and not self.stalled("feeder", "both"):
                self.feed()

    def kernel_goes_on(self) -> None:
        self.tick += 1
        frame = self.kernel.tick()
        if frame is not None:
            self.echoes.append((self.tick, frame))

    def read(self) -> None:
        while self.echoes and not self.dead and not self.stalled("reader", "both"):
            self.last_echo, data = self.echoes.popleft()
            assert self.ring.sent(data), "an echo of ours was taken for a stranger's"
            if self.ring.met_guard:
                self.write(self.ring.give_up(self.position()))

    def feed(self) -> None:
        self.write(self.ring.refill(self.position()))

    def write(self, write: Write | None) -> None:
        """As kernel.py: the write may take long to be packed and to arrive, and is looked after in between and then."""
        if write is not None:
            while self.stalled("packing"):
                self.kernel_goes_on()
            self.hand_over(self.ring.overdue(self.position()) or write)
            if self.dead:
                return
            undone = self.ring.overdue(self.position())
            if undone is not None:
                self.kernel.take(undone)
        if self.ring.held_up:
            self.ring.held_up = False
            self.held_up_at = len(self.kernel.sent)

    def hand_over(self, write: Write) -> None:
        death = self.death
        self.dead = death is not None and self.writes == death.at
        for _ in range(death.late if self.dead and death else 0):
            self.kernel_goes_on()
        while self.stalled("write"):
            self.kernel_goes_on()
        if not self.dead or (death and death.arrives):
            self.kernel.take(write)
        self.writes += 1

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
    assert world.kernel.running
    world.run(10 * HOLD)
    assert world.kernel.running, "what comes after is held on"
    assert world.kernel.count is not None, "but not without end"
    assert world.held_up_at is None


LONG = 150
#: Of a motion of so many setpoints: the writes until it is held again, and on.
WRITES = 30


@pytest.mark.parametrize("at", range(WRITES))
@pytest.mark.parametrize("arrives", [True, False])
def test_a_program_that_hangs_for_ever_at_a_write_leaves_quick_stop_and_silence(
    at: int, arrives: bool
) -> None:
    """Whichever write it is, right before or right behind it, and however late that arrives within the spare slots."""
    for late in (0, 1, 2, 7, 16, 33, 2 * (SPARE - OFF) - 1):
        world = World([], Death(at, late, arrives))
        play(world, LONG)
        world.run(2 * (LONG + LEAD + 3 * HOLD))
        assert world.dead
        check(world.kernel.sent, LONG if at or arrives else 0)
        assert not world.kernel.running
        words = [parts(frame)[0] for frame in world.kernel.sent]
        stops = [word for word in words if word != cia402.ENABLE_OPERATION]
        if not stops:  # it stands, and is held: for so long, and then it hears nothing any more
            assert parts(world.kernel.sent[-1])[2] == 0
            assert len({parts(frame)[1] for frame in world.kernel.sent[-HOLD // 2 :]}) == 1
            assert at == 0 or parts(world.kernel.sent[-1])[1] == HELD + LONG
            continue
        assert set(stops) == {cia402.QUICK_STOP}
        assert GUARD <= len(stops) <= GUARD + SPARE


@pytest.mark.parametrize("late", range(2 * (SPARE - OFF), 2 * CYCLES, 9))
def test_whatever_a_write_that_arrives_too_late_repeats_finds_the_drive_off_and_then_silence(
    late: int,
) -> None:
    """The kernel is given it for so long, and the program hangs again before it can look after it."""
    for at in range(1, WRITES):
        world = World([], Death(at, late))
        play(world, LONG)
        world.run(2 * (LONG + LEAD + 3 * HOLD) + late)
        assert not world.kernel.running
        sent = world.kernel.sent
        played = [parts(frame)[1] for frame in sent if energises(frame) and parts(frame)[2]]
        again = next((target for i, target in enumerate(played) if target in played[:i]), None)
        if again is not None:
            second = [i for i, frame in enumerate(sent) if frame == rpdo(again)][1]
            assert cia402.DISABLE_VOLTAGE in [parts(frame)[0] for frame in sent[:second]]


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
@given(
    length=st.integers(1, 600),
    who=st.sampled_from(["packing", "write"]),
    at=st.integers(12, 1400),
    late=st.integers(1, 2 * CYCLES),
)
@example(length=500, who="write", at=400, late=2 * SPARE)
def test_a_write_that_comes_late_is_seen_and_stopped_at_once(
    length: int, who: str, at: int, late: int
) -> None:
    """It hangs between deciding and the kernel's taking it. Where it met the guard meanwhile it is not handed over, or,
    where that came within the kernel's call, undoes a stop: the frame behind it is the stop again."""
    world = World([Stall(who, at, late)])
    play(world, length)
    world.run(2 * (length + LEAD + 40) + 500)
    sent = world.kernel.sent
    stops = [i for i, frame in enumerate(sent) if not energises(frame)]
    undone = [i for i in range(stops[0], len(sent)) if energises(sent[i])] if stops else []
    assert undone == []
    check(sent, length)
    assert world.kernel.running, "the stop is not held"


@pytest.mark.parametrize("late", range(2 * (CYCLES - SPARE - GUARD), 2 * CYCLES, 5))
def test_what_was_packed_while_the_guard_was_met_is_not_handed_over(late: int) -> None:
    """It would undo a stop, for good where the program hangs again before it has looked after it."""

    class HangsAgain(World):
        def hand_over(self, write: Write) -> None:
            super().hand_over(write)
            self.dead = self.tick >= 300 + late

    world = HangsAgain([Stall("packing", 300, late)])
    play(world, 600)
    world.run(2 * (600 + 3 * HOLD))
    words = [parts(frame)[0] for frame in world.kernel.sent]
    assert set(words[words.index(cia402.QUICK_STOP) :]) == {cia402.QUICK_STOP}


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
    ring = Ring(STOP, rpdo(HELD, 0), GUARD, LEAD, HOLD)
    assert ring.sent(rpdo(HELD, 0))
    ring.play(motion(600), rpdo(HELD))
    for _ in range(8):
        assert ring.refill(ring.played) is None
        assert ring.sent(rpdo(HELD, 0))
    assert ring.refill(ring.played) is not None
    assert ring.sent(rpdo(HELD, 0))
    assert ring.refill(ring.played) is None
    assert ring.overdue(ring.played + SPARE + 1) is None
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
    ring = Ring(STOP, rpdo(HELD, 0), GUARD, 4, HOLD)
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
    ring = Ring(STOP, rpdo(HELD, 0), GUARD, LEAD, HOLD)
    assert ring.sent(rpdo(HELD, 0))
    stop = ring.latch(cia402.QUICK_STOP, 0)
    assert set(stop.slots) == {rpdo(HELD, 0, cia402.QUICK_STOP)}
    off = ring.latch(cia402.DISABLE_VOLTAGE, 0)
    assert set(off.slots) == {rpdo(HELD, 0, cia402.DISABLE_VOLTAGE)}
    assert not ring.admits(rpdo(HELD, 0, cia402.ENABLE_OPERATION | cia402.NEW_SET_POINT))
    ring.latched = False
    assert ring.admits(rpdo(HELD))
