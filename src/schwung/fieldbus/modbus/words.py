"""Registers and values: how 16-bit words make a parameter, and back.

A word is a byte pair with the high byte first (Modbus Application Protocol 1.1b3, 4.2); in which order words make a
wider value is every manufacturer's own choice.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Literal

from schwung.errors import InputError
from schwung.fieldbus.drive import RawValue

WordOrder = Literal["high_first", "low_first"]

_FORMATS = {
    "INTEGER16": "h", "UNSIGNED16": "H", "INTEGER32": "i", "UNSIGNED32": "I",
    "INTEGER64": "q", "UNSIGNED64": "Q", "REAL32": "f", "REAL64": "d",
}  # fmt: skip


def word_count(type_name: str, at_least: int = 1) -> int:
    """How many registers a parameter of that type takes; `at_least`: some drives give every parameter two."""
    return max(struct.calcsize(_format(type_name)) // 2, at_least)


def encode(raw: RawValue, type_name: str, order: WordOrder, at_least: int = 1) -> tuple[int, ...]:
    """The words of a value in the order of their addresses. A value narrower than its registers is sign-extended.

    Raises InputError for a value that does not fit its type.
    """
    code = _format(type_name)
    real = code in "fd"
    if isinstance(raw, bool) or not isinstance(raw, int | float) or (isinstance(raw, float) and not real):
        raise InputError(f"value {raw!r}", f"is no {type_name}", "Give a number of that type.")
    try:
        data = struct.pack(f">{code}", raw)
    except (struct.error, OverflowError):
        raise InputError(f"value {raw}", f"does not fit {type_name}", "Give one in its range.") from None
    missing = 2 * at_least - len(data)
    if missing > 0:
        data = (b"\xff" if raw < 0 else b"\x00") * missing + data
    words = struct.unpack(f">{len(data) // 2}H", data)
    return words if order == "high_first" else words[::-1]


def decode(words: Sequence[int], type_name: str, order: WordOrder) -> int | float:
    """The value of words that were read in the order of their addresses; of more words than the type needs, the
    low ones count: whether a drive extends the sign into the others is not said by all."""
    needed = word_count(type_name)
    ordered = list(words) if order == "high_first" else list(words)[::-1]
    data = struct.pack(f">{needed}H", *ordered[len(ordered) - needed :])
    value: int | float = struct.unpack(f">{_format(type_name)}", data)[0]
    return value


def _format(type_name: str) -> str:
    try:
        return _FORMATS[type_name]
    except KeyError:
        raise InputError(
            f'type "{type_name}"', "is none that registers hold", f"Use {', '.join(_FORMATS)}."
        ) from None
