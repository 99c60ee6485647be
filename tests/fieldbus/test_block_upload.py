"""Block upload from the bench drive's server, over a wire that loses, garbles, doubles and falls silent."""

from __future__ import annotations

import itertools
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sdo_desk import TURN_AROUND_S, USER_DATA, Desk, content, delay, double, holding, lose, merged

from schwung.fieldbus.canopen.abort import AbortedError, SilenceError
from schwung.fieldbus.canopen.block import SEGMENTS, BlockError, BlockUpload
from schwung.fieldbus.canopen.turns import Talk


def upload(desk: Desk) -> bytes:
    return desk.by_block(lambda talk: BlockUpload(talk).run())


@pytest.mark.parametrize("size", [1, 4, 7, 8, 889, 890, 1778, 20_000])
def test_any_size_comes_whole(size: int) -> None:
    desk = holding(size)
    assert upload(desk) == content(size)
    assert (
        desk.asked[0].hex() == "a41020007f000000"
    )  # CRC, object 2010, 127 segments, no switch to another protocol
    assert desk.asked[-1][0] == 0xA1
    assert len(desk.asked) == 3 + -(-size // (7 * SEGMENTS))  # one acknowledgement per sub-block


@pytest.mark.parametrize("lost", [(1,), (64,), (127,), (1, 2, 3), (126, 127), (130,), (40, 41, 200)])
def test_lost_segments_are_asked_for_again(lost: tuple[int, ...]) -> None:
    desk = holding(2000)
    desk.to_client = lose(*lost)  # answer 0 is that to the request
    assert upload(desk) == content(2000)


def test_a_lost_end_of_the_data_is_asked_for_again() -> None:
    desk = holding(70)
    desk.to_client = lose(10)
    assert upload(desk) == content(70)


@pytest.mark.parametrize("number", [0, 1, 64, 126, 127, 128, 254, 286, 287])
@pytest.mark.parametrize("after_s", [0.0, 0.003])
def test_a_frame_that_comes_twice_changes_nothing(number: int, after_s: float) -> None:
    desk = holding(2000)
    desk.to_client = double(number, after_s=after_s)
    assert upload(desk) == content(2000)


def test_a_last_segment_that_comes_twice_is_not_the_end_frame() -> None:
    """65 segments: the last begins with C1, as the end frame does."""
    desk = holding(7 * 65)
    desk.to_client = double(65, after_s=TURN_AROUND_S / 2)
    assert upload(desk) == content(7 * 65)
    assert desk.answered[65][0] == desk.answered[66][0] == 0xC1


@settings(max_examples=150, deadline=None)
@given(
    size=st.integers(1, 3000),
    lost=st.sets(st.integers(0, 500), max_size=12),
    doubled=st.sets(st.integers(0, 500), max_size=5),
    late=st.sets(st.integers(0, 500), max_size=3),
    unheard=st.sets(st.integers(0, 8), max_size=2),
)
def test_what_comes_over_a_bad_wire_is_right_or_nothing(
    size: int, lost: set[int], doubled: set[int], late: set[int], unheard: set[int]
) -> None:
    desk = holding(size)
    desk.to_client = merged(lose(*lost), double(*doubled, after_s=0.001), delay(0.002, *late))
    desk.to_server = lose(*unheard)
    try:
        assert upload(desk) == content(size)
    except (BlockError, SilenceError):
        assert desk.asked[-1][0] == 0x80  # the server was told
    except AbortedError:
        assert any(frame[0] == 0x80 for frame in desk.answered)


def test_a_wrong_crc_is_refused_and_said() -> None:
    desk = holding(100)
    desk.garble = lambda number, frame: frame[:3] + b"\xff" + frame[4:] if number == 5 else frame
    with pytest.raises(BlockError, match="CRC"):
        upload(desk)
    assert desk.asked[-1] == bytes.fromhex("80102000") + struct.pack("<I", 0x05040004)


def test_a_server_without_crc_is_believed_by_its_size() -> None:
    desk = holding(100)
    answers = {0: b"\xc2\x10\x20\0d\0\0\0", 16: b"\xd5" + bytes(7)}
    desk.garble = answers.get
    assert upload(desk) == content(100)
    short = holding(100)
    answers[0] = b"\xc2\x10\x20\0c\0\0\0"
    short.garble = answers.get
    with pytest.raises(BlockError, match="100 of 99"):
        upload(short)


def test_zeros_whose_last_segment_is_the_very_end_frame_come_whole() -> None:
    """65 segments: the last has the number 0x41, and the end frame of zeros is C1 and zeros too."""
    desk = Desk()
    desk.objects.values[USER_DATA.index, 0] = bytes(7 * 65)
    assert upload(desk) == bytes(7 * 65)
    assert desk.answered[-1] == desk.answered[-2] == b"\xc1" + bytes(7)


@pytest.mark.parametrize("number", [0, 3, 128])
def test_a_server_that_aborts_is_heard_at_any_time(number: int) -> None:
    desk = holding(2000)

    def aborting(n: int, frame: bytes) -> tuple[float, ...]:
        if n == number:
            desk.answer(bytes.fromhex("8010200001000405"))
            return ()
        return (0.0,)

    desk.to_client = aborting
    with pytest.raises(AbortedError) as caught:
        upload(desk)
    assert caught.value.code == 0x05040001
    assert desk.asked[-1][0] != 0x80


def test_an_abort_of_another_object_is_not_ours() -> None:
    desk = holding(2000)
    for when_s in (0.0001, 0.001, 0.005, 0.02):
        desk.at(when_s, lambda: desk.answer(bytes.fromhex("8041600000000206")))
    assert upload(desk) == content(2000)


def test_a_server_that_falls_silent_is_told_that_it_is_given_up() -> None:
    desk = holding(2000)
    desk.to_client = lambda number, frame: () if number > 200 else (0.0,)
    with pytest.raises(SilenceError):
        upload(desk)
    assert desk.asked[-1][4:] == struct.pack("<I", 0x05040000)


def test_an_interrupt_ends_the_transfer_on_the_bus_too() -> None:
    desk = holding(2000)

    def interrupted(talk: Talk) -> bytes:
        receive, frames = talk.receive, itertools.count()

        def receiving(timeout_s: float) -> bytes | None:
            if next(frames) == 50:
                raise KeyboardInterrupt
            return receive(timeout_s)

        talk.receive = receiving  # type: ignore[method-assign]
        return BlockUpload(talk).run()

    with pytest.raises(KeyboardInterrupt):
        desk.by_block(interrupted)
    assert desk.asked[-1] == bytes.fromhex("80102000") + struct.pack("<I", 0x08000000)
