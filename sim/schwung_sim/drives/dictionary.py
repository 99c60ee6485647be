"""The drive's object dictionary: what the EDS declares, the values now, and hooks where a value is live.

The EDS is the one source of types, access, defaults, limits and PDO mapping (CiA 306-1, CiA 301 clause 7.4).
"""

from __future__ import annotations

import configparser
import math
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import canopen

from schwung_sim.errors import BenchError

Value = int | float | bytes
Reader = Callable[[], Value]
Writer = Callable[[int], None]

#: struct format of each numeric data type (CiA 301 table 44)
NUMERIC = {
    0x01: "<?", 0x02: "<b", 0x03: "<h", 0x04: "<i", 0x05: "<B", 0x06: "<H", 0x07: "<I",
    0x08: "<f", 0x11: "<d", 0x15: "<q", 0x1B: "<Q",
}  # fmt: skip
DOMAIN = 0x0F
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


@dataclass(frozen=True, slots=True)
class Entry:
    """One object of the dictionary, as the EDS declares it."""

    index: int
    subindex: int
    name: str
    data_type: int
    access: str
    default: Value
    low: int | None
    high: int | None
    mappable: bool

    @property
    def key(self) -> int:
        return key(self.index, self.subindex)

    @property
    def size(self) -> int | None:
        """Bytes of a numeric value; None for strings and domains."""
        form = NUMERIC.get(self.data_type)
        return None if form is None else struct.calcsize(form)

    @property
    def readable(self) -> bool:
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        return "w" in self.access


def key(index: int, subindex: int = 0) -> int:
    """One number for index and subindex."""
    return index << 8 | subindex


class ObjectDictionary:
    """Entries, values and hooks by `key(index, subindex)`.

    A `reader` gives a value that is live; a `writer` is called with a value before it is stored and may
    refuse it by raising AbortError.
    """

    def __init__(self, entries: Iterator[Entry] | list[Entry]) -> None:
        self.entries = {entry.key: entry for entry in entries}
        self.values: dict[int, Value] = {k: entry.default for k, entry in self.entries.items()}
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
        """An integer value, for the drive's own use. Raises BenchError where the EDS has no such object."""
        value = self.values.get(key(index, subindex))
        if value is None:
            raise _incomplete(key(index, subindex))
        return int(value)

    def check_hooks(self) -> None:
        """Raises BenchError where the drive has a hook for an object that the EDS does not declare."""
        for k in (*self.readers, *self.writers):
            if k not in self.entries:
                raise _incomplete(k)

    def upload(self, index: int, subindex: int) -> bytes:
        """What an SDO upload returns. Raises AbortError."""
        entry = self.entry(index, subindex)
        if not entry.readable:
            raise AbortError(Code.WRITE_ONLY)
        value = self.reader(entry.key)()
        return value if isinstance(value, bytes) else struct.pack(NUMERIC[entry.data_type], value)

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
            self.writer(entry.key)(struct.unpack(NUMERIC[entry.data_type], data)[0])

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


def _incomplete(k: int) -> BenchError:
    return BenchError("EDS", f"lacks object 0x{k >> 8:04X}:{k & 0xFF:02X}, which this drive is made of")


def read_eds(path: Path, node_id: int) -> ObjectDictionary:
    """The dictionary that an EDS declares, with $NODEID filled in. Raises BenchError."""
    if not path.is_file():
        raise BenchError(str(path), "there is no such EDS", "Give the file that describes the drive.")
    try:
        parsed = canopen.import_od(str(path), node_id)
    except (configparser.Error, ValueError, KeyError, UnicodeDecodeError) as error:
        raise BenchError(str(path), f"is no EDS that can be read: {error}") from error
    return ObjectDictionary([_entry(variable) for variable in _variables(parsed) if variable.index > 0x1F])


def _variables(parsed: canopen.ObjectDictionary) -> Iterator[canopen.objectdictionary.ODVariable]:
    for item in parsed.values():
        if isinstance(item, canopen.objectdictionary.ODVariable):
            yield item
        else:
            yield from item.subindices.values()


def _entry(variable: canopen.objectdictionary.ODVariable) -> Entry:
    default = variable.default
    if variable.data_type not in NUMERIC:
        default = default.encode() if isinstance(default, str) else bytes(default or b"")
    elif default is None:
        raise BenchError(
            f"EDS, object 0x{variable.index:04X}:{variable.subindex:02X}", "has no default value"
        )
    return Entry(
        index=variable.index,
        subindex=variable.subindex,
        name=variable.name,
        data_type=variable.data_type,
        access=variable.access_type,
        default=default,
        low=variable.min,
        high=variable.max,
        mappable=variable.pdo_mappable,
    )
