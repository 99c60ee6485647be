"""Quantities as people write them: a number in SI units, or with a unit of its kind behind it (180deg, 250ms, 1kHz)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from schwung.errors import InputError

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
