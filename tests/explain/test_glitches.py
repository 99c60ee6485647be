"""Single samples that no motion makes are told and left out; what a machine does stays."""

from dataclasses import replace

import numpy as np
import pytest
from strangers import STRANGERS, belief_of, session_of

from schwung.explain.plausibility import without_glitches
from schwung.explain.publishing.publish import publish


@pytest.fixture(scope="module")
def session():
    return session_of(STRANGERS[0], 5, every=4, times=(0.25, 0.4))


def with_repeated(session, place):
    """The same with a sample that is logged a second time in place of the next, in every run."""
    runs = []
    for run in session.runs:
        signals = {name: getattr(run, name).copy() for name in ("position_rad", "speed_rad_s", "torque_nm")}
        for values in signals.values():
            values[place] = values[place - 1]
        runs.append(replace(run, **signals))
    return replace(session, runs=tuple(runs))


@pytest.mark.long
def test_a_sample_that_was_logged_twice_is_no_physics(session):
    """One of 1500 samples of a run made a sound machine 'unexplained', with 1.3 times its noise."""
    found = publish(with_repeated(session, 500), belief_of(STRANGERS[0]))
    assert found.verdict == "consistent"
    assert found.proof is not None
    assert found.proof.after < 1.02
    assert sum("unlike its neighbours" in note for note in found.notes) == len(session.runs)


def test_what_neighbours_say_is_what_was_there(session):
    mended, notes = without_glitches(with_repeated(session, 500))
    for run, before in zip(mended.runs, session.runs, strict=True):
        assert np.flatnonzero(run.position_rad != before.position_rad).tolist() == [500]
        assert run.position_rad[500] == pytest.approx(before.position_rad[500], abs=2e-5)
    assert "at 0.2" in notes[0]


@pytest.mark.parametrize("number", [0, 8, 12, 16])
def test_a_machine_makes_none(number):
    """Play that strikes, a hum that jumps, what slips in the coupling."""
    session = session_of(STRANGERS[number], 5, every=8, times=(0.25, 0.4))
    assert without_glitches(session) == (session, ())


def test_an_impact_between_samples_is_none(session):
    """A speed that jumps, wherever that is between two samples."""
    run = session.runs[0]
    for share in np.linspace(0.0, 0.9, 10):
        jump = 3.0 * np.maximum(run.time_s - run.time_s[500] - share / run.sample_rate_hz, 0.0)
        hit = replace(
            run, position_rad=run.position_rad + jump, speed_rad_s=run.speed_rad_s + 3.0 * (jump > 0)
        )
        assert not without_glitches(replace(session, runs=(hit,)))[1]
