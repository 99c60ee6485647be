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
    unanswered: int = 1,
) -> list[int]:
    """Setpoints at whose answers the axis was away."""
    watch = Following(LAYOUT, POSITION, demand, rate_hz, 2000.0, patience_s, lag_cycles)
    frames = [LAYOUT.pack({POSITION: int(counts)}, 1) for counts in positions]
    return [index for index, frame in enumerate(frames) if watch.away(index, frame, unanswered)]


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


def test_answers_that_are_missing_may_have_come_late() -> None:
    assert _away(_behind(30), lag_cycles=2) != []
    assert _away(_behind(30), lag_cycles=2, unanswered=29) == []
    assert _away(_behind(80), lag_cycles=2, unanswered=80) != []
