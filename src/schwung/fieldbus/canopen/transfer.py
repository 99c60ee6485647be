"""SDO expedited and segmented transfer, the client's side (CiA 301 clauses 7.2.4.3.3 to 7.2.4.3.7)."""

from __future__ import annotations

import struct

from schwung.fieldbus.canopen import abort
from schwung.fieldbus.canopen.abort import BrokenError
from schwung.fieldbus.canopen.turns import WRITTEN, Fits, Talk

SEGMENT_BYTES = 7
EXPEDITED_BYTES = 4

_DOWNLOAD, _UPLOAD, _DOWNLOAD_SEGMENT, _UPLOAD_SEGMENT = 0x20, 0x40, 0x00, 0x60  # of the client
_UPLOADED, _SEGMENT_WRITTEN, _SEGMENT_UPLOADED = 0x40, 0x20, 0x00  # of the server
_SPECIFIER, _TOGGLE, _EXPEDITED, _SIZED, _LAST = 0xE0, 0x10, 0x02, 0x01, 0x01


def upload(talk: Talk, *, short: bool) -> bytes:
    """The object's bytes, in one frame or by segments, checked against their number as far as the server tells it.

    `short` says that it has no more than 4 bytes, so that the server will hold no transfer. Raises AbortedError,
    BrokenError, SilenceError, PreemptedError and BusError.
    """
    talk.open = not short
    request = bytes([_UPLOAD]) + talk.multiplexer + bytes(4)
    return uploaded(talk, talk.request(request, is_uploaded))


def is_uploaded(frame: bytes) -> bool:
    """True for the answer to the request of an upload."""
    return frame[0] & _SPECIFIER == _UPLOADED


def uploaded(talk: Talk, answer: bytes) -> bytes:
    """What comes after the answer to the request, or is in it already; see `upload`."""
    if answer[0] & _EXPEDITED:
        unused = answer[0] >> 2 & 3 if answer[0] & _SIZED else 0
        return answer[4 : 8 - unused]
    talk.open = True
    size = struct.unpack_from("<I", answer, 4)[0] if answer[0] & _SIZED else None
    data, toggle, former = bytearray(), 0, b""
    while True:
        talk.send(bytes([_UPLOAD_SEGMENT | toggle]) + bytes(7))
        frame = talk.answer(_segment_after(former))
        if frame[0] & _TOGGLE != toggle:
            raise BrokenError("a segment came out of turn", abort.TOGGLE)
        data += frame[1 : 8 - (frame[0] >> 1 & 7)]
        if frame[0] & _LAST or (size is not None and len(data) > size):
            break
        toggle, former = toggle ^ _TOGGLE, frame
    if size is not None and len(data) != size:
        raise BrokenError(f"{len(data)} of {size} bytes came", abort.LENGTH)
    return bytes(data)


def _segment_after(former: bytes) -> Fits:
    """A segment, but not the former one once more: that has the other toggle bit, so this one never equals it."""
    return lambda frame: frame[0] & _SPECIFIER == _SEGMENT_UPLOADED and frame != former


def download(talk: Talk, data: bytes, *, segmented: bool) -> bytes:
    """Write the object, in one frame where it fits and may; nothing comes back. Raises as `upload`.

    Segments are confirmed by their toggle bit alone: a confirmation that came a second time, as late as that of the
    segment after the next, could not be told from it.
    """
    if 1 <= len(data) <= EXPEDITED_BYTES and not segmented:
        talk.request(expedited(talk.multiplexer, data), _is_written)
        return b""
    talk.open = True
    announcement = bytes([_DOWNLOAD | _SIZED]) + talk.multiplexer + struct.pack("<I", len(data))
    talk.request(announcement, _is_written)
    toggle = 0
    for start in range(0, max(len(data), 1), SEGMENT_BYTES):
        chunk = data[start : start + SEGMENT_BYTES]
        last = start + SEGMENT_BYTES >= len(data)
        head = _DOWNLOAD_SEGMENT | toggle | (SEGMENT_BYTES - len(chunk)) << 1 | last
        talk.send(bytes([head]) + chunk.ljust(SEGMENT_BYTES, b"\0"))
        answer = talk.answer(_is_segment_written if start == 0 else _confirmation(toggle))
        if answer[0] & _TOGGLE != toggle:
            raise BrokenError("a segment was confirmed out of turn", abort.TOGGLE)
        toggle ^= _TOGGLE
    return b""


def expedited(multiplexer: bytes, data: bytes) -> bytes:
    """The one frame that writes 1 to 4 bytes."""
    if not 1 <= len(data) <= EXPEDITED_BYTES:
        raise ValueError(f"{len(data)} bytes do not fit into one frame")
    head = _DOWNLOAD | _EXPEDITED | _SIZED | (EXPEDITED_BYTES - len(data)) << 2
    return bytes([head]) + multiplexer + data.ljust(EXPEDITED_BYTES, b"\0")


def _is_written(frame: bytes) -> bool:
    return frame[0] == WRITTEN


def _is_segment_written(frame: bytes) -> bool:
    return frame[0] & _SPECIFIER == _SEGMENT_WRITTEN


def _confirmation(toggle: int) -> Fits:
    """Of the segment with this toggle bit: with the other one, it is that of the former segment once more."""
    return lambda frame: frame[0] & (_SPECIFIER | _TOGGLE) == _SEGMENT_WRITTEN | toggle
