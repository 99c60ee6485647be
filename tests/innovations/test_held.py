"""An injection that is held between samples, as the innovations model takes it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from schwung.innovations.signals import Drive

RATE_HZ, SINE_HZ = 1000.0, 50.0


def _drive(held: np.ndarray, smooth: np.ndarray) -> Drive:
    time = np.arange(smooth.size) / RATE_HZ
    return Drive(time, CubicSpline(time, smooth), held)


def test_the_whole_torque_is_the_controllers_and_the_injection() -> None:
    time = np.arange(200) / RATE_HZ
    middles = (time[1:] + time[:-1]) / 2
    drive = _drive(10 * np.sin(2 * np.pi * SINE_HZ * middles), 3.0 + 0 * time)
    expected = 3.0 + 10 * np.sin(2 * np.pi * SINE_HZ * time)
    assert drive.whole_nm[2:-2] == pytest.approx(expected[2:-2], abs=2e-3)


def test_jumps_stand_at_the_samples_between_two_steps() -> None:
    drive = _drive(np.array([0.0, 0.0, 2.0, 2.0, -1.0]), np.zeros(6))
    assert drive.jumps_nm.tolist() == [0.0, 0.0, 2.0, 0.0, -3.0, 0.0]


def test_nothing_is_injected_where_nothing_is_held() -> None:
    assert not _drive(np.zeros(5), np.ones(6)).injected_nm.any()


def test_only_a_corner_is_too_sharp_for_its_neighbours_to_tell() -> None:
    time, chance = np.arange(200) / RATE_HZ, np.random.default_rng(4)
    noise = 0.02 * chance.standard_normal(200)
    smooth = 40 * np.sin(2 * np.pi * SINE_HZ * time) + noise
    assert np.mean(_drive(np.zeros(199), smooth).sharp_nm2 > 0) < 0.05
    corner = _drive(np.zeros(199), np.maximum(0.0, 1700.0 * (time - 0.1004)) + noise).sharp_nm2
    sharp = np.flatnonzero(corner > 0.05**2)
    assert {100, 101} <= set(sharp.tolist())  # on either side of 100.4
    assert np.max(np.abs(sharp - 100.4)) < 3.5  # and no further than the neighbours reach
