"""Block upload against the simulated server, over a wire that loses, garbles and falls silent."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schwung.fieldbus.canopen.block import SEGMENTS, BlockAbortedError, BlockError, BlockUpload
from schwung_sim.drives.dictionary import ObjectDictionary
from schwung_sim.drives.sdo_server import SdoServer

USER_DATA = 0x2010
Frames = Callable[[int, bytes], bytes | None]


def content(size: int) -> bytes:
    return bytes((7 * i + i // 256) % 251 for i in range(size))


class Holds:
    """The one object of a dictionary that is read here."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def upload(self, index: int, subindex: int) -> bytes:
        return self.data


class Wire:
    """Both directions by hand: `to_client` and `to_server` see every frame with its number, may change or lose it."""

    def __init__(self, data: bytes) -> None:
        self.server = SdoServer(cast(ObjectDictionary, Holds(data)), self._answer)
        self.answers: deque[bytes] = deque()
        self.asked: list[bytes] = []
        self.answered = 0
        self.to_client: Frames = lambda number, frame: frame
        self.to_server: Frames = lambda number, frame: frame

    def _answer(self, frame: bytes) -> None:
        passed = self.to_client(self.answered, frame)
        self.answered += 1
        if passed is not None:
            self.answers.append(passed)

    def send(self, frame: bytes) -> None:
        assert len(frame) == 8
        number = len(self.asked)
        self.asked.append(frame)
        passed = self.to_server(number, frame)
        if passed is not None:
            self.server.service(passed, 0.0)

    def receive(self, timeout_s: float) -> bytes | None:
        return self.answers.popleft() if self.answers else None

    def upload(self, index: int = USER_DATA) -> bytes:
        return BlockUpload(self.send, self.receive, index, 0, 0.5).run()


def lose(*numbers: int) -> Frames:
    return lambda number, frame: None if number in numbers else frame


@pytest.mark.parametrize("size", [1, 4, 7, 8, 889, 890, 1778, 20_000])
def test_any_size_comes_whole(size: int) -> None:
    wire = Wire(content(size))
    assert wire.upload() == content(size)
    assert (
        wire.asked[0].hex() == "a41020007f000000"
    )  # CRC, object 2010, 127 segments, no switch to another protocol
    assert wire.asked[-1][0] == 0xA1
    assert len(wire.asked) == 3 + -(-size // (7 * SEGMENTS))  # one acknowledgement per sub-block


@pytest.mark.parametrize("lost", [(1,), (64,), (127,), (1, 2, 3), (126, 127), (130,), (40, 41, 200)])
def test_lost_segments_are_asked_for_again(lost: tuple[int, ...]) -> None:
    wire = Wire(content(2000))
    wire.to_client = lose(*lost)  # answer 0 is that to the request
    assert wire.upload() == content(2000)


def test_a_lost_end_of_the_data_is_asked_for_again() -> None:
    wire = Wire(content(70))
    wire.to_client = lose(10)
    assert wire.upload() == content(70)


@settings(max_examples=150, deadline=None)
@given(
    size=st.integers(1, 3000),
    lost=st.sets(st.integers(0, 500), max_size=12),
    unheard=st.sets(st.integers(0, 8), max_size=2),
)
def test_what_comes_over_a_bad_wire_is_right_or_nothing(size: int, lost: set[int], unheard: set[int]) -> None:
    wire = Wire(content(size))
    wire.to_client, wire.to_server = lose(*lost), lose(*unheard)
    try:
        assert wire.upload() == content(size)
    except BlockError:
        assert wire.asked[-1][0] == 0x80  # the server was told


def test_a_wrong_crc_is_refused_and_said() -> None:
    wire = Wire(content(100))
    wire.to_client = lambda number, frame: frame[:3] + b"\xff" + frame[4:] if number == 5 else frame
    with pytest.raises(BlockError, match="CRC"):
        wire.upload()
    assert wire.asked[-1] == bytes.fromhex("80102000") + struct.pack("<I", 0x05040004)


def test_a_server_without_crc_is_believed_by_its_size() -> None:
    wire = Wire(content(100))
    wire.to_client = lambda number, frame: bytes([frame[0] & ~4]) + frame[1:] if number == 0 else frame
    assert wire.upload() == content(100)
    short = Wire(content(100))
    short.to_client = lambda number, frame: b"\xc2" + frame[1:4] + b"\x63\0\0\0" if number == 0 else frame
    with pytest.raises(BlockError, match="100 of 99"):
        short.upload()


@pytest.mark.parametrize("number", [0, 3, 128])
def test_a_server_that_aborts_is_heard_at_any_time(number: int) -> None:
    abort = bytes.fromhex("8010200001000405")
    wire = Wire(content(2000))
    wire.to_client = lambda n, frame: abort if n == number else frame
    with pytest.raises(BlockAbortedError) as caught:
        wire.upload()
    assert caught.value.code == 0x05040001
    assert wire.asked[-1][0] != 0x80


def test_a_server_that_falls_silent_is_told_that_it_is_given_up() -> None:
    wire = Wire(content(2000))
    wire.to_client = lambda number, frame: None if number > 200 else frame
    with pytest.raises(BlockError):
        wire.upload()
    assert wire.asked[-1][4:] == struct.pack("<I", 0x05040000)


def test_an_interrupt_ends_the_transfer_on_the_bus_too() -> None:
    wire = Wire(content(2000))
    waited = wire.receive

    def interrupted(timeout_s: float) -> bytes | None:
        if len(wire.answers) == 50:
            raise KeyboardInterrupt
        return waited(timeout_s)

    with pytest.raises(KeyboardInterrupt):
        BlockUpload(wire.send, interrupted, USER_DATA, 0, 0.5).run()
    assert wire.asked[-1][0] == 0x80
