"""The coupling's damping, and what noise looks like."""

from pathlib import Path

import pytest
from sealed_sessions import drawn

from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
def test_noise_of_the_wind_up_is_no_damping(tmp_path: Path) -> None:
    """A sound machine sampled at 1 kHz, whose coupling winds up by little more than what noise makes of it: noise of
    its rate stood on both sides, and 80 % more damping at three deviations had a name with 0.98. Contacts without a gap
    that only push made noise likelier by 20 nats, and all that was weighed beside them was worth something.
    """
    session, machine, label = drawn(tmp_path, 202003, each=3, kind="none")
    assert not label["effects"]
    found = weigh(session, machine)
    assert all(one.probability < 0.1 for one in (*found.names, *found.unnamed))


def test_an_inertia_that_bends_within_a_step_is_no_damping(tmp_path: Path) -> None:
    """A sound machine sampled at 1 kHz, which passes more of its inertia's bends between two samples than these show:
    30 % less damping had a name with 0.96, of two runs each with 1.00."""
    session, machine, label = drawn(tmp_path, 294428, kind="none")
    assert not label["effects"]
    found = weigh(session, machine)
    assert all(one.probability < 0.1 for one in (*found.names, *found.unnamed))


@pytest.mark.long
def test_a_damping_that_is_a_fiftieth_off_has_a_name(tmp_path: Path) -> None:
    """A coupling's damping is heard to a thousandth, however little anybody knows of it before: of 4.6 % more beside a
    weight and a viscous friction (304202) it was the better set by 19 000 nats, and neither told nor in the file."""
    session, machine, label = drawn(tmp_path, 190016, each=2, kind="single")
    assert machine.coupling is not None
    (effect,) = label["effects"]
    true = effect["parameters"]["damping_nms"]
    believed = machine.coupling.model_copy(update={"damping_nms": true / 1.02})
    nearly = machine.model_copy(update={"coupling": believed})
    (found,) = (name for name in weigh(session, nearly).names if name.probability > 0.5)
    assert found.name == "coupling_damping"
    assert found.parameters["damping_nms"].value == pytest.approx(true, rel=5e-3)
