"""PDOs of a log by the mapping that held when they were sent, brought to one row per SYNC.

A row is what a SYNC asked for: the samples that the drive took at it, which follow it on the bus, and what had been
commanded with the SYNC before, since a drive that takes a setpoint at one SYNC has reached it at the next
(`commissioning/runs.py` has the same rule for what we play ourselves).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.fieldbus.canlog.observed import ObservedObjects
from schwung.fieldbus.canopen.pdo import INVALID, PREDEFINED
from schwung.fieldbus.canopen.recorder import attribute
from schwung.fieldbus.eds import EdsFile
from schwung.motion import Array
from schwung.session.imports.canframes import Frames

_MOST_ENTRIES = 8  # of one PDO, at one byte each
_MASK_ID = 0x1FFFFFFF
_SYNC_ID = 0x080
#: An interval between SYNCs that is longer than so many periods: SYNCs, or frames of the log, are missing between.
_GAP_PERIODS = 1.5
_FEWEST_SYNCS = 16

Key = tuple[int, int]  # index and sub-index


@dataclass(frozen=True)
class Mapped:
    """One object in a PDO's frame."""

    key: Key
    first_bit: int
    bits: int
    signed: bool


@dataclass(frozen=True)
class PdoMapping:
    """One PDO as it was set up: direction, number, identifier, objects."""

    direction: str  # "rpdo" | "tpdo"
    number: int
    can_id: int
    entries: tuple[Mapped, ...]

    @property
    def bits(self) -> int:
        """Bits of a frame."""
        return sum(entry.bits for entry in self.entries)

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.direction.upper()} {self.number}"


@dataclass(frozen=True, eq=False)
class Rows:
    """Counts by SYNC. Every array is (n,), n SYNCs; NaN where no frame came, or none had come yet.

    `commanded` of row k is what held when SYNC k was sent, `sampled` what came in answer to it. `piece` numbers the
    stretches within which no SYNC is missing. `origin` says in which PDO each object was.
    """

    time_s: Array
    frame: NDArray[np.int64]
    rate_hz: float
    piece: NDArray[np.int64]
    commanded: Mapping[Key, Array]
    sampled: Mapping[Key, Array]
    origin: Mapping[Key, str]
    late: int


def label(key: Key) -> str:
    """An object as it is written everywhere."""
    return f"{key[0]:04X}:{key[1]:02X}"


class PdoReader:
    """Mappings of one node over a log: as seen in SDO transfers, else as EDS or DCF have them."""

    def __init__(self, frames: Frames, objects: ObservedObjects, file: EdsFile) -> None:
        self._frames, self._objects, self._file = frames, objects, file
        self._node = objects.node_id
        #: Frames at which some mapping may change: between two of them every frame is read in the same way.
        self.boundaries = [0, *objects.changes(lambda index: 0x1400 <= index <= 0x1BFF), len(frames)]

    def integer(self, index: int, subindex: int, frame: int) -> int | None:
        """An object's value when a frame was sent: in the log, else in EDS or DCF; None where neither tells."""
        seen = self._objects.at(index, subindex, frame)
        if seen is not None:
            return int.from_bytes(seen, "little")
        variable = self._file.variable(index, subindex)
        value = None if variable is None else (variable.configured or variable.default)
        return value.raw if value is not None and isinstance(value.raw, int) else None

    def mappings(self, frame: int) -> list[PdoMapping]:
        """All PDOs of the node that were enabled when a frame was sent."""
        found = []
        for direction, communication in (("rpdo", 0x1400), ("tpdo", 0x1800)):
            for number in self._numbers(communication):
                made = self._mapping(direction, number, communication + number - 1, frame)
                if made is not None:
                    found.append(made)
        return found

    def _numbers(self, communication: int) -> list[int]:
        """Numbers of the PDOs that log or file know, and those of the predefined connection set."""
        indices = {index for index, _ in self._objects.of} | set(self._file.description.objects)
        return sorted(
            {index - communication + 1 for index in indices if communication <= index < communication + 0x200}
        )

    def _mapping(self, direction: str, number: int, communication: int, frame: int) -> PdoMapping | None:
        cob_id = self.integer(communication, 1, frame)
        if cob_id is None and number <= PREDEFINED:
            cob_id = (0x200 if direction == "rpdo" else 0x180) + 0x100 * (number - 1) + self._node
        if cob_id is None or cob_id & INVALID:
            return None
        count = self.integer(communication + 0x200, 0, frame) or 0
        entries, first = [], 0
        for subindex in range(1, min(count, _MOST_ENTRIES * 8) + 1):
            told = self.integer(communication + 0x200, subindex, frame)
            if not told:
                continue
            key, bits = (told >> 16, told >> 8 & 0xFF), told & 0xFF
            entries.append(Mapped(key, first, bits, self._signed(key)))
            first += bits
        if not entries or first > 64:
            return None
        return PdoMapping(direction, number, cob_id & _MASK_ID, tuple(entries))

    def _signed(self, key: Key) -> bool:
        found = self._file.find(*key)
        if found is not None:
            return found.type.startswith("INTEGER")
        return key[0] in _SIGNED


#: Of the objects of CiA 402-2 that are mapped as a rule, those that are signed: for files that lack them.
_SIGNED = {0x6060, 0x6061, 0x6062, 0x6063, 0x6064, 0x606B, 0x606C, 0x6071, 0x6074, 0x6077, 0x6078, 0x607A, 0x60B0,
           0x60B1, 0x60B2, 0x60F4, 0x60FC, 0x60FF}  # fmt: skip


def read_rows(frames: Frames, reader: PdoReader, wanted: Callable[[Key], bool]) -> Rows:
    """Everything that SYNC asked for, as counts. Raises InputError where there is no SYNC, or a frame is shorter than
    its mapping."""
    sync = np.flatnonzero(frames.can_id == _SYNC_ID)
    if sync.size < _FEWEST_SYNCS:
        raise InputError(
            str(frames.path), f"holds {sync.size} SYNCs (0x080), so that nothing says when its PDOs were sampled",
            "Log a commissioning in which a master sends SYNC, or read PDOs that are sent on events with --dbc.",
        )  # fmt: skip
    period = float(np.median(np.diff(frames.time_s[sync])))
    if not period > 0:
        raise InputError(str(frames.path), "has stamps that do not grow from SYNC to SYNC",
                         "Log with absolute stamps: candump -L.")  # fmt: skip
    told = reader.integer(0x1006, 0, int(sync[-1]))
    rate = _rate(frames.time_s[sync], period, told)
    steps = np.diff(frames.time_s[sync])
    missing = (steps > _GAP_PERIODS / rate) | (steps < 0)  # or somebody set the clock
    missing |= _skipped(frames, sync)
    piece = np.concatenate(([0], np.cumsum(missing)))
    streams = _streams(frames, reader, wanted)
    commanded: dict[Key, Array] = {}
    sampled: dict[Key, Array] = {}
    origin: dict[Key, str] = {}
    late = 0
    for stream in streams:
        values = stream.values()
        if stream.direction == "rpdo":
            columns, held = commanded, _held(np.asarray(stream.frames), sync)
        else:
            columns = sampled
            windows = np.searchsorted(sync, stream.frames) - 1
            inside = windows >= 0
            owners = attribute(windows[inside].tolist(), sync.size)
            late += owners.late
            held = np.where(
                owners.frame_of_window >= 0, owners.frame_of_window + int(np.count_nonzero(~inside)), -1
            )
        for key, counts in values.items():
            column = columns.setdefault(key, np.full(sync.size, np.nan))
            there = held >= 0
            column[there] = counts[held[there]]
            origin.setdefault(key, stream.name)
    return Rows(frames.time_s[sync], sync, rate, piece, commanded, sampled, origin, late)


def _rate(time_s: Array, period_s: float, told_us: int | None) -> float:
    """SYNC's rate: as the drive was told (1006), where the stamps agree; else the stamps' median, to three digits."""
    if told_us and abs(told_us * 1e-6 / period_s - 1) < 0.02:
        return 1e6 / told_us
    return float(f"{1 / period_s:.3g}")


def _skipped(frames: Frames, sync: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Where SYNC's own counter jumps: the log has lost frames there. (n-1,)"""
    counts = [frames.data[k][0] if len(frames.data[k]) == 1 else -1 for k in sync]
    numbers = np.array(counts)
    steps = np.diff(numbers)
    wraps = (numbers[1:] == 1) | (numbers[1:] == 0)  # the overflow value is the producer's affair
    return np.asarray((numbers[:-1] > 0) & (numbers[1:] > 0) & (steps != 1) & ~wraps)


def _held(frames: NDArray[np.int64], sync: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which of a PDO's frames was the last before each SYNC; -1 where none was."""
    return np.searchsorted(frames, sync) - 1


@dataclass
class _Stream:
    """All frames of one identifier, with the mapping of each."""

    direction: str
    name: str
    frames: list[int]
    chunks: list[tuple[PdoMapping, list[bytes]]]
    wanted: Callable[[Key], bool]

    def values(self) -> dict[Key, Array]:
        """Counts of every object that is wanted, (frames,); NaN while it was not mapped."""
        found: dict[Key, Array] = {}
        done = 0
        for mapping, data in self.chunks:
            words = np.frombuffer(b"".join(each.ljust(8, b"\0")[:8] for each in data), "<u8")
            for entry in mapping.entries:
                if not self.wanted(entry.key):
                    continue
                column = found.setdefault(entry.key, np.full(len(self.frames), np.nan))
                column[done : done + len(data)] = _extracted(words, entry)
            done += len(data)
        return found


def _extracted(words: NDArray[np.uint64], entry: Mapped) -> Array:
    raw = words >> np.uint64(entry.first_bit)
    if entry.bits < 64:
        raw = raw & np.uint64((1 << entry.bits) - 1)
    if not entry.signed:
        return raw.astype(np.float64)
    up = np.uint64(64 - entry.bits)
    return ((raw << up).view(np.int64) >> np.int64(64 - entry.bits)).astype(np.float64)


def _streams(frames: Frames, reader: PdoReader, wanted: Callable[[Key], bool]) -> list[_Stream]:
    streams: dict[tuple[str, int], _Stream] = {}
    by_id: dict[int, NDArray[np.int64]] = {}
    for can_id in np.unique(frames.can_id).tolist():
        by_id[can_id] = np.flatnonzero(frames.can_id == can_id)
    bounds: Sequence[int] = sorted(set(reader.boundaries))
    for start, stop in pairwise(bounds):
        mappings: list[PdoMapping] | None = None
        for can_id, places in by_id.items():
            own = places[np.searchsorted(places, start) : np.searchsorted(places, stop)]
            if not own.size or can_id < 0x180 or 0x580 <= can_id < 0x700:
                continue
            if mappings is None:
                mappings = reader.mappings(start)
            mapping = next((each for each in mappings if each.can_id == can_id), None)
            if mapping is None or not any(wanted(entry.key) for entry in mapping.entries):
                continue
            _check_sizes(frames, own, mapping)
            stream = streams.setdefault((mapping.direction, can_id),
                                        _Stream(mapping.direction, mapping.name, [], [], wanted))  # fmt: skip
            stream.frames += own.tolist()
            stream.chunks.append((mapping, [frames.data[k] for k in own]))
    return list(streams.values())


def _check_sizes(frames: Frames, own: NDArray[np.int64], mapping: PdoMapping) -> None:
    size = (mapping.bits + 7) // 8
    short = next((int(k) for k in own if len(frames.data[k]) < size), None)
    if short is not None:
        listed = ", ".join(label(entry.key) for entry in mapping.entries)
        raise InputError(
            frames.place(short),
            f"{mapping.name} holds {len(frames.data[short])} bytes, its mapping ({listed}) is {size} bytes long",
            "Give the DCF of this drive as it was configured, or a log that begins before its PDOs were mapped.",
        )
