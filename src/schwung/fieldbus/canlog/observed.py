"""SDO transfers as somebody else makes them: what a node's objects held, by listening (CiA 301, 7.2.4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from schwung.session.imports.canframes import Frames

_REQUEST, _ANSWER = 0x600, 0x580
_ABORT = 0x80


@dataclass(frozen=True)
class Observation:
    """One object read or written: at which frame the answer came, and its bytes."""

    frame: int
    data: bytes
    written: bool


@dataclass
class _Transfer:
    """A transfer that is under way."""

    index: int
    subindex: int
    kind: str  # "write" | "read" | "block"
    data: bytearray = field(default_factory=bytearray)
    segmented: bool = False
    last: bool = False


@dataclass(frozen=True)
class ObservedObjects:
    """What one node's objects held, as far as the log shows; in the order of the log, by index and sub-index."""

    node_id: int
    of: dict[tuple[int, int], list[Observation]]

    def at(self, index: int, subindex: int, frame: int) -> bytes | None:
        """The bytes of an object when a frame was sent: the last that was read or written before; else the first that
        was read afterwards, before anything was written. None where the log does not tell."""
        seen = self.of.get((index, subindex), [])
        before = [each for each in seen if each.frame <= frame]
        if before:
            return before[-1].data
        return seen[0].data if seen and not seen[0].written else None

    def latest(self, index: int, subindex: int) -> bytes | None:
        """The bytes that were seen last."""
        seen = self.of.get((index, subindex))
        return seen[-1].data if seen else None

    def changes(self, wanted: Callable[[int], bool]) -> list[int]:
        """Frames at which objects were written of which `wanted` says so by index."""
        return sorted(
            each.frame
            for (index, _), seen in self.of.items()
            if wanted(index)
            for each in seen
            if each.written
        )


def nodes_of(frames: Frames) -> list[int]:
    """Nodes that answer SDO or send TPDOs by the predefined connection set, in order; else those with a heartbeat,
    which masters have, too."""
    heard = set(frames.can_id.tolist())

    def sending(bases: tuple[int, ...]) -> list[int]:
        return sorted({can_id & 0x7F for can_id in heard if can_id & ~0x7F in bases and can_id & 0x7F})

    return sending((0x180, 0x280, 0x380, 0x480, _ANSWER)) or sending((0x700,))


def observe(frames: Frames, node_id: int) -> ObservedObjects:
    """All SDO transfers of the node's default channel that came to their end. Block transfers are passed over: nothing
    that a PDO or a unit needs is so long."""
    seen: dict[tuple[int, int], list[Observation]] = {}
    transfer: _Transfer | None = None
    for k, can_id in enumerate(frames.can_id.tolist()):
        if can_id not in (_REQUEST + node_id, _ANSWER + node_id) or len(frames.data[k]) != 8:
            continue
        data, asked = frames.data[k], can_id == _REQUEST + node_id
        transfer, done = _asked(data, transfer) if asked else _answered(data, transfer)
        if done is not None:
            found = Observation(k, bytes(done.data), done.kind == "write")
            seen.setdefault((done.index, done.subindex), []).append(found)
    return ObservedObjects(node_id, seen)


_Step = tuple[_Transfer | None, _Transfer | None]


def _asked(data: bytes, transfer: _Transfer | None) -> _Step:
    """A client's frame: the transfer that goes on, and the one that is finished by it."""
    command, what = data[0], data[0] >> 5
    if command == _ABORT:
        return None, None
    index, subindex = int.from_bytes(data[1:3], "little"), data[3]
    if transfer is not None and transfer.kind == "block":
        ends = command & 0xE3 in (0xA1, 0xC1)  # of an upload: acknowledged; of a download: the last frame
        return (None if ends else transfer), None
    if what == 1:
        size = 4 - (command >> 2 & 3) if command & 1 else 4
        expedited = bool(command & 2)
        return _Transfer(index, subindex, "write", bytearray(data[4 : 4 + size] if expedited else b""),
                         segmented=not expedited), None  # fmt: skip
    if what == 2:
        return _Transfer(index, subindex, "read"), None
    if command & 0xE3 == 0xA0 or command & 0xE1 == 0xC0:
        return _Transfer(index, subindex, "block"), None
    if what == 0 and transfer is not None and transfer.kind == "write" and transfer.segmented:
        transfer.data += data[1 : 8 - (command >> 1 & 7)]
        transfer.last = bool(command & 1)
    return transfer, None


def _answered(data: bytes, transfer: _Transfer | None) -> _Step:
    """A server's frame, likewise."""
    command, what = data[0], data[0] >> 5
    if transfer is None or command == _ABORT:
        return None, None
    same = not transfer.segmented and (int.from_bytes(data[1:3], "little"), data[3]) == (
        transfer.index,
        transfer.subindex,
    )
    if transfer.kind == "write":
        done = (what == 3 and same) or (what == 1 and transfer.last)
        return (None, transfer) if done else (transfer, None)
    if transfer.kind == "block" and what in (5, 6):
        transfer.segmented = True  # the server goes along: what comes now are the block's frames
    elif what == 2 and same:  # also where a block was asked for and a plain one comes
        transfer.kind, transfer.segmented = "read", not command & 2
        if command & 2:
            size = 4 - (command >> 2 & 3) if command & 1 else 4
            transfer.data += data[4 : 4 + size]
            return None, transfer
    elif transfer.kind == "read" and what == 0 and transfer.segmented:
        transfer.data += data[1 : 8 - (command >> 1 & 7)]
        transfer.last = bool(command & 1)
    return (None, transfer) if transfer.kind == "read" and transfer.last else (transfer, None)
