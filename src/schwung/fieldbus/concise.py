"""Concise DCF (CiA 302-3, object 1F22): the values of a configuration as one block of bytes, in order of download.

    number of entries, UNSIGNED32
    per entry: index UNSIGNED16, sub-index UNSIGNED8, size in bytes UNSIGNED32, data          all little-endian

An object may occur more than once: a PDO is switched off, remapped, and switched on again (CiA 301 7.5.2.36).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from schwung.errors import InputError
from schwung.fieldbus.canopen import pdo, setup
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung.fieldbus.eds import byte_size, encode

_COUNT, _HEAD = struct.Struct("<I"), struct.Struct("<HBI")


@dataclass(frozen=True)
class ConciseEntry:
    """One download."""

    index: int
    subindex: int
    data: bytes


def write_concise(values: Sequence[ParameterValue], lookup: Callable[[int, int], Parameter | None]) -> bytes:
    """A concise DCF that brings a drive to these values, whatever it holds before; in an order that it takes.

    `lookup` knows all objects of the drive: count and identifier of a PDO are needed where its entries are given.
    Raises InputError where a value does not fit its type.
    """
    downloads: list[ParameterValue] = []
    present = {(v.parameter.index, v.parameter.subindex): v.raw for v in values}

    def read(parameter: Parameter) -> int:
        """What the drive is thought to hold: an enabled PDO, so that it is switched off first."""
        raw = present.get((parameter.index, parameter.subindex), 0)
        return int(raw) & ~pdo.INVALID if isinstance(raw, int) else 0

    setup.write_ordered(values, lookup, read, downloads.append)
    entries = [(value.parameter, encode(value.parameter, value.raw)) for value in downloads]
    body = [_HEAD.pack(p.index, p.subindex, len(data)) + data for p, data in entries]
    return _COUNT.pack(len(entries)) + b"".join(body)


def read_concise(content: bytes, place: str) -> list[ConciseEntry]:
    """The downloads of a concise DCF, in order. Raises InputError naming entry and offset where it is none."""
    if len(content) < _COUNT.size:
        raise InputError(place, "is too short for a concise DCF", "Give a whole file.")
    (count,) = _COUNT.unpack_from(content)
    entries, at = [], _COUNT.size
    for number in range(1, count + 1):
        if len(content) < at + _HEAD.size:
            raise InputError(
                f"{place}, entry {number} of {count}", f"is missing at byte {at}", "Give a whole file."
            )
        index, subindex, size = _HEAD.unpack_from(content, at)
        at += _HEAD.size
        if index < 0x1000 or len(content) < at + size:
            problem = f"0x{index:04X} is no object" if index < 0x1000 else f"its {size} bytes are not there"
            raise InputError(
                f"{place}, entry {number} of {count}", f"{problem} (byte {at})", "Is this a concise DCF?"
            )
        entries.append(ConciseEntry(index, subindex, content[at : at + size]))
        at += size
    if at != len(content):
        raise InputError(place, f"goes on behind its {count} entries, at byte {at}", "Is this a concise DCF?")
    return entries


def untyped_parameter(entry: ConciseEntry) -> Parameter:
    """A parameter for who has no dictionary: an unsigned integer of that size, or bytes."""
    name = f"UNSIGNED{8 * len(entry.data)}"
    return Parameter(entry.index, entry.subindex, name if byte_size(name) in (1, 2, 4, 8) else "OCTET_STRING")
