"""A drive made of literal frames, which knows neither a profile nor an EDS nor the simulated drive.

What it is asked and what it answers is written down as bytes, as a manual prints them or as CiA 301 (7.2.4.3, expedited
SDO) composes them for that object and type. What is not written down does not exist: SDO abort 06020000.
"""

from __future__ import annotations

import queue
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import can

from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.profile import CanopenProfile

NODE = 1
_NMT, _SYNC, _RPDO = 0x000, 0x080, 0x200 + NODE
_SDO_REQUEST, _SDO_ANSWER, _HEARTBEAT = 0x600 + NODE, 0x580 + NODE, 0x700 + NODE
_ABSENT = bytes.fromhex("00 00 02 06")
#: First byte of an expedited upload's answer, by that of the download that wrote the value (CiA 301, 7.2.4.3.3).
_READ_BACK = {0x23: 0x43, 0x27: 0x47, 0x2B: 0x4B, 0x2F: 0x4F}


@dataclass(frozen=True)
class Row:
    """One SDO exchange, what it says, and who says so. Bytes as hex; those that are left out at the end are 0."""

    request: str
    answer: str
    value: int
    source: str


def sdo(text: str) -> bytes:
    """Eight bytes of a table."""
    return bytes.fromhex(text).ljust(8, b"\0")


_EMPTY = "CiA 301, 7.5.2.35 to 38: transmission type 255, nothing mapped"
#: RPDO 1, TPDO 1 and 2 before anybody maps anything. Their COB-IDs are each manual's own.
PDO_ROWS = (
    *(Row(f"40 {pdo} 02", f"4F {pdo} 02 FF", 255, _EMPTY) for pdo in ("00 14", "00 18", "01 18")),
    *(Row(f"40 {pdo} 00", f"4F {pdo} 00 00", 0, _EMPTY) for pdo in ("00 16", "00 1A", "01 1A")),
    *(
        Row(f"40 {pdo} {number:02X}", f"43 {pdo} {number:02X}", 0, _EMPTY)
        for pdo in ("00 16", "00 1A", "01 1A")
        for number in (1, 2, 3)
    ),
)


@dataclass(frozen=True)
class Sample:
    """One SYNC: what is demanded, the frames that go and come (TPDO 1, 2, …), and what they say. SI; None: nobody tells
    what a count is worth."""

    position_demand_rad: float
    torque_added_nm: float
    rpdo: str
    tpdos: tuple[str, ...]
    position_rad: float
    speed_rad_s: float | None
    torque_nm: float | None


@dataclass(frozen=True)
class Scale:
    """SI per count, as the manual has it; None: the profile must not claim to know it."""

    position_rad: float | None
    speed_rad_s: float | None
    torque_nm: float | None
    acceleration_rad_s2: float | None
    rated_torque_nm: float | None
    source: str


@dataclass(frozen=True)
class Golden:
    """A family by its manual: literal exchanges, scales, states, frames."""

    family: str
    rows: tuple[Row, ...]
    scale: Scale
    states: Mapping[int, str]  # statuswords that the manual prints, and the standard's name of each
    samples: tuple[Sample, ...] = ()
    mode: str = "csp"
    modes: tuple[str, ...] = ("2F 60 60 00 08", "2F 60 60 00 01")  # downloads that choose csp, pp
    #: Downloads that setting up at 1 kHz must send, in any order; to 605A, 605E and 6007 no other ones.
    written: tuple[str, ...] = ()
    limits: Mapping[str, float] = field(default_factory=dict)  # fields of DriveLimits; all others are unknown
    identified: bool = True  # by 1018
    #: Answers, by request, with which the tool must refuse the drive.
    wrong: Mapping[str, str] = field(default_factory=dict)


class GoldenDrive:
    """Answers from the table. `downloads` keeps what was written, `rpdos` what came by PDO."""

    def __init__(
        self,
        rows: Sequence[Row],
        samples: Sequence[Sample] = (),
        states: Mapping[int, int] | None = None,
    ) -> None:
        self.answers = {sdo(row.request): sdo(row.answer) for row in (*PDO_ROWS, *rows)}
        self.pdos = {bytes.fromhex(s.rpdo): [bytes.fromhex(t) for t in s.tpdos] for s in samples}
        self.states = states or {}  # statusword by controlword
        self.downloads: list[bytes] = []
        self.rpdos: list[bytes] = []

    def take(self, message: can.Message) -> Iterator[can.Message]:
        """What it says to a frame."""
        data = bytes(message.data)
        if message.arbitration_id == _SDO_REQUEST:
            yield _frame(_SDO_ANSWER, self._served(data))
        elif message.arbitration_id == _NMT:
            yield _frame(_HEARTBEAT, bytes([{0x01: 0x05, 0x80: 0x7F}.get(data[0], 0x00)]))
        elif message.arbitration_id == _RPDO:
            self.rpdos.append(data)
        elif message.arbitration_id == _SYNC and self.rpdos:
            for number, tpdo in enumerate(self._sampled(self.rpdos[-1])):
                yield _frame(0x180 + 0x100 * number + NODE, tpdo)

    def _served(self, request: bytes) -> bytes:
        read = bytes([0x40, *request[1:4], 0, 0, 0, 0])
        if request in self.answers:
            return self.answers[request]
        if request[0] in _READ_BACK and read in self.answers:
            self.downloads.append(request)
            self.answers[read] = bytes([_READ_BACK[request[0]], *request[1:]])
            return bytes([0x60, *request[1:4], 0, 0, 0, 0])
        return bytes([0x80, *request[1:4], *_ABSENT])

    def _sampled(self, rpdo: bytes) -> list[bytes]:
        """The table's; before and after the motion it stands as at the begin, in the state that it was told."""
        if rpdo in self.pdos:
            return self.pdos[rpdo]
        first, *rest = next(iter(self.pdos.values()))
        word = self.states.get(int.from_bytes(rpdo[:2], "little"), 0x0240)
        return [word.to_bytes(2, "little") + first[2:], *rest]


def _frame(can_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


class GoldenBus(can.BusABC):
    """A bus with that drive alone on it: every frame is answered when it is sent."""

    def __init__(self, drive: GoldenDrive) -> None:
        self.channel_info, self._drive = "golden", drive
        self._answers: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
        super().__init__(channel="golden")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """See can.BusABC."""
        for answer in self._drive.take(msg):
            self._answers.put(answer)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """See can.BusABC."""
        try:
            return self._answers.get(timeout=timeout)
        except queue.Empty:
            return None


@contextmanager
def connected(drive: GoldenDrive, profile: CanopenProfile) -> Iterator[CanopenDrive]:
    """The tool's own driver, connected to it."""
    bus = GoldenBus(drive)
    try:
        with CanopenDrive(bus, NODE, profile) as driver:
            yield driver
    finally:
        bus.shutdown()
