"""Time stamps: uniform, rounded, jittering, with gaps; and resampling that neither delays nor aliases."""

from __future__ import annotations

import numpy as np
import pytest

from schwung.errors import InputError
from schwung.session.imports.clock import read_clock, resample

GRID = np.arange(2000) / 1000


def test_a_uniform_clock_has_its_rate_to_the_last_digit() -> None:
    clock = read_clock(0.5 + GRID, "time")
    assert clock.uniform
    assert clock.rate_hz == 1000.0
    assert clock.worst_samples < 1e-9


def test_jitter_is_measured_in_samples() -> None:
    jitter = np.random.default_rng(1).normal(0, 5e-5, GRID.size)
    clock = read_clock(GRID + jitter, "time")
    assert not clock.uniform
    assert clock.rms_samples == pytest.approx(0.05, rel=0.1)
    assert clock.worst_index == np.argmax(np.abs(jitter))
    assert "0.05" in clock.describe()


@pytest.mark.parametrize("rate", [3000.0, 333.3])
def test_stamps_that_were_merely_rounded_are_uniform(rate: float) -> None:
    clock = read_clock(np.round(np.arange(900) / rate, 4), "time")
    assert clock.rounded
    assert clock.uniform
    assert clock.rate_hz == pytest.approx(rate, rel=1e-4)


def test_missing_samples_are_found_and_never_bridged() -> None:
    stamps = np.concatenate((GRID[:800], GRID[900:]))
    clock = read_clock(stamps, "time")
    assert not clock.uniform
    assert [(piece.start, piece.stop) for piece in clock.pieces] == [(0, 800), (800, 1900)]
    assert clock.rate_hz == 1000.0


@pytest.mark.parametrize(("at", "what"), [(1.0, "stands still at sample 50"), (0.5, "stands still")])
def test_time_that_does_not_increase_is_an_error(at: float, what: str) -> None:
    stamps = GRID + 1e-5 * np.random.default_rng(0).random(GRID.size)
    stamps[50] = stamps[49]
    with pytest.raises(InputError, match=what):
        read_clock(stamps * at, "time")


def test_time_that_runs_backwards_is_an_error() -> None:
    stamps = GRID.copy()
    stamps[100] = stamps[90]
    with pytest.raises(InputError, match="runs backwards at sample 100"):
        read_clock(stamps, "time")


def test_resampling_from_jittering_stamps_restores_the_signal() -> None:
    stamps = GRID + np.random.default_rng(2).uniform(-3e-4, 3e-4, GRID.size)
    at = np.arange(50, 1900) / 1000
    restored = resample(stamps, np.sin(2 * np.pi * 20 * stamps), at)
    np.testing.assert_allclose(restored, np.sin(2 * np.pi * 20 * at), atol=1e-4)


def test_thinning_out_lets_no_alias_through_and_has_no_lag() -> None:
    at = np.arange(0, 2 * 200) / 200  # 200 Hz from 1000 Hz: 130 Hz would come back as 70 Hz
    slow = np.sin(2 * np.pi * 10 * GRID)
    restored = resample(GRID, slow + np.sin(2 * np.pi * 130 * GRID), at)
    inner = slice(20, -20)
    np.testing.assert_allclose(restored[inner], np.sin(2 * np.pi * 10 * at)[inner], atol=5e-3)
