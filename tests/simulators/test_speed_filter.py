"""The drive's own filter: told from a pure delay by what it bends, and taken back."""

from __future__ import annotations

import numpy as np
import pytest

from schwung.session import Run
from schwung.simulators.speed_filter import bent, speed_filter

RATE_HZ, ANGLE_NOISE_RAD, SPEED_NOISE_RAD_S = 4000.0, 1e-6, 2e-3
LINES = ((2.0, 1.0), (40.0, 0.02), (70.0, 0.01))  # Hz and rad


def _runs(time_constant_s: float, delay_s: float) -> list[Run]:
    """Three runs of a swing with two faster ones upon it; the speed passes a low-pass of first order and a delay."""
    time, chance, runs = np.arange(6000) / RATE_HZ, np.random.default_rng(3), []
    for _ in range(3):
        angle, speed = np.zeros(time.size), np.zeros(time.size)
        for hertz, size in LINES:
            omega = 2 * np.pi * hertz
            gain = size * omega * np.exp(-1j * omega * delay_s) / (1 + 1j * omega * time_constant_s)
            angle += size * np.sin(omega * time)
            speed += np.real(gain * np.exp(1j * omega * time))
        runs.append(
            Run(
                role="reference",
                repeat=0,
                sample_rate_hz=RATE_HZ,
                time_s=time,
                position_rad=angle + ANGLE_NOISE_RAD * chance.standard_normal(time.size),
                speed_rad_s=speed + SPEED_NOISE_RAD_S * chance.standard_normal(time.size),
                torque_nm=np.zeros(time.size),
            )
        )
    return runs


@pytest.mark.parametrize(("time_constant_s", "delay_s"), [(2e-4, 0.0), (0.0, 2e-4), (1.5e-4, 6e-4)])
def test_a_low_pass_is_told_from_a_delay(time_constant_s: float, delay_s: float) -> None:
    runs = _runs(time_constant_s, delay_s)
    jumps = [np.zeros(len(run)) for run in runs]
    found = speed_filter(runs, jumps, 200.0, ANGLE_NOISE_RAD, SPEED_NOISE_RAD_S)
    assert found.delay_s == pytest.approx(time_constant_s + delay_s, abs=3e-6)
    assert found.bend_s2 == pytest.approx(time_constant_s**2 / 2, abs=4e-9)


def test_what_the_filter_did_is_undone() -> None:
    runs = _runs(2e-4, 0.0)
    jumps = [np.zeros(len(run)) for run in runs]
    found = speed_filter(runs, jumps, 200.0, ANGLE_NOISE_RAD, SPEED_NOISE_RAD_S)
    omega = 2j * np.pi * np.array([5.0, 60.0, 150.0])
    whole = found.undone(omega) / (1 + 2e-4 * omega)
    np.testing.assert_allclose(whole, 1.0, atol=4e-3)


def test_no_filter_bends_for_longer_than_there_are_filters() -> None:
    omega = 2j * np.pi * np.array([100.0, 200.0])
    np.testing.assert_array_equal(bent(omega, 1.0), bent(omega, 0.5 * 2.5e-4**2))
    np.testing.assert_array_equal(bent(omega, -1.0), np.ones(2))
