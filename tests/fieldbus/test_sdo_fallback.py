"""Block transfer where the server refuses it, breaks it off or forgets it: another way is found, or it is said why."""

from __future__ import annotations

import can
import pytest
from sdo_desk import STATUSWORD, USER_DATA, Desk, content, holding, lose

from schwung.errors import SdoError
from schwung.fieldbus.canopen.abort import AbortedError
from schwung.fieldbus.canopen.block import BlockDownload
from schwung.fieldbus.canopen.turns import Talk
from schwung.fieldbus.drive import Parameter
from schwung_sim.drives.dictionary import AbortError

MOTIONLESS = bytes.fromhex("4b41600037020000")  # 6041 = 0x0237


def test_an_abort_that_comes_while_segments_are_sent_ends_them() -> None:
    """What follows would be commands to a server that waits for no segment any more."""
    desk = Desk(attempts=1)
    send, abort = desk.link.send, bytes.fromhex("8010200000000008")

    def sending(can_id: int, data: bytes) -> None:
        send(can_id, data)
        if len(desk.asked) == 20:
            desk.link._receive(can.Message(arbitration_id=0x585, data=abort, is_extended_id=False))

    desk.link.send = sending  # type: ignore[method-assign]
    desk.by_block(until_aborted)
    assert len(desk.asked) == 20


def until_aborted(talk: Talk) -> bytes:
    with pytest.raises(AbortedError):
        BlockDownload(talk, content(2000)).run()
    return b""


def broken_off(desk: Desk, times: int, code: int = 0x08000000) -> None:
    """The server aborts so many block uploads midway."""
    server = desk._server.__closure__[0].cell_contents
    left, send_block = [times], server._send_block

    def breaking(transfer: object) -> None:
        if transfer.position > 5000 and left[0]:  # type: ignore[attr-defined]
            left[0] -= 1
            raise AbortError(code)
        send_block(transfer)

    server._send_block = breaking


@pytest.mark.parametrize(
    "code", [0x08000000, 0x05040001]
)  # the latter also says that it has no blocks, but not here
@pytest.mark.parametrize("times", [1, 5])
def test_a_server_that_aborts_midway_is_asked_again_and_then_for_segments(times: int, code: int) -> None:
    desk = holding(8000)
    broken_off(desk, times, code)
    assert desk.sdo.upload(USER_DATA, block=True) == content(8000)
    assert [request[0] for request in desk.asked].count(0xA4) == 2
    assert (len(desk.asked) > 1000) == (times > 1)
    assert desk.sdo.serves_blocks


def test_a_server_without_block_upload_is_asked_for_it_once() -> None:
    desk = holding(100)
    server = desk._server.__closure__[0].cell_contents

    def refused(index: int, subindex: int, frame: bytes) -> None:
        raise AbortError(0x05040001)

    server._start_block_upload = refused
    for _ in range(2):
        assert desk.sdo.upload(USER_DATA, block=True) == content(100)
    assert [request[0] for request in desk.asked].count(0xA4) == 1
    assert not desk.sdo.serves_blocks


def test_an_object_that_is_not_there_and_a_drive_that_is_not_are_told_apart_by_block_too() -> None:
    desk = holding(100)
    with pytest.raises(SdoError, match=r"sub-index does not exist"):
        desk.sdo.upload(Parameter(0x2010, 9, "DOMAIN"), block=True)
    desk.to_server = lambda number, frame: ()
    with pytest.raises(SdoError, match="no answer"):
        desk.sdo.upload(USER_DATA, block=True)
    desk.to_server = lose()
    assert desk.sdo.upload(USER_DATA, block=True) == content(100)


def test_what_is_left_of_a_broken_block_is_not_taken_for_the_next_answer() -> None:
    """The interrupt comes with a hundred segments still on their way; one of them looks like an answer of 6041."""
    looks = MOTIONLESS[1:4] + bytes(4)
    number = MOTIONLESS[0]  # of the segment, too
    desk = Desk()
    desk.objects.values[USER_DATA.index, 0] = content(7 * (number - 1)) + looks + content(200)

    def interrupt() -> None:
        raise KeyboardInterrupt

    desk.at(0.005, interrupt)
    with pytest.raises(KeyboardInterrupt):
        desk.sdo.upload(USER_DATA, block=True)
    assert len(desk.answered) > number
    assert desk.sdo.read(STATUSWORD).raw == 0x237
    assert desk.sdo.upload(USER_DATA, block=True) == desk.objects.values[USER_DATA.index, 0]
