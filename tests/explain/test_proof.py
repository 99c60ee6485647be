"""The three parts of a session: runs to fit on, runs that check what was chosen, runs that nothing hangs on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sealed_sessions import drawn

from schwung.drivetrain.machine import Machine
from schwung.explain import sharpened
from schwung.explain.explain import explain
from schwung.explain.proof import split
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


def test_a_motion_time_is_kept_aside_and_halved() -> None:
    times = (0.2, 0.3, 0.4)
    parts = split(
        session_of(*((duration, excited) for duration in times for excited in (False, False, True, True)))
    )
    assert parts.train == (0, 1, 2, 3, 8, 9, 10, 11)
    assert parts.check == (4, 6)
    assert parts.heldout == (5, 7)


def test_of_repeats_the_last_are_kept_aside_and_halved() -> None:
    parts = split(session_of((0.2, False), (0.2, True), (0.2, False), (0.2, True)))
    assert (parts.train, parts.check, parts.heldout) == ((0, 1), (2,), (3,))


def test_where_one_run_can_be_spared_it_is_for_the_proof() -> None:
    parts = split(session_of((0.2, False), (0.2, False)))
    assert (parts.train, parts.check, parts.heldout) == ((0,), (), (1,))
    assert split(session_of((0.2, False), (0.2, True))).heldout == ()


def test_a_third_repeat_checks_where_one_run_alone_is_for_the_proof() -> None:
    parts = split(session_of((0.2, False), (0.2, False), (0.2, False), (0.2, False)))
    assert (parts.train, parts.check, parts.heldout) == ((0, 1), (2,), (3,))
    parts = split(session_of((0.2, False), (0.2, False), (0.2, False), (0.2, True)))
    assert (parts.train, parts.check, parts.heldout) == ((0, 3), (1,), (2,))


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, Machine]:
    """A session that conceals dry friction, and the belief."""
    session, machine, _ = drawn(tmp_path_factory.mktemp("rubbing"), 422, 2, among=("coulomb_friction",))
    return session, machine


def test_runs_for_the_proof_change_nothing_but_the_proof(rubbing: tuple[Session, Machine]) -> None:
    """Whatever happens on them: names, numbers, intervals and the floor stay as they were, to the last bit."""
    session, machine = rubbing
    before = explain(session, machine)
    chance = np.random.default_rng(1)
    runs = list(session.runs)
    for number in before.fit.heldout_runs:
        noise = 2 * before.noise_floor.torque_nm * chance.standard_normal(len(runs[number]))
        runs[number] = replace(runs[number], torque_nm=runs[number].torque_nm + noise)
    after = explain(replace(session, runs=tuple(runs)), machine)
    assert before.verdict == "explained"
    assert after.verdict == "partly_explained"
    assert after.noise_floor == before.noise_floor
    assert after.to_json()["findings"] == before.to_json()["findings"]
    assert (
        after.fit.after.torque_rmse_nm > 1.2 * before.noise_floor.torque_nm >= before.fit.after.torque_rmse_nm
    )


def test_the_proof_is_of_what_is_published(
    rubbing: tuple[Session, Machine], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A correction of the fit that chance never makes is dropped; what is left is in finding and file alike."""
    session, machine = rubbing
    before = explain(session, machine)
    published_nm = before.findings[0].parameters["torque_nm"].value
    assert isinstance(published_nm, float)
    made = sharpened._shaken

    def wild(*given: Any) -> tuple[dict[str, float], Any]:
        bias, scatter = made(*given)
        return {name: 0.5 * published_nm if "coulomb" in name else 0.0 for name in bias}, scatter

    monkeypatch.setattr(sharpened, "_shaken", wild)
    after = explain(session, machine)
    told = after.findings[0].parameters["torque_nm"].value
    assert told == pytest.approx(published_nm, rel=0.05)
    assert after.machine.physics[-1].number("torque_nm") == told
    assert after.fit.after.torque_rmse_nm == pytest.approx(before.fit.after.torque_rmse_nm, rel=0.05)
