"""Domains over the bus from a drive that loses frames, refuses, breaks off or takes its time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import can
import pytest
from driver_desk import NODE, bench_and_bus

from schwung.clock import clock_of
from schwung.errors import SdoError
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.drive import Parameter
from schwung_sim.bench import Bench
from schwung_sim.drives.dictionary import AbortError

USER_DATA = Parameter(0x2010, 0, "DOMAIN", "User data")
CONTENT = bytes((7 * i + i // 256) % 251 for i in range(20_000))


@contextmanager
def channel(faults: str = "", timeout_s: float = 0.3) -> Iterator[tuple[Bench, SdoChannel, list[bytes]]]:
    """Bench, SDO channel, and every request that goes out."""
    with bench_and_bus(faults=faults) as (bench, bus):
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
            yield bench, sdo, asked
        finally:
            sdo.close()
            link.close()


def test_a_trace_by_block_is_at_least_three_times_faster_where_each_answer_takes_a_millisecond() -> None:
    """A fifth of the 20 kB of benchmarks/sdo.py: the ratio does not depend on it."""
    with channel("turn-around=0.001") as (bench, sdo, _):
        bench.servo.dictionary.values[USER_DATA.index << 8] = CONTENT[:4000]
        took = []
        for block in (False, True):
            begin = clock_of(bench.bus).now()
            assert sdo.upload(USER_DATA, block=block) == CONTENT[:4000]
            took.append(clock_of(bench.bus).now() - begin)
        assert took[0] > 0.57  # 572 segments, a millisecond each
        assert took[0] > 3 * took[1]


def test_lost_segments_and_acknowledgements_cost_time_and_nothing_else() -> None:
    with channel("drop=0.003", timeout_s=0.05) as (bench, sdo, asked):
        assert sdo.upload(USER_DATA, block=True) == CONTENT
        assert bench.bus.dropped > 0
        assert len(asked) < 400  # by blocks: segments would be 2858 requests


def test_a_server_without_block_transfer_is_asked_for_it_once() -> None:
    with channel() as (bench, sdo, asked):
        bench.servo.sdo._start_block_upload = _refused  # type: ignore[method-assign]
        for _ in range(2):
            assert sdo.upload(USER_DATA, block=True) == CONTENT
        assert [request[0] for request in asked].count(0xA4) == 1
        assert not sdo.serves_blocks


def _refused(index: int, subindex: int, frame: bytes) -> None:
    raise AbortError(0x05040001)


@pytest.mark.parametrize("times", [1, 5])
def test_a_server_that_aborts_midway_is_asked_again_and_then_for_segments(times: int) -> None:
    with channel() as (bench, sdo, asked):
        server, left = bench.servo.sdo, [times]
        send_block = server._send_block

        def breaking(transfer: object) -> None:
            if transfer.position > 5000 and left[0]:  # type: ignore[attr-defined]
                left[0] -= 1
                raise AbortError(0x08000000)
            send_block(transfer)  # type: ignore[arg-type]

        server._send_block = breaking  # type: ignore[method-assign]
        assert sdo.upload(USER_DATA, block=True) == CONTENT
        assert [request[0] for request in asked].count(0xA4) == 2
        assert (len(asked) > 2000) == (times > 1)
        assert sdo.serves_blocks


def test_an_object_that_is_not_there_and_a_drive_that_is_not_are_told_apart() -> None:
    with channel(timeout_s=0.05) as (bench, sdo, _):
        with pytest.raises(SdoError, match=r"does not exist|sub-index"):
            sdo.upload(Parameter(0x2010, 9, "DOMAIN"), block=True)
        bench.servo.sdo.silent.add(0x2010)
        with pytest.raises(SdoError, match="no answer"):
            sdo.upload(USER_DATA, block=True)
        bench.servo.sdo.silent.clear()
        assert sdo.upload(USER_DATA, block=True) == CONTENT


def test_what_is_left_of_a_broken_block_is_not_taken_for_the_next_answer() -> None:
    """The interrupt comes with a hundred segments still on their way, whose numbers look like answers."""
    with channel() as (_, sdo, _):
        waited, frames = sdo._client.wait, [0]

        def interrupted(timeout_s: float) -> bytes | None:
            frames[0] += 1
            if frames[0] == 20:
                raise KeyboardInterrupt
            return waited(timeout_s)

        sdo._client.wait = interrupted  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            sdo.upload(USER_DATA, block=True)
        for _ in range(20):
            assert sdo.read(Parameter(0x1018, 1, "UNSIGNED32")).raw == 0x53574E47
