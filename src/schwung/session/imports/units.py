"""Units of recordings from elsewhere, as factors to those of the session file (rad, m, N·m, N, s)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from schwung.errors import InputError
from schwung.quantities import Effort
from schwung.session.model import Axis

Quantity = Literal["time", "position", "speed", "torque"]

_TURN = 2 * math.pi
_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "100ns": 1e-7, "ns": 1e-9, "min": 60.0}
_UNITS: dict[Axis, dict[Quantity, dict[str, float]]] = {
    "rotary": {
        "time": _TIME,
        "position": {"rad": 1.0, "mrad": 1e-3, "deg": _TURN / 360, "rev": _TURN},
        "speed": {
            "rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _TURN / 360, "rpm": _TURN / 60, "rev/s": _TURN,
        },
        "torque": {"nm": 1.0, "mnm": 1e-3, "knm": 1e3, "ncm": 1e-2},
    },
    "linear": {
        "time": _TIME,
        "position": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "cm": 1e-2},
        "speed": {"m/s": 1.0, "mm/s": 1e-3, "um/s": 1e-6, "m/min": 1 / 60, "mm/min": 1e-3 / 60},
        "torque": {"n": 1.0, "mn": 1e-3, "kn": 1e3},
    },
}  # fmt: skip
#: Units that need a number: `counts=4096` per turn (or per metre), `%=2.4` of the rated torque, `a=0.0458` N·m/A.
_WITH_NUMBER: dict[Quantity, dict[str, str]] = {
    "time": {},
    "position": {"counts": "counts per turn (per metre on a linear axis)"},
    "speed": {"counts/s": "counts per turn (per metre on a linear axis)"},
    "torque": {"%": "the rated torque", "permille": "the rated torque", "a": "the torque per ampere"},
}
_SPELLINGS = {
    "°": "deg", "grad": "deg", "degree": "deg", "degrees": "deg", "°/s": "deg/s", "1/min": "rpm", "min-1": "rpm",
    "u/min": "rpm", "turn": "rev", "turns": "rev", "revs": "rev", "r": "rev", "1/s": "rev/s", "rps": "rev/s",
    "rad/sec": "rad/s", "sec": "s", "second": "s", "seconds": "s", "msec": "ms", "micron": "um", "inc": "counts",
    "incs": "counts", "count": "counts", "inc/s": "counts/s", "‰": "permille", "percent": "%",
    "rad_s": "rad/s", "rads": "rad/s", "deg_s": "deg/s", "dps": "deg/s", "mm_s": "mm/s", "m_s": "m/s", "1_min": "rpm",
}  # fmt: skip


#: Units of a current that stays one.
_CURRENTS = {"a": 1.0, "ma": 1e-3, "arms": 1.0, "amp": 1.0, "ampere": 1.0}


@dataclass(frozen=True)
class Unit:
    """A unit as it was understood: what was written, and the factor to SI."""

    text: str
    factor: float
    effort: Effort = "torque"  # "current": amperes, of which nobody says how many N·m they make


def _plain(text: str) -> str:
    """One spelling: small letters, no blanks or dots, µ as u."""
    flat = re.sub(r"[\s·⋅*.]", "", text.strip().lower()).replace("µ", "u").replace("μ", "u")
    return _SPELLINGS.get(flat, flat)


def unit(text: str, quantity: Quantity, axis: Axis) -> Unit:
    """Understand a unit, such as `deg`, `rpm`, `mN·m`, `counts=4096` or `%=2.4`.

    Raises InputError, naming the units that there are, for anything else.
    """
    if quantity == "torque" and (current := _CURRENTS.get(_plain(text))) is not None:
        return Unit(text, current, "current")
    name, _, number = text.partition("=")
    wanted = _WITH_NUMBER[quantity]
    key = _plain(name)
    known = _UNITS[axis][quantity]
    place = f"--{quantity}-unit"
    if not number and key in known:
        return Unit(text, known[key])
    if key in wanted:
        return Unit(text, _numbered(key, number, axis, place, wanted[key]))
    other: Axis = "linear" if axis == "rotary" else "rotary"
    if key in _UNITS[other][quantity]:
        raise InputError(place, f'"{text}" belongs to a {other} axis', f"Add --axis {other}.")
    listed = ", ".join(
        [*known, *(f"{each}=NUMBER" for each in wanted), *(["A"] if quantity == "torque" else [])]
    )
    raise InputError(place, f'"{text}" is no unit of {quantity}', f"Use one of {listed}.")


def _numbered(key: str, number: str, axis: Axis, place: str, what: str) -> float:
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise InputError(place, f'"{key}" needs a number above zero', f"Write {key}=NUMBER, {what}.")
    if key.startswith("counts"):
        return (_TURN if axis == "rotary" else 1.0) / value
    return value * {"%": 1e-2, "permille": 1e-3, "a": 1.0}[key]


def axis_of(text: str) -> Axis | None:
    """The axis that a unit of position belongs to, None where it belongs to both or none."""
    key = _plain(text.partition("=")[0])
    for axis in ("rotary", "linear"):
        if key in _UNITS[axis]["position"]:
            return axis
    return None


def unit_in_name(name: str, quantity: Quantity, axis: Axis) -> Unit | None:
    """The unit that a column's name carries in brackets, `Position [deg]` or `speed (rpm)`, or at its end, `vel_rpm`
    and `speed_rad_s`, where that is no single letter; None without one."""
    found = re.search(r"[\[(]\s*([^\[\]()]+?)\s*[\])]\s*$", name)
    if found:
        return header_unit(found[1], quantity, axis)
    ends = [name.split("_", k)[-1] for k in range(name.count("_"), 0, -1)]
    told = [header_unit(end, quantity, axis) for end in ends[:2] if len(end) > 1]
    return next((each for each in reversed(told) if each is not None), None)


def is_unit(text: str) -> bool:
    """Whether this is a unit of anything that a recording holds."""
    key = _plain(text.partition("(")[0])
    known = {"-", "v", *_CURRENTS}.union(*(table for axis in _UNITS.values() for table in axis.values()))
    return key in known.union(*_WITH_NUMBER.values())


def header_unit(text: str, quantity: Quantity, axis: Axis) -> Unit | None:
    """A unit from a file's header, `° (Angle)` as TwinCAT writes it included; None for what is not understood."""
    key = _plain(text.partition("(")[0])
    if quantity == "torque" and key in _CURRENTS:
        return Unit(text.partition("(")[0].strip(), _CURRENTS[key], "current")
    factor = _UNITS[axis][quantity].get(key)
    return None if factor is None else Unit(text.partition("(")[0].strip(), factor)
