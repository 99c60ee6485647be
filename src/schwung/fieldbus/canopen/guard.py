"""Limits that a CiA 402 drive keeps by itself: 607D software limits, 6065 following error, 6072 torque.

A disabled limit is no limit: both ends of 607D equal, or as wide as the counts; 6065 at its highest value or 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from schwung.fieldbus.drive import Guard, Parameter, ParameterValue
from schwung.fieldbus.units import Scales

Lookup = Callable[[int, int], Parameter | None]
ReadInteger = Callable[[Parameter], int | None]

_LOWEST, _HIGHEST, _OFF = -(1 << 31), (1 << 31) - 1, 0xFFFFFFFF
#: No servo motor turns faster: a 6080 above it counts in some unit of the vendor's, and is no limit to rely upon.
_FASTEST_RPM = 100_000


def limit(raw: int | None) -> int | None:
    """An unsigned limit as read; None where it is switched off."""
    return None if raw in (None, 0, _OFF) else raw


def speed_limit_rad_s(raw: int | None) -> float | None:
    """6080, in rpm by CiA 402-2, as rad/s; None where it is switched off or cannot be rpm."""
    rpm = limit(raw)
    return None if rpm is None or rpm > _FASTEST_RPM else rpm * 2 * math.pi / 60


def window_rad(low: int | None, high: int | None, scales: Scales) -> tuple[float, ...]:
    """607D as read, in rad, lower end first; empty where it is switched off."""
    if low is None or high is None or low >= high or (low <= _LOWEST + 1 and high >= _HIGHEST):
        return ()
    first, second = sorted(x * scales.position_rad for x in (low, high))
    return first, second


def tightened(guard: Guard, scales: Scales, lookup: Lookup, read: ReadInteger) -> list[ParameterValue]:
    """What has to be written for the drive to keep these limits; where its own are as tight, they stay."""
    wanted = _window(guard, scales, lookup, read)
    following = round(guard.following_error_rad / abs(scales.position_rad))
    ceilings = [(0x6065, following)]
    if scales.rated_torque_nm:
        ceilings.append((0x6072, round(1000 * guard.torque_max_nm / scales.rated_torque_nm)))
    for index, most in ceilings:
        parameter = lookup(index, 0)
        present = None if parameter is None else read(parameter)
        if parameter is not None and present is not None and not 0 < present <= most:
            wanted.append(ParameterValue(parameter, most))
    return wanted


def _window(guard: Guard, scales: Scales, lookup: Lookup, read: ReadInteger) -> list[ParameterValue]:
    parameters = [lookup(0x607D, subindex) for subindex in (1, 2)]
    lower, upper = parameters
    if lower is None or upper is None:
        return []
    low, high = read(lower), read(upper)
    if low is None or high is None:
        return []
    ends = sorted(round(x / scales.position_rad) for x in (guard.position_min_rad, guard.position_max_rad))
    first, last = max(ends[0], _LOWEST), min(ends[1], _HIGHEST)
    if low < high:
        first, last = max(first, low), min(last, high)
    values = [
        ParameterValue(p, raw) for p, raw, now in ((lower, first, low), (upper, last, high)) if raw != now
    ]
    return values if first <= high else values[::-1]  # at no time may the lower end be the higher one
