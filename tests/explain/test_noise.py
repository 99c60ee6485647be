"""What no model can explain: the whitening filter, and the floor measured from repeats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.channels import Noise
from schwung.explain.noise import ORDER, Whitener, impedance, motion_noise, usable, whitener
from schwung.explain.signals import Prepared, prepare
from schwung.motion import Array, Motion
from schwung.session.model import Run, Session

RATE_HZ = 2000.0
MACHINE = Machine(
    name="rigid",
    motor=Motor(inertia_kgm2=0.01, viscous_friction_nms=0.0, peak_torque_nm=500.0),
    load=Load(viscous_friction_nms=0.0, inertia_kgm2=0.05),
)
SPRINGY = MACHINE.model_copy(update={"coupling": Coupling(stiffness_nm_rad=5000.0, damping_nms=0.3)})
#: Noise with a colour: an oscillation at a fifth of the sampling rate, and its innovation's deviation.
COLOUR, INNOVATION_NM = np.array([1.0, -0.55, 0.6, -0.2]), 0.08


def prepared(repeats: int) -> Prepared:
    """So many repeats of one exact motion."""
    motion = Motion(distance_rad=3.0, duration_s=0.8, start_time_s=0.1, dwell_s=0.1)
    time = motion.time(RATE_HZ)
    demand = motion.demand(time)
    runs = [
        Run(
            role="reference",
            repeat=repeat,
            sample_rate_hz=RATE_HZ,
            time_s=time,
            position_rad=demand.position_rad,
            speed_rad_s=demand.speed_rad_s,
            torque_nm=0.06 * demand.acceleration_rad_s2,
            motion=motion,
        )
        for repeat in range(repeats)
    ]
    result = prepare(Session(tuple(runs), created="2026-01-01T00:00:00", source="test"), MACHINE)
    quiet = Noise(1e-12, 1e-12, 1e-12)
    return replace(result, alike=quiet)


def coloured(runs: Prepared, seed: int) -> list[Array]:
    """Coloured noise on the compared grid of every run."""
    rng = np.random.default_rng(seed)
    samples = [run.time_s[:: runs.every].size for run in runs.runs]
    return [lfilter([1.0], COLOUR, rng.normal(0.0, INNOVATION_NM, n + 200))[200:] for n in samples]


def deviation() -> float:
    """Of the coloured noise, exactly: √Σ h² of its impulse response."""
    pulse = np.r_[1.0, np.zeros(2000)]
    return INNOVATION_NM * float(np.sqrt(np.sum(lfilter([1.0], COLOUR, pulse) ** 2)))


def correlation(values: Array, lag: int) -> float:
    return float(np.mean(values[lag:] * values[:-lag]) / np.mean(values**2))


def test_whitening_makes_white_noise_of_coloured_noise() -> None:
    runs = prepared(10)
    noise = coloured(runs, 1)
    found = whitener(runs, MACHINE, noise)

    fresh = coloured(runs, 2)
    white = [
        found.white(one, run.considered[:: runs.every]) for one, run in zip(fresh, runs.runs, strict=True)
    ]

    together = np.concatenate(white)
    assert np.std(together) == pytest.approx(1.0, abs=0.05)
    for lag in range(1, 5):
        assert abs(np.mean([correlation(one, lag) for one in white])) < 0.07
    assert abs(correlation(np.concatenate(fresh), 2)) > 0.3


def test_floor_from_repeats_is_the_noise_that_was_put_in() -> None:
    runs = prepared(10)
    common = 5.0 * np.sin(np.arange(runs.runs[0].time_s[:: runs.every].size) / 7)  # a misfit that repeats

    found = whitener(runs, MACHINE, [one + common for one in coloured(runs, 3)])

    assert found.torque_nm == pytest.approx(deviation(), rel=0.06)
    assert found.innovation_nm == pytest.approx(INNOVATION_NM, rel=0.06)
    assert "repeats" in found.how


def ringing(runs: Prepared, seed: int) -> tuple[list[Array], float]:
    """The angle's noise as a load on a spring of little damping passes it on, per run; and its deviation."""
    rng = np.random.default_rng(seed)
    size, step = runs.runs[0].time_s[:: runs.every].size, runs.every / runs.rate_hz
    frequency = np.fft.rfftfreq(4 * size, step)
    low = 1 / (1 + (frequency / runs.band_hz) ** 8)
    gain = low * np.sqrt(runs.noise.torque_nm**2 + motion_noise(runs, SPRINGY, runs.noise, frequency))
    drawn = [np.fft.irfft(np.fft.rfft(rng.normal(size=4 * size)) * gain)[:size] for _ in runs.runs]
    return drawn, float(np.sqrt(np.fft.irfft(gain**2)[0]))


@pytest.mark.parametrize("line_nm", [0.0, 2.0])
def test_what_rings_for_noise_is_noise_and_a_line_of_its_own_phase_is_not(line_nm: float) -> None:
    runs = replace(prepared(12), noise=Noise(1e-5, np.inf, 0.01))
    noise, floor_nm = ringing(runs, 5)
    time, rng = runs.runs[0].time_s[:: runs.every], np.random.default_rng(6)
    lines = [line_nm * np.sin(2 * np.pi * 37.0 * time + rng.uniform(0, 2 * np.pi)) for _ in noise]

    found = whitener(runs, SPRINGY, [one + line for one, line in zip(noise, lines, strict=True)])

    assert found.torque_nm == pytest.approx(floor_nm, rel=0.15)


def test_without_repeats_the_floor_is_that_of_the_channels_and_says_so() -> None:
    runs = replace(prepared(1), noise=Noise(1e-12, 1e-12, 0.5))
    one = np.zeros(runs.runs[0].time_s[:: runs.every].size)

    found = whitener(runs, MACHINE, [one])

    rate, source = runs.rate_hz / runs.every, runs.source_rate_hz
    frequency = np.linspace(0, rate / 2, 20001)
    passed = np.mean(1 / (1 + (frequency / runs.band_hz) ** 8) ** 2) * rate / source
    assert found.torque_nm == pytest.approx(0.5 * np.sqrt(passed), rel=0.02)
    assert "no repeats" in found.how


def test_white_is_a_plain_difference_equation_over_samples_with_a_valid_past() -> None:
    rng = np.random.default_rng(4)
    residual, valid = rng.normal(size=(2, 60)), np.ones(60, dtype=bool)
    valid[30] = False
    coefficients = np.array([0.5, -0.3, 0.1, 0.0, 0.0, 0.2])

    white = Whitener(coefficients, 2.0, 1.0, "test").white(residual, valid)

    kept = [i for i in range(ORDER, 60) if not 30 <= i <= 30 + ORDER]
    assert np.flatnonzero(usable(valid)).tolist() == kept
    expected = [[row[i] - coefficients @ row[i - ORDER : i][::-1] for i in kept] for row in residual]
    np.testing.assert_allclose(white, np.array(expected) / 2.0, rtol=1e-12, atol=1e-12)


def test_impedance_of_a_rigid_machine_is_its_mass() -> None:
    omega = np.array([1.0, 10.0, 100.0])

    np.testing.assert_allclose(impedance(MACHINE, omega), 1j * omega * 0.06, rtol=1e-12)
