"""Data types of CiA 301, and what raw values look like on the bus."""

from __future__ import annotations

import struct

from schwung.errors import InputError
from schwung.fieldbus.drive import Parameter, RawValue

#: Data type codes of CiA 301 table 44.
TYPE_NAMES = {
    0x01: "BOOLEAN", 0x02: "INTEGER8", 0x03: "INTEGER16", 0x04: "INTEGER32", 0x05: "UNSIGNED8",
    0x06: "UNSIGNED16", 0x07: "UNSIGNED32", 0x08: "REAL32", 0x09: "VISIBLE_STRING", 0x0A: "OCTET_STRING",
    0x0B: "UNICODE_STRING", 0x0C: "TIME_OF_DAY", 0x0D: "TIME_DIFFERENCE", 0x0F: "DOMAIN", 0x10: "INTEGER24",
    0x11: "REAL64", 0x12: "INTEGER40", 0x13: "INTEGER48", 0x14: "INTEGER56", 0x15: "INTEGER64",
    0x16: "UNSIGNED24", 0x18: "UNSIGNED40", 0x19: "UNSIGNED48", 0x1A: "UNSIGNED56", 0x1B: "UNSIGNED64",
}  # fmt: skip

TYPE_CODES = {name: code for code, name in TYPE_NAMES.items()}


def byte_size(type_name: str) -> int | None:
    """Bytes of a fixed-size type, None for strings, times and domains."""
    if type_name == "BOOLEAN":
        return 1
    digits = type_name.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ_")
    return int(digits) // 8 if digits.isdigit() else None


def integer_range(type_name: str) -> tuple[int, int] | None:
    """Lowest and highest value of an integer type or BOOLEAN; None for any other type."""
    if type_name == "BOOLEAN":
        return 0, 1
    bits = 8 * (byte_size(type_name) or 0)
    if type_name.startswith("UNSIGNED"):
        return 0, (1 << bits) - 1
    if type_name.startswith("INTEGER"):
        return -(1 << (bits - 1)), (1 << (bits - 1)) - 1
    return None


def encode(parameter: Parameter, raw: RawValue) -> bytes:
    """Bytes on the bus of a raw value. Raises InputError when it does not fit the type."""
    kind, size = parameter.type, byte_size(parameter.type)
    try:
        if isinstance(raw, bytes):
            return raw
        if kind == "VISIBLE_STRING" and isinstance(raw, str):
            return raw.encode("ascii")
        if kind == "UNICODE_STRING" and isinstance(raw, str):
            return raw.encode("utf-16-le")
        if size is not None and not isinstance(raw, str):
            if kind.startswith("REAL"):
                return struct.pack("<f" if size == 4 else "<d", raw)
            if float(raw).is_integer():
                return int(raw).to_bytes(size, "little", signed=kind.startswith("INTEGER"))
    except (OverflowError, UnicodeEncodeError, struct.error):
        pass
    raise InputError(parameter.label, f"{raw!r} is no {kind}", "Give a value within the type's range.")


def decode(parameter: Parameter, data: bytes) -> RawValue:
    """Raw value of bytes from the bus: int, float, str, or bytes for domains.

    More bytes than the type has are cut: some drives answer every integer with four. Raises InputError where
    there are too few: the EDS then is of another drive.
    """
    kind, size = parameter.type, byte_size(parameter.type)
    if kind == "VISIBLE_STRING":
        return data.decode("ascii", errors="replace").rstrip("\0")
    if kind == "UNICODE_STRING":
        return data.decode("utf-16-le", errors="replace").rstrip("\0")
    if size is None:
        return bytes(data)
    if len(data) < size:
        raise InputError(
            parameter.label, f"{len(data)} bytes came for {kind}", "Use the EDS that belongs to this drive."
        )
    if kind.startswith("REAL"):
        return float(struct.unpack("<f" if size == 4 else "<d", data[:size])[0])
    return int.from_bytes(data[:size], "little", signed=kind.startswith("INTEGER"))
