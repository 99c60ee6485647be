"""Runs for the proof: nothing hangs on them, and what they prove is what is published."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sealed_sessions import drawn

from schwung.drivetrain.machine import Machine
from schwung.explain import sharpened
from schwung.explain.explain import explain
from schwung.session import Session


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
    assert after.to_json()["names"] == before.to_json()["names"]
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
