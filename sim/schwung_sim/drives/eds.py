"""Electronic data sheets as the bench reads them (CiA 306-1), forgiving what vendors' tools get wrong.

Anything that a line-by-line reader can make sense of is taken: other encodings, doubled sections and keys (the
last one counts), upper and lower case, sub-indices before their object, missing types, values that are `NULL`.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from schwung_sim.errors import BenchError

Value = int | float | bytes

#: struct format of each numeric data type (CiA 301 table 44)
NUMERIC = {
    0x01: "<?", 0x02: "<b", 0x03: "<h", 0x04: "<i", 0x05: "<B", 0x06: "<H", 0x07: "<I",
    0x08: "<f", 0x11: "<d", 0x15: "<q", 0x1B: "<Q",
}  # fmt: skip
#: bytes of the integers that no struct format has: SDO only, the bench maps none of them
ODD_INTEGERS = {0x10: 3, 0x12: 5, 0x13: 6, 0x14: 7, 0x16: 3, 0x18: 5, 0x19: 6, 0x1A: 7}
SIGNED = (0x02, 0x03, 0x04, 0x10, 0x12, 0x13, 0x14, 0x15)
REALS = (0x08, 0x11)
UNSIGNED8, UNSIGNED32 = 0x05, 0x07
VISIBLE_STRING, OCTET_STRING, UNICODE_STRING, DOMAIN = 0x09, 0x0A, 0x0B, 0x0F

_ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
_RECORDS = (8, 9)
_IDENTITY = {1: "vendornumber", 2: "productnumber", 3: "revisionnumber"}  # of 1018, in [DeviceInfo]
_SECTION = re.compile(r"([0-9a-f]{4})(?:sub([0-9a-f]{1,2}))?")

Section = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Entry:
    """One object of the dictionary, as the EDS declares it; `default` None: it says nothing."""

    index: int
    subindex: int
    name: str
    data_type: int
    access: str
    default: Value | None
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
        return ODD_INTEGERS.get(self.data_type) if form is None else struct.calcsize(form)

    @property
    def readable(self) -> bool:
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        return "w" in self.access

    @property
    def sendable(self) -> bool:
        """A TPDO may carry it: rww is for what the drive receives (CiA 306-1 table 7)."""
        return self.mappable and self.access in ("ro", "const", "rw", "rwr")

    @property
    def receivable(self) -> bool:
        """An RPDO may carry it."""
        return self.mappable and self.access in ("wo", "rw", "rww")

    @property
    def span(self) -> tuple[float, float]:
        """What its type can hold; unlimited for real numbers."""
        if self.data_type in REALS or self.size is None:
            return -math.inf, math.inf
        bits = 8 * self.size
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.data_type in SIGNED else (0, (1 << bits) - 1)

    def fit(self, value: float) -> int | float:
        """The nearest value that the type holds and the EDS allows."""
        low, high = self.span
        low, high = (
            max(low, low if self.low is None else self.low),
            min(high, high if self.high is None else self.high),
        )
        held = min(max(value, low), high)
        return held if self.data_type in REALS else round(held)

    def encode(self, value: Value) -> bytes:
        """Bytes on the bus."""
        if isinstance(value, bytes):
            return value
        form = NUMERIC.get(self.data_type)
        if form is not None:
            return struct.pack(form, value)
        size = self.size or 8  # a number where the EDS has no type for one
        return (int(value) & (1 << 8 * size) - 1).to_bytes(size, "little")

    def decode(self, data: bytes) -> int | float:
        """A numeric value from as many bytes as it has."""
        form = NUMERIC.get(self.data_type)
        if form is not None:
            value: int | float = struct.unpack(form, data)[0]
            return value
        return int.from_bytes(data, "little", signed=self.data_type in SIGNED)


def key(index: int, subindex: int = 0) -> int:
    """One number for index and subindex."""
    return index << 8 | subindex


def read_entries(path: Path, node_id: int) -> list[Entry]:
    """Every object that an EDS or DCF declares, $NODEID filled in. Raises BenchError where there is none.

    Of a DCF the defaults are taken: its ParameterValues are of another axis, but for what only reads and has no
    default, which is the device's own (identity, supported modes).
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BenchError(
            str(path), f"there is no such EDS ({error.strerror})", "Give the drive's file."
        ) from error
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    entries = _declared(text, node_id)
    if not entries:
        raise BenchError(
            str(path), "is no EDS that can be read: it declares no object", "Give the drive's file."
        )
    return list(entries)


@lru_cache(maxsize=16)
def _declared(text: str, node_id: int) -> tuple[Entry, ...]:
    """Kept, since drives are powered up by the thousand: most of what making one takes."""
    return tuple({entry.key: entry for entry in _entries(_sections(text), node_id)}.values())


def _sections(text: str) -> dict[str, dict[str, str]]:
    sections: dict[str, dict[str, str]] = {}
    present: dict[str, str] = {}
    for raw in text.splitlines():
        line = raw.strip()
        if line.startswith("["):
            present = sections.setdefault(line.strip("[] \t").lower(), {})
        elif "=" in line and not line.startswith((";", "#")):
            name, _, value = line.partition("=")
            present[name.strip().lower()] = value.strip()
    return sections


def _entries(sections: Mapping[str, Section], node_id: int) -> Iterator[Entry]:
    whole: dict[int, Section] = {}
    parts: dict[int, dict[int, Section]] = {}
    for title, section in sections.items():
        match = _SECTION.fullmatch(title)
        if match is None or int(match[1], 16) < 0x1000:  # below are data types
            continue
        if match[2] is None:
            whole[int(match[1], 16)] = section
        else:
            parts.setdefault(int(match[1], 16), {})[int(match[2], 16)] = section
    identity = sections.get("deviceinfo", {})
    for index in sorted(whole.keys() | parts.keys()):
        parent = whole.get(index, {})
        subs = parts.get(index, {}) or dict(_compact(index, parent, sections))
        if _integer(parent.get("objecttype"), node_id) not in _RECORDS and ("datatype" in parent or not subs):
            yield _entry(index, 0, parent, node_id)
            continue
        for subindex, section in sorted(subs.items()):
            entry = _entry(index, subindex, section, node_id)
            if subindex == 0 and entry.default is None and not _counts_what_is_used(index):
                entry = replace(entry, default=max(subs))
            elif index == 0x1018 and entry.default is None:
                told = identity.get(_IDENTITY.get(subindex, ""), "")
                entry = replace(entry, default=_integer(told, node_id))
            yield entry


def _counts_what_is_used(index: int) -> bool:
    """Sub-index 0 of error history and PDO mapping counts entries in use, not entries that there are."""
    return index == 0x1003 or 0x1600 <= index < 0x1800 or 0x1A00 <= index < 0x1C00


def _compact(index: int, parent: Section, sections: Mapping[str, Section]) -> Iterator[tuple[int, Section]]:
    """The elements of an array that is written in short (CiA 306-1 clause 4.6.3.3)."""
    count = _integer(parent.get("compactsubobj"), 0) or 0
    names = sections.get(f"{index:04x}name", {})
    values = sections.get(f"{index:04x}value", {})
    if 1 <= count <= 254:
        yield (
            0,
            {
                "parametername": "Number of entries",
                "datatype": "5",
                "accesstype": "ro",
                "defaultvalue": str(count),
            },
        )
    for n in range(1, min(count, 254) + 1):
        own = {"parametername": names.get(str(n), f"{parent.get('parametername', '')}{n}")}
        if str(n) in values:
            own["defaultvalue"] = values[str(n)]
        yield n, {**parent, **own}


def _entry(index: int, subindex: int, section: Section, node_id: int) -> Entry:
    data_type = _integer(section.get("datatype"), node_id)
    if data_type is None:
        is_domain = _integer(section.get("objecttype"), node_id) == 2
        data_type = DOMAIN if is_domain else UNSIGNED32 if subindex else UNSIGNED8
    access = section.get("accesstype", "rw").lower()
    access = access if access in _ACCESS else "rw"
    default = _value(data_type, section.get("defaultvalue"), node_id)
    if default is None and access in ("ro", "const"):
        default = _value(data_type, section.get("parametervalue"), node_id)
    low, high = (_limit(data_type, section.get(name), node_id) for name in ("lowlimit", "highlimit"))
    if low is not None and high is not None and low > high:
        low = high = None
    if index == 0x1016 and high is not None and high < 1 << 16:
        high = None  # meant for the time: with a node id above it, no value would be left
    return Entry(
        index=index,
        subindex=subindex,
        name=section.get("parametername", ""),
        data_type=data_type,
        access=access,
        default=default,
        low=low,
        high=high,
        mappable=bool(_integer(section.get("pdomapping"), node_id)),
    )


def _value(data_type: int, text: str | None, node_id: int) -> Value | None:
    if data_type in REALS:
        try:
            return float((text or "").partition(";")[0])
        except ValueError:
            number = _integer(text, node_id)
            return None if number is None else float(number)
    if data_type in NUMERIC or data_type in ODD_INTEGERS:
        return _limit(data_type, text, node_id)
    if not text or text.upper() == "NULL" or data_type == DOMAIN:
        return None
    if data_type == UNICODE_STRING:
        return text.encode("utf-16-le")
    return text.encode("latin-1", errors="replace")


def _limit(data_type: int, text: str | None, node_id: int) -> int | None:
    """An integer as its type holds it: hexadecimal numbers of signed types are written as two's complement."""
    number = _integer(text, node_id)
    form = NUMERIC.get(data_type)
    size = ODD_INTEGERS.get(data_type, 8) if form is None else struct.calcsize(form)
    if number is None or data_type in REALS:
        return number
    if data_type == 0x01:
        return int(number != 0)
    number &= (1 << 8 * size) - 1
    return number - (1 << 8 * size) if data_type in SIGNED and number >> 8 * size - 1 else number


def _integer(text: str | None, node_id: int) -> int | None:
    """A number, or a sum with $NODEID in it; None where it is neither."""
    total = 0
    for part in (text or "").partition(";")[0].lower().split("+"):
        word = part.strip()
        try:
            total += node_id if word == "$nodeid" else int(word, 16 if word.startswith("0x") else 10)
        except ValueError:
            return None
    return total
