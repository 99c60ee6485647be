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

    values = guard.tightened(wanted, _scales(sign), lookup, lambda p: held.get((p.index, p.subindex)))
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


FULL = replace(WANTED, following_error_time_s=0.02, speed_max_rad_s=30.0, stop_deceleration_rad_s2=400.0)
NARROW = {(0x607D, 1): -100, (0x607D, 2): 100, (0x6065, 0): 5, (0x6072, 0): 10}


def test_speed_time_and_braking_are_tightened_to_what_the_motion_takes() -> None:
    loose = NARROW | {
        (0x6066, 0): 500,
        (0x6080, 0): 6000,
        (0x607F, 0): 0,
        (0x6085, 0): 1000,
        (0x60E0, 0): 3000,
    }
    told = _tightened(loose, wanted=FULL)
    assert told == [
        (0x6066, 0, 20),
        (0x60E0, 0, 500),
        (0x6080, 0, 287),  # 30 rad/s are 286.5 rpm
        (0x607F, 0, 30_000),  # at 1e-3 rad/s a count
        (0x6085, 0, 400_000),
    ]
    assert _tightened(loose | {(i, s): raw for i, s, raw in told}, wanted=FULL) == []
    tight = NARROW | {
        (0x6066, 0): 0,
        (0x6080, 0): 100,
        (0x607F, 0): 1000,
        (0x6085, 0): 10**6,
        (0x60E0, 0): 100,
    }
    assert _tightened(tight, wanted=FULL) == []


def test_a_speed_limit_in_another_unit_is_left_alone() -> None:
    assert _tightened(NARROW | {(0x6080, 0): 50 * 2**20}, wanted=FULL) == []


def test_no_limit_is_written_that_its_object_cannot_hold_or_that_would_mean_off() -> None:
    held = NARROW | {(0x6065, 0): OFF, (0x6066, 0): 65535, (0x6072, 0): 0}
    huge = replace(FULL, torque_max_nm=1e9, following_error_rad=1e12, following_error_time_s=1e6)
    told = {index: raw for index, _, raw in _tightened(held, wanted=huge)}
    assert told == {0x6065: OFF - 1, 0x6066: 65534, 0x6072: 65534}


@pytest.mark.parametrize(
    ("option", "index"), [(1, 0x6084), (5, 0x6084), (2, 0x6085), (6, 0x6085), (None, 0x6085)]
)
def test_the_ramp_that_a_quick_stop_takes_is_the_one_that_is_made_stronger(
    option: int | None, index: int
) -> None:
    held = NARROW | {(0x6084, 0): 1, (0x6085, 0): 1, (0x605A, 0): option or 0}
    values = guard.tightened(
        FULL, _scales(), lambda i, s: Parameter(i, s, "INTEGER32") if (i, s) in held else None,
        lambda p: held.get((p.index, p.subindex)), option,
    )  # fmt: skip
    assert [v.parameter.index for v in values] == [index]


@pytest.mark.parametrize("offset", [40, -40])
def test_a_home_offset_narrows_the_window_to_what_holds_in_both_readings(offset: int) -> None:
    wide = {(0x607D, 1): -5000, (0x607D, 2): 5000, (0x607C, 0): offset}
    inner = replace(WANTED, travel_rad=(-0.2, 1.0))
    told = {subindex: raw for index, subindex, raw in _tightened(wide, wanted=inner) if index == 0x607D}
    low, high = (int(str(told[n])) for n in (1, 2))
    for shift in (0, offset):  # the drive compares with 607D, or with 607D less 607C
        assert low - shift >= -159
        assert high - shift <= 318
    assert guard.window_rad(low, high, _scales(), offset) == pytest.approx(
        (max(low, low - offset) * COUNT, min(high, high - offset) * COUNT)
    )


def test_where_that_would_lock_out_the_motion_the_standards_reading_counts() -> None:
    wide = {(0x607D, 1): -5000, (0x607D, 2): 5000, (0x607C, 0): 200}
    told = _tightened(wide, wanted=replace(WANTED, travel_rad=(-0.9, 1.9)))
    assert told[:2] == [(0x607D, 1, -159 + 200), (0x607D, 2, 318 + 200)]


def test_what_is_easily_overlooked_is_read_also_where_the_eds_leaves_it_out() -> None:
    hidden = {
        (0x605A, 0): 0, (0x607B, 1): -500, (0x607B, 2): 500, (0x607C, 0): 10, (0x607E, 0): 0xC0, (0x60FE, 1): 1,
        (0x60FE, 2): 1,
    }  # fmt: skip

    def told_by(option: int | None) -> guard.Meaning:
        return guard.meaning(
            _scales(), lambda i, s: None, lambda p: hidden.get((p.index, p.subindex)), option
        )

    told = told_by(None)
    assert told["quick_stop_option"] == 0
    assert told["range_rad"] == pytest.approx((-500 * COUNT, 500 * COUNT))
    assert told["home_offset_rad"] == pytest.approx(10 * COUNT)
    assert told["polarity"] == 0xC0
    assert told["brake_closed"]
    assert told["lacking"] == ("607D", "6065", "6066", "6072", "6080 and 607F", "6085")
    hidden[0x60FE, 2] = 0  # the output is not the bus' to rule
    assert not told_by(6)["brake_closed"]
