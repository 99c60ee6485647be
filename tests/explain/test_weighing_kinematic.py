"""A transmission that is off many times a turn."""

import numpy as np
import pytest
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
@pytest.mark.parametrize(("amplitude", "order"), [(1e-4, 12.0), (4e-4, 6.0)])
def test_it_is_no_error_of_the_encoder(amplitude, order):
    """Both are many times a turn; what the motor's end does of it, only one of them shows in the torque."""
    stranger = Stranger("mesh", ("kinematic_error",), mesh=(amplitude, order))
    found = weigh(session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger))
    assert [one.name for one in found.names if one.probability > 0.05] == ["kinematic_error"]
    told = found.names[0].parameters
    assert told["order"].value == pytest.approx(order, rel=0.01)
    assert told["amplitude_rad"].value == pytest.approx(amplitude, rel=0.05)


@pytest.mark.long
def test_its_second_wave_is_no_error_of_an_encoder():
    """A pulley that is eccentric and no circle: one wave was a transmission's, the other an encoder's (0.99)."""
    amplitude, order = 2e-5, 12.0
    stranger = Stranger("oval", ("kinematic_error",), oval=(amplitude, order))
    found = publish(session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger))
    assert [one.physics for one in found.names if one.probability > 0.05] == ["kinematic_error"]
    angle = np.linspace(0, 2 * np.pi, 4097)[:-1]
    wave = amplitude * np.sin(angle) / (1 + 0.2 * np.cos(angle))
    first, second = (2 * np.mean(wave * np.sin(n * angle)) for n in (1, 2))
    told = found.names[0].parameters
    assert told["order"].value == pytest.approx(order, rel=0.01)
    assert told["amplitude_rad"].value == pytest.approx(first, rel=0.05)
    assert told["second_amplitude_rad"].value == pytest.approx(abs(second), rel=0.2)
    assert found.proof.after < 1.05 < found.proof.before


@pytest.mark.long
def test_a_belief_that_has_it_misses_nothing():
    amplitude, order = 1e-4, 12.0
    stranger = Stranger("mesh", ("kinematic_error",), mesh=(amplitude, order))
    term = PhysicsTerm(name="kinematic_error", order=order, amplitude_rad=amplitude, phase_rad=1.0)
    session, machine = session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger)
    assert publish(session, machine).proof.before > 1.2
    found = publish(session, machine.model_copy(update={"physics": (term,)}))
    assert all(one.probability < 0.5 for one in (*found.names, *found.curves))
    assert found.proof.before == pytest.approx(1.0, abs=0.1)
