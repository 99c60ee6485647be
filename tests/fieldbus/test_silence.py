"""A drive that does not hear us for a while: nothing goes out behind it that would be a step when it does again."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from itertools import pairwise

import can
import numpy as np
import pytest
from stepped_broadcast import Seen, StallingClock, SteppedBroadcast

from schwung.clock import SteppedBus, Wire
from schwung.errors import NodeLostError
from schwung.fieldbus import cia402, eds
from schwung.fieldbus.canopen import pdo
from schwung.fieldbus.canopen.exchange import Exchange, Producer
from schwung.fieldbus.canopen.following import JITTER_CYCLES, Following
from schwung.fieldbus.canopen.kernel import KernelProducer
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.output import Output, StopFrame
from schwung.fieldbus.canopen.recorder import Recorder
from schwung.fieldbus.canopen.silence import Silence
from schwung.fieldbus.canopen.sync import LockstepProducer, PeriodicProducer
from schwung.fieldbus.profile import load_profile

NODE, PERIOD_S, TOLERATED, LENGTH = 5, 0.001, 12, 400


class Setting:
    """A producer, a drive that listens until `deaf`, and a way of one count per SYNC."""

    def __init__(self, kind: str) -> None:
        profile = load_profile("schwung-bench")
        layouts = pdo.layouts(profile, eds.read_eds(profile.eds_path, NODE).find, NODE)
        self.clock = StallingClock()
        wire = Wire(self.clock)
        self.ends: list[SteppedBus] = [wire.bus() for _ in range(3)]
        answers = {t.can_id: struct.pack("<H", 0x0027).ljust(t.size, b"\0") for t in layouts.tpdos}
        self.drive = Seen(self.clock, self.ends[0], layouts.rpdo.can_id, answers)
        self.exchange = exchange = Exchange(Link(self.ends[1]), layouts, NODE, counter=False)
        stop = StopFrame.of(profile, layouts.rpdo)
        self.producer: Producer
        if kind == "kernel":
            broadcast = SteppedBroadcast(self.clock, self.ends[2], 23e-6)
            kernel = KernelProducer(exchange, PERIOD_S, stop, broadcast.opener)
            self.producer, exchange.latch = kernel, kernel.latch_ring
        else:
            output = Output(self.clock, stop, "node 5")
            producer = LockstepProducer if kind == "lockstep" else PeriodicProducer
            self.producer, exchange.latch = producer(exchange, PERIOD_S, output), output.latch
        self.recorder = Recorder(len(layouts.tpdos))
        self.producer.start(_frame(0))
        self.producer.pump(0.2)

    def play(self) -> None:
        exchange = self.exchange
        position = exchange.layouts.tpdos[0]
        demand = np.arange(LENGTH, dtype=np.int64)
        watch = Following(position, "6041:00", demand, 1 / PERIOD_S, TOLERATED, 0.0)
        exchange.recorder, exchange.guarded, exchange.leaps = self.recorder, True, watch.leaps
        self.producer.play(
            [_frame(index) for index in range(LENGTH)], _frame(LENGTH - 1), self.recorder, None
        )

    def gather(self, cycles: int) -> None:
        """From now on an adapter hands on what the drive answers so many SYNCs at a time."""
        answers, self.drive.answers = self.drive.answers, {}

        def hand_on() -> None:
            for can_id, data in [*answers.items()] * cycles:
                self.drive.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

        self.clock.every(cycles * PERIOD_S, hand_on, "adapter")
        self.producer.pump(1.0)

    def be_deaf(self, from_cycle: int, cycles: int) -> None:
        """It neither hears nor answers so many SYNCs of the way."""
        begin = len(self.drive.at_sync) + from_cycle
        self.drive.deaf_during = range(begin, begin + cycles)

    def steps(self) -> list[int]:
        """Between targets that enable, as a drive sees them that hears nothing while deaf."""
        return [
            after - before for before, after in pairwise(_target(f) for f in self.drive.heard if _enables(f))
        ]


@pytest.fixture
def settings() -> Iterator[Callable[[str], Setting]]:
    made: list[Setting] = []

    def make(kind: str) -> Setting:
        made.append(Setting(kind))
        return made[-1]

    yield make
    for one in made:
        one.producer.stop()
        for end in one.ends:
            end.shutdown()


def _frame(target: int) -> bytes:
    return struct.pack("<Hih", cia402.ENABLE_OPERATION, target, 0)


def _target(frame: bytes) -> int:
    return int(struct.unpack("<Hih", frame)[1])


def _enables(frame: bytes) -> bool:
    return cia402.enables_operation(struct.unpack("<Hih", frame)[0])


KINDS = ["kernel", "thread", "lockstep"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("cycles", [15, 17, 18, 19, 30, 49])
def test_what_it_has_missed_is_no_step_beyond_what_it_tolerates(
    settings: Callable[[str], Setting], kind: str, cycles: int
) -> None:
    """Campaign seeds 693559 and 695037: 37 ms without a frame, and what came then went beyond the window."""
    setting = settings(kind)
    setting.be_deaf(150, cycles)
    setting.play()
    while len(setting.drive.at_sync) < setting.drive.deaf_during.stop + 5:
        setting.producer.pump(PERIOD_S)
    assert max(setting.steps()) <= TOLERATED + JITTER_CYCLES + 2
    if cycles > 20:
        assert isinstance(setting.exchange.trouble, NodeLostError)
        assert "one step" in str(setting.exchange.trouble)
        assert not _enables(setting.drive.heard[-1])


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_step_is_played_on(settings: Callable[[str], Setting], kind: str) -> None:
    setting = settings(kind)
    setting.be_deaf(150, 10)
    setting.play()
    assert setting.exchange.trouble is None
    assert max(setting.steps()) in (10, 11, 12)
    assert _target(setting.drive.at_sync[-1]) == LENGTH - 1


@pytest.mark.parametrize("kind", ["kernel", "thread"])
@pytest.mark.parametrize("burst", [4, 16, 30])
def test_answers_that_always_come_in_bursts_are_no_silence(
    settings: Callable[[str], Setting], kind: str, burst: int
) -> None:
    setting = settings(kind)
    setting.gather(burst)
    setting.play()
    assert setting.exchange.trouble is None


def test_one_long_silence_is_not_usual() -> None:
    silence = Silence()
    assert silence.usual == 0
    for sync in [*range(1, 300), *range(380, 600)]:
        for _ in range(2):  # TPDOs
            silence.answered(sync)
        assert silence.length(sync + 3) == 3
    assert silence.usual == 1
    for sync in range(600, 6000, 16):
        silence.answered(sync)
    assert silence.usual == 16


def test_answers_that_wait_in_this_computer_are_heard_before_anything_is_said(
    settings: Callable[[str], Setting], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that reads may be held up while the one that sends is not."""
    setting = settings("thread")
    answers, setting.drive.answers = setting.drive.answers, {}
    link, heard = setting.exchange.link, list[int]()

    def catch_up() -> None:
        heard.append(setting.exchange.sync_count)
        for can_id, data in answers.items():
            link._receive(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    monkeypatch.setattr(link, "catch_up", catch_up)
    setting.play()
    assert heard
    assert setting.exchange.trouble is None
