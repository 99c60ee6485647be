"""Where an axis stands, held against where it was sent."""

from __future__ import annotations

import numpy as np
import pytest

from schwung.fieldbus.canopen.following import Following
from schwung.fieldbus.canopen.pdo import Layout
from schwung.fieldbus.profile import Pdo

RATE_HZ = 1000.0
WAY = np.rint(np.linspace(0, 100_000, 400)).astype(np.int64)
POSITION = "6064:00"


LAYOUT = Layout(Pdo.model_construct(number=1), 0x181, (), np.dtype([("6041:00", "<u2"), (POSITION, "<i4")]))


def _away(
    positions: np.ndarray,
    patience_s: float = 0.0,
    demand: np.ndarray = WAY,
    rate_hz: float = RATE_HZ,
    lag_cycles: int | None = None,
) -> list[int]:
    """Setpoints at whose answers the axis was away."""
    watch = Following(LAYOUT, POSITION, demand, rate_hz, 2000.0, patience_s, lag_cycles)
    return [index for index, counts in enumerate(positions) if watch.away(index, _answer(counts))]


def _answer(counts: float) -> bytes:
    return LAYOUT.pack({POSITION: int(counts)}, 1)


def _stroke(distance_rad: float, counts_per_turn: float, cycles: int = 300) -> np.ndarray:
    """There and back, with a rest around."""
    there = distance_rad * (1 - np.cos(np.pi * np.arange(cycles) / (cycles - 1))) / 2
    rest = np.zeros(60)
    way = np.concatenate([rest, there, rest + distance_rad, there[::-1], rest])
    return np.rint(way * counts_per_turn / (2 * np.pi)).astype(np.int64)


def _late(demand: np.ndarray, cycles: int) -> np.ndarray:
    return np.concatenate([np.full(cycles, demand[0]), demand])[: demand.size]


def _behind(cycles: int) -> np.ndarray:
    return np.concatenate([np.zeros(cycles), WAY])[: WAY.size]


@pytest.mark.parametrize("late", [0, 1, 20, 50])
def test_answers_that_are_late_by_as_much_as_a_drive_may_be_silent_are_no_trouble(late: int) -> None:
    assert _away(np.concatenate([np.zeros(late), WAY])[: WAY.size]) == []


def test_at_a_low_rate_it_is_cycles_that_count() -> None:
    """100 Hz: twenty cycles without an answer are 0.2 s."""
    assert _away(np.concatenate([np.zeros(20), WAY])[: WAY.size], rate_hz=100.0) == []


def test_an_axis_that_stands_is_away_when_the_demand_has_gone_and_not_before_the_drive_could_have_said_so() -> (
    None
):
    gone = int(np.argmax(WAY > 2000)) + 51
    at_once, patient = _away(np.zeros(WAY.size)), _away(np.zeros(WAY.size), 0.02)
    assert gone <= at_once[0] <= gone + 3
    assert patient[0] == at_once[0] + 20


def test_off_for_a_sample_is_noise() -> None:
    positions = WAY.copy()
    positions[100::50] += 5000
    assert _away(positions) == []


def test_ahead_or_back_is_away_too() -> None:
    assert _away(WAY + 5000)
    assert _away(WAY - 80_000)


def test_counts_that_run_over_are_no_trouble() -> None:
    top = 2**31 - 50_000
    demand = WAY + top
    wrapped = (demand + 2**31) % 2**32 - 2**31
    assert _away(wrapped, demand=demand) == []


def test_what_is_beside_the_setpoints_is_not_judged() -> None:
    watch = Following(LAYOUT, POSITION, WAY[:1], RATE_HZ, 2000.0, 0.0)
    far = LAYOUT.pack({POSITION: 10**6}, 1)
    assert not any(watch.away(-1, far) for _ in range(5))
    assert not any(watch.away(1, far) for _ in range(5))
    assert not any(watch.away(0, far[:2]) for _ in range(5))


@pytest.mark.parametrize("cycles", [0, 1, 7, 30])
def test_by_how_much_an_axis_is_usually_behind_is_seen_on_the_way(cycles: int) -> None:
    watch = Following(LAYOUT, POSITION, WAY, RATE_HZ, 2000.0, 0.0)
    assert watch.lag_cycles is None
    swing = np.rint(300 * np.sin(np.arange(WAY.size) * 0.5)).astype(np.int64)  # of an injected sine
    for index, counts in enumerate(_behind(cycles) + swing):
        watch.away(index, LAYOUT.pack({POSITION: int(counts)}, 1))
    assert watch.lag_cycles is not None
    assert 0.95 * cycles <= watch.lag_cycles <= cycles + 1
    assert Following(LAYOUT, POSITION, WAY, RATE_HZ, 2000.0, 0.0, 40).lag_cycles == 40


def test_once_that_is_known_an_axis_that_falls_behind_is_away_at_once() -> None:
    """Campaign seed 623460: setpoints were lost for 36 ms, and what came then was one step."""
    held = np.concatenate([WAY[:100], np.full(30, WAY[100]), WAY[130:]])
    assert _away(held) == []
    gone = 100 + 2 + int(np.argmax(WAY > 2000))
    assert gone <= _away(held, lag_cycles=0)[0] <= gone + 2
    assert _away(_behind(12), lag_cycles=12) == []
    assert _away(_behind(30), lag_cycles=12) != []


def _learnt(demand: np.ndarray, positions: np.ndarray, known: int | None = None) -> int | None:
    watch = Following(LAYOUT, POSITION, demand, RATE_HZ, 2000.0, 0.0, known)
    for index, counts in enumerate(np.rint(positions)):
        watch.away(index, _answer(counts))
    return watch.lag_cycles


@pytest.mark.parametrize("counts_per_turn", [4096, 10_000, 2**20])
def test_a_creep_says_how_late_an_axis_is_or_nothing(counts_per_turn: int) -> None:
    """Its first stages are shorter than what is injected, and of some encoders' counts there are few in all of it: a
    sound axis was then taken for one that is never behind, and the first stroke was stopped."""
    late, lag = 8, None
    for share in (1 / 256, 1 / 64, 1 / 16, 1 / 4, 1.0):
        creep = _stroke(np.radians(share), counts_per_turn, 600)
        swing = share * 5e-4 * counts_per_turn / (2 * np.pi) * np.sin(0.2 * np.arange(creep.size))
        lag = _learnt(creep, _late(creep, late) + swing, lag)
        assert lag in (None, late)
    assert (lag == late) == (counts_per_turn == 2**20)
    stroke = _stroke(2.0, counts_per_turn)
    watch = Following(LAYOUT, POSITION, stroke, RATE_HZ, 0.03 * counts_per_turn / (2 * np.pi), 0.0, lag)
    assert not any(watch.away(index, _answer(p)) for index, p in enumerate(_late(stroke, late)))
    assert watch.lag_cycles == late


@pytest.mark.parametrize("offset", [-100, 100])
def test_an_axis_that_stands_beside_its_setpoints_is_not_behind_them(offset: int) -> None:
    """It holds against friction; the approach to a start is some counts."""
    assert _learnt(np.arange(6).repeat(20), np.arange(6).repeat(20) + offset) is None
    assert _learnt(WAY, _late(WAY, 5) + offset) == 5


@pytest.mark.parametrize("kind", ["<i2", "<i4", "<i8"])
@pytest.mark.parametrize("direction", [-1, 1])
def test_counts_of_any_width_in_either_direction(kind: str, direction: int) -> None:
    """Two bytes run over on the way."""
    layout = Layout(Pdo.model_construct(number=1), 0x181, (), np.dtype([(POSITION, kind)]))
    watch = Following(layout, POSITION, direction * WAY, RATE_HZ, 2000.0, 0.0)
    bits = 8 * np.dtype(kind).itemsize
    for index, counts in enumerate(_late(direction * WAY, 7)):
        wrapped = (int(counts) + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)
        assert not watch.away(index, layout.pack({POSITION: wrapped}, 1))
    assert watch.lag_cycles == 7


def test_an_axis_that_is_stuck_tells_nothing_new() -> None:
    assert _learnt(_stroke(2.0, 2**20), np.zeros(780)) is None
    assert _learnt(_stroke(2.0, 2**20), np.zeros(780), 3) == 3


BURST = 16  # milliseconds for which a USB adapter gathers what it hears


def test_answers_that_come_in_bursts_are_late_not_away() -> None:
    """By 15 cycles, then 14, and so on; counted from the midst of one, the late ones were taken for prompt."""
    stroke = _stroke(10.0, 2**16)
    for begins_with in range(0, BURST, 5):
        watch = Following(LAYOUT, POSITION, stroke, RATE_HZ, 500.0, 0.0, 2)
        for heard in range(begins_with, stroke.size, BURST):
            for index in range(max(heard - BURST + 1, 0), heard + 1):
                assert not watch.away(heard, _answer(_late(stroke, 2)[index]), heard - index)
        assert watch.lag_cycles == 2


def test_answers_that_are_lost_are_waited_for_no_longer_than_one_may_be_late() -> None:
    """Else each would hide another cycle of an axis that is away, and make what is usual less than it is."""
    late, stroke = 6, _stroke(2.0, 2**16, 600)
    lost = set(range(50, stroke.size, 40))
    watch = Following(LAYOUT, POSITION, stroke, RATE_HZ, 500.0, 0.0, late)
    there = stroke.size - 350  # it stands still on the way back
    positions, still_open, away = _late(stroke, late), 0, []
    positions[there:] = positions[there]
    for index in range(stroke.size):
        if index in lost:
            still_open += 1
        elif watch.away(index, _answer(positions[index]), still_open):
            away.append(index)
    assert still_open > 25
    gone = there + int(np.argmax(np.abs(stroke[there:] - positions[there]) > 500))
    assert gone <= away[0] <= gone + late + 6
    answered = [index for index in range(there) if index not in lost]
    watch = Following(LAYOUT, POSITION, stroke, RATE_HZ, 500.0, 0.0)
    for index in answered:
        watch.away(index, _answer(positions[index]), sum(one < index for one in lost))
    assert watch.lag_cycles == late


def test_an_answer_that_comes_twice_is_no_trouble() -> None:
    late, stroke = 6, _stroke(2.0, 2**16)
    watch = Following(LAYOUT, POSITION, stroke, RATE_HZ, 500.0, 0.0, late)
    twice = 0
    for index, counts in enumerate(_late(stroke, late)):
        for _ in range(1 + (index % 50 == 25)):
            assert not watch.away(index, _answer(counts), -twice)
            twice += index % 50 == 25
    assert watch.lag_cycles == late
