"""SDO block transfer, the client's side (CiA 301 clauses 7.2.4.3.9 to 7.2.4.3.17): sub-blocks of up to 127 segments.

Lost segments are asked for, or sent, again; size and CRC are checked as far as the server knows them.
"""

from __future__ import annotations

import binascii
import struct
from dataclasses import dataclass

from schwung.fieldbus.canopen import abort
from schwung.fieldbus.canopen.abort import BrokenError, SilenceError
from schwung.fieldbus.canopen.transfer import SEGMENT_BYTES, is_uploaded, uploaded
from schwung.fieldbus.canopen.turns import Talk

SEGMENTS = 127  # of a sub-block: as many as the protocol allows
#: Sub-blocks in a row of which no segment was of use: then the bus is worse than the protocol can mend.
MAX_IDLE_BLOCKS = 3

_UPLOAD, _START, _ACKNOWLEDGE, _END_UPLOAD = 0xA0, 0xA3, 0xA2, 0xA1  # of the client
_DOWNLOAD, _END_DOWNLOAD = 0xC0, 0xC1
_WITH_CRC, _SIZED, _LAST = 0x04, 0x02, 0x80


class BlockError(BrokenError):
    """The block transfer broke; the server was told so (SDO abort). A plain transfer may still work."""


@dataclass
class _SubBlock:
    """What came of one sub-block."""

    data: bytearray
    sequence: int = 0  # last segment in order
    last: bool = False  # it holds the end of the data


class BlockUpload:
    """One upload. `run` raises BlockError, AbortedError, SilenceError, PreemptedError and BusError."""

    def __init__(self, talk: Talk) -> None:
        self._dialogue = talk
        self._ended_by = b""  # the frame that ended the sub-block before this one

    def run(self) -> bytes:
        """The object's bytes. A server that prefers plain segments, or one frame, is followed."""
        talk = self._dialogue
        talk.open = True
        head = bytes([_UPLOAD | _WITH_CRC]) + talk.multiplexer
        answer = talk.request(head + bytes([SEGMENTS, 0, 0, 0]), _answers_upload)
        if is_uploaded(answer):
            return uploaded(talk, answer)
        talk.in_block = True
        size = struct.unpack_from("<I", answer, 4)[0] if answer[0] & _SIZED else None
        self._ended_by = answer
        talk.send(bytes([_START]) + bytes(7))
        data = self._segments()
        while True:
            end = talk.answer(lambda frame: frame[0] & 0xE3 == 0xC1)
            whole = bytes(data[: len(data) - (end[0] >> 2 & 7)])
            wrong = _wrong(
                whole, size, struct.unpack_from("<H", end, 1)[0] if answer[0] & _WITH_CRC else None
            )
            if wrong is None:
                break
            if end != self._ended_by:  # else it may be the last segment, come twice
                raise wrong
        talk.send(bytes([_END_UPLOAD]) + bytes(7))
        return whole

    def _segments(self) -> bytearray:
        """The data of all sub-blocks, each acknowledged; the last segment's unused bytes are still at its end."""
        data, idle = bytearray(), 0
        while True:
            block = self._sub_block()
            data += block.data
            idle = 0 if block.sequence else idle + 1
            if idle >= MAX_IDLE_BLOCKS:
                raise BlockError("no segment comes through", abort.TIMED_OUT)
            self._dialogue.send(bytes([_ACKNOWLEDGE, block.sequence, SEGMENTS]) + bytes(5))
            if block.last:
                return data

    def _sub_block(self) -> _SubBlock:
        """Segments up to the end of the sub-block: its last number, the end of the data, or silence after a gap.

        What comes after a gap is left: the acknowledgement names the last one in order, and the server goes on there.
        """
        block, heard = _SubBlock(bytearray()), False
        while True:
            frame = self._dialogue.receive(self._dialogue.timeout_s)
            if frame is None:
                if not heard:  # then nobody knows which acknowledgement the server has
                    raise SilenceError("the segments stop")
                return block
            self._dialogue.check(frame)
            sequence, last = frame[0] & ~_LAST, bool(frame[0] & _LAST)
            if sequence == block.sequence + 1:
                block.sequence, block.last = sequence, last
                block.data += frame[1:]
            elif sequence == 0 or frame == self._ended_by:
                continue  # no segment; or one that came twice, and ends nothing any more
            heard = True
            if sequence == SEGMENTS or last:
                self._ended_by = frame
                return block


class BlockDownload:
    """One download of at least a byte. `run` raises as that of BlockUpload."""

    def __init__(self, talk: Talk, data: bytes) -> None:
        self._dialogue, self._data = talk, data

    def run(self) -> bytes:
        """Write the object; nothing comes back."""
        talk, data = self._dialogue, self._data
        talk.open = True
        head = bytes([_DOWNLOAD | _WITH_CRC | _SIZED]) + talk.multiplexer
        answer = talk.request(head + struct.pack("<I", len(data)), lambda frame: frame[0] & 0xE3 == 0xA0)
        talk.in_block = True
        position, idle, segments = 0, 0, _block_size(answer[4])
        while position < len(data):
            sent = self._send_block(position, segments)
            acknowledged = talk.answer(lambda frame: frame[0] & 0xE3 == 0xA2)
            if acknowledged[1] > sent:
                raise BlockError(f"{acknowledged[1]} of {sent} segments are acknowledged", abort.SEQUENCE)
            position += SEGMENT_BYTES * acknowledged[1]
            idle = 0 if acknowledged[1] else idle + 1
            if idle >= MAX_IDLE_BLOCKS:
                raise BlockError("no segment gets through", abort.TIMED_OUT)
            segments = _block_size(acknowledged[2])
        crc = binascii.crc_hqx(data, 0) if answer[0] & _WITH_CRC else 0
        unused = -len(data) % SEGMENT_BYTES
        talk.send(struct.pack("<BH5x", _END_DOWNLOAD | unused << 2, crc))
        talk.answer(lambda frame: frame[0] & 0xE3 == 0xA1)
        return b""

    def _send_block(self, position: int, segments: int) -> int:
        """One sub-block from `position` on; the number of its segments."""
        starts = range(position, len(self._data), SEGMENT_BYTES)[:segments]
        for sequence, start in enumerate(starts, start=1):
            last = _LAST if start + SEGMENT_BYTES >= len(self._data) else 0
            chunk = self._data[start : start + SEGMENT_BYTES]
            self._dialogue.send(bytes([last | sequence]) + chunk.ljust(SEGMENT_BYTES, b"\0"))
        return len(starts)


def _wrong(whole: bytes, size: int | None, crc: int | None) -> BlockError | None:
    """What contradicts the size and the CRC that the server tells, each where it does."""
    if size is not None and len(whole) != size:
        return BlockError(f"{len(whole)} of {size} bytes came", abort.LENGTH)
    if crc is not None and binascii.crc_hqx(whole, 0) != crc:
        return BlockError("the CRC is wrong", abort.CRC)
    return None


def _answers_upload(frame: bytes) -> bool:
    return frame[0] & 0xE1 == 0xC0 or is_uploaded(frame)


def _block_size(segments: int) -> int:
    if not 1 <= segments <= SEGMENTS:
        raise BlockError(f"sub-blocks of {segments} segments are asked for", abort.BLOCK_SIZE)
    return segments
