"""A drive made of literal frames, which knows neither a profile nor an EDS nor the simulated drive.

What it is asked and what it answers is written down as bytes, as a manual prints them or as CiA 301 (7.2.4.3, expedited
SDO) composes them for that object and type. What is not written down does not exist: SDO abort 06020000.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import can

from schwung.clock import SteppedClock, Wire
from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.profile import CanopenProfile

NODE = 1
_NMT, _SYNC, _RPDO = 0x000, 0x080, 0x200 + NODE
_SDO_REQUEST, _SDO_ANSWER, _HEARTBEAT = 0x600 + NODE, 0x580 + NODE, 0x700 + NODE
_ABSENT = bytes.fromhex("00 00 02 06")
#: First byte of an expedited upload's answer, by that of the download that wrote the value (CiA 301, 7.2.4.3).
_READ_BACK = {0x23: 0x43, 0x27: 0x47, 0x2B: 0x4B, 0x2F: 0x4F}
_CONTROLWORD, _MODE = bytes.fromhex("40 60 00"), bytes.fromhex("60 60 00")
_HEARTBEAT_S = 0.1
#: State in which a controlword ends, bits 0 to 3 (CiA 402-2, table of the controlword; 605A = 6).
_LEADS_TO = {
    0x00: "Switch on disabled", 0x02: "Quick stop active", 0x06: "Ready to switch on", 0x07: "Switched on",
    0x0F: "Operation enabled",
}  # fmt: skip


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
        self, rows: Sequence[Row], samples: Sequence[Sample] = (), states: Mapping[int, str] | None = None
    ) -> None:
        self.answers = {sdo(row.request): sdo(row.answer) for row in (*PDO_ROWS, *rows)}
        self.pdos = {bytes.fromhex(s.rpdo): [bytes.fromhex(t) for t in s.tpdos] for s in samples}
        self.downloads: list[bytes] = []
        self.rpdos: list[bytes] = []
        words: dict[str, int] = {}
        for word, name in (states or {}).items():
            words.setdefault(name, word)
        self._words = {command: words[name] for command, name in _LEADS_TO.items() if name in words}
        self._nmt = 0x7F

    def attach(self, wire: Wire) -> None:
        """Give it an end of its own."""
        bus, clock = wire.bus(), wire.clock

        def receive(message: can.Message) -> None:
            for answer in self._take(message.arbitration_id, bytes(message.data)):
                bus.send(answer)

        clock.read(bus, receive, _fail)
        clock.every(_HEARTBEAT_S, lambda: bus.send(_frame(_HEARTBEAT, bytes([self._nmt]))))

    def _take(self, can_id: int, data: bytes) -> Iterator[can.Message]:
        """What it says to a frame."""
        if can_id == _SDO_REQUEST:
            yield _frame(_SDO_ANSWER, self._served(data))
        elif can_id == _NMT:
            self._nmt = {0x01: 0x05, 0x80: 0x7F}[data[0]]
            yield _frame(_HEARTBEAT, bytes([self._nmt]))
        elif can_id == _RPDO:
            self.rpdos.append(data)
            self._obey(data[:2])
        elif can_id == _SYNC and self.rpdos:
            for number, tpdo in enumerate(self._sampled(self.rpdos[-1])):
                yield _frame(0x180 + 0x100 * number + NODE, tpdo)

    def _served(self, request: bytes) -> bytes:
        read = bytes([0x40, *request[1:4], 0, 0, 0, 0])
        if request in self.answers:
            return self.answers[request]
        if request[0] in _READ_BACK and (read in self.answers or request[1:4] == _CONTROLWORD):
            self.downloads.append(request)
            self.answers[read] = bytes([_READ_BACK[request[0]], *request[1:]])
            if request[1:4] == _MODE:  # is shown at once
                self.answers[sdo("40 61 60 00")] = bytes([0x4F, 0x61, *request[2:]])
            elif request[1:4] == _CONTROLWORD:
                self._obey(request[4:6])
            return bytes([0x60, *request[1:4], 0, 0, 0, 0])
        return bytes([0x80, *request[1:4], *_ABSENT])

    def _obey(self, command: bytes) -> None:
        word = self._words.get(int.from_bytes(command, "little") & 0x0F)
        if word is not None:
            self.answers[sdo("40 41 60 00")] = sdo("4B 41 60 00")[:4] + word.to_bytes(2, "little") + bytes(2)

    def _sampled(self, rpdo: bytes) -> list[bytes]:
        """The table's; before and after the motion it stands as at the begin, in the state that it was told."""
        if rpdo in self.pdos:
            return self.pdos[rpdo]
        first, *rest = next(iter(self.pdos.values()))
        told = self.answers[sdo("40 41 60 00")][4:6]
        in_operation = (
            told[0] & 0x6F == first[0] & 0x6F
        )  # then with the sample's further bits: it follows (bit 12)
        return [first if in_operation else told + first[2:], *rest]


def _frame(can_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def _fail(error: Exception) -> None:
    raise error


@contextmanager
def connected(drive: GoldenDrive, profile: CanopenProfile) -> Iterator[CanopenDrive]:
    """The tool's own driver, connected to it; no time passes but theirs."""
    wire = Wire(SteppedClock())
    drive.attach(wire)
    with CanopenDrive(wire.bus(), NODE, profile) as driver:
        yield driver
