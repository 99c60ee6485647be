"""Quantities as people write them: a number in SI units, or with a unit of its kind behind it (180deg, 250ms, 1kHz)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Literal

from schwung.errors import InputError

#: What "torque" is: that, or the current that makes it, where nobody knows how many N·m an ampere makes. Then every
#: quantity that has N·m in its unit has A instead: friction in A·s/rad, inertia in A·s²/rad.
Effort = Literal["torque", "current"]

_IN_AMPERES = (
    (re.compile(r"kg·m²"), "A·s²/rad"),
    (re.compile(r"N·m"), "A"),
    (re.compile(r"\bkg\b"), "A·s²/m"),
    (re.compile(r"(?:(?<=\d)|(?<=\d\s)|(?<=,\s))N(?=[\s.,;:)]|·s|/m|$)"), "A"),
)

#: Units of each kind of quantity and their factors; the first is SI, and meant where none is written.
UNITS: Mapping[str, Mapping[str, float]] = {
    "angle": {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180, "rev": 2 * math.pi},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
    "speed": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60},
    "torque": {"nm": 1.0, "n·m": 1.0, "mnm": 1e-3},
    "frequency": {"hz": 1.0, "khz": 1e3},
}


def parse_quantity(text: str, what: str, place: str, *, signed: bool = False) -> float:
    """The SI value of a text; `what` is a key of UNITS, `place` names the field or option.

    Raises InputError for anything else; unless `signed`, also for zero and below.
    """
    units = UNITS[what]
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D*)", str(text).strip())
    factor = units.get(match[2].strip().lower() or next(iter(units))) if match else None
    if match is None or factor is None:
        raise InputError(
            place, f'"{text}" is no {what}', f"Write a number, with {' or '.join(units)} behind it."
        )
    value = float(match[1]) * factor
    if not math.isfinite(value) or not (signed or value > 0):
        raise InputError(place, f'"{text}" is {"not finite" if value > 0 else "not above zero"}')
    return value


def sentences_of(effort: Effort) -> Callable[[str], str]:
    """What makes a sentence with units one that is true of such an effort: N·m and kg·m², N and kg, become A and
    A·s²/rad, A and A·s²/m."""
    return _in_amperes if effort == "current" else str


def _in_amperes(text: str) -> str:
    for pattern, unit in _IN_AMPERES:
        text = pattern.sub(unit, text)
    return text


def document_of(effort: Effort, document: dict[str, Any]) -> dict[str, Any]:
    """A document for machines in the units of such an effort, which it says. Its keys stay: they are names."""
    return document if effort == "torque" else {"effort": effort, **_relabelled(document)}


def _relabelled(value: Any) -> Any:
    if isinstance(value, str):
        return _unit_in_amperes(value)
    if isinstance(value, Mapping):
        return {key: _relabelled(each) for key, each in value.items()}
    return [_relabelled(each) for each in value] if isinstance(value, list | tuple) else value


def _unit_in_amperes(text: str) -> str:
    return "A" if text == "N" else _in_amperes(text)
