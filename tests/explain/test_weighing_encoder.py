"""An encoder that is off many times a turn: the drive shakes the machine by it, which looks like another torque."""

import numpy as np
import pytest
from strangers import STRANGERS, Stranger, belief_of, session_of

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.weighing.weigh import weigh


@pytest.mark.parametrize(
    ("amplitude", "order"), [STRANGERS[14].tracks, (1e-3, 3.0)], ids=["as the stranger", "as a profile"]
)
def test_an_encoders_harmonic_has_a_name_and_no_torque_has(amplitude, order):
    stranger = Stranger("tracks", ("encoder_harmonic",), tracks=(amplitude, order))
    found = weigh(session_of(stranger, 5, every=8, times=(0.25, 0.4)), belief_of(stranger))
    (name,) = (one for one in found.names if one.probability > 0.5)
    assert name.name == "encoder_harmonic"
    assert all(one.probability < 0.5 for one in found.unnamed)
    value = {key: one.value for key, one in name.parameters.items()}
    assert value["order"] == pytest.approx(order, rel=0.01)
    assert value["amplitude_rad"] == pytest.approx(amplitude, rel=0.05)
    at = np.linspace(0.0, 4.0, 50)  # it has to be right where it is, not only as large
    # switched on where it reads 0, which is a shift of the angle and so of the phase
    begins = 1.0 + order * amplitude * np.sin(1.0)
    told = amplitude * np.sin(order * at + begins)
    assert value["amplitude_rad"] * np.sin(value["order"] * at + value["phase_rad"]) == pytest.approx(
        told, abs=0.1 * amplitude
    )


def test_a_belief_that_has_it_misses_nothing():
    stranger = STRANGERS[14]
    amplitude, order = stranger.tracks
    phase = 1.0 + order * amplitude * np.sin(1.0)
    term = PhysicsTerm(name="encoder_harmonic", order=order, amplitude_rad=amplitude, phase_rad=phase)
    session = session_of(stranger, 5, every=8, times=(0.25,))
    found = weigh(session, belief_of(stranger).model_copy(update={"physics": (term,)}))
    assert all(one.probability < 0.5 for one in (*found.names, *found.unnamed))
    assert found.proof is not None
    assert found.proof.before == pytest.approx(1.0, abs=0.1)
