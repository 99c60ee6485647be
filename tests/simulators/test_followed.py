"""Recordings from a bus: staircases, counts that fall alike, standstills, and speeds that say nothing of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schwung.motion import Excitation
from schwung.session import Run, Session
from schwung.simulators.followed import Followed, recording_of

RATE_HZ, FREQUENCY_HZ, AMPLITUDE_NM = 1000.0, 50.0, 40.0
INERTIA_KGM2 = 0.1


def _session(*, held: bool, delay_s: float = 0.0, counts: bool = False, repeats: int = 1) -> Session:
    """A swing of 2 rad at 1 Hz, with noise; the injection is reported but does not show in the motion."""
    time = np.arange(2000) / RATE_HZ
    turn, late = 2 * np.pi * time, 2 * np.pi * (time - delay_s)
    runs = []
    for repeat in range(repeats):
        chance = np.random.default_rng(0 if counts else repeat)
        excitation = Excitation(
            frequency_hz=FREQUENCY_HZ, amplitude_nm=AMPLITUDE_NM, hold_s=1 / RATE_HZ if held else None
        )
        runs.append(
            Run(
                role="excited",
                repeat=repeat,
                sample_rate_hz=RATE_HZ,
                time_s=time,
                position_rad=1 - np.cos(turn) + 1e-6 * chance.standard_normal(time.size),
                speed_rad_s=2 * np.pi * np.sin(late) + 1e-3 * chance.standard_normal(time.size),
                torque_nm=excitation.torque(time - 1 / RATE_HZ) + 0.05 * chance.standard_normal(time.size),
                torque_added_nm=excitation.torque(time - 1 / RATE_HZ),
                excitation=excitation,
                extra={"same_motion": 0},
            )
        )
    return Session(tuple(runs), created="", source="test")


def test_a_staircase_is_taken_by_its_fundamental_at_the_instants_of_sampling() -> None:
    """Zero-order hold: sinc(f/f_s) as large, half a step late; the value set at an instant is held after it."""
    signals = recording_of(_session(held=True), INERTIA_KGM2).runs[0]
    x = np.pi * FREQUENCY_HZ / RATE_HZ
    expected = AMPLITUDE_NM * np.sin(x) / x * np.sin(2 * np.pi * FREQUENCY_HZ * signals.time_s - x)
    middle = slice(100, -100)
    assert np.std((signals.torque_nm - expected)[middle]) < 0.1


def test_a_continuous_injection_is_left_as_it_is() -> None:
    session = _session(held=False)
    recording = recording_of(session, INERTIA_KGM2)
    assert recording.rate_hz == RATE_HZ
    np.testing.assert_array_equal(recording.runs[0].torque_nm, session.runs[0].torque_nm)


@pytest.mark.parametrize("delay_s", [0.0, 0.0003, 0.002])
def test_a_late_speed_is_not_late_in_the_motion(delay_s: float) -> None:
    run = recording_of(_session(held=False, delay_s=delay_s), INERTIA_KGM2).runs[0]
    assert _missed_rad_s(run) < 0.1 * (2 * np.pi) ** 2 * 3e-4  # of what the shorter delay makes


def test_a_difference_of_two_angles_is_no_late_speed() -> None:
    session = _session(held=False)
    run = session.runs[0]
    difference = np.diff(run.position_rad, prepend=run.position_rad[0]) * RATE_HZ
    derived = replace(session, runs=(replace(run, speed_rad_s=difference),))
    late = (2 * np.pi) ** 2 * 0.5 / RATE_HZ
    assert _missed_rad_s(recording_of(derived, INERTIA_KGM2).runs[0]) < 0.2 * late


def _missed_rad_s(run: Followed) -> float:
    """Of the true speed, rms, away from the ends."""
    true = 2 * np.pi * np.sin(2 * np.pi * run.time_s)
    return float(np.std((run.speed_rad_s - true)[200:-200]))


def test_angle_and_speed_are_one_motion_of_which_the_counts_do_not_show() -> None:
    """ω = dθ/dt of what is prescribed, and θ to far less than the counts' quantum/√12, where speed tells it better."""
    quantum = 1e-4
    run = _session(held=False).runs[0]
    chance = np.random.default_rng(3)
    turn = 2 * np.pi * run.time_s
    counted = np.round((1 - np.cos(turn)) / quantum) * quantum
    told = 2 * np.pi * np.sin(turn) + 1e-3 * chance.standard_normal(turn.size)
    session = Session((replace(run, position_rad=counted, speed_rad_s=told),), created="", source="test")
    signals, middle = recording_of(session, INERTIA_KGM2).runs[0], slice(200, -200)
    slope = np.gradient(signals.position_rad, signals.time_s)
    exact = 1 - np.cos(2 * np.pi * signals.time_s)
    assert np.std((slope - signals.speed_rad_s)[middle]) < 2e-3
    assert np.std((signals.position_rad - exact)[middle]) < 0.2 * quantum / np.sqrt(12)
