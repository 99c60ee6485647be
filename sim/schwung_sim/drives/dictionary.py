"""The drive's object dictionary: what its EDS declares, the values now, and hooks where a value is live.

The EDS is the one source of types, access, limits and PDO mapping (CiA 306-1, CiA 301 clause 7.4). What the drive's
logic needs beyond that has a value here, and no entry: nobody on the bus sees it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from schwung_sim.drives.eds import DOMAIN, NUMERIC, Entry, Value, key
from schwung_sim.errors import BenchError

__all__ = [
    "DOMAIN",
    "NUMERIC",
    "AbortError",
    "Code",
    "Entry",
    "NoAnswer",
    "ObjectDictionary",
    "Reader",
    "Value",
    "Writer",
    "key",
]

Reader = Callable[[], Value]
Writer = Callable[[Any], None]  # an integer, or a float where the type is one

DOMAIN_MAX_BYTES = 1 << 16


class Code:
    """SDO abort codes (CiA 301 table 22)."""

    TOGGLE = 0x05030000
    TIMED_OUT = 0x05040000
    COMMAND = 0x05040001
    BLOCK_SIZE = 0x05040002
    CRC = 0x05040004
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_LENGTH = 0x06040042
    INCOMPATIBLE = 0x06040043
    LENGTH_HIGH = 0x06070012
    LENGTH_LOW = 0x06070013
    NO_SUBINDEX = 0x06090011
    INVALID_VALUE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    CANNOT_STORE = 0x08000020
    DEVICE_STATE = 0x08000022
    NO_DATA = 0x08000024


class AbortError(Exception):
    """An access that is refused; `code` is the SDO abort code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"0x{code:08X}")


class NoAnswer(Exception):
    """The drive lost its supply during an access: nobody is there to answer."""


class ObjectDictionary:
    """Entries, values and hooks by `key(index, subindex)`; `defaults` are those of all entries, and what is hidden.

    A `reader` gives a value that is live; a `writer` is called with a value before it is stored and may
    refuse it by raising AbortError.
    """

    def __init__(self, entries: Iterable[Entry], defaults: Mapping[int, Value]) -> None:
        self.entries = {entry.key: entry for entry in entries}
        self.defaults = dict(defaults)
        self.values: dict[int, Value] = dict(defaults)
        self.readers: dict[int, Reader] = {}
        self.writers: dict[int, Writer] = {}
        self._indices = {entry.index for entry in self.entries.values()}

    def entry(self, index: int, subindex: int) -> Entry:
        """Raises AbortError (0x06020000, 0x06090011) where there is none."""
        entry = self.entries.get(key(index, subindex))
        if entry is None:
            raise AbortError(Code.NO_SUBINDEX if index in self._indices else Code.NO_OBJECT)
        return entry

    def number(self, index: int, subindex: int = 0) -> int:
        """An integer value, for the drive's own use, shown or hidden. Raises BenchError where it has none."""
        value = self.values.get(index << 8 | subindex)
        if value is None:
            raise incomplete(key(index, subindex))
        return 0 if isinstance(value, bytes) else int(value)

    def real(self, k: int) -> float:
        """A number by its key; 0 where there is none, or something else."""
        value = self.values.get(k, 0.0)
        return 0.0 if isinstance(value, bytes) else float(value)

    def upload(self, index: int, subindex: int) -> bytes:
        """What an SDO upload returns. Raises AbortError."""
        entry = self.entry(index, subindex)
        if not entry.readable:
            raise AbortError(Code.WRITE_ONLY)
        return entry.encode(self.reader(entry.key)())

    def check_download(self, index: int, subindex: int, size: int | None) -> Entry:
        """Refuse what can be refused before the data has come. Raises AbortError."""
        entry = self.entry(index, subindex)
        if not entry.writable:
            raise AbortError(Code.READ_ONLY)
        wanted = entry.size
        if size is not None:
            if size > (DOMAIN_MAX_BYTES if wanted is None else wanted):
                raise AbortError(Code.LENGTH_HIGH)
            if wanted is not None and size < wanted:
                raise AbortError(Code.LENGTH_LOW)
        return entry

    def download(self, index: int, subindex: int, data: bytes) -> None:
        """Write as an SDO download does. Raises AbortError."""
        entry = self.check_download(index, subindex, len(data))
        if entry.size is None:
            self.values[entry.key] = data
        else:
            self.writer(entry.key)(entry.decode(data))

    def writer(self, k: int) -> Writer:
        """A callable that checks the range, asks the hook, and stores. It raises AbortError."""
        entry, hook, values = self.entries[k], self.writers.get(k), self.values
        low = -math.inf if entry.low is None else entry.low
        high = math.inf if entry.high is None else entry.high

        def write(value: int) -> None:
            if value > high:
                raise AbortError(Code.TOO_HIGH)
            if value < low:
                raise AbortError(Code.TOO_LOW)
            if hook is not None:
                hook(value)
            values[k] = value

        return write

    def reader(self, k: int) -> Reader:
        """A callable that gives the value now: the hook, or what is stored."""
        return self.readers.get(k) or (lambda: self.values[k])


def incomplete(k: int) -> BenchError:
    """What is raised where the drive's logic misses a value."""
    return BenchError("EDS", f"lacks object 0x{k >> 8:04X}:{k & 0xFF:02X}, which this drive is made of")
