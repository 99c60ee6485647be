"""Limits that a CiA 402 drive keeps by itself, and what changes their meaning.

607D software limits, 6065 and 6066 following error, 6072, 60E0 and 60E1 torque, 6080 and 607F speed, 6085 (or 6084)
how hard a quick stop brakes. A disabled limit is no limit: both ends of 607D equal, or as wide as the counts; the
others at their highest value or 0.

607C moves 607D: "always relative to the machine home position", the limits are compared after the home offset was
taken from them (CiA 402-2, 607Dh). Not every drive does so: where 607C is not 0, what is read holds in both readings,
and what is written does as far as the travel allows. 607E turns position (bit 7) and speed (bit 6), but neither 6077
nor 60B2 (CiA 402-2, 607Eh).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TypedDict

from schwung.fieldbus.drive import Guard, Parameter, ParameterValue
from schwung.fieldbus.eds.standard import standard_type
from schwung.fieldbus.units import Scales

Lookup = Callable[[int, int], Parameter | None]
ReadInteger = Callable[[Parameter], int | None]

_LOWEST, _HIGHEST, _OFF = -(1 << 31), (1 << 31) - 1, 0xFFFFFFFF
#: No servo motor turns faster: a 6080 above it counts in some unit of the vendor's, and is no limit to rely upon.
_FASTEST_RPM = 100_000
_RPM = 2 * math.pi / 60
#: Options of 605A that brake on the slow-down ramp (6084); 2 and 6 take the quick-stop ramp (6085).
_SLOW_DOWN = (1, 5)
QUICK_STOP_OPTION = 0x605A
COASTS, ON_QUICK_STOP_RAMP = 0, 2
_BRAKE = 1  # bit 0 of 60FE:01, and of its mask 60FE:02


def limit(raw: int | None) -> int | None:
    """An unsigned limit as read; None where it is switched off."""
    return None if raw in (None, 0, _OFF) else raw


def speed_limit_rad_s(raw: int | None) -> float | None:
    """6080, in rpm by CiA 402-2, as rad/s; None where it is switched off or cannot be rpm."""
    rpm = limit(raw)
    return None if rpm is None or rpm > _FASTEST_RPM else rpm * _RPM


def window_rad(low: int | None, high: int | None, scales: Scales, home_offset: int = 0) -> tuple[float, ...]:
    """607D as read, in rad, lower end first; empty where it is switched off.

    `home_offset`: 607C in counts. The window then is what holds whether the drive takes it from 607D or not; where
    nothing does, both ends are where the two readings end.
    """
    if low is None or high is None or low >= high or (low <= _LOWEST + 1 and high >= _HIGHEST):
        return ()
    if home_offset:
        low, high = max(low, low - home_offset), min(high, high - home_offset)
        high = max(low, high)
    first, second = sorted(x * scales.position_rad for x in (low, high))
    return first, second


def tightened(
    guard: Guard, scales: Scales, lookup: Lookup, read: ReadInteger, quick_stop_option: int | None = None
) -> list[ParameterValue]:
    """What has to be written for the drive to keep these limits; where its own are as tight, they stay.

    `quick_stop_option`: 605A as it will be. A drive that would coast (0) is told to brake.
    """
    wanted = _window(guard, scales, lookup, read)
    for index, most in _ceilings(guard, scales):
        parameter = lookup(index, 0)
        present = None if parameter is None else read(parameter)
        if parameter is None or present is None or (index == 0x6080 and present > _FASTEST_RPM):
            continue
        least = 0 if index == 0x6066 else 1  # 6066: at once; else 0 means that nothing is watched
        if not least <= present <= most:
            wanted.append(ParameterValue(parameter, most))
    if quick_stop_option == COASTS:
        option = lookup(QUICK_STOP_OPTION, 0)
        if option is not None:
            wanted.append(ParameterValue(option, ON_QUICK_STOP_RAMP))
            quick_stop_option = ON_QUICK_STOP_RAMP
    return wanted + _stronger_stop(guard, scales, lookup, read, quick_stop_option)


def _ceilings(guard: Guard, scales: Scales) -> Iterable[tuple[int, int]]:
    yield 0x6065, _within(guard.following_error_rad / abs(scales.position_rad), 32)
    if guard.following_error_time_s is not None:
        yield 0x6066, _within(guard.following_error_time_s * 1000, 16)
    if scales.rated_torque_nm:
        for index in (0x6072, 0x60E0, 0x60E1):
            yield index, _within(1000 * guard.torque_max_nm / scales.rated_torque_nm, 16)
    if guard.speed_max_rad_s is not None:
        yield 0x6080, _within(math.ceil(guard.speed_max_rad_s / _RPM), 32)
        if math.isfinite(scales.speed_rad_s):
            yield 0x607F, _within(math.ceil(guard.speed_max_rad_s / abs(scales.speed_rad_s)), 32)


def _within(value: float, bits: int) -> int:
    """Rounded, and such that the highest value, which means "off", is not reached; never 0."""
    return min(max(round(value), 1), (1 << bits) - 2)


def _stronger_stop(
    guard: Guard, scales: Scales, lookup: Lookup, read: ReadInteger, option: int | None
) -> list[ParameterValue]:
    least, unit = guard.stop_deceleration_rad_s2, abs(scales.acceleration_rad_s2)
    ramp = lookup(stop_ramp(option), 0)
    present = None if ramp is None or least is None or not math.isfinite(unit) else read(ramp)
    if ramp is None or least is None or present is None or present * unit >= least:
        return []
    return [ParameterValue(ramp, _within(math.ceil(least / unit), 32))]


def stop_ramp(option: int | None) -> int:
    """The object that holds a quick stop's deceleration, by 605A (CiA 402-2, 605Ah)."""
    return 0x6084 if option in _SLOW_DOWN else 0x6085


def _window(guard: Guard, scales: Scales, lookup: Lookup, read: ReadInteger) -> list[ParameterValue]:
    parameters = [lookup(0x607D, subindex) for subindex in (1, 2)]
    lower, upper = parameters
    if lower is None or upper is None:
        return []
    low, high = read(lower), read(upper)
    if low is None or high is None:
        return []
    offset = read(_standard(0x607C)) or 0
    window = _counts((guard.position_min_rad, guard.position_max_rad), scales)
    travel = window if guard.travel_rad is None else _counts(guard.travel_rad, scales)
    both = max(window[0], window[0] + offset), min(window[1], window[1] + offset)
    # in either reading, unless that would lock out where the axis has to go: then in the standard's
    open_in_both = max(both[0], both[0] - offset) <= travel[0] and travel[1] <= min(both[1], both[1] - offset)
    ends = both if open_in_both else (window[0] + offset, window[1] + offset)
    first, last = max(ends[0], _LOWEST), min(ends[1], _HIGHEST)
    if low < high:
        first, last = max(first, low), min(last, high)
    values = [
        ParameterValue(p, raw) for p, raw, now in ((lower, first, low), (upper, last, high)) if raw != now
    ]
    return values if first <= high else values[::-1]  # at no time may the lower end be the higher one


def _counts(ends_rad: tuple[float, float], scales: Scales) -> tuple[int, int]:
    first, second = sorted(round(x / scales.position_rad) for x in ends_rad)
    return first, second


class Meaning(TypedDict):
    """What of DriveLimits changes the meaning of limits, or what a stop is worth."""

    stop_deceleration_rad_s2: float | None
    quick_stop_option: int | None
    home_offset_rad: float
    range_rad: tuple[float, float] | None
    polarity: int
    brake_closed: bool
    lacking: tuple[str, ...]


def meaning(scales: Scales, lookup: Lookup, read: ReadInteger, option_set: int | None) -> Meaning:
    """Read what is easily overlooked, also where the EDS leaves it out. `option_set`: what the profile puts in 605A."""
    option = option_set if option_set is not None else read(_standard(QUICK_STOP_OPTION))
    writable = lookup(QUICK_STOP_OPTION, 0) is not None
    option = ON_QUICK_STOP_RAMP if option == COASTS and writable else option
    ramp = lookup(stop_ramp(option), 0)
    unit = abs(scales.acceleration_rad_s2)
    deceleration = None if ramp is None or not math.isfinite(unit) else read(ramp)
    ends = [read(_standard(0x607B, subindex)) for subindex in (1, 2)]
    wraps = window_rad(ends[0], ends[1], scales)
    outputs, mask = (read(_standard(0x60FE, subindex)) or 0 for subindex in (1, 2))
    return Meaning(
        stop_deceleration_rad_s2=deceleration * unit if deceleration else None,
        quick_stop_option=option,
        home_offset_rad=(read(_standard(0x607C)) or 0) * scales.position_rad,
        range_rad=(wraps[0], wraps[1]) if wraps else None,
        polarity=read(_standard(0x607E)) or 0,
        brake_closed=bool(outputs & mask & _BRAKE),
        lacking=tuple(lacking(lookup, read)),
    )


def lacking(lookup: Lookup, read: ReadInteger) -> Iterable[str]:
    """Objects by which a drive could be guarded, and that this one does not have."""
    for name, alternatives in (
        ("607D", ((0x607D, 1), (0x607D, 2))), ("6065", ((0x6065, 0),)), ("6066", ((0x6066, 0),)),
        ("6072", ((0x6072, 0), (0x60E0, 0))), ("6080 and 607F", ((0x6080, 0), (0x607F, 0))),
        ("6085", ((0x6085, 0), (0x6084, 0))),
    ):  # fmt: skip
        found = (lookup(*key) for key in alternatives)
        if not any(parameter is not None and read(parameter) is not None for parameter in found):
            yield name


def _standard(index: int, subindex: int = 0) -> Parameter:
    return Parameter(index, subindex, standard_type(index, subindex) or "UNSIGNED32")
