"""An encoder that is off many times a turn: the drive shakes the machine by it, which looks like another torque."""

from types import SimpleNamespace

import numpy as np
import pytest
from sealed_sessions import drawn
from strangers import STRANGERS, Stranger, belief_of, session_of

from schwung.drivetrain.inertia import InertiaTable, LoadTorqueTable
from schwung.drivetrain.machine import Load
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import Along
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
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
    found = publish(session, belief_of(stranger).model_copy(update={"physics": (term,)}))
    assert all(one.probability < 0.5 for one in (*found.names, *found.curves))
    assert found.proof is not None
    assert found.proof.before == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_half_a_degree_misread_where_the_inertia_is_steep_is_no_other_inertia(tmp_path):
    """Two degrees, a speed 0.8 ms late: a line without the load's other torque there is worth less than a profile."""
    session, machine, _ = drawn(tmp_path, 285308, kind="two", level="clear")
    found = weigh(session, machine)
    assert {one.name for one in found.names if one.probability > 0.5} == {
        "encoder_eccentricity",
        "measurement_delay",
    }


def test_where_the_angle_is_misread_the_load_is_another():
    """J α + ½ J' ω² − T of the load, at an angle a little further, and at a speed a little faster, is so much more."""
    points = np.linspace(-0.5, 3.5, 800)
    crank = belief_of(STRANGERS[14]).model_copy(
        update={
            "load": Load(
                inertia_table=InertiaTable(points, 0.02 * (1 + 0.6 * np.sin(2 * points) ** 2)),
                torque_table=LoadTorqueTable(points, 3.0 * np.cos(points)),
            )
        }
    )
    at, speed, faster = np.linspace(0.1, 3.0, 200), 12.0, 300.0
    along = SimpleNamespace(present=crank, load_angle=at, load_speed=speed, load_acceleration=faster)

    slope, bend, pull = 0.024 * np.sin(4 * at), 0.096 * np.cos(4 * at), -3.0 * np.sin(at)
    expected = slope * faster + bend * speed**2 / 2 - pull
    further, quicker = vars(Along)["load_torque_slopes"].func(along).T
    assert np.std(further - expected) < 0.15 * np.std(expected)  # a table's second derivative is rough
    np.testing.assert_allclose(quicker, slope * speed, atol=0.02 * 0.024 * speed)
