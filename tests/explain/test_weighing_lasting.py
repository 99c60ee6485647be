"""What repeats of a motion differ by for longer than noise lasts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sealed_sessions import drawn

from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.repeated import lasting, telling_noise
from schwung.session import Session

#: Of the torque, that a cold motor gives more.
COLD = 0.05


def _warming(session: Session) -> Session:
    """The first run of each motion with a motor that is cold at its beginning."""
    firsts = {group[0] for group in telling_noise(session) if len(group) > 1}
    runs = [
        replace(run, torque_nm=run.torque_nm * (1 - COLD * np.exp(-run.time_s / 0.3))) if i in firsts else run
        for i, run in enumerate(session.runs)
    ]
    return replace(session, runs=tuple(runs))


def test_noise_alone_does_not_last(tmp_path: Path) -> None:
    assert lasting(drawn(tmp_path, 309501, 3, kind="none")[0]) is None


def test_what_a_cold_motor_does_lasts(tmp_path: Path) -> None:
    """Its size is that of what one run has more than another, over the square root of two."""
    sound = drawn(tmp_path, 309501, 3, kind="none")[0]
    found = lasting(_warming(sound))
    assert found is not None
    more = (COLD * np.exp(-run.time_s / 0.3) * run.torque_nm for run in sound.runs if run.role == "reference")
    whole = max(float(np.sqrt(np.mean(one**2) / 2)) for one in more)
    assert 0.2 * whole < found.torque_nm <= whole
    assert found.over_noise > 2


@pytest.mark.long
def test_where_nothing_takes_it_the_session_is_not_consistent(tmp_path: Path) -> None:
    """It was taken for noise, about which the belief was told to leave out nothing."""
    session, belief, _ = drawn(tmp_path, 309501, 3, kind="none")
    assert publish(session, belief).verdict == "consistent"
    found = publish(_warming(session), belief)
    assert found.lasting is not None
    assert found.verdict == "unexplained"
    assert "from one run to the next" in found.headline
    assert any("as warm as it gets" in note for note in found.notes)


@pytest.mark.parametrize("frequency_hz", [4.0, 12.5, 30.0])
def test_what_still_swings_lasts_as_well(frequency_hz: float, tmp_path: Path) -> None:
    """However long a period is: a quarter of it later, nothing would be shared."""
    sound = drawn(tmp_path, 309501, 2, kind="none")[0]
    size = 0.2
    swinging = {group[0] for group in telling_noise(sound) if len(group) > 1}
    runs = [
        replace(run, torque_nm=run.torque_nm + size * np.sin(2 * np.pi * frequency_hz * run.time_s))
        if i in swinging
        else run
        for i, run in enumerate(sound.runs)
    ]
    found = lasting(replace(sound, runs=tuple(runs)))
    assert found is not None
    assert found.torque_nm == pytest.approx(size / 2, rel=0.15)
