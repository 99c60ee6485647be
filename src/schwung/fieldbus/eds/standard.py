"""Data types that the standards fix, for files that leave them out or have them wrong.

Sources: CiA 301 4.2 (communication profile area), CiA 402-2 and -3 (IEC 61800-7-201, drive profile area).
"""

from __future__ import annotations

_VARIABLES = {
    "UNSIGNED8": (
        0x1001, 0x100D, 0x1019, 0x1022, 0x607E,
    ),
    "UNSIGNED16": (
        0x100C, 0x1015, 0x1017, 0x603F, 0x6040, 0x6041, 0x6066, 0x6068, 0x606D, 0x606E, 0x606F, 0x6070, 0x6072,
        0x6073, 0x60B8, 0x60B9,
    ),
    "UNSIGNED32": (
        0x1000, 0x1002, 0x1005, 0x1006, 0x1007, 0x1012, 0x1013, 0x1014, 0x6065, 0x6067, 0x6075, 0x6076, 0x6079,
        0x607F, 0x6080, 0x6081, 0x6082, 0x6083, 0x6084, 0x6085, 0x6087, 0x609A, 0x60A8, 0x60A9, 0x60AA, 0x60C5,
        0x60C6, 0x60FD, 0x6502,
    ),
    "INTEGER8": (0x6060, 0x6061, 0x6098),
    "INTEGER16": (
        0x6007, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E, 0x606A, 0x6071, 0x6074, 0x6077, 0x6078, 0x6086, 0x6088,
        0x60B2, 0x60C0,
    ),
    "INTEGER32": (
        0x6062, 0x6063, 0x6064, 0x6069, 0x606B, 0x606C, 0x607A, 0x607C, 0x60B0, 0x60B1, 0x60BA, 0x60BB, 0x60BC,
        0x60BD, 0x60F4, 0x60FA, 0x60FC, 0x60FF,
    ),
    "VISIBLE_STRING": (0x1008, 0x1009, 0x100A),
}  # fmt: skip
_VARIABLE_TYPES = {index: name for name, indices in _VARIABLES.items() for index in indices}

_ELEMENTS = {  # every sub-index from 1 on
    0x1003: "UNSIGNED32", 0x1010: "UNSIGNED32", 0x1011: "UNSIGNED32", 0x1016: "UNSIGNED32", 0x1018: "UNSIGNED32",
    0x1029: "UNSIGNED8", 0x607B: "INTEGER32", 0x607D: "INTEGER32", 0x608F: "UNSIGNED32", 0x6090: "UNSIGNED32",
    0x6091: "UNSIGNED32", 0x6092: "UNSIGNED32", 0x6099: "UNSIGNED32", 0x60C1: "INTEGER32", 0x60FE: "UNSIGNED32",
}  # fmt: skip
_PDO_COMMUNICATION = {
    1: "UNSIGNED32", 2: "UNSIGNED8", 3: "UNSIGNED16", 4: "UNSIGNED8", 5: "UNSIGNED16", 6: "UNSIGNED8",
}  # fmt: skip
_INTERPOLATION = {1: "UNSIGNED8", 2: "INTEGER8"}
_SDO = {1: "UNSIGNED32", 2: "UNSIGNED32", 3: "UNSIGNED8"}


def standard_type(index: int, subindex: int) -> str | None:
    """The data type that CiA 301 or CiA 402 gives an object; None where they leave it open."""
    if index in _VARIABLE_TYPES:
        return _VARIABLE_TYPES[index] if subindex == 0 else None
    elements = _elements(index)
    if elements is None:
        return None
    if subindex == 0:
        return "UNSIGNED8"
    return elements if isinstance(elements, str) else elements.get(subindex)


def _elements(index: int) -> str | dict[int, str] | None:
    """Types of the sub-indices of a record or an array."""
    area = index & 0xFE00
    if area in (0x1400, 0x1800):
        return _PDO_COMMUNICATION
    if area in (0x1600, 0x1A00):
        return "UNSIGNED32"
    if 0x1200 <= index < 0x1300:
        return _SDO
    return _INTERPOLATION if index == 0x60C2 else _ELEMENTS.get(index)
