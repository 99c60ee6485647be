"""An injection that is held between samples, as the innovations model takes it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from schwung.innovations.held import Held, early_moments
from schwung.innovations.signals import Drive
from schwung.innovations.steps import Steps
from schwung.innovations.values import Shaft

RATE_HZ, SINE_HZ = 1000.0, 50.0


def _drive(held: np.ndarray, smooth: np.ndarray) -> Drive:
    time = np.arange(smooth.size) / RATE_HZ
    return Drive(time, CubicSpline(time, smooth), Held(time, held))


def test_the_whole_torque_is_the_controllers_and_the_injection() -> None:
    time = np.arange(200) / RATE_HZ
    middles = (time[1:] + time[:-1]) / 2
    drive = _drive(10 * np.sin(2 * np.pi * SINE_HZ * middles), 3.0 + 0 * time)
    expected = 3.0 + 10 * np.sin(2 * np.pi * SINE_HZ * time)
    assert drive.whole_nm[2:-2] == pytest.approx(expected[2:-2], abs=2e-3)


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


@pytest.mark.parametrize("late", [-0.3, 0.0, 0.125, 0.5, 0.9, 1.4])
def test_what_is_taken_late_has_the_moments_of_its_steps(late: float) -> None:
    """Its mean, its lever about the middle, and its second moment, as sums of ten thousand parts say them."""
    held = Held(np.arange(5) / RATE_HZ, np.array([0.0, 2.0, -1.0, 4.0]))
    x = (np.arange(10_000) + 0.5) / 10_000
    start, end, height = held.over_steps(late / RATE_HZ)[2]
    parabola = start * (1 - x) + end * x + 4 * height * x * (1 - x)
    taken = held.torque_nm[np.floor(2 + x - late).astype(int)]
    for power in range(3):
        assert np.mean(parabola * x**power) == pytest.approx(np.mean(taken * x**power), abs=1e-3)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.8, 1.0])
def test_a_corner_within_a_step_moves_the_machine_as_it_does(share: float) -> None:
    """Against steps of a hundredth, near a resonance at a third of the sampling rate."""
    shaft, step_s = Shaft(0.01, 0.1, 0.05, 45_000.0, 5.0, False), 1 / RATE_HZ
    inertia, coupling = np.array([0.1, 0.15]), np.array([45_000.0, 5.0])
    whole, part = (Steps.of(shaft, inertia, length, slopes=False) for length in (step_s, step_s / 100))
    state = np.zeros((2, 4))
    for at in range(100):
        torque = 1.0 if at < round(100 * share) else 0.0
        pushed = (part.inputs[:, :, 0] + part.inputs[:, :, 2]) * torque
        state = np.einsum("kst,kt->ks", part.transition, state) + pushed
    parabola = whole.inputs[:, :, 0::2] @ early_moments(share)
    found = parabola + whole.early(shaft, coupling, inertia, step_s, share)
    assert found == pytest.approx(state, rel=1e-5, abs=1e-12)
    if share == 0.5:  # alone, the parabola is off by more than is known of any torque
        assert np.max(np.abs(parabola / state - 1)) > 0.003
