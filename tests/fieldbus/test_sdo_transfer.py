"""Plain SDO transfers where frames are lost, late, doubled or out of order: the right bytes, or an error in words."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sdo_desk import (
    CONTROLWORD,
    MODE,
    STATUSWORD,
    TURN_AROUND_S,
    USER_DATA,
    Desk,
    Objects,
    Serve,
    content,
    delay,
    double,
    holding,
    lose,
    merged,
    stalled,
)

from schwung.errors import InputError, SdoError
from schwung.fieldbus.canopen.abort import TRANSIENT
from schwung.fieldbus.canopen.sdo import is_absent
from schwung.fieldbus.drive import ParameterValue

ABORT_TOGGLE = struct.pack("<BHBI", 0x80, 0x2010, 0, 0x05030000)
ABORT_TIMED_OUT = struct.pack("<BHBI", 0x80, 0x2010, 0, 0x05040000)


def silent(objects: Objects, answer: Serve) -> Serve:
    return lambda frame: None


# ── what is lost ─────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("number", range(4))
def test_a_lost_frame_costs_a_repeat(number: int) -> None:
    for up in (True, False):
        desk = holding(20)
        if up:
            desk.to_server = lose(number)
        else:
            desk.to_client = lose(number)
        assert desk.sdo.upload(USER_DATA) == content(20)
        assert [frame[0] for frame in desk.asked].count(0x40) == 2
        assert ABORT_TIMED_OUT in desk.asked
        desk = Desk()
        if up:
            desk.to_server = lose(number)
        else:
            desk.to_client = lose(number)
        desk.sdo.download(USER_DATA, content(20))
        assert desk.objects.values[USER_DATA.index, 0] == content(20)
        assert [frame[0] for frame in desk.asked].count(0x21) == 2


def test_silence_is_told_apart_from_a_refusal() -> None:
    desk = Desk(silent, timeout_s=0.1)
    for took_s in (3 * 0.1, 0.1):  # once it is known to be silent, one attempt is enough
        began = desk.clock.now()
        with pytest.raises(SdoError, match=r"node 5, 0x6041:00 Statusword: no answer to read it") as raised:
            desk.sdo.read(STATUSWORD)
        assert not is_absent(raised.value)
        assert took_s <= desk.clock.now() - began < took_s + 0.1
    with pytest.raises(SdoError, match="no answer"):
        desk.sdo.read_integer(0x6041, 0, "UNSIGNED16")
    assert Desk().sdo.read_integer(0x5FFF, 0, "UNSIGNED16") is None


def test_a_node_that_is_assumed_silent_is_asked_once_until_it_answers() -> None:
    desk = Desk(timeout_s=0.5)
    desk.sdo.assume_silent()
    desk.to_server = lose(0)
    with pytest.raises(SdoError, match="no answer"):
        desk.sdo.read(STATUSWORD)
    assert desk.clock.now() < 0.25
    assert desk.sdo.read(STATUSWORD).raw == 0x237
    desk.to_server = lose(len(desk.asked))
    assert desk.sdo.read(STATUSWORD).raw == 0x237  # tried again


@pytest.mark.parametrize("code", [*TRANSIENT, 0x06090030, 0x08000000])
def test_an_abort_for_lost_frames_is_tried_again_and_a_refusal_is_not(code: int) -> None:
    def aborting(objects: Objects, answer: Serve) -> Serve:
        return lambda frame: answer(struct.pack("<B3sI", 0x80, frame[1:4], code))

    desk = Desk(aborting)
    with pytest.raises(SdoError, match=f"refused to write it: .*0x{code:08X}"):
        desk.sdo.write(ParameterValue(MODE, 8))
    assert len(desk.asked) == (3 if code in TRANSIENT else 1)
    if code in TRANSIENT:  # no refusal: whether it has the object is not known
        with pytest.raises(SdoError):
            desk.sdo.read_integer(0x6041, 0, "UNSIGNED16")
    else:
        assert desk.sdo.read_integer(0x6041, 0, "UNSIGNED16") is None


# ── what is late, doubled or meant for others ────────────────────────────────────────────────────────────────────────


def test_an_answer_for_another_object_is_no_answer() -> None:
    desk = Desk()
    for late in ("4f60600008000000", "8060600000000206", "6060600000000000", "41102000e8030000"):
        desk.answer(bytes.fromhex(late))
    assert desk.sdo.read(STATUSWORD).raw == 0x237
    desk.to_client = delay(0.001, 5)
    desk.answer(bytes.fromhex("8060600000000206"))
    assert desk.sdo.read(STATUSWORD).raw == 0x237
    assert len(desk.asked) == 2


def test_an_abort_that_names_no_object_is_ours() -> None:
    def nameless(objects: Objects, answer: Serve) -> Serve:
        return lambda frame: answer(struct.pack("<BHBI", 0x80, 0, 0, 0x06020000))

    with pytest.raises(SdoError, match="does not exist") as raised:
        Desk(nameless).sdo.read(STATUSWORD)
    assert is_absent(raised.value)


def test_a_late_answer_is_as_good_as_that_of_the_repeat_which_is_waited_for() -> None:
    """The next request of the same object could get it."""
    desk = Desk(timeout_s=0.05)
    desk.to_client = delay(0.0705, 0)  # some microseconds after the repeat was sent
    assert desk.sdo.read(STATUSWORD).raw == 0x237
    assert len(desk.asked) == 3  # request, abort, request
    assert len(desk.answered) == 2
    assert desk.clock.now() < 0.073


def test_the_confirmation_of_a_repeated_write_is_not_taken_for_that_of_the_next() -> None:
    """The server stalls for longer than the time-out and then answers both attempts; the next word is lost."""
    stalled: list[bytes] = []

    def stalling(objects: Objects, answer: Serve) -> Serve:
        def serve(frame: bytes) -> None:
            if frame[0] == 0x80:
                return
            stalled.append(frame)
            if desk.clock.now() > 0.06:
                for request in stalled:
                    objects.written.append((CONTROLWORD.index, request[4:6]))
                    answer(b"\x60" + request[1:4])
                stalled.clear()

        return serve

    desk = Desk(stalling, timeout_s=0.05)
    desk.to_server = lose(3)
    desk.sdo.write(ParameterValue(CONTROLWORD, 6))
    asked = len(desk.asked)
    desk.sdo.write(ParameterValue(CONTROLWORD, 7))
    assert desk.objects.written == [(0x6040, b"\6\0"), (0x6040, b"\6\0"), (0x6040, b"\7\0")]
    assert len(desk.asked) == asked + 3  # lost, given up, repeated


def test_late_answers_of_another_length_are_not_mixed() -> None:
    """The object was long when it was asked for first, and is short when it is asked for again."""
    desk = holding(30)
    desk.to_client = delay(0.08, 2)  # the second segment arrives amid the repeat
    desk.at(0.06, lambda: desk.objects.values.update({(USER_DATA.index, 0): content(20)[::-1]}))
    assert desk.sdo.upload(USER_DATA) == content(20)[::-1]


@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("after_s", [0.0, TURN_AROUND_S])
def test_a_segment_that_comes_twice_is_one(number: int, after_s: float) -> None:
    desk = holding(25)
    desk.to_client = double(number, after_s=after_s)
    assert desk.sdo.upload(USER_DATA) == content(25)
    assert [frame[0] for frame in desk.asked].count(0x40) == 1  # at the first attempt


@pytest.mark.parametrize("number", range(5))
@pytest.mark.parametrize("after_s", [0.0, TURN_AROUND_S])
def test_a_confirmation_that_comes_twice_is_one(number: int, after_s: float) -> None:
    """After more than a round trip it would be just like that of the segment after the next."""
    desk = Desk()
    desk.to_client = double(number, after_s=after_s)
    desk.sdo.download(USER_DATA, content(25))
    assert desk.objects.values[USER_DATA.index, 0] == content(25)
    assert [frame[0] for frame in desk.asked].count(0x21) == 1


@pytest.mark.parametrize("number", range(1, 5))
def test_a_request_that_comes_twice_is_aborted_by_the_server_and_repeated(number: int) -> None:
    desk = holding(25)
    desk.to_server = double(number)
    assert desk.sdo.upload(USER_DATA) == content(25)
    desk = Desk()
    desk.to_server = double(number)
    desk.sdo.download(USER_DATA, content(25))
    assert desk.objects.values[USER_DATA.index, 0] == content(25)


def test_a_server_with_the_wrong_toggle_bit_is_told_so() -> None:
    def wrong(objects: Objects, answer: Serve) -> Serve:
        def serve(frame: bytes) -> None:
            if frame[0] in (0x40, 0x21):
                answer(struct.pack("<B3sI", 0x41 if frame[0] == 0x40 else 0x60, frame[1:4], 20))
            elif frame[0] == 0x60:
                answer(b"\x10" + bytes(7))
            elif frame[0] == 0x00:
                answer(b"\x30" + bytes(7))

        return serve

    for desk, action in (
        (up := Desk(wrong), lambda: up.sdo.upload(USER_DATA)),
        (down := Desk(wrong), lambda: down.sdo.download(USER_DATA, content(20))),
    ):
        with pytest.raises(SdoError, match=r"cannot be right.*out of turn"):
            action()
        assert desk.asked.count(ABORT_TOGGLE) == 3
        assert desk.clock.now() < 0.1  # it did not wait for the time-out


def test_the_second_segment_with_the_wrong_toggle_bit_is_told_too() -> None:
    def wrong(objects: Objects, answer: Serve) -> Serve:
        answers = [b"\x41\x10\x20\0\x14", b"\x00abcdefg", b"\x00hijklmn"]
        return lambda frame: answer(answers.pop(0)) if answers else None

    desk = Desk(wrong, attempts=1)
    with pytest.raises(SdoError, match="out of turn"):
        desk.sdo.upload(USER_DATA)
    assert desk.asked[-1] == ABORT_TOGGLE


@pytest.mark.parametrize(("announced", "segments"), [(15, 2), (13, 2), (6, 1)])
def test_segments_that_do_not_add_up_are_refused(announced: int, segments: int) -> None:
    def lying(objects: Objects, answer: Serve) -> Serve:
        answers = [struct.pack("<BHBI", 0x41, 0x2010, 0, announced), b"\x00abcdefg", b"\x11hijklmn"]
        return lambda frame: answer(answers.pop(0)) if answers else None

    desk = Desk(lying, attempts=1)
    with pytest.raises(SdoError, match=f"{7 * segments} of {announced} bytes"):
        desk.sdo.upload(USER_DATA)
    assert desk.asked[-1] == struct.pack("<BHBI", 0x80, 0x2010, 0, 0x06070010)


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        ("4f10200001020304", "01"),
        ("4310200001020304", "01020304"),
        ("4210200001020304", "01020304"),  # its length is not told
    ],
)
def test_expedited_uploads_have_the_length_that_is_told(answer: str, expected: str) -> None:
    desk = Desk(lambda objects, send: lambda frame: send(bytes.fromhex(answer)))
    assert desk.sdo.upload(USER_DATA).hex() == expected


def test_segments_without_a_size_end_where_the_server_says() -> None:
    def sizeless(objects: Objects, answer: Serve) -> Serve:
        answers = [b"\x40\x10\x20\0", b"\x00abcdefg", b"\x1bhi"]
        return lambda frame: answer(answers.pop(0))

    assert Desk(sizeless).sdo.upload(USER_DATA) == b"abcdefghi"


def test_an_answer_too_short_for_its_type_is_the_eds_fault_and_no_integer() -> None:
    desk = Desk()
    desk.objects.values[STATUSWORD.index, 0] = b"\1"
    with pytest.raises(InputError, match="1 bytes came"):
        desk.sdo.read(STATUSWORD)
    assert desk.sdo.read_integer(0x6041, 0, "UNSIGNED16") is None


@settings(max_examples=200, deadline=None)
@given(
    size=st.integers(0, 60),
    attempts=st.integers(1, 4),
    lost=st.sets(st.integers(0, 40), max_size=4),
    doubled=st.sets(st.integers(0, 40), max_size=4),
    late=st.dictionaries(st.integers(0, 40), st.floats(0, 0.12), max_size=3),
    unheard=st.sets(st.integers(0, 40), max_size=3),
    heard_twice=st.sets(st.integers(0, 40), max_size=3),
)
def test_what_comes_over_a_bad_wire_is_right_or_an_error(
    size: int,
    attempts: int,
    lost: set[int],
    doubled: set[int],
    late: dict[int, float],
    unheard: set[int],
    heard_twice: set[int],
) -> None:
    """Frames are lost, doubled, and late by more than a time-out, in any number; in order, as a bus keeps it."""

    def bad() -> Desk:
        desk = Desk(attempts=attempts)
        desk.to_client = stalled(desk.clock, late, merged(lose(*lost), double(*doubled)))
        desk.to_server = merged(lose(*unheard), double(*heard_twice))
        return desk

    bad_enough = lost or late or unheard or heard_twice
    desk = bad()
    desk.objects.values[USER_DATA.index, 0] = content(size)
    try:
        assert desk.sdo.upload(USER_DATA) == content(size)
    except SdoError:
        assert bad_enough
    desk = bad()
    try:
        desk.sdo.download(USER_DATA, content(size))
        assert desk.objects.values[USER_DATA.index, 0] == content(size)
    except SdoError:
        assert bad_enough
    assert {data for _, data in desk.objects.written} <= {content(size)}


@settings(max_examples=200, deadline=None)
@given(size=st.integers(0, 60), number=st.integers(0, 12), by_s=st.floats(0, 0.12), twice=st.booleans())
def test_an_answer_that_is_overtaken_by_others_does_no_harm(
    size: int, number: int, by_s: float, twice: bool
) -> None:
    """One of them, by any number of others: no bus does that, but gateways have been seen to."""
    desk = Desk()
    desk.objects.values[USER_DATA.index, 0] = content(size)
    desk.to_client = double(number, after_s=by_s) if twice else delay(by_s, number)
    assert desk.sdo.upload(USER_DATA) == content(size)
    desk = Desk()
    desk.to_client = double(number, after_s=by_s) if twice else delay(by_s, number)
    desk.sdo.download(USER_DATA, content(size))
    desk.clock.sleep(0.01)  # the last segment may still be on its way
    assert desk.objects.values[USER_DATA.index, 0] == content(size)


def test_a_server_that_forgets_a_transfer_is_asked_anew() -> None:
    """It restarted: what it then says of a segment is no refusal of the object."""
    desk = holding(100)
    server = desk._server.__closure__[0].cell_contents
    desk.at(0.005, server.reset)
    assert desk.sdo.upload(USER_DATA) == content(100)
    assert [frame[0] for frame in desk.asked].count(0x40) == 2
    desk.at(desk.clock.now() + 0.005, server.reset)
    desk.sdo.download(USER_DATA, content(100)[::-1])
    assert desk.objects.values[USER_DATA.index, 0] == content(100)[::-1]
