"""A stop waits for no transfer: whatever is under way, its frame goes out at once, and nothing undoes it."""

from __future__ import annotations

import struct
from collections.abc import Callable

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
    MakeServer,
    Objects,
    Serve,
    bench_server,
    canopen_server,
    content,
    delay,
    lose,
    stalled,
    strict_server,
)

from schwung.errors import BusError, SdoError
from schwung.fieldbus.canopen.abort import PreemptedError
from schwung.fieldbus.canopen.sdo import Outcome
from schwung.fieldbus.canopen.turns import Talk
from schwung.fieldbus.drive import Parameter, ParameterValue

STOP = struct.pack("<BHBHxx", 0x2B, 0x6040, 0, 2)
PATIENCE_S = 0.2
#: Bytes that take 50 ms on the wire, in blocks and in segments.
SIZE, SEGMENTED_SIZE = 3000, 480
FRAME_S = 111e-6  # 8 bytes at 1 Mbit/s


def stop(desk: Desk) -> Outcome:
    return desk.sdo.write_once(CONTROLWORD, 2, PATIENCE_S)


def uploading(desk: Desk, block: bool) -> None:
    data = content(SIZE if block else SEGMENTED_SIZE)
    desk.objects.values[USER_DATA.index, 0] = data
    assert desk.sdo.upload(USER_DATA, block=block) == data


def downloading(desk: Desk, block: bool) -> None:
    data = content(SIZE if block else SEGMENTED_SIZE)
    desk.sdo.download(USER_DATA, data, block=block)
    assert desk.objects.values[USER_DATA.index, 0] == data


def reading(desk: Desk) -> None:
    assert [desk.sdo.read(STATUSWORD).raw for _ in range(50)] == [0x237] * 50


def writing(desk: Desk) -> None:
    for mode in range(50):
        desk.sdo.write(ParameterValue(MODE, mode))
        assert desk.objects.values[MODE.index, 0] == bytes([mode])


TRANSFERS: dict[str, Callable[[Desk], None]] = {
    "expedited upload": reading,
    "expedited download": writing,
    "segmented upload": lambda desk: uploading(desk, block=False),
    "segmented download": lambda desk: downloading(desk, block=False),
    "block upload": lambda desk: uploading(desk, block=True),
    "block download": lambda desk: downloading(desk, block=True),
}
SERVERS: list[MakeServer] = [bench_server, strict_server, canopen_server]


@pytest.mark.parametrize("name", TRANSFERS)
@pytest.mark.parametrize("server", SERVERS)
def test_a_timer_stops_amid_any_transfer_which_is_carried_out_afterwards(
    server: MakeServer, name: str
) -> None:
    """At forty instants each, a millisecond and a bit apart."""
    for when_s in [1e-5 + 0.00113 * number for number in range(40)]:
        desk = Desk(server)
        outcomes: list[Outcome] = []
        desk.at(when_s, lambda desk=desk, outcomes=outcomes: outcomes.append(stop(desk)))  # type: ignore[misc]
        TRANSFERS[name](desk)
        desk.clock.sleep(max(0.0, when_s + 0.01 - desk.clock.now()))
        assert outcomes == [Outcome.CONFIRMED], when_s
        assert desk.asked.count(STOP) == 1
        assert desk.at_s[desk.asked.index(STOP)] == pytest.approx(when_s, abs=1e-9)  # at once
        assert desk.objects.values[CONTROLWORD.index, 0] == b"\2\0"
        aborts = [frame for frame in desk.asked[: desk.asked.index(STOP)] if frame[0] == 0x80]
        several = ("segmented" in name or "block" in name) and aborts
        assert aborts == ([struct.pack("<BHBI", 0x80, 0x2010, 0, 0x08000000)] if several else [])


@pytest.mark.parametrize("name", ["segmented upload", "segmented download", "block upload", "block download"])
def test_a_server_that_holds_a_transfer_is_told_its_end_before_the_stop(name: str) -> None:
    desk = Desk()
    desk.at(0.005, lambda: stop(desk))
    TRANSFERS[name](desk)
    place = desk.asked.index(STOP)
    assert desk.asked[place - 1] == struct.pack("<BHBI", 0x80, 0x2010, 0, 0x08000000)
    assert desk.at_s[place - 1] == desk.at_s[place]


def test_a_word_under_way_is_not_written_again_after_the_stop() -> None:
    """It would enable the drive again."""
    for way in (lose(), lose(0), delay(0.01, 0)):
        desk = Desk(timeout_s=0.05)
        desk.to_server = way
        outcomes: list[Outcome] = []
        desk.at(0.0002, lambda desk=desk, outcomes=outcomes: outcomes.append(stop(desk)))  # type: ignore[misc]
        with pytest.raises(SdoError, match=r"node 5, 0x6040:00 Controlword: .*given up.*stop"):
            desk.sdo.write(ParameterValue(CONTROLWORD, 0x0F))
        desk.clock.sleep(1.0)
        words = [frame[4] for frame in desk.asked if frame[1:4] == b"\x40\x60\0"]
        assert words == [0x0F, 2]


def test_a_word_between_two_attempts_is_not_written_again_either() -> None:
    desk = Desk(timeout_s=0.05)
    desk.to_server = lose(0)
    desk.at(0.06, lambda: stop(desk))  # the first attempt has timed out, the second is still to come
    with pytest.raises(SdoError, match="given up"):
        desk.sdo.write(ParameterValue(CONTROLWORD, 0x0F))
    assert desk.asked[-1] == STOP


def test_the_confirmation_of_the_word_before_is_not_that_of_the_stop() -> None:
    """Both words are confirmed alike. The stop's frame is lost: one confirmation comes, and it is not the stop's."""
    desk = Desk(timeout_s=0.5)
    outcomes: list[Outcome] = []
    desk.at(0.0002, lambda: outcomes.append(stop(desk)))
    desk.to_server = lose(1)
    with pytest.raises(SdoError, match="given up"):
        desk.sdo.write(ParameterValue(CONTROLWORD, 0x0F))
    assert outcomes == [Outcome.NOT_ANSWERED]
    assert not outcomes[0]
    assert desk.objects.written == [(0x6040, b"\x0f\0")]
    assert stop(desk) is Outcome.CONFIRMED  # once more, and nothing is owed any longer
    assert desk.objects.written[-1] == (0x6040, b"\2\0")


def test_both_confirmed_is_confirmed() -> None:
    desk = Desk(timeout_s=0.5)
    outcomes: list[Outcome] = []
    desk.at(0.0002, lambda: outcomes.append(stop(desk)))
    with pytest.raises(SdoError, match="given up"):
        desk.sdo.write(ParameterValue(CONTROLWORD, 0x0F))
    assert outcomes == [Outcome.CONFIRMED]
    assert desk.objects.written == [(0x6040, b"\x0f\0"), (0x6040, b"\2\0")]


def test_a_refused_read_of_the_word_is_not_a_refused_stop() -> None:
    def write_only(objects: Objects, answer: Serve) -> Serve:
        serve = bench_server(objects, answer)
        refusal = struct.pack("<BHBI", 0x80, 0x6040, 0, 0x06010001)
        return lambda frame: answer(refusal) if frame[:4] == b"\x40\x40\x60\0" else serve(frame)

    desk = Desk(write_only)
    outcomes: list[Outcome] = []
    desk.at(0.0002, lambda: outcomes.append(stop(desk)))
    assert desk.sdo.read_integer(0x6040, 0, "UNSIGNED16") is None
    assert outcomes == [Outcome.CONFIRMED]
    assert len(desk.asked) == 3  # the read, the stop, and the read anew


def test_confirmed_refused_and_not_answered_are_told_apart_and_nothing_is_raised() -> None:
    desk = Desk()
    assert stop(desk) is Outcome.CONFIRMED
    assert stop(desk)
    assert desk.sdo.write_once(Parameter(0x1018, 1, "UNSIGNED32"), 1, PATIENCE_S) is Outcome.REFUSED
    assert not desk.sdo.write_once(Parameter(0x5FFF, 0, "UNSIGNED32"), 1, PATIENCE_S)
    desk.to_server = lose(*range(100))
    began = desk.clock.now()
    assert stop(desk) is Outcome.NOT_ANSWERED
    assert not Outcome.NOT_ANSWERED
    assert desk.clock.now() - began == pytest.approx(PATIENCE_S)
    assert (
        desk.sdo.write_once(CONTROLWORD, 1 << 20, PATIENCE_S) is Outcome.NOT_ANSWERED
    )  # does not fit the type

    def fail(can_id: int, data: bytes) -> None:
        raise BusError("can0", "the send buffer stays full")

    desk.link.send = fail  # type: ignore[method-assign]
    assert stop(desk) is Outcome.NOT_ANSWERED


def test_answers_for_others_do_not_confirm_a_stop() -> None:
    desk = Desk(lambda objects, answer: lambda frame: None)
    for late in (
        "6041600000000000",
        "8041600000000206",
        "6060600000000000",
        "4b40600002000000",
        "2000",
        "a2",
    ):
        desk.at(0.001, lambda late=late: desk.answer(bytes.fromhex(late)))  # type: ignore[misc]
    assert stop(desk) is Outcome.NOT_ANSWERED


def test_a_segment_that_looks_like_the_confirmation_does_not_confirm_a_stop() -> None:
    """Segment 96 of a block is 0x60, and its first bytes are those of 6040. The stop's frame is lost."""
    desk = Desk(timeout_s=0.05)
    looks = b"\x40\x60\0" + b"\2\0\0\0"
    desk.objects.values[USER_DATA.index, 0] = content(7 * 95) + looks + content(1000)
    outcomes: list[Outcome] = []
    desk.at(0.004, lambda: outcomes.append(stop(desk)))  # segments 1 to 30 have come
    desk.to_server = lambda number, frame: () if frame == STOP else (0.0,)
    assert desk.sdo.upload(USER_DATA, block=True) == desk.objects.values[USER_DATA.index, 0]
    assert b"\x60" + looks in desk.answered[: 2 + 127]
    assert outcomes == [Outcome.NOT_ANSWERED]


def test_nor_does_it_confirm_a_second_stop() -> None:
    desk = Desk(timeout_s=0.05)
    looks = b"\x40\x60\0" + b"\2\0\0\0"
    desk.objects.values[USER_DATA.index, 0] = content(7 * 95) + looks + content(1000)
    outcomes: list[Outcome] = []
    desk.at(0.004, lambda: outcomes.append(desk.sdo.write_once(MODE, 8, 0.001)))
    desk.at(0.0045, lambda: outcomes.append(stop(desk)))
    desk.to_server = lambda number, frame: () if frame[0] in (0x2B, 0x2F) else (0.0,)
    assert desk.sdo.upload(USER_DATA, block=True) == desk.objects.values[USER_DATA.index, 0]
    assert outcomes == [Outcome.NOT_ANSWERED] * 2


@pytest.mark.parametrize("name", ["segmented upload", "segmented download", "block upload", "block download"])
def test_a_read_within_a_transfer_ends_it_for_the_server_too(name: str) -> None:
    """A timer may read while the main flow waits within a transfer, and both come right."""
    desk = Desk(strict_server)
    read: list[object] = []
    desk.at(0.005, lambda: read.append(desk.sdo.read(STATUSWORD).raw))
    TRANSFERS[name](desk)
    assert read == [0x237]
    assert struct.pack("<BHBI", 0x80, 0x2010, 0, 0x08000000) in desk.asked


def test_a_stop_while_nobody_answers_waits_for_itself_alone() -> None:
    desk = Desk(lambda objects, answer: lambda frame: None, timeout_s=0.5)
    outcomes: list[Outcome] = []
    ended: list[float] = []
    desk.at(0.3, lambda: (outcomes.append(stop(desk)), ended.append(desk.clock.now())))
    with pytest.raises(SdoError, match="no answer"):
        desk.sdo.read(STATUSWORD)
    assert outcomes == [Outcome.NOT_ANSWERED]
    assert ended == [pytest.approx(0.3 + PATIENCE_S)]


def test_a_transfer_does_not_begin_before_a_stop_was_answered() -> None:
    """A server with room for one frame would lose one of the two."""
    desk = Desk()
    desk.objects.values[USER_DATA.index, 0] = content(SIZE)
    began: list[float] = []
    read: list[object] = []
    desk.at(0.005, lambda: (stop(desk), began.append(desk.clock.now())))
    desk.at(0.0051, lambda: read.append(desk.sdo.read(STATUSWORD).raw))
    assert desk.sdo.upload(USER_DATA) == content(SIZE)
    asked_s = desk.at_s[desk.asked.index(bytes.fromhex("4041600000000000"))]
    assert asked_s > 0.005 + TURN_AROUND_S
    assert read == [0x237]


def test_a_read_within_a_stop_that_nobody_answers_begins_when_the_stop_has_waited_enough() -> None:
    desk = Desk()
    desk.to_server = lambda number, frame: () if frame[0] == 0x2B else (0.0,)
    read: list[float] = []
    for when_s in (0.01, 0.02, 0.03):
        desk.at(when_s, lambda: (desk.sdo.read(STATUSWORD), read.append(desk.clock.now())))
        desk.at(when_s + 0.001, lambda: desk.sdo.write_once(MODE, 8, 0.001))
    assert stop(desk) is Outcome.NOT_ANSWERED
    assert len(read) == 3
    assert read[0] == pytest.approx(PATIENCE_S, abs=0.01)


def test_a_write_within_a_stop_that_nobody_answers_does_not_confirm_it() -> None:
    desk = Desk()
    desk.to_server = lose(0)
    desk.at(0.001, lambda: desk.sdo.write(ParameterValue(CONTROLWORD, 0)))
    assert stop(desk) is Outcome.NOT_ANSWERED
    assert desk.asked == [STOP, STOP[:4] + bytes(4)]


def test_a_stop_between_two_frames_of_a_sub_block_lets_no_other_through() -> None:
    """As from a signal's handler: what followed would be commands, to a server that waits for no segment any more."""
    desk = Desk()
    send, outcomes = desk.link.send, list[Outcome]()

    def sending(can_id: int, data: bytes) -> None:
        send(can_id, data)
        if len(desk.asked) == 20:
            outcomes.append(stop(desk))

    desk.link.send = sending  # type: ignore[method-assign]
    desk.sdo.download(USER_DATA, content(SIZE), block=True)
    assert desk.objects.values[USER_DATA.index, 0] == content(SIZE)
    assert outcomes == [Outcome.CONFIRMED]
    assert [frame[0] for frame in desk.asked[19:23]] == [19, 0x80, 0x2B, 0xC6]


def test_a_stop_that_is_asked_for_is_ahead_of_a_transfer_that_goes_on_sending() -> None:
    """Another thread may win the lock again and again, a frame at a time."""
    desk = Desk()
    turns = desk.sdo._turns
    tries: list[str] = []

    class Contended:
        def __enter__(self) -> None:
            if tries == ["armed"]:
                tries.append("tried")
                with pytest.raises(PreemptedError):
                    turns._turn.send(bytes(8))  # type: ignore[union-attr]

        def __exit__(self, *_: object) -> None:
            pass

    def interrupted(talk: Talk) -> bytes:
        turns._sending = Contended()
        tries.append("armed")
        assert stop(desk)
        return b""

    desk.by_block(interrupted)
    assert tries == ["armed", "tried"]
    assert desk.asked == [STOP]


def test_a_lost_read_of_the_word_owes_the_stop_no_confirmation() -> None:
    desk = Desk()
    desk.to_server = lose(0)
    outcomes: list[Outcome] = []
    desk.at(0.0002, lambda: outcomes.append(stop(desk)))
    assert desk.sdo.read(CONTROLWORD).raw == 2
    assert outcomes == [Outcome.CONFIRMED]


def test_stops_within_stops_and_reads_within_reads() -> None:
    """Timers interrupt one another: a read in an upload, a stop in the read, a read in the stop."""
    desk = Desk()
    desk.objects.values[USER_DATA.index, 0] = content(SIZE)
    outcomes: list[Outcome] = []
    read: list[object] = []
    desk.at(0.0050, lambda: read.append(desk.sdo.read(STATUSWORD).raw))
    desk.at(0.0051, lambda: outcomes.append(stop(desk)))
    desk.at(0.0052, lambda: read.append(desk.sdo.read(STATUSWORD).raw))
    desk.at(0.0053, lambda: outcomes.append(stop(desk)))
    desk.at(0.0054, lambda: outcomes.append(desk.sdo.write_once(MODE, 8, PATIENCE_S)))
    assert desk.sdo.upload(USER_DATA) == content(SIZE)
    assert read == [0x237, 0x237]
    assert outcomes == [Outcome.CONFIRMED] * 3
    for frame in (STOP, struct.pack("<BHBBxxx", 0x2F, 0x6060, 0, 8)):
        assert frame in desk.asked


def test_a_write_within_a_write_of_the_same_object_is_the_last_word() -> None:
    desk = Desk()
    desk.at(0.0002, lambda: desk.sdo.write(ParameterValue(MODE, 3)))
    with pytest.raises(SdoError, match="given up"):
        desk.sdo.write(ParameterValue(MODE, 8))
    desk.clock.sleep(1.0)
    assert desk.objects.values[MODE.index, 0] == b"\3"


def test_a_read_that_is_interrupted_for_ever_says_so() -> None:
    desk = Desk()
    desk.objects.values[USER_DATA.index, 0] = content(SIZE)
    task = desk.clock.every(0.01, lambda: stop(desk))
    with pytest.raises(SdoError, match="interrupting"):
        desk.sdo.upload(USER_DATA)
    task.close()
    assert desk.sdo.read(STATUSWORD).raw == 0x237


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(sorted(TRANSFERS)),
    server=st.sampled_from(SERVERS[:2]),
    stops_s=st.lists(st.floats(1e-6, 0.05), min_size=1, max_size=4, unique=True),
    late=st.dictionaries(st.integers(0, 60), st.floats(0, 0.003), max_size=3),
)
def test_stops_are_confirmed_only_where_they_were_carried_out(
    name: str, server: MakeServer, stops_s: list[float], late: dict[int, float]
) -> None:
    """Each stop writes another word; answers of the server come late, but in order."""
    desk = Desk(server)
    desk.to_client = stalled(desk.clock, late)
    outcomes: dict[int, Outcome] = {}
    for word, when_s in enumerate(sorted(stops_s), start=100):
        desk.at(
            when_s,
            lambda word=word: outcomes.update({word: desk.sdo.write_once(CONTROLWORD, word, PATIENCE_S)}),  # type: ignore[misc]
        )
    TRANSFERS[name](desk)
    desk.clock.sleep(max(0.0, 0.3 - desk.clock.now()))
    carried_out = [struct.unpack("<H", data)[0] for index, data in desk.objects.written if index == 0x6040]
    assert len(outcomes) == len(stops_s)
    assert carried_out == sorted(carried_out)
    assert {word for word, outcome in outcomes.items() if outcome} <= set(carried_out)
