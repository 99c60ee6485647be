"""PDO layout and write order, emergencies, set-up values, SDO answers: against the bytes of the standards."""

from __future__ import annotations

from collections.abc import Iterator

import can
import numpy as np
import pytest

from schwung.clock import SteppedClock, Wire, clock_of
from schwung.errors import DriveError, InputError, NodeLostError, SdoError, StateError
from schwung.fieldbus import eds
from schwung.fieldbus.canopen import pdo, setup
from schwung.fieldbus.canopen.emcy import Emergency, describe_code
from schwung.fieldbus.canopen.link import Frame, Link
from schwung.fieldbus.canopen.nmt import HeartbeatProducer, NodeMonitor, OtherMasters
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.sync import measure_evenness
from schwung.fieldbus.drive import Acquisition, Parameter, ParameterValue
from schwung.fieldbus.profile import ObjectRef, load_profile

PROFILE = load_profile("schwung-bench")
DICTIONARY = eds.load_dictionary(PROFILE.eds_path, 5)


def lookup(index: int, subindex: int) -> Parameter | None:
    return eds.find_parameter(DICTIONARY, index, subindex)


LAYOUTS = pdo.layouts(PROFILE, lookup, 5)


def test_frames_are_little_endian_in_the_order_of_the_mapping() -> None:
    rpdo = LAYOUTS.rpdo
    packed = rpdo.pack({"6040:00": 0x000F, "607A:00": np.array([-2, 1]), "60B2:00": 0x1234}, 2)
    assert packed[:8].hex(" ") == "0f 00 fe ff ff ff 34 12"
    assert packed[8:16].hex(" ") == "0f 00 01 00 00 00 34 12"
    assert rpdo.can_id == 0x205
    assert [t.can_id for t in LAYOUTS.tpdos] == [0x185, 0x285]


def test_frames_are_unpacked_signed_and_short_ones_do_not_shift_others() -> None:
    records = LAYOUTS.tpdos[0].unpack([bytes.fromhex("3702ffffffff0100"), b"\x37\x02", bytes(8)])
    assert records["6064:00"].tolist() == [-1, 0, 0]
    assert records["6041:00"].tolist() == [0x237, 0x237, 0]


def test_a_frame_of_more_than_eight_bytes_is_refused() -> None:
    full = PROFILE.rpdos[0].model_copy(
        update={"entries": (*PROFILE.rpdos[0].entries, ObjectRef(index=0x6060, subindex=0))}
    )
    profile = PROFILE.model_copy(update={"pdo": (full, *PROFILE.tpdos)})
    with pytest.raises(InputError, match="9 bytes"):
        pdo.layouts(profile, lookup, 5)


def test_mapping_entries_hold_index_sub_index_and_bits() -> None:
    values = {(i, s): v for i, s, v in pdo.wanted(LAYOUTS.tpdos[0], present_cob_id=0xC0000185)}
    assert values == {
        (0x1800, 1): 0x40000185,
        (0x1800, 2): 1,
        (0x1A00, 1): 0x60410010,
        (0x1A00, 2): 0x60640020,
        (0x1A00, 3): 0x60770010,
        (0x1A00, 0): 3,
    }


def test_pdos_are_written_disabled_count_zero_entries_count_enabled() -> None:
    wanted = [
        ParameterValue(Parameter(i, s, "UNSIGNED32"), v)
        for i, s, v in pdo.wanted(LAYOUTS.tpdos[0], 0x40000185)
    ]
    order: list[tuple[int, int, object]] = []
    pdo.write_pdos(
        wanted, lookup, lambda p: 0x40000185,
        lambda v: order.append((v.parameter.index, v.parameter.subindex, v.raw)),
    )  # fmt: skip
    assert order == [
        (0x1800, 1, 0xC0000185), (0x1A00, 0, 0), (0x1A00, 1, 0x60410010), (0x1A00, 2, 0x60640020),
        (0x1A00, 3, 0x60770010), (0x1800, 2, 1), (0x1A00, 0, 3), (0x1800, 1, 0x40000185),
    ]  # fmt: skip


def test_the_sync_counter_is_written_while_the_period_is_zero() -> None:
    values = [
        ParameterValue(Parameter(i, 0, "UNSIGNED32"), v)
        for i, v in ((0x1006, 1000), (0x1019, 240), (0x6060, 8))
    ]
    order: list[tuple[int, object]] = []
    setup.write_ordered(values, lookup, lambda p: 500, lambda v: order.append((v.parameter.index, v.raw)))
    assert order == [(0x1006, 0), (0x1019, 240), (0x1006, 1000), (0x6060, 8)]


@pytest.mark.parametrize(
    ("rate", "value", "exponent"), [(1000, 1, -3), (500, 2, -3), (4000, 25, -5), (8000, 125, -6)]
)
def test_interpolation_period_is_value_times_power_of_ten(rate: float, value: int, exponent: int) -> None:
    held = {v.parameter.index * 256 + v.parameter.subindex: v.raw for v in setup.wanted_values(
        PROFILE, LAYOUTS, Acquisition("csp", rate), lookup, lambda p: None)}  # fmt: skip
    assert (held[0x60C201], held[0x60C202]) == (value, exponent)
    assert held[0x100600] == round(1e6 / rate)


def test_a_rate_that_the_drive_cannot_be_told_is_refused() -> None:
    with pytest.raises(InputError, match="60C2"):
        setup.wanted_values(PROFILE, LAYOUTS, Acquisition("csp", 3333.0), lookup, lambda p: None)


@pytest.mark.parametrize(
    ("held", "slot"),
    [((0, 0), 1), ((0x00030064, 0), 2), ((0x00030064, 0x007F012C), 2), ((0x30064, 0x40064), None)],
)
def test_a_free_heartbeat_consumer_is_taken_and_others_are_left(
    held: tuple[int, int], slot: int | None
) -> None:
    values = {0: 2, 1: held[0], 2: held[1]}
    assert setup.consumer_slot(lookup, lambda p: values[p.subindex]) == slot


def test_tpdos_that_the_profile_does_not_name_are_switched_off() -> None:
    present = {(0x1802, 1): 0x40000385, (0x1803, 1): 0xC0000485}
    wanted = setup.wanted_values(
        PROFILE, LAYOUTS, Acquisition("csp", 1000.0), lookup, lambda p: present.get((p.index, p.subindex))
    )
    assert [v.raw for v in wanted if v.parameter.index in (0x1802, 0x1803)] == [0xC0000385]


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x8611, "following error"),
        (0x8130, "heartbeat"),
        (0x2311, "continuous over-current"),
        (0x4ABC, "temperature"),
        (0x0000, "no error"),
        (0xB000, "unknown"),
    ],
)
def test_error_codes_are_told_in_words(code: int, words: str) -> None:
    assert words in describe_code(code)
    assert f"0x{code:04X}" in describe_code(code)


def test_an_emergency_is_decoded() -> None:
    emergency = Emergency.decode(bytes.fromhex("11862100deadbeef"), 1.0)
    assert (emergency.code, emergency.register, emergency.is_reset) == (0x8611, 0x21, False)
    assert "de ad be ef" in str(emergency)
    assert Emergency.decode(bytes(8), 1.0).is_reset


@pytest.fixture
def ends() -> Iterator[tuple[Link, can.BusABC]]:
    clock = SteppedClock()
    wire = Wire(clock)
    one, other = wire.bus(), wire.bus()
    link = Link(one)
    yield link, other
    link.close()
    other.shutdown()
    one.shutdown()


def serve(bus: can.BusABC, answers: dict[str, list[str]]) -> None:
    """Answer SDO requests (hex) with frames (hex)."""

    def answer(message: can.Message) -> None:
        if message.arbitration_id == 0x605:
            for frame in answers.get(message.data.hex(), []):
                bus.send(Frame(0x585, bytes.fromhex(frame)))

    clock_of(bus).read(bus, answer, lambda error: pytest.fail(str(error)))


def test_sdo_is_deaf_to_answers_for_other_objects(ends: tuple[Link, can.BusABC]) -> None:
    link, other = ends
    late = "4f60600008000000"  # 6060 = 8: the answer to an earlier request
    serve(other, {"4041600000000000": [late, "4b41600037020000"]})
    sdo = SdoChannel(link, 5, timeout_s=0.5)
    assert sdo.read(Parameter(0x6041, 0, "UNSIGNED16")).raw == 0x237


def test_a_refused_block_transfer_falls_back_to_segments(ends: tuple[Link, can.BusABC]) -> None:
    link, other = ends
    answers = {
        "a40022047f000000": ["8000220401000405"],  # block upload: command specifier unknown
        "4000220400000000": ["4100220409000000"],  # segmented, 9 bytes
        "6000000000000000": ["0001020304050607"],
        "7000000000000000": ["1b08090000000000"],
    }
    serve(other, answers)
    sdo = SdoChannel(link, 5, timeout_s=0.3)
    assert sdo.read(Parameter(0x2200, 4, "DOMAIN")).raw == bytes(range(1, 10))


def test_no_answer_is_an_sdo_error_and_the_next_one_comes_sooner(ends: tuple[Link, can.BusABC]) -> None:
    link, _ = ends
    sdo = SdoChannel(link, 5, timeout_s=0.1, attempts=3)
    took = []
    for _ in range(2):
        began = link.clock.now()
        with pytest.raises(SdoError, match=r"node 5, 0x6041:00.*no answer"):
            sdo.read(Parameter(0x6041, 0, "UNSIGNED16"))
        took.append(link.clock.now() - began)
    assert took[0] > 0.3
    assert took[1] < 0.25


def test_silence_restart_and_leaving_operational_are_trouble(ends: tuple[Link, can.BusABC]) -> None:
    link, other = ends
    monitor = NodeMonitor(link, 5)
    troubles: list[DriveError] = []
    monitor.on_trouble = troubles.append
    other.send(Frame(0x705, b"\x7f"))  # not watched yet: no trouble
    other.send(Frame(0x705, b"\x05"))
    assert monitor.wait_for("OPERATIONAL", 1.0)
    monitor.expect(0.06)
    other.send(Frame(0x705, b"\x7f"))
    other.send(Frame(0x705, b"\x00"))
    link.clock.sleep(0.1)
    monitor.check()
    assert [type(t) for t in troubles] == [NodeLostError] * 3
    assert ["left OPERATIONAL" in str(troubles[0]), "restarted" in str(troubles[1])] == [True, True]
    assert "no heartbeat" in str(troubles[2])


def test_our_heartbeat_is_sent_until_it_is_closed(ends: tuple[Link, can.BusABC]) -> None:
    link, other = ends
    producer = HeartbeatProducer(link, NodeMonitor(link, 5), OtherMasters(link), 0.02)
    link.clock.sleep(0.15)
    producer.close()
    link.clock.sleep(0.01)
    beats = []
    while (message := other.recv(0)) is not None:
        beats.append((message.arbitration_id, bytes(message.data)))
    assert len(beats) == 8
    assert set(beats) == {(0x77F, b"\x05")}
    assert other.recv(0.06) is None


@pytest.mark.parametrize("heard_s", [0.0, 0.9], ids=["at once", "late"])
def test_who_beats_as_we_do_keeps_us_from_beating(ends: tuple[Link, can.BusABC], heard_s: float) -> None:
    """A drive cannot tell two masters of one id apart: if one died, it would run on by the other's heartbeat."""
    link, other = ends
    masters = OtherMasters(link)
    link.clock.later(heard_s, lambda: other.send(Frame(0x77F, b"\x05")))
    with pytest.raises(StateError, match="another master"):
        HeartbeatProducer(link, NodeMonitor(link, 5), masters, 0.1)
    link.clock.sleep(1.0)
    assert other.recv(0) is None  # not one of ours went out


def test_who_begins_to_beat_as_we_do_is_trouble(ends: tuple[Link, can.BusABC]) -> None:
    link, other = ends
    monitor, troubles = NodeMonitor(link, 5), list[DriveError]()
    producer = HeartbeatProducer(link, monitor, OtherMasters(link), 0.1)
    monitor.on_trouble = troubles.append
    other.send(Frame(0x77F, b"\x05"))
    link.clock.sleep(0.01)
    producer.close()
    assert len(troubles) == 1
    assert "another master" in str(troubles[0])


def test_how_evenly_frames_go_out_is_measured_without_a_word_to_anybody(
    ends: tuple[Link, can.BusABC],
) -> None:
    link, other = ends
    timing = measure_evenness(link, 0.001)
    assert timing.period_s == pytest.approx(0.001, rel=1e-3)
    assert timing.max_s < 1e-6  # this clock keeps every deadline
    heard = list(iter(lambda: other.recv(0), None))
    assert len(heard) >= 500  # of half a second; the last may still be on its way
    assert {(m.arbitration_id, bytes(m.data)) for m in heard} == {(0x6FF, b"")}


@pytest.mark.parametrize(("misses", "silence_ms"), [(3, 300), (15, 1500)])
def test_how_many_heartbeats_may_be_missing_is_a_setting(misses: int, silence_ms: int) -> None:
    acquisition = Acquisition("csp", 1000.0, misses_allowed=misses)
    held = {(0x1016, 0): 4}  # four consumers, all free
    values = setup.wanted_values(
        PROFILE, LAYOUTS, acquisition, lookup, lambda p: held.get((p.index, p.subindex), 0)
    )
    consumer = next(v.raw for v in values if v.parameter.index == 0x1016)
    assert consumer == 0x7F << 16 | silence_ms
    assert acquisition.silence_allowed_s == pytest.approx(silence_ms / 1000)
