"""Domains from the bench drive, over a bus that takes its time or loses frames; and a stop amid them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import can
import pytest
from driver_desk import NODE, bench_and_bus

from schwung.clock import Clock, SteppedBus
from schwung.errors import SdoError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.sdo import Outcome, SdoChannel
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung_sim.bench import Bench
from schwung_sim.drives.power import Power

USER_DATA = Parameter(0x2010, 0, "DOMAIN", "User data")
CONTROLWORD = Parameter(0x6040, 0, "UNSIGNED16", "Controlword")
CONTENT = bytes((7 * i + i // 256) % 251 for i in range(20_000))


@dataclass
class Room:
    """A bench drive that holds CONTENT, an SDO channel, and every request that goes out."""

    bench: Bench
    sdo: SdoChannel
    clock: Clock
    asked: list[bytes]


@contextmanager
def room(faults: str = "", *, timeout_s: float = 0.3, turn_around_s: float = 0.0) -> Iterator[Room]:
    """`turn_around_s`: how long a request waits before the drive looks at it."""
    with bench_and_bus(faults=faults) as (bench, bus):
        assert isinstance(bus, SteppedBus)
        bus.wire.weather = lambda sender, end, message: (
            turn_around_s if message.arbitration_id == 0x600 + NODE else 0.0,
        )
        bench.servo.dictionary.values[USER_DATA.index << 8] = CONTENT
        asked: list[bytes] = []
        send = bus.send

        def noting(message: can.Message, timeout: float | None = None) -> None:
            asked.append(bytes(message.data))
            send(message, timeout)

        bus.send = noting  # type: ignore[method-assign]  # a spy
        link = Link(bus)
        sdo = SdoChannel(link, NODE, timeout_s)
        try:
            yield Room(bench, sdo, link.clock, asked)
        finally:
            sdo.close()
            link.close()


def test_a_trace_by_block_is_many_times_faster_where_each_answer_takes_a_millisecond() -> None:
    """1 Mbit/s: 20 kB are 2858 frames of 111 us; by segments each waits for its request and the drive besides."""
    with room(turn_around_s=0.001) as at:
        took = []
        for block in (False, True):
            began = at.clock.now()
            assert at.sdo.upload(USER_DATA, block=block) == CONTENT
            took.append(at.clock.now() - began)
    assert took[0] == pytest.approx(2859 * (0.001 + 2 * 111e-6), rel=1e-3)
    assert took[1] == pytest.approx(2858 * 111e-6 + 25 * (0.001 + 2 * 111e-6), rel=0.02)
    assert took[0] > 9 * took[1]


def test_lost_segments_and_acknowledgements_cost_time_and_nothing_else() -> None:
    with room("drop=0.003", timeout_s=0.05) as at:
        assert at.sdo.upload(USER_DATA, block=True) == CONTENT
        assert at.bench.bus.dropped > 0
        assert len(at.asked) < 400  # by blocks: segments would be 2858 requests


def test_an_object_that_is_not_there_and_a_drive_that_is_not_are_told_apart() -> None:
    with room(timeout_s=0.05) as at:
        with pytest.raises(SdoError, match=r"does not exist|sub-index"):
            at.sdo.upload(Parameter(0x2010, 9, "DOMAIN"), block=True)
        at.bench.servo.sdo.silent.add(0x2010)
        with pytest.raises(SdoError, match="no answer"):
            at.sdo.upload(USER_DATA, block=True)
        at.bench.servo.sdo.silent.clear()
        assert at.sdo.upload(USER_DATA, block=True) == CONTENT


@pytest.mark.parametrize("block", [True, False])
@pytest.mark.parametrize("turn_around_s", [0.0, 0.001])
def test_a_drive_is_stopped_amid_the_reading_of_its_trace(block: bool, turn_around_s: float) -> None:
    with room(turn_around_s=turn_around_s) as at:
        power = at.bench.servo.power
        for word in (cia402.SHUTDOWN, cia402.SWITCH_ON, cia402.ENABLE_OPERATION):
            at.sdo.write(ParameterValue(CONTROLWORD, word))
        assert power.state is Power.OPERATION_ENABLED
        stopped: list[tuple[Outcome, float, Power]] = []
        asked_s = at.clock.now() + 0.1

        def stop() -> None:
            outcome = at.sdo.write_once(CONTROLWORD, cia402.QUICK_STOP, 0.2)
            stopped.append((outcome, at.clock.now() - asked_s, power.state))

        at.clock.later(0.1, stop)
        assert at.sdo.upload(USER_DATA, block=block) == CONTENT
        ((outcome, took_s, state),) = stopped
        assert outcome is Outcome.CONFIRMED
        assert state is not Power.OPERATION_ENABLED
        # The abort and the word, two turn-arounds, and what is left of a sub-block and before it on the wire.
        assert took_s < 0.002 + (127 + 4) * 111e-6
        at.clock.sleep(1.0)
        assert power.state is not Power.OPERATION_ENABLED
