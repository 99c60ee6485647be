"""The two parts of a session: runs to fit on, and runs that prove what was found there."""

from __future__ import annotations

import numpy as np

from schwung.explain.kept_aside import kept_aside
from schwung.motion import Excitation, Motion
from schwung.session import Run, Session


def session_of(*runs: tuple[float, bool]) -> Session:
    """Runs of motion times (s), with or without an injection."""
    time = np.arange(2000) / 1000.0

    def run(number: int, duration_s: float, excited: bool) -> Run:
        motion = Motion(kind="third", distance_rad=1.0, duration_s=duration_s, start_time_s=0.1)
        injected = Excitation(frequency_hz=50.0, amplitude_nm=1.0, phase_rad=0.0, ramp_s=0.04, end_s=1.0)
        return Run(
            role="excited" if excited else "reference", repeat=number, sample_rate_hz=1000.0, time_s=time,
            position_rad=motion.demand(time).position_rad, speed_rad_s=motion.demand(time).speed_rad_s,
            torque_nm=np.zeros_like(time), torque_added_nm=None, motion=motion,
            excitation=injected if excited else None,
        )  # fmt: skip

    made = tuple(run(number, duration, excited) for number, (duration, excited) in enumerate(runs))
    return Session(made, created="2026-01-01T00:00:00", source="test")


def test_half_of_a_motion_time_is_kept_aside() -> None:
    times = (0.2, 0.3, 0.4)
    every = ((duration, excited) for duration in times for excited in (False, False, True, True))
    assert kept_aside(session_of(*every)) == (5, 7)


def test_of_repeats_the_last_is_kept_aside() -> None:
    assert kept_aside(session_of((0.2, False), (0.2, True), (0.2, False), (0.2, True))) == (3,)
    assert kept_aside(session_of((0.2, False), (0.2, False), (0.2, False), (0.2, True))) == (2,)


def test_where_one_run_can_be_spared_it_is_for_the_proof() -> None:
    assert kept_aside(session_of((0.2, False), (0.2, False))) == (1,)
    assert kept_aside(session_of((0.2, False), (0.2, True))) == ()
