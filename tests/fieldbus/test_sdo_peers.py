"""Our SDO client beside canopen's, and against canopen's server: the same frames, the same bytes."""

from __future__ import annotations

import canopen
import pytest
from sdo_desk import (
    MODE,
    NODE,
    READ_ONLY,
    REQUEST,
    USER_DATA,
    Desk,
    Objects,
    Outlet,
    bench_server,
    canopen_server,
    content,
)

from schwung.errors import SdoError
from schwung.fieldbus.canopen.block import SEGMENTS
from schwung.fieldbus.drive import Parameter, ParameterValue

SIZES = [*range(71), *range(71, 880, 13), *range(880, 900), *range(900, 1001, 9)]
NUMBER = Parameter(USER_DATA.index, 0, "UNSIGNED32")  # the same object, but not as a domain


class Canopen:
    """canopen's client, wired to the bench drive's server without time in between; its frames."""

    def __init__(self) -> None:
        self.objects = Objects()
        self.asked: list[bytes] = []
        self.client = canopen.sdo.SdoClient(REQUEST, 0x580 + NODE, canopen.ObjectDictionary())
        serve = bench_server(self.objects, lambda frame: self.client.on_response(0x580 + NODE, frame, 0.0))

        def send(can_id: int, data: bytes) -> None:
            assert can_id == REQUEST
            self.asked.append(data)
            serve(data)

        self.client.network = Outlet(send)

    def upload(self, *, block: bool) -> bytes:
        with self.client.open(USER_DATA.index, 0, "rb", block_transfer=block, buffering=7) as stream:
            return bytes(stream.read())

    def download(self, data: bytes, *, block: bool, segmented: bool = False) -> None:
        if not block:
            self.client.download(USER_DATA.index, 0, data, force_segment=segmented)
            return
        with self.client.open(
            USER_DATA.index, 0, "wb", size=len(data), buffering=7, block_transfer=True
        ) as stream:
            stream.write(data)


@pytest.mark.parametrize("block", [False, True], ids=["plain", "block"])
def test_uploads_are_the_frames_that_canopen_sends(block: bool) -> None:
    peer, desk = Canopen(), Desk()
    for size in SIZES:
        if block and size == 0:
            continue  # canopen's breaks
        for objects in (peer.objects, desk.objects):
            objects.values[USER_DATA.index, 0] = content(size)
        peer.asked.clear()
        desk.asked.clear()
        assert desk.sdo.upload(USER_DATA, block=block) == peer.upload(block=block) == content(size)
        assert desk.asked == peer.asked, size


@pytest.mark.parametrize("way", ["plain", "segmented", "block"])
def test_downloads_are_the_frames_that_canopen_sends(way: str) -> None:
    peer, desk = Canopen(), Desk()
    for size in SIZES:
        if way == "block" and size == 0:
            continue
        peer.asked.clear()
        desk.asked.clear()
        peer.download(content(size), block=way == "block", segmented=way == "segmented")
        parameter = NUMBER if way == "plain" else USER_DATA
        desk.sdo.download(parameter, content(size), block=way == "block")
        assert desk.objects.values[USER_DATA.index, 0] == content(size)
        assert peer.objects.values[USER_DATA.index, 0] == content(size)
        assert desk.asked == peer.asked, size
    assert not desk.clock.wait(lambda: False, 1.0)
    assert len(desk.asked) == len(peer.asked)  # and nothing afterwards


def test_what_one_writes_the_other_reads() -> None:
    peer, desk = Canopen(), Desk()
    desk.objects = peer.objects
    desk._server = bench_server(peer.objects, desk.answer)
    for size in SIZES[1:]:
        desk.sdo.download(USER_DATA, content(size), block=True)
        assert peer.upload(block=True) == content(size)
        peer.download(content(size)[::-1], block=True)
        assert desk.sdo.upload(USER_DATA, block=True) == content(size)[::-1]


def test_canopens_server_is_read_and_written() -> None:
    desk = Desk(canopen_server)
    for size in SIZES:
        desk.sdo.download(NUMBER, content(size))
        assert desk.objects.values[USER_DATA.index, 0] == content(size)
        if size:  # else it aborts: no data available
            assert desk.sdo.upload(USER_DATA) == content(size)
    desk.sdo.write(ParameterValue(MODE, -3))
    assert desk.sdo.read(MODE).raw == -3


def test_a_server_that_answers_a_block_request_by_segments_is_followed() -> None:
    """As canopen's does, though nobody has allowed it to."""
    desk = Desk(canopen_server)
    for size in (1, 4, 5, 8, 1000):
        desk.objects.values[USER_DATA.index, 0] = content(size)
        desk.asked.clear()
        assert desk.sdo.upload(USER_DATA, block=True) == content(size)
        assert desk.asked[0].hex() == f"a41020007f{0:06x}"
        assert len(desk.asked) == (1 if size <= 4 else 1 + -(-size // 7))


def test_a_server_without_block_download_is_asked_for_it_once() -> None:
    desk = Desk(canopen_server)
    for _ in range(2):
        desk.sdo.download(USER_DATA, content(1000), block=True)
        assert desk.objects.values[USER_DATA.index, 0] == content(1000)
        desk.objects.values[USER_DATA.index, 0] = b""
    assert [frame[0] for frame in desk.asked].count(0xC6) == 1
    assert not desk.sdo.serves_blocks


@pytest.mark.parametrize("server", [bench_server, canopen_server])
def test_both_servers_refuse_alike(server: object) -> None:
    desk = Desk(server)  # type: ignore[arg-type]
    for parameter, words in (
        (Parameter(0x5FFF, 0, "UNSIGNED8"), "does not exist"),
        (Parameter(0x1018, 9, "UNSIGNED8"), "sub-index"),
    ):
        with pytest.raises(SdoError, match=words):
            desk.sdo.read(parameter)
        assert desk.sdo.read_integer(parameter.index, parameter.subindex, parameter.type) is None
    with pytest.raises(SdoError, match=r"refused to write it: .*read-only \(0x06010002\)"):
        desk.sdo.write(ParameterValue(READ_ONLY, 1))
    assert all(frame[0] != 0x80 for frame in desk.asked)


def test_sub_blocks_have_the_size_that_the_server_asks_for() -> None:
    desk = Desk()
    desk.sdo.download(USER_DATA, content(5000), block=True)
    numbers = [frame[0] & 0x7F for frame in desk.asked[1:-1]]
    assert max(numbers) == SEGMENTS
    assert numbers.count(1) == -(-5000 // (7 * SEGMENTS))
