"""SDO block upload, the client's side (CiA 301 clause 7.2.4.3.15 to 17): a domain in sub-blocks of 127 segments.

canopen's acknowledges in the middle of a sub-block at the first gap, and takes for new what a server then repeats.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Callable
from dataclasses import dataclass

SEGMENTS = 127  # of a sub-block: as many as the protocol allows
SEGMENT_BYTES = 7
#: Sub-blocks in a row of which no segment was of use: then the bus is worse than the protocol can mend.
MAX_IDLE_BLOCKS = 3

_INITIATE, _START, _ACKNOWLEDGE, _END, _ABORT = 0xA0, 0xA3, 0xA2, 0xA1, 0x80
_WITH_CRC = 0x04
_TIMED_OUT, _COMMAND, _CRC, _LENGTH, _GENERAL = 0x05040000, 0x05040001, 0x05040004, 0x06070010, 0x08000000

Send = Callable[[bytes], None]
Receive = Callable[[float], bytes | None]


class BlockError(Exception):
    """The transfer broke; the server was told so (SDO abort). A plain transfer may still work."""


class BlockAbortedError(Exception):
    """The server ended the transfer with this abort code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


@dataclass
class _SubBlock:
    """What came of one sub-block."""

    data: bytearray
    sequence: int = 0  # last segment in order
    last: bool = False  # it holds the end of the data


class BlockUpload:
    """One transfer. `receive` waits so many seconds for the server's next frame of 8 bytes; None: it was silent."""

    def __init__(self, send: Send, receive: Receive, index: int, subindex: int, timeout_s: float) -> None:
        self._send, self._receive, self._timeout_s = send, receive, timeout_s
        self._multiplexer = struct.pack("<HB", index, subindex)

    def run(self) -> bytes:
        """The object's bytes, checked against size and CRC as far as the server tells them.

        Segments that are lost are asked for again. Raises BlockError, BlockAbortedError, and what `send` raises.
        """
        try:
            return self._run()
        except BlockAbortedError:
            raise
        except BlockError as error:
            self._abort(error.args[1])
            raise
        except BaseException:  # Ctrl-C: the server shall not go on
            self._abort(_GENERAL)
            raise

    def _run(self) -> bytes:
        self._send(bytes([_INITIATE | _WITH_CRC]) + self._multiplexer + bytes([SEGMENTS, 0, 0, 0]))
        answer = self._next("no answer to the request")
        while answer[0] & 0xE1 != 0xC0 or answer[1:4] != self._multiplexer:  # late, and of an earlier request
            answer = self._next("no answer to the request")
        size = struct.unpack_from("<I", answer, 4)[0] if answer[0] & 2 else None
        checked = bool(answer[0] & _WITH_CRC)
        self._send(bytes([_START]) + bytes(7))
        data, idle = bytearray(), 0
        while True:
            block = self._sub_block()
            data += block.data
            idle = 0 if block.sequence else idle + 1
            if idle >= MAX_IDLE_BLOCKS:
                raise BlockError("no segment comes through", _TIMED_OUT)
            self._send(bytes([_ACKNOWLEDGE, block.sequence, SEGMENTS]) + bytes(5))
            if block.last:
                break
        end = self._next("the end is missing")
        if end[0] & 0xE3 != 0xC1:
            raise BlockError(f"unexpected end 0x{end[0]:02X}", _COMMAND)
        unused = end[0] >> 2 & 7
        whole = bytes(data[: len(data) - unused])
        if size is not None and len(whole) != size:
            raise BlockError(f"{len(whole)} of {size} bytes came", _LENGTH)
        if checked and binascii.crc_hqx(whole, 0) != struct.unpack_from("<H", end, 1)[0]:
            raise BlockError("the CRC is wrong", _CRC)
        self._send(bytes([_END]) + bytes(7))
        return whole

    def _sub_block(self) -> _SubBlock:
        """Segments up to the end of the sub-block: its last number, the end of the data, or silence after a gap.

        What comes after a gap is left: the acknowledgement names the last one in order, and the server goes on there.
        """
        block, heard = _SubBlock(bytearray()), False
        while True:
            frame = self._receive(self._timeout_s)
            if frame is None:
                if not heard:  # then nobody knows which acknowledgement the server has
                    raise BlockError("the segments stop", _TIMED_OUT)
                return block
            self._check_abort(frame)
            heard = True
            sequence = frame[0] & 0x7F
            if sequence == block.sequence + 1:
                block.sequence = sequence
                block.data += frame[1:]
                block.last = bool(frame[0] & 0x80)
            if sequence == SEGMENTS or frame[0] & 0x80:
                return block

    def _next(self, missing: str) -> bytes:
        frame = self._receive(self._timeout_s)
        if frame is None:
            raise BlockError(missing, _TIMED_OUT)
        self._check_abort(frame)
        return frame

    def _check_abort(self, frame: bytes) -> None:
        """An abort names the object, or none; a last segment that is the first of its sub-block begins with 0x81."""
        if frame[0] == _ABORT:
            raise BlockAbortedError(struct.unpack_from("<I", frame, 4)[0])

    def _abort(self, code: int) -> None:
        self._send(bytes([_ABORT]) + self._multiplexer + struct.pack("<I", code))
