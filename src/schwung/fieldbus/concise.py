"""Concise DCF (CiA 302-3, object 1F22): the values of a configuration as one block of bytes, in order of download.

    number of entries, UNSIGNED32
    per entry: index UNSIGNED16, sub-index UNSIGNED8, size in bytes UNSIGNED32, data          all little-endian

An object may occur more than once: a PDO is switched off, remapped, and switched on again (CiA 301 7.5.2.36).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Container, Sequence
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

    `lookup` knows all objects of the drive. Nothing but these values is downloaded: a PDO whose identifier or count is
    not among them (a drive may have them fixed) is not switched off for its others, since nobody knows what on is.
    Raises InputError where a value does not fit its type.
    """
    present = {(v.parameter.index, v.parameter.subindex): v.raw for v in values}
    fixed = [v for v in values if _is_fixed(v.parameter, present)]
    downloads = _in_order(fixed)

    def read(parameter: Parameter) -> int:
        """What the drive is thought to hold: an enabled PDO, so that it is switched off first."""
        raw = present.get((parameter.index, parameter.subindex), 0)
        return int(raw) & ~pdo.INVALID if isinstance(raw, int) else 0

    def given(index: int, subindex: int) -> Parameter | None:
        return lookup(index, subindex) if (index, subindex) in present else None

    setup.write_ordered([v for v in values if v not in fixed], given, read, downloads.append)
    entries = [(value.parameter, encode(value.parameter, value.raw)) for value in downloads]
    body = [_HEAD.pack(p.index, p.subindex, len(data)) + data for p, data in entries]
    return _COUNT.pack(len(entries)) + b"".join(body)


def _is_fixed(parameter: Parameter, present: Container[tuple[int, int]]) -> bool:
    """True for what belongs to a PDO whose identifier, or count of entries, is not given."""
    if not pdo.is_pdo_object(parameter):
        return False
    mapping = parameter.index | 0x200
    entries = parameter.index == mapping and (mapping, 0) not in present
    return entries or (mapping & 0xFDFF, 1) not in present


def _in_order(values: Sequence[ParameterValue]) -> list[ParameterValue]:
    """Object by object; the count of a mapping goes to 0 before its entries, and comes back behind them."""
    ordered: list[ParameterValue] = []
    for index in sorted({v.parameter.index for v in values}):
        own = sorted(
            (v for v in values if v.parameter.index == index), key=lambda v: v.parameter.subindex or 256
        )
        if len(own) > 1 and own[-1].parameter.subindex == 0:
            ordered.append(ParameterValue(own[-1].parameter, 0))
        ordered += own
    return ordered


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
