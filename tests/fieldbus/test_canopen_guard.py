"""The drive's own limits: when they count, and how they are tightened."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from schwung.fieldbus.canopen import guard
from schwung.fieldbus.drive import Guard, Parameter
from schwung.fieldbus.units import Scales

COUNT = 2 * math.pi / 1000
OFF = 0xFFFFFFFF
WANTED = Guard(-1.0, 2.0, 35.0, 0.1)


def _scales(sign: int = 1) -> Scales:
    return Scales(sign * COUNT, 1e-3, 0.07, 0.07, 1e-3, 70.0)


def _tightened(
    held: dict[tuple[int, int], int], sign: int = 1, wanted: Guard = WANTED
) -> list[tuple[int, int, object]]:
    def lookup(index: int, subindex: int) -> Parameter | None:
        return Parameter(index, subindex, "INTEGER32") if (index, subindex) in held else None

    values = guard.tightened(wanted, _scales(sign), lookup, lambda p: held[p.index, p.subindex])
    return [(v.parameter.index, v.parameter.subindex, v.raw) for v in values]


@pytest.mark.parametrize(
    "ends", [(None, None), (0, 0), (5, 5), (-(2**31), 2**31 - 1), (-(2**31) + 1, 2**31 - 1)]
)
def test_a_window_that_is_switched_off_is_no_window(ends: tuple[int | None, int | None]) -> None:
    assert guard.window_rad(*ends, _scales()) == ()


def test_a_window_is_in_rad_whichever_way_counts_go() -> None:
    assert guard.window_rad(-100, 200, _scales()) == pytest.approx((-100 * COUNT, 200 * COUNT))
    assert guard.window_rad(-100, 200, _scales(-1)) == pytest.approx((-200 * COUNT, 100 * COUNT))


def test_limits_of_zero_or_of_the_highest_value_are_none() -> None:
    assert [guard.limit(raw) for raw in (None, 0, OFF, 7)] == [None, None, None, 7]


def test_wider_limits_are_tightened_and_tighter_ones_stay() -> None:
    low, high, error, torque = -159, 318, 16, 500
    wide = {(0x607D, 1): -5000, (0x607D, 2): 5000, (0x6065, 0): OFF, (0x6072, 0): 3000}
    assert _tightened(wide) == [
        (0x607D, 1, low), (0x607D, 2, high), (0x6065, 0, error), (0x6072, 0, torque)
    ]  # fmt: skip
    tight = {(0x607D, 1): -100, (0x607D, 2): 100, (0x6065, 0): 5, (0x6072, 0): 10}
    assert _tightened(tight) == []
    assert _tightened({}) == []


def test_a_window_that_is_off_is_switched_on_with_its_lower_end_never_the_higher() -> None:
    above = replace(WANTED, position_min_rad=1.0)
    assert _tightened({(0x607D, 1): 0, (0x607D, 2): 0}, wanted=above) == [(0x607D, 2, 318), (0x607D, 1, 159)]
    assert _tightened({(0x607D, 1): 0, (0x607D, 2): 0}) == [(0x607D, 1, -159), (0x607D, 2, 318)]
    assert _tightened({(0x607D, 1): -1000, (0x607D, 2): 1000}, sign=-1) == [
        (0x607D, 1, -318),
        (0x607D, 2, 159),
    ]


@pytest.mark.parametrize(
    ("raw", "rad_s"), [(3000, 314.159), (100_000, 10471.98), (None, None), (0, None), (0xFFFFFFFF, None)]
)
def test_the_speed_limit_is_in_rpm(raw: int | None, rad_s: float | None) -> None:
    assert guard.speed_limit_rad_s(raw) == (None if rad_s is None else pytest.approx(rad_s, rel=1e-5))


def test_a_speed_limit_beyond_any_motor_is_in_some_other_unit() -> None:
    """Counts per second, say: 3000 rpm of a 20-bit encoder. Taken for rpm it would allow everything."""
    assert guard.speed_limit_rad_s(50 * 2**20) is None
