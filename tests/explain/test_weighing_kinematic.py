"""A transmission that is off many times a turn, where the belief knows it."""

import pytest
from strangers import Stranger, belief_of, session_of

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.weighing.weigh import weigh


def test_a_belief_that_has_it_misses_nothing():
    amplitude, order = 1e-4, 12.0
    stranger = Stranger("mesh", ("kinematic_error",), mesh=(amplitude, order))
    term = PhysicsTerm(name="kinematic_error", order=order, amplitude_rad=amplitude, phase_rad=1.0)
    session, machine = session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger)
    assert weigh(session, machine).proof.before > 1.2
    found = weigh(session, machine.model_copy(update={"physics": (term,)}))
    assert all(one.probability < 0.5 for one in (*found.names, *found.unnamed))
    assert found.proof.before == pytest.approx(1.0, abs=0.1)
