"""Object dictionaries: EDS and DCF files read through canopen, and the data types of CiA 301.

Objects are addressed by index only: vendors spell one name in many ways.
"""

from __future__ import annotations

import configparser
import io
import logging
import struct
from pathlib import Path
from typing import Any

import canopen
from canopen.objectdictionary import ObjectDictionaryError
from canopen.objectdictionary.eds import import_eds

from schwung.errors import InputError
from schwung.fieldbus.drive import Parameter, RawValue

logging.getLogger("canopen").addHandler(logging.NullHandler())  # our errors say it better, and once

#: Data type codes of CiA 301 table 44.
TYPE_NAMES = {
    0x01: "BOOLEAN", 0x02: "INTEGER8", 0x03: "INTEGER16", 0x04: "INTEGER32", 0x05: "UNSIGNED8",
    0x06: "UNSIGNED16", 0x07: "UNSIGNED32", 0x08: "REAL32", 0x09: "VISIBLE_STRING", 0x0A: "OCTET_STRING",
    0x0B: "UNICODE_STRING", 0x0F: "DOMAIN", 0x10: "INTEGER24", 0x11: "REAL64", 0x12: "INTEGER40",
    0x13: "INTEGER48", 0x14: "INTEGER56", 0x15: "INTEGER64", 0x16: "UNSIGNED24", 0x18: "UNSIGNED40",
    0x19: "UNSIGNED48", 0x1A: "UNSIGNED56", 0x1B: "UNSIGNED64",
}  # fmt: skip


def load_dictionary(path: Path, node_id: int) -> canopen.ObjectDictionary:
    """Read an EDS or DCF file for the given node ($NODEID is put in). Raises InputError naming file and defect."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            str(path), f"cannot be read ({error.strerror})", "Give an existing EDS file."
        ) from error
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")  # what vendors' Windows tools write
    try:
        dictionary = import_eds(io.StringIO(text), node_id)
    except (
        configparser.Error,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        ObjectDictionaryError,
    ) as error:
        reason = str(error).replace("\n", " ") or type(error).__name__
        raise InputError(str(path), f"is no usable EDS: {reason}", "Check it with an EDS checker.") from error
    if len(dictionary) == 0:
        raise InputError(str(path), "describes no object at all", "Give the drive's EDS file.")
    return dictionary


def find_parameter(dictionary: canopen.ObjectDictionary, index: int, subindex: int) -> Parameter | None:
    """The parameter at index and sub-index with its type and name; None where the dictionary lacks it."""
    variable: Any = None
    if index in dictionary.indices:
        entry = dictionary.indices[index]
        if hasattr(entry, "subindices"):
            try:
                variable = entry[subindex]
            except KeyError:
                return None
        elif subindex == 0:
            variable = entry
    type_name = None if variable is None else TYPE_NAMES.get(variable.data_type)
    if type_name is None:
        return None
    entry = dictionary.indices[index]
    name = variable.name if variable is entry else f"{entry.name}: {variable.name}"
    return Parameter(index, subindex, type_name, name)


def byte_size(type_name: str) -> int | None:
    """Bytes of a fixed-size type, None for strings and domains."""
    if type_name == "BOOLEAN":
        return 1
    digits = type_name.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ_")
    return int(digits) // 8 if digits.isdigit() else None


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
