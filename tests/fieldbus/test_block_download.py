"""Block download to the bench drive's server, over a wire that loses, doubles and falls silent."""

from __future__ import annotations

import binascii
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sdo_desk import USER_DATA, Desk, Objects, Serve, content, delay, double, lose, merged

from schwung.fieldbus.canopen.abort import AbortedError, SilenceError
from schwung.fieldbus.canopen.block import MAX_IDLE_BLOCKS, BlockDownload, BlockError


def download(desk: Desk, data: bytes) -> None:
    desk.by_block(lambda talk: BlockDownload(talk, data).run())


def scripted(answers: dict[bytes, bytes]) -> object:
    """A server that answers frames by their first byte."""

    def make(objects: Objects, answer: Serve) -> Serve:
        def serve(frame: bytes) -> None:
            if frame[:1] in answers:
                answer(answers[frame[:1]])

        return serve

    return make


@pytest.mark.parametrize("size", [1, 7, 8, 889, 890, 20_000])
def test_the_frames_are_those_of_the_standard(size: int) -> None:
    desk, data = Desk(), content(size)
    download(desk, data)
    assert desk.objects.written == [(0x2010, data)]
    assert desk.asked[0] == struct.pack("<BHBI", 0xC6, 0x2010, 0, size)
    assert desk.asked[-1][:3] == struct.pack("<BH", 0xC1 | (-size % 7) << 2, binascii.crc_hqx(data, 0))
    assert b"".join(frame[1:] for frame in desk.asked[1:-1])[:size] == data
    assert [frame[0] >> 7 for frame in desk.asked[1:-1]] == [0] * (len(desk.asked) - 3) + [1]


@pytest.mark.parametrize("lost", [(1,), (64,), (126,), (1, 2, 3), (130,), (40, 41, 200)])
def test_lost_segments_are_sent_again(lost: tuple[int, ...]) -> None:
    desk = Desk()
    desk.to_server = lose(*lost)
    download(desk, content(2000))
    assert desk.objects.written == [(0x2010, content(2000))]


@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("after_s", [0.0, 0.004])
def test_an_answer_that_comes_twice_costs_the_block_at_most(number: int, after_s: float) -> None:
    """Acknowledgements of full sub-blocks are all alike. Size and CRC are not: what is written in the end is right."""
    desk = Desk()
    desk.to_client = double(number, after_s=after_s)
    desk.to_server = lose(150)  # in the second sub-block, whose acknowledgement it could be taken for
    desk.sdo.download(USER_DATA, content(2500), block=True)
    assert desk.objects.written == [(0x2010, content(2500))]


@settings(max_examples=150, deadline=None)
@given(
    size=st.integers(1, 3000),
    lost=st.sets(st.integers(0, 500), max_size=8),
    doubled=st.sets(st.integers(0, 500), max_size=5),
    late=st.sets(st.integers(0, 500), max_size=3),
    answers_lost=st.sets(st.integers(0, 8), max_size=2),
    answers_doubled=st.sets(st.integers(0, 8), max_size=2),
)
def test_what_is_written_over_a_bad_wire_is_right_or_nothing(
    size: int,
    lost: set[int],
    doubled: set[int],
    late: set[int],
    answers_lost: set[int],
    answers_doubled: set[int],
) -> None:
    desk, data = Desk(), content(size)
    desk.to_server = merged(lose(*lost), double(*doubled, after_s=0.0005), delay(0.001, *late))
    desk.to_client = merged(lose(*answers_lost), double(*answers_doubled, after_s=0.002))
    try:
        download(desk, data)
        assert desk.objects.written == [(0x2010, data)]
    except (BlockError, SilenceError):
        assert desk.asked[-1][0] == 0x80  # the server was told
    except AbortedError:
        assert any(frame[0] == 0x80 for frame in desk.answered)
    assert desk.objects.written in ([], [(0x2010, data)])


@pytest.mark.parametrize(
    ("answers", "words", "code"),
    [
        ({b"\xc6": b"\xa4\x10\x20\0\0"}, "0 segments", 0x05040002),
        ({b"\xc6": b"\xa4\x10\x20\0\x80"}, "128 segments", 0x05040002),
        ({b"\xc6": b"\xa4\x10\x20\0\x04", b"\x04": b"\xa2\x05\x04"}, "5 of 4", 0x05040003),
        ({b"\xc6": b"\xa4\x10\x20\0\x04", b"\x04": b"\xa2\x04\0"}, "0 segments", 0x05040002),
        ({b"\xc6": b"\xa4\x10\x20\0\x04", b"\x04": b"\xa2\x00\x04"}, "no segment", 0x05040000),
    ],
)
def test_a_server_that_answers_nonsense_is_told_so(
    answers: dict[bytes, bytes], words: str, code: int
) -> None:
    desk = Desk(scripted(answers))  # type: ignore[arg-type]
    with pytest.raises(BlockError, match=words):
        download(desk, content(100))
    assert desk.asked[-1] == struct.pack("<BHBI", 0x80, 0x2010, 0, code)
    assert [frame[0] for frame in desk.asked].count(1) <= MAX_IDLE_BLOCKS


def test_a_server_without_crc_gets_none() -> None:
    answers = {b"\xc6": b"\xa0\x10\x20\0\x7f", b"\x82": b"\xa2\x02\x7f", b"\xc5": b"\xa1"}
    desk = Desk(scripted(answers))  # type: ignore[arg-type]
    download(desk, content(13))
    assert desk.asked[-1] == b"\xc5" + bytes(7)


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_a_lost_answer_ends_it_and_the_server_is_told(number: int) -> None:
    desk = Desk()
    desk.to_client = lose(number)
    with pytest.raises(SilenceError):
        download(desk, content(1000))
    assert desk.asked[-1] == struct.pack("<BHBI", 0x80, 0x2010, 0, 0x05040000)
