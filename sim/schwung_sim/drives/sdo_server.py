"""The drive's SDO server: expedited, segmented and block transfer both ways (CiA 301 clause 7.2.4)."""

from __future__ import annotations

import binascii
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from schwung_sim.drives.dictionary import DOMAIN_MAX_BYTES, AbortError, Code, NoAnswer, ObjectDictionary

BLOCK_SIZE = 127  # segments per sub-block that we ask for
TIMEOUT_S = 1.0

Send = Callable[[bytes], None]


@dataclass
class _Transfer:
    """One transfer under way; which of the fields count depends on `phase`."""

    phase: str  # "upload", "download", "block download", "block download end", "block upload …"
    index: int
    subindex: int
    data: bytearray = field(default_factory=bytearray)
    size: int | None = None
    position: int = 0
    toggle: int = 0
    crc: bool = False
    block_size: int = BLOCK_SIZE
    sequence: int = 0  # last segment of the present sub-block that came, or that was sent


class SdoServer:
    """Serves one client, one transfer at a time. `now` is in seconds.

    `aborts` and `silent` are the bench's own: objects whose access is aborted with a code, or not answered.
    """

    def __init__(self, dictionary: ObjectDictionary, send: Send) -> None:
        self.aborts: dict[int, int] = {}
        self.silent: set[int] = set()
        self._dictionary = dictionary
        self._send = send
        self._transfer: _Transfer | None = None
        self._last_s = 0.0
        self._served = False  # since the last look at the clock: answers may have taken long to send

    def reset(self) -> None:
        """Forget a transfer under way."""
        self._transfer = None

    def tick(self, now: float) -> None:
        """Abort a transfer whose client has fallen silent."""
        if self._served:
            self._last_s, self._served = now, False
        if self._transfer is not None and now - self._last_s > TIMEOUT_S:
            self._abort(Code.TIMED_OUT)

    def service(self, frame: bytes, now: float) -> None:
        """Handle one frame of the client."""
        if len(frame) < 8:
            return
        self._last_s, self._served = now, True
        try:
            if self._transfer is not None and self._transfer.phase == "block download":
                self._block_segment(self._transfer, frame)
            else:
                self._command(frame)
        except AbortError as error:
            self._abort(error.code, frame)
        except NoAnswer:
            self._transfer = None

    def _command(self, frame: bytes) -> None:
        specifier = frame[0] >> 5
        if (
            specifier in (1, 2)
            or (specifier == 5 and frame[0] & 3 == 0)
            or (specifier == 6 and not frame[0] & 1)
        ):
            self._initiate(specifier, frame)
        elif specifier == 4:
            self._transfer = None
        elif specifier == 0:
            self._download_segment(self._expect("download"), frame)
        elif specifier == 3:
            self._upload_segment(self._expect("upload"), frame)
        elif specifier == 5:
            self._block_upload(self._expect("block upload"), frame)
        elif specifier == 6:
            self._block_download_end(self._expect("block download end"), frame)
        else:
            raise AbortError(Code.COMMAND)

    def _expect(self, phase: str) -> _Transfer:
        if self._transfer is None or self._transfer.phase != phase:
            raise AbortError(Code.COMMAND)
        return self._transfer

    def _abort(self, code: int, frame: bytes = bytes(8)) -> None:
        transfer, self._transfer = self._transfer, None
        index, subindex = struct.unpack_from("<HB", frame, 1)
        if transfer is not None:
            index, subindex = transfer.index, transfer.subindex
        self._send(struct.pack("<BHBI", 0x80, index, subindex, code))

    # -- Initiation -------------------------------------------------------------------------------

    def _initiate(self, specifier: int, frame: bytes) -> None:
        self._transfer = None
        index, subindex = struct.unpack_from("<HB", frame, 1)
        if index in self.silent:
            return
        if index in self.aborts:
            raise AbortError(self.aborts[index])
        start = {1: self._start_download, 2: self._start_upload, 5: self._start_block_upload}
        start.get(specifier, self._start_block_download)(index, subindex, frame)

    def _start_download(self, index: int, subindex: int, frame: bytes) -> None:
        sized = bool(frame[0] & 1)
        if frame[0] & 2:
            wanted = self._dictionary.check_download(index, subindex, None).size
            length = 4 - (frame[0] >> 2 & 3) if sized else min(wanted or 4, 4)
            self._dictionary.download(index, subindex, bytes(frame[4 : 4 + length]))
        else:
            size = struct.unpack_from("<I", frame, 4)[0] if sized else None
            self._dictionary.check_download(index, subindex, size)
            self._transfer = _Transfer("download", index, subindex, size=size)
        self._send(struct.pack("<BHB4x", 0x60, index, subindex))

    def _start_upload(self, index: int, subindex: int, frame: bytes) -> None:
        data = self._dictionary.upload(index, subindex)
        if 1 <= len(data) <= 4:
            command = 0x43 | (4 - len(data)) << 2
            self._send(struct.pack("<BHB4s", command, index, subindex, data))
        else:
            self._transfer = _Transfer("upload", index, subindex, data=bytearray(data))
            self._send(struct.pack("<BHBI", 0x41, index, subindex, len(data)))

    def _start_block_download(self, index: int, subindex: int, frame: bytes) -> None:
        size = struct.unpack_from("<I", frame, 4)[0] if frame[0] & 2 else None
        self._dictionary.check_download(index, subindex, size)
        self._transfer = _Transfer("block download", index, subindex, size=size, crc=bool(frame[0] & 4))
        self._send(struct.pack("<BHBB3x", 0xA4, index, subindex, BLOCK_SIZE))

    def _start_block_upload(self, index: int, subindex: int, frame: bytes) -> None:
        block_size, threshold = frame[4], frame[5]
        self._check_block_size(block_size)
        data = self._dictionary.upload(index, subindex)
        if 0 < len(data) <= threshold:  # the client prefers the plain protocol for so little
            self._start_upload(index, subindex, frame)
            return
        self._transfer = _Transfer(
            "block upload",
            index,
            subindex,
            data=bytearray(data),
            crc=bool(frame[0] & 4),
            block_size=block_size,
        )
        self._send(struct.pack("<BHBI", 0xC6, index, subindex, len(data)))

    @staticmethod
    def _check_block_size(segments: int) -> None:
        if not 1 <= segments <= 127:
            raise AbortError(Code.BLOCK_SIZE)

    # -- Segmented transfer -----------------------------------------------------------------------

    @staticmethod
    def _check_toggle(transfer: _Transfer, frame: bytes) -> None:
        if frame[0] & 0x10 != transfer.toggle:
            raise AbortError(Code.TOGGLE)
        transfer.toggle ^= 0x10

    def _download_segment(self, transfer: _Transfer, frame: bytes) -> None:
        reply = 0x20 | transfer.toggle
        self._check_toggle(transfer, frame)
        transfer.data += frame[1 : 8 - (frame[0] >> 1 & 7)]
        self._check_room(transfer)
        if frame[0] & 1:
            self._commit(transfer)
        self._send(bytes((reply, 0, 0, 0, 0, 0, 0, 0)))

    @staticmethod
    def _check_room(transfer: _Transfer) -> None:
        most = DOMAIN_MAX_BYTES if transfer.size is None else transfer.size
        slack = (
            6 if transfer.phase.startswith("block") else 0
        )  # the end frame tells how much of the last one counts
        if len(transfer.data) > most + slack:
            raise AbortError(Code.LENGTH_HIGH)

    def _commit(self, transfer: _Transfer) -> None:
        if transfer.size is not None and len(transfer.data) != transfer.size:
            raise AbortError(Code.LENGTH_LOW if len(transfer.data) < transfer.size else Code.LENGTH_HIGH)
        self._dictionary.download(transfer.index, transfer.subindex, bytes(transfer.data))
        self._transfer = None

    def _upload_segment(self, transfer: _Transfer, frame: bytes) -> None:
        toggle = transfer.toggle
        self._check_toggle(transfer, frame)
        chunk = transfer.data[transfer.position : transfer.position + 7]
        transfer.position += len(chunk)
        last = transfer.position >= len(transfer.data)
        self._send(struct.pack("<B7s", toggle | (7 - len(chunk)) << 1 | last, bytes(chunk)))
        if last:
            self._transfer = None

    # -- Block transfer ---------------------------------------------------------------------------

    def _block_segment(self, transfer: _Transfer, frame: bytes) -> None:
        sequence, last = frame[0] & 0x7F, bool(frame[0] & 0x80)
        if sequence == 0:  # no segment has number 0: the client aborts, or it is lost
            if not last:
                raise AbortError(Code.COMMAND)
            self._transfer = None
            return
        good = sequence == transfer.sequence + 1
        if good:
            transfer.sequence = sequence
            transfer.data += frame[1:8]
            self._check_room(transfer)
        if last or sequence == BLOCK_SIZE:  # a gap: the client repeats from the last good segment
            self._send(struct.pack("<BBB5x", 0xA2, transfer.sequence, BLOCK_SIZE))
            transfer.sequence = 0
            if last and good:
                transfer.phase = "block download end"

    def _block_download_end(self, transfer: _Transfer, frame: bytes) -> None:
        unused = frame[0] >> 2 & 7
        if unused:
            del transfer.data[-unused:]
        if transfer.crc and binascii.crc_hqx(transfer.data, 0) != struct.unpack_from("<H", frame, 1)[0]:
            raise AbortError(Code.CRC)
        self._commit(transfer)
        self._send(struct.pack("<B7x", 0xA1))

    def _block_upload(self, transfer: _Transfer, frame: bytes) -> None:
        command = frame[0] & 3
        if command == 3:
            self._send_block(transfer)
        elif command == 2:
            acknowledged, block_size = frame[1], frame[2]
            self._check_block_size(block_size)
            if acknowledged > transfer.sequence:
                raise AbortError(Code.COMMAND)
            transfer.position += 7 * acknowledged
            transfer.block_size = block_size
            if transfer.position < len(transfer.data) or (not transfer.data and not acknowledged):
                self._send_block(transfer)
            else:
                unused = -len(transfer.data) % 7 if transfer.data else 7
                crc = binascii.crc_hqx(transfer.data, 0)
                self._send(struct.pack("<BH5x", 0xC1 | unused << 2, crc))
        else:
            self._transfer = None

    def _send_block(self, transfer: _Transfer) -> None:
        chunks = range(transfer.position, max(len(transfer.data), 1), 7)[: transfer.block_size]
        for sequence, start in enumerate(chunks, start=1):
            chunk = bytes(transfer.data[start : start + 7])
            last = 0x80 if start + 7 >= len(transfer.data) else 0
            self._send(struct.pack("<B7s", last | sequence, chunk))
        transfer.sequence = len(chunks)
