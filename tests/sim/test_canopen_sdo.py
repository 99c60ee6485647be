"""The drive's SDO server, against frames of the standard and against canopen's client."""

import binascii
import struct

import pytest
from canopen.sdo.exceptions import SdoAbortedError
from canopen_rig import NODE, Aborted, Rig
from hypothesis import given, settings
from hypothesis import strategies as st

USER_DATA = 0x2010  # DOMAIN, rw
sizes = st.one_of(st.integers(0, 40), st.integers(880, 900), st.integers(0, 5000))
RIG = Rig()
CLIENT = RIG.client()


@pytest.fixture
def rig() -> Rig:
    return Rig()


def content(size: int) -> bytes:
    return bytes((7 * i + i // 256) % 251 for i in range(size))


@settings(max_examples=60, deadline=None)
@given(size=sizes)
def test_segmented_both_ways(size: int) -> None:
    data = content(size)
    CLIENT.sdo.download(USER_DATA, 0, data, force_segment=True)
    assert CLIENT.sdo.upload(USER_DATA, 0) == data


@settings(max_examples=60, deadline=None)
@given(size=sizes.filter(bool), crc=st.booleans())
def test_block_both_ways(size: int, crc: bool) -> None:
    data = content(size)
    CLIENT.sdo[USER_DATA].raw = b"old"
    with CLIENT.sdo[USER_DATA].open(
        "wb", size=size, buffering=7, block_transfer=True, request_crc_support=crc
    ) as stream:
        stream.write(data)
    assert RIG.servo.dictionary.values[USER_DATA << 8] == data
    with CLIENT.sdo[USER_DATA].open("rb", block_transfer=True, request_crc_support=crc) as stream:
        assert stream.raw.size == size
        assert stream.read() == data


def test_strings_and_numbers_read_as_the_eds_says() -> None:
    assert CLIENT.sdo[0x1008].raw == "Schwung bench drive"
    assert CLIENT.sdo[0x1018][1].raw == 0x53574E47
    assert CLIENT.sdo[0x1018][2].raw == 0x402
    assert CLIENT.sdo[0x607D][1].raw == -(2**21)
    assert CLIENT.sdo[0x60C2][2].raw == -3


def test_every_readable_object_can_be_read_and_has_the_declared_length() -> None:
    empty = {0x1003}
    for item in CLIENT.object_dictionary.values():
        for variable in item.subindices.values() if hasattr(item, "subindices") else [item]:
            if variable.index < 0x1000 or (variable.index in empty and variable.subindex):
                continue
            raw = CLIENT.sdo.upload(variable.index, variable.subindex)
            if variable.fixed_size:
                assert 8 * len(raw) == len(variable), hex(variable.index)


@pytest.mark.parametrize(
    ("index", "subindex", "value", "size", "code"),
    [
        (0x5FFF, 0, 1, 1, 0x06020000),  # no such object
        (0x1018, 9, 1, 4, 0x06090011),  # no such sub-index
        (0x6041, 0, 1, 2, 0x06010002),  # read only
        (0x1008, 0, 1, 4, 0x06010002),  # const
        (0x6065, 0, 1, 2, 0x06070013),  # too short
        (0x6060, 0, 1, 2, 0x06070012),  # too long
        (0x6072, 0, 3330, 2, 0x06090031),  # above its limit
        (0x605D, 0, 0, 2, 0x06090032),  # below its limit
        (0x6060, 0, 3, 1, 0x06090030),  # a mode that it does not have
        (0x60A9, 0, 0x12345678, 4, 0x06090030),  # a unit that it does not have
        (0x1010, 1, 0x12345678, 4, 0x08000020),  # not the signature
        (0x1006, 0, 333, 4, 0x06090030),  # not whole control ticks
        (0x1019, 0, 1, 1, 0x06090030),  # reserved
        (0x1005, 0, 0x40000080, 4, 0x06090030),  # it does not produce SYNC
        (0x1016, 1, 0x800010, 4, 0x06090030),  # node 128
    ],
)
def test_refused_downloads(rig: Rig, index: int, subindex: int, value: int, size: int, code: int) -> None:
    with pytest.raises(Aborted) as caught:
        rig.write(index, subindex, value, size)
    assert caught.value.code == code


def test_refused_value_changes_nothing(rig: Rig) -> None:
    with pytest.raises(Aborted):
        rig.write(0x6072, 0, 4000, 2)
    assert rig.read(0x6072) == 3329


def test_one_heartbeat_time_for_one_node(rig: Rig) -> None:
    rig.write(0x1016, 1, 0x007F0064, 4)
    with pytest.raises(Aborted) as caught:
        rig.write(0x1016, 2, 0x007F00C8, 4)
    assert caught.value.code == 0x06040043
    rig.write(0x1016, 1, 0x007F00C8, 4)  # the same sub-index may be changed


def test_sync_counter_cannot_change_while_a_period_is_set(rig: Rig) -> None:
    rig.write(0x1006, 0, 1000, 4)
    with pytest.raises(Aborted) as caught:
        rig.write(0x1019, 0, 240, 1)
    assert caught.value.code == 0x08000022


def test_empty_error_history_has_no_data(rig: Rig) -> None:
    assert rig.read(0x1003, 0) == 0
    with pytest.raises(Aborted) as caught:
        rig.read(0x1003, 1)
    assert caught.value.code == 0x08000024


def test_expedited_download_without_size_takes_the_objects_own(rig: Rig) -> None:
    (reply,) = rig.ask(struct.pack("<BHBI", 0x22, 0x6066, 0, 0xFFFF0042))
    assert reply[0] == 0x60
    assert rig.read(0x6066) == 0x42


def test_wrong_toggle_is_aborted_and_ends_the_transfer(rig: Rig) -> None:
    rig.ask(struct.pack("<BHBI", 0x21, USER_DATA, 0, 14))
    assert rig.ask(b"\x00" + b"abcdefg") == [b"\x20" + bytes(7)]
    (reply,) = rig.ask(b"\x00" + b"hijklmn")  # again toggle 0
    assert reply == struct.pack("<BHBI", 0x80, USER_DATA, 0, 0x05030000)
    (reply,) = rig.ask(b"\x11" + b"hijklmn")
    assert struct.unpack_from("<I", reply, 4)[0] == 0x05040001
    assert rig.servo.dictionary.values[USER_DATA << 8] == b""


def test_upload_toggle(rig: Rig) -> None:
    rig.ask(struct.pack("<BHB", 0x40, 0x1008, 0))
    assert rig.ask(b"\x60")[0][1:] == b"Schwung"
    assert struct.unpack_from("<I", rig.ask(b"\x60")[0], 4)[0] == 0x05030000


@pytest.mark.parametrize(("announced", "code"), [(8, 0x06070013), (6, 0x06070012)])
def test_segments_that_do_not_add_up(rig: Rig, announced: int, code: int) -> None:
    rig.ask(struct.pack("<BHBI", 0x21, USER_DATA, 0, announced))
    (reply,) = rig.ask(b"\x01" + b"abcdefg")
    assert struct.unpack_from("<I", reply, 4)[0] == code


def test_number_by_segments_is_checked_before_its_data(rig: Rig) -> None:
    (reply,) = rig.ask(struct.pack("<BHBI", 0x21, 0x6065, 0, 5))
    assert struct.unpack_from("<I", reply, 4)[0] == 0x06070012


def test_silent_client_is_timed_out(rig: Rig) -> None:
    rig.ask(struct.pack("<BHBI", 0x21, USER_DATA, 0, 14))
    rig.wait(0.9)
    assert rig.take(0x580 + NODE) == []
    rig.wait(0.2)
    assert rig.take(0x580 + NODE) == [struct.pack("<BHBI", 0x80, USER_DATA, 0, 0x05040000)]


def test_client_abort_frees_the_server(rig: Rig) -> None:
    rig.ask(struct.pack("<BHBI", 0x21, USER_DATA, 0, 14))
    assert rig.ask(struct.pack("<BHBI", 0x80, USER_DATA, 0, 0x08000000)) == []
    rig.wait(1.5)
    assert rig.take(0x580 + NODE) == []


def test_a_new_request_replaces_a_transfer(rig: Rig) -> None:
    rig.ask(struct.pack("<BHBI", 0x21, USER_DATA, 0, 14))
    assert rig.read(0x1018, 2) == 0x402


def test_unknown_command_and_short_frame(rig: Rig) -> None:
    assert struct.unpack_from("<I", rig.ask(b"\xe0")[0], 4)[0] == 0x05040001
    rig.give(0x600 + NODE, b"\x40\x18\x10")
    assert rig.take(0x580 + NODE) == []


# -- block transfer, frame by frame --


def start_block_download(rig: Rig, size: int) -> None:
    (reply,) = rig.ask(struct.pack("<BHBI", 0xC6, USER_DATA, 0, size))
    assert reply == struct.pack("<BHBB3x", 0xA4, USER_DATA, 0, 127)


def test_lost_segment_is_asked_for_again(rig: Rig) -> None:
    data = content(21)
    start_block_download(rig, 21)
    assert rig.ask(b"\x01" + data[:7]) == []
    assert rig.ask(b"\x83" + data[14:]) == [b"\xa2\x01\x7f" + bytes(5)]  # segment 2 is missing: go on after 1
    assert rig.ask(b"\x01" + data[7:14]) == []
    assert rig.ask(b"\x82" + data[14:]) == [b"\xa2\x02\x7f" + bytes(5)]
    assert rig.ask(struct.pack("<BH", 0xC1, binascii.crc_hqx(data, 0))) == [b"\xa1" + bytes(7)]
    assert rig.servo.dictionary.values[USER_DATA << 8] == data


def test_wrong_crc_is_refused(rig: Rig) -> None:
    data = content(7)
    start_block_download(rig, 7)
    rig.ask(b"\x81" + data)
    (reply,) = rig.ask(struct.pack("<BH", 0xC1, binascii.crc_hqx(data, 0) ^ 1))
    assert reply == struct.pack("<BHBI", 0x80, USER_DATA, 0, 0x05040004)
    assert rig.servo.dictionary.values[USER_DATA << 8] == b""


def test_client_may_abort_amid_a_block(rig: Rig) -> None:
    start_block_download(rig, 700)
    rig.ask(b"\x01" + bytes(7))
    assert rig.ask(struct.pack("<BHBI", 0x80, USER_DATA, 0, 0x08000000)) == []
    assert rig.read(0x1018, 2) == 0x402


def test_block_upload_resends_from_the_acknowledged_segment(rig: Rig) -> None:
    data = content(30)
    rig.servo.dictionary.values[USER_DATA << 8] = data
    (reply,) = rig.ask(struct.pack("<BHBBB", 0xA4, USER_DATA, 0, 3, 0))
    assert reply == struct.pack("<BHBI", 0xC6, USER_DATA, 0, 30)
    first = rig.ask(b"\xa3")
    assert [frame[0] for frame in first] == [1, 2, 3]
    again = rig.ask(b"\xa2\x01\x7f")  # only one came, and now up to 127 may come
    assert [frame[0] for frame in again] == [1, 2, 3, 0x84]
    received = first[0][1:] + b"".join(frame[1:] for frame in again)
    assert received[:30] == data
    (end,) = rig.ask(b"\xa2\x04\x7f")
    assert end[:3] == struct.pack("<BH", 0xC1 | 5 << 2, binascii.crc_hqx(data, 0))
    assert rig.ask(b"\xa1") == []


@pytest.mark.parametrize("segments", [0, 128])
def test_impossible_block_size(rig: Rig, segments: int) -> None:
    (reply,) = rig.ask(struct.pack("<BHBBB", 0xA0, USER_DATA, 0, segments, 0))
    assert struct.unpack_from("<I", reply, 4)[0] == 0x05040002


def test_small_objects_fall_back_to_the_plain_protocol(rig: Rig) -> None:
    (reply,) = rig.ask(struct.pack("<BHBBB", 0xA0, 0x1018, 2, 127, 8))
    assert reply == struct.pack("<BHBI", 0x43, 0x1018, 2, 0x402)


def test_a_domain_has_an_end(rig: Rig) -> None:
    (reply,) = rig.ask(struct.pack("<BHBI", 0x21, USER_DATA, 0, 65537))
    assert struct.unpack_from("<I", reply, 4)[0] == 0x06070012


# -- what the bench can make of it --


def test_sabotaged_objects() -> None:
    rig = Rig()
    client = rig.client()
    rig.servo.sdo.aborts[0x6065] = 0x08000021
    with pytest.raises(SdoAbortedError) as caught:
        client.sdo.upload(0x6065, 0)
    assert caught.value.code == 0x08000021
    rig.servo.sdo.silent.add(0x6064)
    assert rig.ask(struct.pack("<BHB", 0x40, 0x6064, 0)) == []


def test_no_sdo_while_stopped(rig: Rig) -> None:
    rig.nmt(2)
    assert rig.ask(struct.pack("<BHB", 0x40, 0x1018, 2)) == []
    rig.nmt(0x80, 0)
    assert rig.read(0x1018, 2) == 0x402
