"""Units of other people's models, and what one of them is in SI."""

from __future__ import annotations

from math import pi

from schwung.errors import InputError

#: What a signal can be: torque, angle, speed and acceleration, or the same of a linear axis.
UNITS: dict[str, dict[str, float]] = {
    "torque": {
        "N.m": 1.0, "Nm": 1.0, "N*m": 1.0, "N·m": 1.0, "mN.m": 1e-3, "mNm": 1e-3, "N.cm": 1e-2, "Ncm": 1e-2,
        "kN.m": 1e3, "kNm": 1e3, "N": 1.0, "mN": 1e-3, "kN": 1e3,
    },
    "position": {"rad": 1.0, "mrad": 1e-3, "deg": pi / 180, "rev": 2 * pi, "m": 1.0, "mm": 1e-3, "um": 1e-6},
    "speed": {
        "rad/s": 1.0, "deg/s": pi / 180, "rev/s": 2 * pi, "rpm": pi / 30, "1/min": pi / 30, "rev/min": pi / 30,
        "r/min": pi / 30, "m/s": 1.0, "mm/s": 1e-3, "m/min": 1 / 60,
    },
    "acceleration": {
        "rad/s2": 1.0, "rad/s^2": 1.0, "deg/s2": pi / 180, "deg/s^2": pi / 180, "m/s2": 1.0, "mm/s2": 1e-3,
    },
}  # fmt: skip
#: Exponents of kg, m and s, on a rotary and on a linear axis; the radian is no dimension to everybody.
_DIMENSIONS = {
    "torque": ((1, 2, -2), (1, 1, -2)),
    "position": ((0, 0, 0), (0, 1, 0)),
    "speed": ((0, 0, -1), (0, 1, -1)),
    "acceleration": ((0, 0, -2), (0, 1, -2)),
}


def in_si(quantity: str, unit: str, place: str) -> float:
    """What one of a unit is in SI. Raises InputError, naming the place, for a unit that is none of the quantity."""
    factor = UNITS[quantity].get(unit)
    if factor is None:
        raise InputError(
            place,
            f'"{unit}" is no unit of {quantity} that is known',
            f"Write one of {', '.join(UNITS[quantity])}.",
        )
    return factor


def of_base_units(quantity: str, exponents: tuple[int, int, int], factor: float) -> float | None:
    """The same of a unit that a model declares by its base units; None where these are not the quantity's."""
    return factor if exponents in _DIMENSIONS[quantity] else None
