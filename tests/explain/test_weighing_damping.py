"""The coupling's damping, and what noise looks like."""

from pathlib import Path

from sealed_sessions import drawn

from schwung.explain.weighing.weigh import weigh


def test_noise_of_the_wind_up_is_no_damping(tmp_path: Path) -> None:
    """A sound machine sampled at 1 kHz, whose coupling winds up by little more than what noise makes of it: noise of
    its rate stood on both sides, and 80 % more damping at three deviations had a name with 0.98."""
    session, machine, label = drawn(tmp_path, 202003, each=4, kind="none")
    assert not label["effects"]
    assert all(name.probability < 0.1 for name in weigh(session, machine).names)
