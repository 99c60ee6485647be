"""The drive's PDO engine: mapping rules, transmission types, exchange on SYNC (CiA 301 7.2.2)."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable

from schwung_sim.drives.dictionary import NUMERIC, AbortError, Code, Entry, ObjectDictionary, Reader, key

NOT_VALID = 1 << 31
EXTENDED = 1 << 29
EVENT = 254  # transmission types 254 and 255 are event-driven, 0…240 follow SYNC
MAX_BITS = 64
EMCY_TOO_SHORT, EMCY_TOO_LONG, EMCY_RPDO_TIMEOUT = 0x8210, 0x8220, 0x8250

SendFrame = Callable[[int, bytes], None]
Report = Callable[[int], None]

_RESTRICTED = (range(0x80), range(0x101, 0x181), range(0x581, 0x600), range(0x601, 0x680),
               range(0x6E0, 0x700), range(0x701, 0x800))  # fmt: skip


class _Pdo(ABC):
    """What both directions have in common: communication record, mapping record and their rules."""

    def __init__(self, dictionary: ObjectDictionary, communication: int, mapping: int) -> None:
        self.dictionary, self.communication, self.mapping = dictionary, communication, mapping
        self.valid = False
        self.can_id = 0
        self.type = 255
        self.format = struct.Struct("<")
        hooks = dictionary.writers
        hooks[key(communication, 1)] = self._write_cob_id
        hooks[key(communication, 2)] = self._write_type
        hooks[key(mapping, 0)] = self._write_count
        for k in [k for k in dictionary.entries if k >> 8 == mapping and k & 0xFF]:
            hooks[k] = self._write_mapping

    @property
    def synchronous(self) -> bool:
        return self.type <= 240

    def load(self) -> None:
        """Take over what the dictionary holds: at power-on and after a reset. What cannot be mapped is not."""
        cob_id = self.dictionary.number(self.communication, 1)
        self.valid, self.can_id = not cob_id & NOT_VALID, cob_id & 0x7FF
        self.type = self.dictionary.number(self.communication, 2)
        try:
            self._compile(self._mapped(self.dictionary.number(self.mapping, 0)))
        except AbortError:
            self._compile([])

    def _write_cob_id(self, value: int) -> None:
        value = int(value)
        valid = not value & NOT_VALID
        if value & EXTENDED or (valid and any(value & 0x7FF in ids for ids in _RESTRICTED)):
            raise AbortError(Code.INVALID_VALUE)
        if self.valid and valid and value & 0x7FF != self.can_id:
            raise AbortError(Code.DEVICE_STATE)  # an identifier is changed while the PDO is off
        self.valid, self.can_id = valid, value & 0x7FF
        self.restart()

    def _write_type(self, value: int) -> None:
        if 240 < value < EVENT:
            raise AbortError(Code.INVALID_VALUE)
        self.type = value
        self.restart()

    def _write_count(self, count: int) -> None:
        if self.valid:
            raise AbortError(Code.DEVICE_STATE)
        mapped = self._mapped(count)
        if sum(bits for _, bits in mapped) > MAX_BITS:
            raise AbortError(Code.PDO_LENGTH)
        self._compile(mapped)

    def _write_mapping(self, value: int) -> None:
        if self.valid or self.dictionary.number(self.mapping, 0):
            raise AbortError(Code.DEVICE_STATE)
        if value:
            self._check_mappable(int(value))

    def _mapped(self, count: int) -> list[tuple[int, int]]:
        """(key, bits) of the first `count` entries. Raises AbortError where one cannot be mapped."""
        if count and key(self.mapping, count) not in self.dictionary.entries:
            raise AbortError(Code.PDO_LENGTH)
        values = [self.dictionary.number(self.mapping, subindex) for subindex in range(1, count + 1)]
        for value in values:
            self._check_mappable(value)
        return [(value >> 8, value & 0xFF) for value in values]

    def _check_mappable(self, value: int) -> None:
        index, subindex, bits = value >> 16, value >> 8 & 0xFF, value & 0xFF
        if self._is_dummy(value >> 8, bits):
            return
        entry = self.dictionary.entry(index, subindex)
        if entry.data_type not in NUMERIC or 8 * (entry.size or 0) != bits or not self._fits(entry):
            raise AbortError(Code.NOT_MAPPABLE)

    def _is_dummy(self, k: int, bits: int) -> bool:
        return False

    @abstractmethod
    def _fits(self, entry: Entry) -> bool:
        """Whether a PDO of this direction may carry it."""

    def _form(self, k: int) -> str:
        data_type = k >> 8 if self._is_dummy(k, 0) else self.dictionary.entries[k].data_type
        return NUMERIC[data_type][1]

    def _compile(self, mapped: list[tuple[int, int]]) -> None:
        self.format = struct.Struct("<" + "".join(self._form(k) for k, _ in mapped))
        self._bind([k for k, _ in mapped])
        self.restart()

    @abstractmethod
    def _bind(self, keys: list[int]) -> None:
        """Prepare the exchange of these objects."""

    @abstractmethod
    def restart(self) -> None:
        """Forget what belongs to the exchange so far."""


class Rpdo(_Pdo):
    """What the drive receives. Synchronous ones are held until the next SYNC."""

    def __init__(self, dictionary: ObjectDictionary, number: int, report: Report, clear: Report) -> None:
        self._writes: list[Callable[[int], None]] = []
        self._keys: list[int] = []
        self._held: bytes | None = None
        self._report, self._clear = report, clear
        self.keeps_first = False  # of several frames in one SYNC window the first acts
        self._came = False  # since the last look at the deadline
        self._came_s: float | None = None
        super().__init__(dictionary, 0x1400 + number, 0x1600 + number)

    def _is_dummy(self, k: int, bits: int) -> bool:
        form = NUMERIC.get(k >> 8) if k & 0xFF == 0 and 2 <= k >> 8 <= 7 else None
        return form is not None and bits in (0, 8 * struct.calcsize(form))

    def _fits(self, entry: Entry) -> bool:
        return entry.receivable

    def _bind(self, keys: list[int]) -> None:
        self._keys = keys
        self._writes = [_ignore if self._is_dummy(k, 0) else self.dictionary.writer(k) for k in keys]

    def rebind(self) -> None:
        """Look anew for what stands behind the mapped objects."""
        self._bind(self._keys)

    def restart(self) -> None:
        self._held, self._came, self._came_s = None, False, None

    def receive(self, data: bytes) -> None:
        """Take a frame: act now, or hold it for SYNC."""
        if len(data) != self.format.size:
            self._report(EMCY_TOO_SHORT if len(data) < self.format.size else EMCY_TOO_LONG)
            if len(data) < self.format.size:
                return
        self._came = True
        if self.type <= 240:
            if self._held is None or not self.keeps_first:
                self._held = data
        else:
            self._act(data)

    def watch(self, now: float) -> None:
        """The deadline of 14xx:05, which begins with the first frame (CiA 301 7.5.2.35): past it, an error."""
        limit = self.dictionary.real(key(self.communication, 5)) * 1e-3
        if self._came:
            self._came, self._came_s = False, now
            self._clear(EMCY_RPDO_TIMEOUT)
        elif limit and self._came_s is not None and now - self._came_s > limit:
            self._came_s = None
            self._report(EMCY_RPDO_TIMEOUT)

    def sync(self) -> None:
        """Act on what came since the last SYNC."""
        if self._held is not None:
            data, self._held = self._held, None
            self._act(data)

    def _act(self, data: bytes) -> None:
        """Take a frame's values together: the controlword finds the set-point beside it, wherever it is mapped."""
        held, received = self.dictionary.values, self.format.unpack_from(data)
        before = [held.get(k, 0) for k in self._keys]
        for k, value in zip(self._keys, received, strict=True):
            held[k] = value
        for k, write, value, old in zip(self._keys, self._writes, received, before, strict=True):
            try:
                write(value)
            except AbortError:
                held[k] = old  # a PDO has no answer: a value out of its range leaves the old one


class Tpdo(_Pdo):
    """What the drive sends: at every n-th SYNC, or on events no faster than the inhibit time."""

    def __init__(self, dictionary: ObjectDictionary, number: int, send: SendFrame) -> None:
        self._reads: list[Reader] = []
        self._send = send
        self._last = b""
        self._sent_s = float("-inf")
        self._syncs = 0
        self._waiting = False
        super().__init__(dictionary, 0x1800 + number, 0x1A00 + number)
        dictionary.writers[key(self.communication, 3)] = self._write_while_off
        dictionary.writers[key(self.communication, 6)] = self._write_while_off

    def _fits(self, entry: Entry) -> bool:
        return entry.sendable

    def _write_while_off(self, value: int) -> None:
        if self.valid:
            raise AbortError(Code.DEVICE_STATE)

    def _bind(self, keys: list[int]) -> None:
        self._reads = [self.dictionary.reader(k) for k in keys]

    def restart(self) -> None:
        self._last, self._sent_s, self._syncs = b"", float("-inf"), 0
        self._waiting = self.dictionary.number(self.communication, 6) > 0

    def _sample(self) -> bytes:
        return self.format.pack(*[read() for read in self._reads])

    def sync(self, counter: int) -> None:
        """Sample and send where this SYNC is ours. `counter` is 0 where SYNC carries none."""
        if self._waiting and counter:  # 1800:06: the first SYNC that counts
            if counter != self.dictionary.number(self.communication, 6):
                return
            self._waiting, self._syncs = False, self.type - 1
        if self.type == 0:
            data = self._sample()
            if data != self._last:
                self._last = data
                self._send(self.can_id, data)
            return
        self._syncs += 1
        if self._syncs >= self.type:
            self._syncs = 0
            self._send(self.can_id, self._sample())

    def poll(self, now: float) -> None:
        """Send an event-driven PDO that has changed, or whose event timer has run out."""
        if now - self._sent_s < self.dictionary.number(self.communication, 3) * 1e-4:
            return
        data = self._sample()
        period = self.dictionary.number(self.communication, 5) * 1e-3
        if data != self._last or (period and now - self._sent_s >= period):
            self._last, self._sent_s = data, now
            self._send(self.can_id, data)


def _numbers(dictionary: ObjectDictionary, first: int) -> list[int]:
    """Numbers of the PDOs, from 0, whose communication record the EDS declares."""
    return sorted({(k >> 8) - first for k in dictionary.entries if first <= k >> 8 < first + 0x200})


def _ignore(value: int) -> None:
    """Where a dummy entry goes."""


class PdoEngine:
    """All PDOs that the EDS declares; active only while the node is operational."""

    def __init__(self, dictionary: ObjectDictionary, send: SendFrame, report: Report, clear: Report) -> None:
        self.rpdos = [Rpdo(dictionary, number, report, clear) for number in _numbers(dictionary, 0x1400)]
        self.tpdos = [Tpdo(dictionary, number, send) for number in _numbers(dictionary, 0x1800)]
        self.misses: list[
            bool
        ] = []  # the bench's own: the next RPDOs do not come with their SYNC; True: behind it
        self._late: list[tuple[int, bytes]] = []

    def load(self) -> None:
        """Take over what the dictionary holds."""
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.load()

    def restart(self) -> None:
        """At the start of NMT operational."""
        for pdo in (*self.rpdos, *self.tpdos):
            pdo.restart()

    def receive(self, can_id: int, data: bytes) -> None:
        """Take a frame, where it is one of ours."""
        for rpdo in self.rpdos:
            if rpdo.can_id == can_id and rpdo.valid:
                if not self.misses:
                    rpdo.receive(data)
                elif self.misses.pop():
                    self._late.append((can_id, data))

    def sync(self, counter: int) -> None:
        """Sample and send first, then act: what is reported belongs to the instant of SYNC."""
        for tpdo in self.tpdos:
            if tpdo.type <= 240 and tpdo.valid and tpdo.format.size:
                tpdo.sync(counter)
        for rpdo in self.rpdos:
            rpdo.sync()
        if self._late:
            late, self._late = self._late, []
            for can_id, data in late:
                self.receive(can_id, data)

    def poll(self, now: float) -> None:
        """Send what is due by event; look at the deadlines of what should come."""
        for rpdo in self.rpdos:
            if rpdo.valid:
                rpdo.watch(now)
        for tpdo in self.tpdos:
            if tpdo.type >= EVENT and tpdo.valid and tpdo.format.size:
                tpdo.poll(now)
