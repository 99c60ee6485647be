"""Nested JSON as labelled rows for people: names carry their units, identities are hexadecimal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

#: Ends of names and the units that they stand for; the longer first.
_UNITS = {
    "_nm_rad": "N·m/rad",
    "_rad_s": "rad/s",
    "_per_s": "1/s",
    "_kgm2": "kg·m²",
    "_nms": "N·m·s/rad",
    "_rad": "rad",
    "_nm": "N·m",
    "_hz": "Hz",
    "_s": "s",
}
_LINEAR = {"N·m": "N", "kg·m²": "kg", "rad": "m"}
_HEXADECIMAL = ("vendor_id", "product_code", "revision")
_GROUPS = {"units": "one count of"}


def rows_of(values: Mapping[str, Any], linear: bool = False, group: str = "") -> Iterator[tuple[str, str]]:
    """("motor inertia, kg·m²", "0.012") for {"motor": {"inertia_kgm2": 0.012}}; None and empty are left out."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from rows_of(value, linear, f"{group}{_GROUPS.get(name, _words(name))} ")
        elif isinstance(value, list | tuple):
            yield from [(group + _label(name, linear), ", ".join(map(str, value)))] if value else []
        elif value is not None:
            yield group + _label(name, linear), _text(name, value)


def _label(name: str, linear: bool) -> str:
    for end, unit in _UNITS.items():
        if name.endswith(end):
            return f"{_words(name.removesuffix(end))}, {_linear(unit) if linear else unit}"
    return _words(name)


def _linear(unit: str) -> str:
    for rotary, other in _LINEAR.items():
        unit = unit.replace(rotary, other)
    return unit


def _words(name: str) -> str:
    return name.replace("_", " ")


def _text(name: str, value: object) -> str:
    if name in _HEXADECIMAL and isinstance(value, int):
        return f"0x{value:08X}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
