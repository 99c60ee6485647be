"""An SDO channel and a server at two ends of a stepped wire: every frame is noted, and may be lost, late or doubled."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar, cast

import can
import canopen

from schwung.clock import SteppedBus, SteppedClock, Wire
from schwung.fieldbus.canopen.link import Link
from schwung.fieldbus.canopen.sdo import SdoChannel
from schwung.fieldbus.canopen.turns import Talk
from schwung.fieldbus.drive import Parameter
from schwung_sim.drives.dictionary import AbortError, Code, ObjectDictionary
from schwung_sim.drives.sdo_server import SdoServer

T = TypeVar("T")

NODE = 5
REQUEST, ANSWER = 0x600 + NODE, 0x580 + NODE
TURN_AROUND_S = 0.0005
USER_DATA = Parameter(0x2010, 0, "DOMAIN", "User data")
CONTROLWORD = Parameter(0x6040, 0, "UNSIGNED16", "Controlword")
STATUSWORD = Parameter(0x6041, 0, "UNSIGNED16", "Statusword")
MODE = Parameter(0x6060, 0, "INTEGER8", "Modes of operation")
READ_ONLY = Parameter(0x1018, 1, "UNSIGNED32", "Vendor")

Serve = Callable[[bytes], None]
MakeServer = Callable[["Objects", Serve], Serve]
#: Of a direction's frame, by its number: the delays (s) after which it arrives; none: it is lost, two: doubled.
Way = Callable[[int, bytes], Sequence[float]]


def content(size: int) -> bytes:
    return bytes((7 * i + i // 256) % 251 for i in range(size))


def unharmed(number: int, frame: bytes) -> Sequence[float]:
    return (0.0,)


def lose(*numbers: int) -> Way:
    return lambda number, frame: () if number in numbers else (0.0,)


def double(*numbers: int, after_s: float = 0.0) -> Way:
    return lambda number, frame: (0.0, after_s) if number in numbers else (0.0,)


def delay(delay_s: float, *numbers: int) -> Way:
    return lambda number, frame: (delay_s,) if number in numbers else (0.0,)


def stalled(clock: SteppedClock, late: Mapping[int, float], way: Way = unharmed) -> Way:
    """Late by so much, by number; and what comes after does not overtake, as on a bus. Else as `way` has it."""
    last_s = [0.0]

    def arrive(number: int, frame: bytes) -> Sequence[float]:
        last_s[0] = max(clock.now() + late.get(number, 0.0), last_s[0])
        return [last_s[0] - clock.now() + after_s for after_s in way(number, frame)]

    return arrive


def merged(*ways: Way) -> Way:
    """The first of them that does something to the frame."""
    return lambda number, frame: next(
        (done for way in ways if (done := way(number, frame)) != (0.0,)), (0.0,)
    )


class Objects:
    """What the server holds; as the bench drive's dictionary where SdoServer asks."""

    def __init__(self) -> None:
        self.values: dict[tuple[int, int], bytes] = {
            (USER_DATA.index, 0): b"",
            (CONTROLWORD.index, 0): b"\0\0",
            (STATUSWORD.index, 0): b"\x37\x02",
            (MODE.index, 0): b"\0",
            (READ_ONLY.index, 1): b"GNWS",
        }
        self.written: list[tuple[int, bytes]] = []  # index and data, in order

    def upload(self, index: int, subindex: int) -> bytes:
        if (index, subindex) not in self.values:
            known = any(there == index for there, _ in self.values)
            raise AbortError(Code.NO_SUBINDEX if known else Code.NO_OBJECT)
        return self.values[index, subindex]

    def check_download(self, index: int, subindex: int, size: int | None) -> _Size:
        held = self.upload(index, subindex)
        if index == READ_ONLY.index:
            raise AbortError(Code.READ_ONLY)
        return _Size(len(held))

    def download(self, index: int, subindex: int, data: bytes) -> None:
        self.check_download(index, subindex, len(data))
        self.written.append((index, data))
        self.values[index, subindex] = data


class _Size:
    def __init__(self, size: int) -> None:
        self.size = size


def bench_server(objects: Objects, answer: Serve) -> Serve:
    """The bench drive's."""
    server = SdoServer(cast(ObjectDictionary, objects), answer)
    return lambda frame: server.service(frame, 0.0)


def strict_server(objects: Objects, answer: Serve) -> Serve:
    """The bench drive's, but it takes no new request before the transfer under way has ended."""
    server = SdoServer(cast(ObjectDictionary, objects), answer)

    def serve(frame: bytes) -> None:
        held = server._transfer
        begins = frame[0] >> 5 in (1, 2) or frame[0] in (0xA4, 0xC6)
        segments = held is not None and held.phase == "block download"
        if held is not None and begins and not segments:
            answer(struct.pack("<B3sI", 0x80, frame[1:4], Code.COMMAND))
            return
        server.service(frame, 0.0)

    return serve


def canopen_server(objects: Objects, answer: Serve) -> Serve:
    """That of the canopen package. It cannot do blocks: an upload by block it turns into a plain one."""
    server = canopen.sdo.SdoServer(REQUEST, ANSWER, _Node(objects))
    server.network = Outlet(lambda can_id, data: answer(data))
    return lambda frame: server.on_request(REQUEST, frame, 0.0)


class _Node:
    """What canopen's server asks for objects."""

    def __init__(self, objects: Objects) -> None:
        self.objects, self.object_dictionary = objects, canopen.ObjectDictionary()

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        return self._or_abort(lambda: self.objects.upload(index, subindex))

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        self._or_abort(lambda: self.objects.download(index, subindex, bytes(data)))

    @staticmethod
    def _or_abort(access: Callable[[], T]) -> T:
        try:
            return access()
        except AbortError as error:
            raise canopen.SdoAbortedError(error.code) from error


class Outlet:
    """Where canopen's client and server send to."""

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        self._send = send

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._send(can_id, bytes(data))


def unexpected(error: Exception) -> None:
    raise error


class Desk:
    """`sdo` on one end, the server of `make` on the other; `to_server` and `to_client` are the ways between.

    `asked` and `answered` are all frames of a direction as they were sent, `at_s` when those asked were.
    """

    def __init__(
        self, make: MakeServer = bench_server, *, timeout_s: float = 0.05, attempts: int = 3
    ) -> None:
        self.clock, self.objects = SteppedClock(), Objects()
        self.asked: list[bytes] = []
        self.answered: list[bytes] = []
        self.at_s: list[float] = []
        self.to_server: Way = unharmed
        self.to_client: Way = unharmed
        self.garble: Callable[[int, bytes], bytes] = lambda number, frame: frame  # on the way to the client
        wire = Wire(self.clock)
        ours, self._theirs = wire.bus(), wire.bus()
        for bus in (ours, self._theirs):
            bus._is_shutdown = True  # nothing to close: spares a warning for every wire that is dropped
        wire.weather = self._weather
        self._server = make(self.objects, self.answer)
        self.clock.read(self._theirs, self._serve, unexpected)
        self.link = Link(ours)
        self.sdo = SdoChannel(self.link, NODE, timeout_s, attempts)

    def answer(self, frame: bytes) -> None:
        """Send a frame as the server does."""
        frame = frame.ljust(8, b"\0")
        self._theirs.send(can.Message(arbitration_id=ANSWER, data=frame, is_extended_id=False))

    def at(self, when_s: float, call: Callable[[], object]) -> None:
        """Have a timer call at this time of the clock."""
        self.clock.later(when_s - self.clock.now(), lambda: (call(), None)[1])

    def by_block(self, action: Callable[[Talk], bytes], parameter: Parameter = USER_DATA) -> bytes:
        """One attempt of a transfer, without what the channel does about its failure."""
        turns = self.sdo._turns
        multiplexer = struct.pack("<HB", parameter.index, parameter.subindex)
        talk = Talk(turns, multiplexer, writes=False)
        with turns.underway(talk):
            turns.take(talk)
            talk.timeout_s = self.sdo.timeout_s
            return talk.carry_out(action)

    def _serve(self, message: can.Message) -> None:
        if message.arbitration_id == REQUEST:
            frame = bytes(message.data)
            self.clock.later(TURN_AROUND_S, lambda: self._server(frame))

    def _weather(self, sender: SteppedBus, end: SteppedBus, message: can.Message) -> Sequence[float]:
        up = message.arbitration_id == REQUEST
        sent, way = (self.asked, self.to_server) if up else (self.answered, self.to_client)
        sent.append(bytes(message.data))
        if up:
            self.at_s.append(self.clock.now())
        else:
            message.data[:] = self.garble(len(sent) - 1, sent[-1])
        return way(len(sent) - 1, sent[-1])


def holding(size: int) -> Desk:
    desk = Desk()
    desk.objects.values[USER_DATA.index, 0] = content(size)
    return desk
