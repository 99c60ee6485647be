"""Units of position and speed by their ratio: which pair of units makes a speed the slope of its position."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from schwung.motion import Array
from schwung.session.imports.table import Column
from schwung.session.imports.units import Quantity, header_unit, unit, unit_in_name
from schwung.session.model import Axis

_POSITIONS: dict[Axis, tuple[str, ...]] = {"rotary": ("rad", "deg", "rev"), "linear": ("m", "mm")}
_SPEEDS: dict[Axis, tuple[str, ...]] = {
    "rotary": ("rad/s", "rpm", "deg/s", "rev/s"),
    "linear": ("m/s", "mm/s", "m/min", "mm/min"),
}
_SAME_RATIO = 0.02  # filters and quantisation take a per cent
_WHOLE = 1e-6  # a column of whole numbers is one of counts
_FEWEST_COUNTS = 1000.0  # within the range of a position in counts
#: Encoders count a power of two per turn, or four times a multiple of 25 lines; so exactly are steps known.
_EXACT = 2e-5
_ON_STEP, _FEWEST_STEPS = 0.05, 20
_MANY_TURNS = 5
_MOST_LINES = 1e5


@dataclass(frozen=True)
class UnitPair:
    """Units of position and speed, how well they explain the ratio, and why."""

    position: str
    speed: str | None
    evidence: str
    alternatives: tuple[str, ...]
    sure: bool


def told_unit(column: Column, quantity: Quantity, axis: Axis) -> str | None:
    """The unit that a file's header says, as `--…-unit` takes it; None where it says none that is understood."""
    found = header_unit(column.unit, quantity, axis) or unit_in_name(column.name, quantity, axis)
    return None if found is None else found.text


def find_units(
    position: Column,
    speed: Column | None,
    ratio: float | None,
    axis: Axis,
    said: dict[str, str],
    correlation: float = 1.0,
) -> UnitPair:
    """Units of a position and of a speed that is `ratio` times its slope (per s), and correlates so well with it."""
    own_position = said.get("position") or told_unit(position, "position", axis)
    own_speed = said.get("speed") or (told_unit(speed, "speed", axis) if speed is not None else None)
    numbers = position.values[np.isfinite(position.values)]
    counts = (
        bool(np.all(np.abs(numbers - np.rint(numbers)) < _WHOLE)) and float(np.ptp(numbers)) > _FEWEST_COUNTS
    )
    if speed is None or ratio is None:
        return _alone(own_position, counts, numbers, axis)
    size = abs(ratio)
    within = _SAME_RATIO + 2 * (1 - abs(correlation))  # noise in the speed takes from the ratio
    fitting = _fitting(size, axis, own_position, own_speed, within)
    if counts and own_position is None:
        fitting = [*_by_counts(size, axis, own_speed), *fitting]
    if not fitting:
        said_so = f" ({own_position}, {own_speed})" if own_position or own_speed else ""
        return UnitPair(own_position or _POSITIONS[axis][0], own_speed or _SPEEDS[axis][0],
                        f"the speed is {size:.4g} times the slope of the position, as no usual units have it{said_so}",
                        ("a gear between both, or a time that is not in s",), False)  # fmt: skip
    best = min(fitting, key=lambda pair: _unlikely(pair, numbers, axis))
    others = tuple(f"{pair[0]} with {pair[1]}" for pair in fitting if pair != best)
    evidence = (
        f"the speed is {size:.4g} times the slope of the position: {best[0]} and {best[1]} make {best[2]:.4g}"
    )
    stated = own_position is not None or own_speed is not None
    encoder = not _unlikely(best, numbers, axis)[0] and not counts
    if stated:
        evidence += ", as the file says"
    elif encoder:
        evidence += f"; {_encoder_words(best[0], numbers, axis)}"
    return UnitPair(best[0], best[1], evidence, others[:4], stated or encoder or len(fitting) == 1)


_Fit = tuple[str, str, float]  # units of position and speed, and the ratio that they make


def _fitting(
    size: float, axis: Axis, own_position: str | None, own_speed: str | None, within: float
) -> list[_Fit]:
    found: list[_Fit] = []
    for place in [own_position] if own_position else _POSITIONS[axis]:
        for pace in [own_speed] if own_speed else _SPEEDS[axis]:
            expected = unit(place, "position", axis).factor / unit(pace, "speed", axis).factor
            if abs(size / expected - 1) < within:
                found.append((place, pace, expected))
    return found


def _by_counts(size: float, axis: Axis, own_speed: str | None) -> list[_Fit]:
    """Counts with a resolution that encoders have, for each unit of speed."""
    found: list[_Fit] = []
    turn = 2 * math.pi if axis == "rotary" else 1.0
    for pace in [own_speed] if own_speed else _SPEEDS[axis]:
        resolution = turn / (unit(pace, "speed", axis).factor * size)
        usual = _usual(resolution)
        if usual is not None:
            found.append((f"counts={usual:g}", pace, turn / (usual * unit(pace, "speed", axis).factor)))
    return found


def _usual(resolution: float, within: float = _SAME_RATIO / 4) -> float | None:
    """The resolution that encoders have nearest to this one; None where there is none so near."""
    power = 2.0 ** round(math.log2(resolution)) if resolution > 1 else 0.0
    lines = 100.0 * round(resolution / 100)
    if resolution > _MOST_LINES:  # every number is near a multiple of 100 there
        lines = 0.0
    near = [each for each in (power, lines) if each >= 100 and abs(resolution / each - 1) < within]
    return min(near, key=lambda each: (each != power, abs(resolution / each - 1))) if near else None


def _unlikely(pair: _Fit, numbers: Array, axis: Axis) -> tuple[bool, bool, int]:
    """How unlikely units are that the ratio allows alike. The steps of a position are those of an encoder in one unit
    only; else what we assume where nobody says: SI, unless an axis would make many turns that are few in degrees."""
    step = _step_of(numbers)
    factor = abs(unit(pair[0], "position", axis).factor)
    encoder = bool(axis == "rotary" and step > 0 and _usual(2 * math.pi / (step * factor), _EXACT))
    far = bool(axis == "rotary" and float(np.ptp(numbers)) * factor > _MANY_TURNS * 2 * math.pi)
    return not encoder, far, [*_POSITIONS[axis], pair[0]].index(pair[0])


def _step_of(numbers: Array) -> float:
    """The smallest step between values, where all are multiples of it (an encoder's); 0 where they are not."""
    values = np.unique(numbers[: 1 << 16])
    steps = np.diff(values)
    if steps.size < _FEWEST_STEPS:
        return 0.0
    step = float(np.median(steps[steps <= 1.5 * steps.min()]))
    if step <= 0:
        return 0.0
    if abs(math.log10(step) - round(math.log10(step))) < _EXACT:
        return 0.0  # decimals, as they were written
    span = float(values[-1] - values[0])
    step = span / round(span / step)
    off = np.abs((values - values[0]) / step - np.rint((values - values[0]) / step))
    return step if float(off.max()) < _ON_STEP else 0.0


def _alone(own: str | None, counts: bool, numbers: Array, axis: Axis) -> UnitPair:
    """The unit of a position without a speed beside it."""
    if own is not None:
        return UnitPair(own, None, f"in {own}, as the file says", (), True)
    if counts:
        told = "whole numbers: counts, of which nobody says how many make a turn (4096 is but an example)"
        return UnitPair("counts=4096", None, told, (), False)
    fits = sorted(_POSITIONS[axis], key=lambda name: _unlikely((name, "", 0.0), numbers, axis))
    told = f"spans {float(np.ptp(numbers)):.4g}, and nothing says in which unit"
    if not _unlikely((fits[0], "", 0.0), numbers, axis)[0]:
        told = _encoder_words(fits[0], numbers, axis)
        return UnitPair(fits[0], None, told, tuple(fits[1:]), True)
    return UnitPair(fits[0], None, told, tuple(fits[1:]), False)


def _encoder_words(position: str, numbers: Array, axis: Axis) -> str:
    turn = 2 * math.pi / (_step_of(numbers) * abs(unit(position, "position", axis).factor))
    return f"its steps are those of {turn:.0f} counts a turn, if it is in {position}"
