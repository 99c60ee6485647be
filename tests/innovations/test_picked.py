"""Every so manieth sample, as it was recorded, with the torque of all between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schwung.drivetrain.machine import Machine
from schwung.innovations.likelihood import Noise, torque_errors, variances_of
from schwung.innovations.signals import picked_signals_of, signals_of
from schwung.session.model import Run

RATE_HZ, EVERY = 8000.0, 4


@pytest.fixture
def machine() -> Machine:
    return Machine.model_validate(
        {
            "name": "arm",
            "motor": {"inertia": 0.01, "viscous_friction": 0.0, "peak_torque": 50.0},
            "load": {"inertia": 0.05, "viscous_friction": 0.0},
        }
    )


def _recorded(torque: np.ndarray) -> Run:
    time = np.arange(torque.size) / RATE_HZ
    chance = np.random.default_rng(1)
    return Run("reference", 0, RATE_HZ, time, np.sin(9 * time) + 1e-5 * chance.standard_normal(time.size),
               9 * np.cos(9 * time), torque)  # fmt: skip


def test_samples_are_those_that_were_recorded(machine: Machine) -> None:
    run = _recorded(np.zeros(8000))
    picked = picked_signals_of(run, machine, 160.0)
    assert picked.step_s == pytest.approx(EVERY / RATE_HZ)
    places = np.round(picked.time_s * RATE_HZ).astype(int)
    assert np.all(np.diff(places) == EVERY)
    np.testing.assert_array_equal(picked.position_rad, run.position_rad[places])
    np.testing.assert_array_equal(picked.speed_rad_s, run.speed_rad_s[places])
    np.testing.assert_allclose(picked.states[:, 0], picked.position_rad)


def test_the_torque_of_a_step_is_that_of_all_samples_in_it(machine: Machine) -> None:
    """A blow between two of the samples that are taken, which a filter would spread over several of them."""
    torque = np.zeros(8000)
    torque[4002] = 1.0
    between = picked_signals_of(_recorded(torque), machine, 160.0).drive.undelayed
    mean = (between.start_nm + between.end_nm) / 2 + 2 / 3 * between.bulge_nm
    assert np.sum(mean) * EVERY == pytest.approx(1.0, rel=1e-9)
    assert np.max(mean) * EVERY == pytest.approx(1.0, rel=0.2)
    # a spline between eight thousand a second knows hardly anything of it half a step away
    assert np.count_nonzero(np.abs(mean) * EVERY > 0.05) <= 2


def test_the_torque_at_the_samples_is_as_quiet_as_a_filter_leaves_it(machine: Machine) -> None:
    noise = np.random.default_rng(2).standard_normal(16_000)
    drive = picked_signals_of(_recorded(noise), machine, 160.0).drive
    assert np.std(drive.smooth_nm) == pytest.approx(EVERY**-0.5, rel=0.1)


def test_a_corner_within_a_step_is_missed_in_one_part_of_it(machine: Machine) -> None:
    torque = np.maximum(0.0, np.arange(8000) - 4002.0)
    slow, fast = (
        signals(_recorded(torque), machine, 160.0).drive.sharp_nm2
        for signals in (picked_signals_of, signals_of)
    )
    assert np.max(slow) == pytest.approx(np.max(fast) / EVERY**2)
    assert 1 <= np.count_nonzero(slow > 1e-9) <= 3


@pytest.mark.parametrize("rate_hz", [2000.0, RATE_HZ])
def test_a_limit_cuts_what_was_asked_for_before_the_drives_filter(machine: Machine, rate_hz: float) -> None:
    """A sine that is asked for, which a filter delays, and which was cut before it."""
    filter_s, pulse, limit = 3e-4, 2 * np.pi * 10.0, 3.0
    time = np.arange(int(rate_hz)) / rate_hz
    asked = 5 * np.sin(pulse * time)
    reported = 5 * np.imag(np.exp(1j * pulse * time) / (1 + 1j * pulse * filter_s))
    run = Run("reference", 0, rate_hz, time, np.sin(9 * time), 9 * np.cos(9 * time), reported)
    picked = picked_signals_of(run, machine, 160.0)
    cut = picked.drive.asked(lambda nm: np.clip(nm, -limit, limit) - nm, filter_s)
    expected = np.interp(picked.time_s, time, np.clip(asked, -limit, limit) - asked)
    assert np.max(np.abs(cut - expected)[5:-5]) < 0.03
    late = picked.drive.asked(lambda nm: np.clip(nm, -limit, limit) - nm, 0.0)
    assert np.max(np.abs(late - expected)) > 0.06


def test_a_recording_with_no_sample_to_spare_is_taken_as_it_is(machine: Machine) -> None:
    run = _recorded(np.zeros(8000))
    picked, whole = picked_signals_of(run, machine, 700.0), signals_of(run, machine, 700.0)
    assert picked.time_s.size == whole.time_s.size == len(run)


@pytest.mark.parametrize("every", [2, 4, 6])
def test_errors_of_recorded_samples_are_in_a_step_what_the_model_says(machine: Machine, every: int) -> None:
    """Between the samples that are taken lie others: of a step's error, the next one has little."""
    noise = np.random.default_rng(3).standard_normal(80_000)
    run = picked_signals_of(_recorded(noise), machine, 160.0 * EVERY / every)
    assert run.drive.every == every
    between = run.drive.undelayed
    means = (between.start_nm + between.end_nm) / 2 + 2 / 3 * between.bulge_nm
    at_samples, alone = torque_errors(Noise(1.0, 1e-3, 1e-6), run)
    assert np.var(means) == pytest.approx(float(at_samples[0] / 2 + alone[0]), rel=0.1)
    shared = float(np.mean(means[1:] * means[:-1]))
    assert shared == pytest.approx(float(at_samples[0] / 4), abs=0.05 * float(np.var(means)))


def test_a_count_that_stays_tells_what_one_sample_of_it_does(machine: Machine) -> None:
    """At rest no motion of less than a count shows, and all samples together told of one that there is none."""
    run = _recorded(np.zeros(8000))
    count = 1e-4
    run = replace(run, position_rad=count * np.round(run.position_rad / count))
    run.position_rad[4000:4400] = run.position_rad[4000]
    signals = signals_of(run, machine, 160.0)
    noise = Noise(1.0, 1.0, count / 12**0.5)
    resting = variances_of(noise, signals)[4000:4400, 0]
    assert 1 / np.sum(1 / resting) == pytest.approx(noise.position_rad**2, rel=0.02)
    moving = variances_of(noise, signals)[100:300, 0]
    assert np.median(moving) == pytest.approx(noise.position_rad**2)
    assert not np.any(signals_of(_recorded(np.zeros(8000)), machine, 160.0).unmoved_rad2)
