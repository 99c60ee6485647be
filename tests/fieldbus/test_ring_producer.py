"""The kernel's producer in simulated time: what a drive sees of it, whatever hangs, and however often it wraps."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import can
import numpy as np
import pytest
from stepped_broadcast import Seen, StallingClock, SteppedBroadcast

from schwung.clock import SteppedBus, Wire
from schwung.errors import BusError, InputError, NodeLostError, StateError
from schwung.fieldbus import cia402, eds
from schwung.fieldbus.canopen import pdo
from schwung.fieldbus.canopen.exchange import Exchange
from schwung.fieldbus.canopen.kernel import HOLD_S, KernelProducer
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.output import StopFrame
from schwung.fieldbus.canopen.recorder import Recorder, arrange
from schwung.fieldbus.canopen.ring import CYCLES
from schwung.fieldbus.profile import load_profile

NODE = 5
PERIOD_S = 0.001
LATENCY_S = 23e-6
ENDS: list[SteppedBus] = []  # of wires, to be left behind each test


def rpdo(target: int, torque: int = 9, word: int = cia402.ENABLE_OPERATION) -> bytes:
    """As the bench's own drive has it: controlword, target, injected torque."""
    return struct.pack("<Hih", word, target, torque)


def target(frame: bytes) -> int:
    return int(struct.unpack("<Hih", frame)[1])


def word(frame: bytes) -> int:
    return int(struct.unpack("<Hih", frame)[0])


class Setting:
    """A producer that holds target 0, a drive that listens, and time that can hang."""

    def __init__(self, period_s: float = PERIOD_S, *, counter: bool = False) -> None:
        profile = load_profile("schwung-bench")
        lookup = eds.read_eds(profile.eds_path, NODE).find
        layouts = pdo.layouts(profile, lookup, NODE)
        self.clock = StallingClock()
        self.wire = Wire(self.clock)
        self.broadcast = SteppedBroadcast(self.clock, self._end(), LATENCY_S)
        answers = {t.can_id: struct.pack("<H", 0x0027).ljust(t.size, b"\0") for t in layouts.tpdos}
        self.drive = Seen(self.clock, self._end(), layouts.rpdo.can_id, answers)
        self.exchange = Exchange(Link(self._end()), layouts, NODE, counter)
        stop = StopFrame.of(profile, layouts.rpdo)
        self.producer = KernelProducer(self.exchange, period_s, stop, self.broadcast.opener)
        self.recorder = Recorder(len(layouts.tpdos))
        self.stranger = self._end()

    def _end(self) -> SteppedBus:
        ENDS.append(self.wire.bus())
        return ENDS[-1]

    def start(self) -> Setting:
        self.producer.start(rpdo(0, 0, cia402.DISABLE_VOLTAGE))
        self.producer.hold(rpdo(0, 0))
        assert self.producer.pump(0.02)
        return self

    def play(self, length: int) -> None:
        """One count per setpoint; afterwards the last one is held without torque."""
        self.exchange.recorder, self.exchange.guarded = self.recorder, True
        frames = [rpdo(1 + index) for index in range(length)]
        self.producer.play(frames, rpdo(length, 0), self.recorder, None)
        self.exchange.guarded = False

    def check(self) -> list[bytes]:
        """No step, nothing twice, nothing that energises behind a stop; returns all frames from the first that did."""
        rpdos = self.drive.rpdos
        began = next(i for i, frame in enumerate(rpdos) if word(frame) == cia402.ENABLE_OPERATION)
        frames = rpdos[began:]
        assert {b - a for a, b in pairwise(map(target, frames))} <= {0, 1}
        played = [target(f) for f in frames if word(f) == cia402.ENABLE_OPERATION and f[6:] != bytes(2)]
        assert played == list(range(1, len(played) + 1))
        words = [word(f) for f in frames]
        stop = next((i for i, w in enumerate(words) if w != cia402.ENABLE_OPERATION), len(words))
        assert cia402.ENABLE_OPERATION not in words[stop:], "a stop was undone"
        assert all(f == frames[stop] for f in frames[stop:] if word(f) == cia402.QUICK_STOP)
        assert all(f[6:] == bytes(2) for f in frames[stop:]), "torque was injected behind a stop"
        return frames


@pytest.fixture(autouse=True)
def _left() -> Iterator[None]:
    yield
    while ENDS:
        ENDS.pop().shutdown()


@pytest.fixture
def setting() -> Setting:
    return Setting().start()


@pytest.mark.parametrize("length", [1, 50, 127, 128, 129, 600])
@pytest.mark.parametrize("counter", [False, True])
def test_each_sync_finds_its_setpoint_and_the_recorder_knows_which(length: int, counter: bool) -> None:
    setting = Setting(counter=counter).start()
    setting.play(length)
    setting.producer.pump(0.3)
    setting.check()
    held = [target(frame) for frame in setting.drive.at_sync if frame[6:] != bytes(2)]
    assert held == list(range(1, length + 1))
    samples = arrange(setting.recorder, length)
    np.testing.assert_array_equal(samples.setpoint, np.arange(length))
    assert samples.lost.size == 0
    assert samples.late == 0
    assert setting.exchange.trouble is None
    assert setting.drive.at_sync[-1] == rpdo(length, 0), "what comes after is held"
    if counter:
        counters = [data[0] for data in setting.drive.counters]
        assert set(np.diff(counters)) == {1, 1 - CYCLES}, "the counter has a gap where the ring wraps"
        assert (min(counters), max(counters)) == (1, CYCLES)
    else:
        assert set(setting.drive.counters) == {b""}


@pytest.mark.parametrize("period_s", [0.001, 0.002, 0.005])
def test_sync_comes_at_the_rate_that_was_asked_for(period_s: float) -> None:
    """The kernel is late by its latency with every frame, RPDO and SYNC; both are taken off."""
    setting = Setting(period_s).start()
    setting.play(200)
    assert np.mean(np.diff(setting.drive.sync_s[-150:])) == pytest.approx(period_s, abs=1e-6)


@pytest.mark.parametrize("at_s", np.linspace(0.003, 0.58, 17))
@pytest.mark.parametrize("who", [["feeder"], ["reader"], ["caller", "feeder", "reader"]])
def test_whoever_hangs_for_a_second_the_drive_stops_and_stays_stopped(
    setting: Setting, who: list[str], at_s: float
) -> None:
    began_s = setting.clock.now()
    for each in who:  # and not all of them come back at once
        setting.clock.later(at_s, partial(setting.clock.stall, 0.98 if each == "caller" else 1.0, each))
    setting.play(600)
    over_s = setting.clock.now() - began_s
    setting.producer.pump(1.2)
    frames = setting.check()
    assert isinstance(setting.exchange.trouble, StateError)
    late = re.search(r"was held up for (\d\.\d\d) s", setting.exchange.trouble.problem)
    assert late
    assert 0.06 < float(late[1]) <= 1.02, "as long as the ring reaches, at least"
    assert at_s + 0.04 < over_s < at_s + 1.2
    assert frames[-1] == rpdo(target(frames[-1]), 0, cia402.QUICK_STOP)
    assert setting.broadcast.running, "once it is back, it holds the stop"


@pytest.mark.parametrize("at_s", [0.005, 0.1, 0.3, 0.7, 1.5])
def test_a_program_may_be_as_late_when_a_motion_begins_as_within_it(at_s: float) -> None:
    setting = Setting(0.004).start()
    setting.clock.later(at_s, partial(setting.clock.stall, 0.25))
    setting.play(600)
    assert setting.exchange.trouble is None
    setting.check()


def test_a_program_that_never_comes_back_leaves_quick_stop_and_silence(setting: Setting) -> None:
    setting.clock.later(0.3, lambda: setting.clock.stall(1e6, "reader", "feeder"))
    setting.clock.later(3.0, lambda: setting.exchange.report(BusError("test", "ends")))
    setting.play(600)
    setting.clock.sleep(2.0)
    frames = setting.check()
    assert not setting.broadcast.running
    stops = [frame for frame in frames if word(frame) == cia402.QUICK_STOP]
    assert len(stops) in (8, 9)  # milliseconds
    assert setting.drive.sync_s[-1] - setting.clock.date() < -2.0


@pytest.mark.parametrize("at_s", [0.0502, 0.1507, 0.2003, 0.3, 0.45])
@pytest.mark.parametrize("controlword", [cia402.QUICK_STOP, cia402.DISABLE_VOLTAGE, cia402.SHUTDOWN])
def test_a_latched_stop_is_the_last_frame_that_went_out(
    setting: Setting, at_s: float, controlword: int
) -> None:
    seen = []

    def latch() -> None:
        seen.append(len(setting.drive.rpdos))
        setting.producer.latch(controlword)

    setting.clock.later(at_s, latch)
    setting.play(600)
    setting.producer.pump(0.3)
    setting.check()
    last = setting.drive.rpdos[seen[0] - 1]
    stop = rpdo(target(last), 0, controlword)
    assert set(setting.drive.rpdos[seen[0] :]) == {stop}
    with pytest.raises(StateError, match="was stopped on request"):
        setting.play(10)
    with pytest.raises(StateError, match="was stopped on request"):
        setting.producer.hold(rpdo(0, 0))
    setting.producer.pump(0.05)
    assert set(setting.drive.rpdos[seen[0] :]) == {stop}
    setting.producer.hold(rpdo(3, 0, cia402.SHUTDOWN))
    setting.producer.pump(0.05)
    assert setting.drive.rpdos[-1] == rpdo(3, 0, cia402.SHUTDOWN)
    setting.producer.release()
    setting.producer.hold(rpdo(4, 0))
    setting.producer.pump(0.05)
    assert setting.drive.rpdos[-1] == rpdo(4, 0)


def test_a_latched_stop_has_the_target_that_went_out_though_echoes_are_late(setting: Setting) -> None:
    """The reader hangs, so that the last echo is old: a stop with its target would be a step back."""
    setting.clock.later(0.300, lambda: setting.clock.stall(0.05, "reader"))
    setting.clock.later(0.3302, lambda: setting.producer.latch(cia402.QUICK_STOP))
    setting.play(600)
    setting.producer.pump(0.2)
    setting.check()


def test_a_write_that_hangs_while_the_guard_is_met_undoes_no_stop(setting: Setting) -> None:
    """Between deciding and writing, a program is not late yet: what it wrote is looked after when it is back."""
    for delay_s in np.linspace(0.01, 0.3, 30):
        setting = Setting().start()
        broadcast = setting.broadcast

        def hang(broadcast: SteppedBroadcast = broadcast, delay_s: float = delay_s) -> None:
            broadcast.delay_s = delay_s

        setting.clock.later(0.25, hang)
        setting.play(400)
        setting.producer.pump(0.1)
        setting.check()


def test_a_stop_amid_starting_stays() -> None:
    setting = Setting()
    setting.clock.later(0.1, lambda: setting.producer.latch(cia402.QUICK_STOP))
    setting.producer.start(rpdo(0, 0, cia402.DISABLE_VOLTAGE))
    setting.producer.pump(0.1)
    assert setting.drive.rpdos[-1] == rpdo(0, 0, cia402.QUICK_STOP)


def test_a_motion_that_is_given_up_by_holding_stays_given_up(setting: Setting) -> None:
    setting.clock.later(0.3, lambda: setting.producer.hold(rpdo(0, 0, cia402.SHUTDOWN)))
    setting.play(600)
    setting.producer.pump(0.3)
    assert set(setting.drive.rpdos[-250:]) == {rpdo(0, 0, cia402.SHUTDOWN)}


def test_another_masters_setpoints_are_trouble(setting: Setting) -> None:
    def speak() -> None:
        frame = can.Message(arbitration_id=0x205, data=rpdo(99), is_extended_id=False)
        setting.stranger.send(frame)

    setting.clock.later(0.3, speak)
    setting.play(600)
    assert isinstance(setting.exchange.trouble, StateError)
    assert "another master" in setting.exchange.trouble.problem


def test_another_masters_setpoints_are_trouble_at_standstill_too(setting: Setting) -> None:
    setting.producer.pump(0.1)
    assert setting.exchange.trouble is None, "nor are echoes of our own"
    setting.stranger.send(can.Message(arbitration_id=0x205, data=rpdo(99), is_extended_id=False))
    setting.producer.pump(0.1)
    assert "another master" in str(setting.exchange.trouble)


@pytest.mark.parametrize("after_s", [0.0001, 0.0004, 0.0006, 0.0009])
def test_another_masters_sync_is_trouble_wherever_it_falls(setting: Setting, after_s: float) -> None:
    """Our own comes back, too: another's was counted as one of ours, and answers were given to the wrong setpoints."""
    last_s = setting.drive.sync_s[-1] - setting.clock.date() + setting.clock.now()
    cycles = np.ceil((setting.clock.now() + 0.3 - last_s) / PERIOD_S)
    sync = can.Message(arbitration_id=0x080, data=b"", is_extended_id=False)
    setting.clock.later(
        last_s + cycles * PERIOD_S + after_s - setting.clock.now(), lambda: setting.stranger.send(sync)
    )
    setting.play(600)
    assert "another master sends SYNC" in str(setting.exchange.trouble)
    setting.producer.pump(0.1)
    assert word(setting.drive.rpdos[-1]) == cia402.QUICK_STOP


def test_echoes_that_are_lost_are_no_other_masters_sync(setting: Setting) -> None:
    """The system drops what a program that is held up does not read: RPDOs and SYNCs as it comes."""
    link = setting.exchange.link
    lost = np.random.default_rng(0).random(2000) < 0.3
    seen = iter(lost)
    receive = link._receive

    def sometimes(message: can.Message) -> None:
        if message.arbitration_id not in (0x080, setting.exchange.layouts.rpdo.can_id) or not next(
            seen, False
        ):
            receive(message)

    setting.exchange.link._reader.close()
    setting.exchange.link._reader = setting.clock.read(link.bus, sometimes, print)
    setting.producer.pump(0.5)
    assert setting.exchange.trouble is None


def test_a_drive_that_falls_silent_is_lost(setting: Setting) -> None:
    def be_deaf() -> None:
        setting.drive.deaf = True

    setting.clock.later(0.2, be_deaf)
    setting.play(2000)
    assert isinstance(setting.exchange.trouble, NodeLostError)
    assert not setting.producer.pump(0.1)


def test_one_tpdo_of_two_is_no_answer_nor_is_another_nodes(setting: Setting) -> None:
    silent, *others = setting.drive.answers
    del setting.drive.answers[silent]
    setting.drive.answers[silent + 1] = bytes(8)  # node 6
    assert others
    assert not setting.producer.pump(0.1)


def test_what_is_held_and_enables_ends_in_silence_where_nobody_holds_on(setting: Setting) -> None:
    setting.producer.pump(3 * HOLD_S)
    assert setting.broadcast.running
    setting.clock.stall(1e6, "reader", "feeder")
    setting.clock.sleep(1.1 * HOLD_S)
    assert not setting.broadcast.running
    assert set(setting.drive.rpdos[-100:]) == {rpdo(0, 0)}


def test_a_bus_that_fails_is_told_and_a_kernel_that_does_not_play_is_no_producer() -> None:
    setting = Setting().start()
    setting.broadcast.broken = True
    setting.producer.hold(rpdo(0, 0))
    assert isinstance(setting.exchange.trouble, BusError)
    broken = Setting()
    broken.broadcast.broken = True
    with pytest.raises(BusError, match="refuses"):
        broken.start()
    mute = Setting()
    mute.broadcast.bus.shutdown()
    with pytest.raises(BusError, match="do not come back"):
        mute.start()


def test_after_stop_nothing_is_sent_and_a_new_start_begins_anew(setting: Setting) -> None:
    setting.play(100)
    setting.producer.stop()
    sent = len(setting.drive.rpdos)
    setting.clock.sleep(0.5)
    assert len(setting.drive.rpdos) == sent
    assert not setting.exchange.expecting_echo
    setting.start()
    assert len(setting.drive.rpdos) > sent


def test_a_period_of_odd_microseconds_is_refused() -> None:
    with pytest.raises(InputError, match="whole number of µs"):
        Setting(1 / 3000)
