"""The endurance benchmarks, in small: one kill in the middle of a motion, and commissionings in a row."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from service_kill import kill_again_and_again
from service_soak import Count, grown, soak

IN_A_MOTION = 3  # the seed whose first kill comes there


@pytest.mark.long
@pytest.mark.timeout(300)  # five processes start one after the other, on whatever computer
def test_a_kill_in_a_motion_stops_the_drive_and_loses_nothing(tmp_path: Path) -> None:
    tally = kill_again_and_again(tmp_path, 1, IN_A_MOTION)
    assert tally.states["interrupted"] + tally.states["done"] + len(tally.notes) == 1
    assert tally.finished


@pytest.mark.long
@pytest.mark.timeout(300)
def test_commissionings_in_a_row_leave_nothing_behind(tmp_path: Path) -> None:
    counts = soak(tmp_path, 1.0, repeats=1, response_repeats=0, sample_rate_hz=500.0, runs=4, tell=False)
    assert [count.runs for count in counts] == [4, 8, 12, 16]  # planned and confirmed, twice
    assert grown(counts) == []


@pytest.mark.parametrize(
    ("name", "per_run"), [("handles", 0.1), ("threads", 0.1), ("objects", 100), ("memory_mb", 0.5)]
)
def test_what_grows_is_told(name: str, per_run: float) -> None:
    flat = {"bus_s": 0.0, "memory_mb": 300.0, "objects": 200_000, "handles": 12, "threads": 5, "processes": 0}
    counts = [Count(**{**flat, name: flat[name] + round(per_run * run, 1)}, runs=run) for run in range(100)]
    assert grown([Count(**flat)] * 100) == []
    (told,) = grown(counts)
    assert told.startswith(name.removesuffix("_mb"))
