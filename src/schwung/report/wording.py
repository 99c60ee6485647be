"""Explanations in words: values with their intervals, names of parameters, places and runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise

from schwung.explain.values import Located, Quantity

_COORDINATES = {
    "position": "position",
    "speed": "speed",
    "direction": "direction of motion",
    "acceleration": "acceleration",
    "torque": "torque",
    "time_in_motion": "time in the motion",
    "frequency": "frequency",
    "run": "number of the run",
    "wind_up": "wind-up of the coupling",
}
_UNIT_WORDS = {"1/rev": "per turn"}
_SMALL = 0.1  # s, rad, m: below it they are written in thousandths
_LARGEST_POWER = 6  # numbers beyond are written with a power of ten
_UNIT_ENDS = (
    "_nm_rad3", "_nm_rad", "_rad_s", "_kgm2", "_nms2", "_nms", "_nm", "_rad", "_hz", "_s",
)  # fmt: skip


def listed(names: Sequence[str]) -> str:
    """'a, b and c'."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def place_of(where: Located) -> str:
    """'speed, −20 … 20 rad/s'; the interval is left out where a coordinate has none that is worth reading."""
    name = _COORDINATES.get(where.coordinate, where.coordinate)
    low, high = where.interval
    if where.coordinate == "direction":
        sides = {(True, False): ", backward", (False, True): ", forward"}
        return name + sides.get((low < 0, high > 0), "")
    if not (math.isfinite(low) and math.isfinite(high)):
        return name
    return f"{name}, {_plain(low)} … {_plain(high)}{_spaced(where.unit)}"


def value_text(quantity: Quantity) -> str:
    """'2.10 N·m (2.04 … 2.16)': as many digits as the 95 % interval deserves; a table by its extent."""
    value = quantity.value
    if not isinstance(value, int | float):
        heights = [pair[1] for pair in value]
        span = f", {_plain(min(heights))} … {_plain(max(heights))}" if heights else ""
        return f"{len(value)} points{span}{_spaced(quantity.unit)}"
    milli = quantity.unit in ("s", "rad", "m") and 0 < abs(value) < _SMALL
    factor, unit = (1e3, f"m{quantity.unit}") if milli else (1.0, quantity.unit)
    if quantity.ci95 is None:
        return f"{_plain(factor * value)}{_spaced(unit)}"
    low, high = (factor * end for end in quantity.ci95)
    known = math.isfinite(high - low) and high > low
    digits = -math.floor(math.log10((high - low) / 3)) if known else 4
    shown = [_rounded(number, digits) for number in (factor * value, low, high)]
    return f"{shown[0]}{_spaced(unit)} {unbroken(f'({shown[1]} … {shown[2]})')}"


def _spaced(unit: str) -> str:
    return f" {_UNIT_WORDS.get(unit, unit)}" if unit and unit != "1" else ""


def _rounded(value: float, digits: int) -> str:
    """To so many decimals, with a proper minus; very large and very small ones with a power of ten."""
    if not math.isfinite(value):
        return f"{value:g}".replace("-", "−").replace("inf", "∞")
    size = math.floor(math.log10(abs(value))) if value else 0
    if value and (size >= _LARGEST_POWER or digits > _LARGEST_POWER):
        power = str(size).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{value / 10**size:.{min(max(digits + size, 0), 6)}f}·10{power}".replace("-", "−")
    return f"{round(value, digits) + 0.0:.{max(digits, 0)}f}".replace("-", "−")


def unbroken(text: str) -> str:
    """A text that no line is broken in."""
    return text.replace(" ", "\u00a0")


def _plain(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")


def label_of(key: str) -> str:
    """A parameter's key in words: 'stribeck speed' for stribeck_speed_rad_s."""
    end = next((end for end in _UNIT_ENDS if key.endswith(end)), "")
    words = key.removesuffix(end).replace("_", " ").strip()
    return words.replace("torque constant", "time constant") if key == "time_constant_s" else words or key


def runs_text(runs: Iterable[int]) -> str:
    """'0–3, 7' for (0, 1, 2, 3, 7)."""
    ordered = sorted(set(runs))
    if not ordered:
        return "none"
    starts = [ordered[0], *(b for a, b in pairwise(ordered) if b != a + 1)]
    ends = [*(a for a, b in pairwise(ordered) if b != a + 1), ordered[-1]]
    return ", ".join(
        f"{a}" if a == b else f"{a}, {b}" if b == a + 1 else f"{a}–{b}"
        for a, b in zip(starts, ends, strict=True)
    )


def parameter_lines(parameters: Mapping[str, Quantity], *, linear: bool) -> Iterator[str]:
    """Parameters with units and intervals, one a line."""
    for key, quantity in parameters.items():
        label = label_of(key).replace("torque", "force") if linear else label_of(key)
        yield f"{label}: {value_text(quantity)}"
