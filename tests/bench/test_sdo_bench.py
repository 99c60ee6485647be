"""Domains from the whole bench drive, on a stepped bus that takes its time or loses frames; and a stop amid them."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import cast

import can
import pytest

from schwung.clock import SteppedBus, SteppedClock
from schwung.errors import SdoError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.sdo import Outcome, SdoChannel
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung_sim.drives.axis import ServoAxis
from schwung_sim.drives.power import Power
from schwung_sim.drives.roles import find_profile, read_profile, read_roles
from schwung_sim.drives.servo import TICK_S, CanopenServo
from schwung_sim.plants import make_plant
from stepped_link import SteppedLink, unexpected

NODE = 5
USER_DATA = Parameter(0x2010, 0, "DOMAIN", "User data")
CONTROLWORD = Parameter(0x6040, 0, "UNSIGNED16", "Controlword")
STATUSWORD = Parameter(0x6041, 0, "UNSIGNED16", "Statusword")
CONTENT = bytes((7 * i + i // 256) % 251 for i in range(20_000))


class Room:
    """A bench drive that holds CONTENT, and an SDO channel; `asked` are all requests. `turn_around_s` goes by before
    the drive reads a frame, and of all frames each way the share `drop` is lost."""

    def __init__(self, *, turn_around_s: float = 0.0, drop: float = 0.0, timeout_s: float = 0.3) -> None:
        self.clock, self.asked, self.lost = SteppedClock(), list[bytes](), 0
        self._turn_around_s, self._drop, self._luck = turn_around_s, drop, random.Random(1)
        ours, theirs = self.clock.bus(), self.clock.bus()
        for bus in (ours, theirs):
            bus._is_shutdown = True  # nothing to close: spares a warning
        ours.wire.weather = self._weather
        profile, eds = read_profile(find_profile("schwung-bench"))
        self.servo = CanopenServo(
            theirs,
            NODE,
            ServoAxis(make_plant("two-mass")),
            eds,
            read_roles(profile),
            monotonic=self.clock.now,
        )
        self.servo.dictionary.values[USER_DATA.index << 8] = CONTENT
        self.clock.read(theirs, self.servo.service, unexpected)
        self.clock.every(TICK_S, self.servo.tick)
        self.servo.start()
        self.sdo = SdoChannel(cast(Link, SteppedLink(ours, self.clock)), NODE, timeout_s, clock=self.clock)

    def _weather(self, sender: SteppedBus, end: SteppedBus, message: can.Message) -> Sequence[float]:
        request = message.arbitration_id == 0x600 + NODE
        if request:
            self.asked.append(bytes(message.data))
        if self._luck.random() < self._drop:
            self.lost += 1
            return ()
        return (self._turn_around_s if request else 0.0,)


def test_a_trace_by_block_is_ten_times_faster_where_each_answer_takes_a_millisecond() -> None:
    """1 Mbit/s: 20 kB are 2858 frames of 111 us; by segments each waits for its request and the drive besides."""
    room = Room(turn_around_s=0.001)
    took = []
    for block in (False, True):
        began = room.clock.now()
        assert room.sdo.upload(USER_DATA, block=block) == CONTENT
        took.append(room.clock.now() - began)
    assert took[0] == pytest.approx(2859 * (0.001 + 2 * 111e-6), rel=1e-3)
    assert took[1] == pytest.approx(2858 * 111e-6 + 25 * (0.001 + 2 * 111e-6), rel=0.02)
    assert took[0] > 9.9 * took[1]


def test_lost_segments_and_acknowledgements_cost_time_and_nothing_else() -> None:
    room = Room(drop=0.003, timeout_s=0.05)
    assert room.sdo.upload(USER_DATA, block=True) == CONTENT
    assert room.lost > 0
    assert len(room.asked) < 400  # by blocks: segments would be 2858 requests


def test_an_object_that_is_not_there_and_a_drive_that_is_not_are_told_apart() -> None:
    room = Room(timeout_s=0.05)
    with pytest.raises(SdoError, match=r"does not exist|sub-index"):
        room.sdo.upload(Parameter(0x2010, 9, "DOMAIN"), block=True)
    room.servo.sdo.silent.add(0x2010)
    with pytest.raises(SdoError, match="no answer"):
        room.sdo.upload(USER_DATA, block=True)
    room.servo.sdo.silent.clear()
    assert room.sdo.upload(USER_DATA, block=True) == CONTENT


@pytest.mark.parametrize("block", [True, False])
@pytest.mark.parametrize("turn_around_s", [0.0, 0.001])
def test_a_drive_is_stopped_amid_the_reading_of_its_trace(block: bool, turn_around_s: float) -> None:
    room = Room(turn_around_s=turn_around_s)
    for word in (cia402.SHUTDOWN, cia402.SWITCH_ON, cia402.ENABLE_OPERATION):
        room.sdo.write(ParameterValue(CONTROLWORD, word))
    assert room.servo.power.state is Power.OPERATION_ENABLED
    stopped: list[tuple[Outcome, float]] = []
    asked_s = room.clock.now() + 0.1

    def stop() -> None:
        outcome = room.sdo.write_once(CONTROLWORD, cia402.QUICK_STOP, 0.2)
        stopped.append((outcome, room.clock.now() - asked_s))
        assert room.servo.power.state is not Power.OPERATION_ENABLED

    room.clock.later(0.1, stop)
    assert room.sdo.upload(USER_DATA, block=block) == CONTENT
    ((outcome, took_s),) = stopped
    assert outcome is Outcome.CONFIRMED
    # The abort, the word, and, before them on the wire, what is left of a sub-block.
    assert took_s < turn_around_s + (127 + 4) * 111e-6
    room.clock.sleep(1.0)
    assert room.servo.power.state is not Power.OPERATION_ENABLED
