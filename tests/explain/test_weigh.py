"""Names by evidence, on machines that share neither laws nor integrator nor filters with the tool."""

from dataclasses import replace

import pytest
from sealed_sessions import fewer
from strangers import ROTOR, STIFFNESS, STRANGERS, Stranger, belief_of, session_of

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.values import Weighed
from schwung.explain.weighing.weigh import weigh

DRY = Stranger("dry friction", ("coulomb_friction",), (0.8, 0.0, 0.0, 0.0))
BOTH = Stranger(
    "dry friction, inertia", ("coulomb_friction", "load_inertia"), DRY.friction, believed_scale=0.95
)


def recorded(stranger):
    """Two motion times, one run each without and with injection, every eighth tick logged."""
    return fewer(session_of(stranger, 5, every=8, times=(0.25, 0.4)), 1)


def asked(stranger, machine=None):
    return weigh(recorded(stranger), machine or belief_of(stranger))


@pytest.fixture(scope="module")
def both() -> Weighed:
    """Of a machine that hides dry friction, and is not as heavy as believed."""
    return asked(BOTH)


def likely(found):
    return {one.name for one in found.names if one.probability > 0.5}


def test_nothing_hidden_has_no_name():
    found = asked(STRANGERS[0])
    assert not likely(found)
    assert all(one.probability < 0.5 for one in found.unnamed)


@pytest.mark.long
def test_dry_friction_beside_a_wrong_inertia_has_both_names_and_their_amounts(both):
    assert likely(both) == {"load_inertia", "coulomb_friction"}
    parameters = {one.name: one.parameters for one in both.names}
    assert parameters["coulomb_friction"]["torque_nm"].value == pytest.approx(0.8, rel=0.01)
    assert parameters["load_inertia"]["delta_kgm2"].value == pytest.approx(0.05 * 2.2e-2, rel=0.01)


@pytest.mark.long
def test_a_shape_has_an_interval_too():
    spot = Stranger("tight spot", ("local_friction",), spot=(1.2, 2.0, 0.5))
    found = asked(spot)
    assert "local_friction" in likely(found)
    parameters = next(one for one in found.names if one.name == "local_friction").parameters
    assert parameters["centre_rad"].value == pytest.approx(2.0, abs=0.02)
    assert parameters["centre_rad"].low < parameters["centre_rad"].value < parameters["centre_rad"].high


@pytest.mark.long
def test_what_is_published_is_proven_on_motions_that_were_not_fitted():
    proof = publish(recorded(BOTH), belief_of(BOTH)).proof
    assert proof is not None
    assert proof.gain > 1
    assert proof.after < 1.15
    assert proof.before > 2


@pytest.mark.long
def test_nothing_is_missed_where_nothing_is_hidden():
    proof = publish(recorded(STRANGERS[0]), belief_of(STRANGERS[0])).proof
    assert proof is not None
    assert proof.after == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_probabilities_are_shares(both):
    assert all(0 <= one.probability <= 1 + 1e-9 for one in (*both.names, *both.unnamed))
    assert both.excess >= 1
    assert both.probability("backlash") < 0.5


def test_what_the_belief_knows_is_not_named_again():
    terms = (PhysicsTerm(name="coulomb_friction", torque_nm=0.8),)
    known = belief_of(DRY).model_copy(update={"physics": terms})
    assert not likely(asked(DRY, known))


@pytest.mark.parametrize("share", [0.0, 0.01])
def test_noise_in_proportion_to_the_torque_is_noise(share):
    stranger = replace(STRANGERS[0], torque_share=share)
    found = weigh(session_of(stranger, 5, times=(0.25,)), belief_of(stranger))
    assert not likely(found)
    # of each recorded sample, of which every second is taken; the plant's two parts add up, and not their squares
    assert found.noise.torque_share == pytest.approx(share, rel=0.35, abs=0.001)
    assert found.noise.torque_nm == pytest.approx(0.05, rel=0.2)


@pytest.mark.long
@pytest.mark.parametrize("scale", [0.6, 1.7])
def test_a_stiffness_that_is_far_off_is_the_only_name(scale):
    machine = belief_of(STRANGERS[0])
    assert machine.coupling is not None
    believed = machine.coupling.model_copy(update={"stiffness_nm_rad": scale * STIFFNESS})
    found = asked(STRANGERS[0], machine.model_copy(update={"coupling": believed}))
    assert likely(found) == {"coupling_stiffness"}
    stiffness = found.names[0].parameters["stiffness_nm_rad"]
    assert stiffness.value == pytest.approx(STIFFNESS, rel=0.005)


@pytest.mark.long
@pytest.mark.parametrize("scale", [0.93, 1.3])
def test_a_motor_inertia_that_is_off_is_the_only_name(scale):
    """Without that name it was a torque constant, a lag and less viscous friction."""
    machine = belief_of(STRANGERS[0])
    believed = machine.motor.model_copy(update={"inertia_kgm2": scale * ROTOR})
    session = session_of(STRANGERS[0], 5, every=8, times=(0.25, 0.4))
    found = weigh(session, machine.model_copy(update={"motor": believed}))
    assert likely(found) == {"motor_inertia"}
    inertia = found.names[0].parameters["inertia_kgm2"]
    assert inertia.value == pytest.approx(ROTOR, rel=0.003)
    assert inertia.low < ROTOR < inertia.high


@pytest.mark.long
def test_a_speed_curve_without_a_name_stands_alone_not_beside_its_cases():
    found = asked(STRANGERS[3])
    assert not likely(found)
    assert {one.coordinate for one in found.unnamed if one.probability > 0.5} == {"speed"}


@pytest.mark.long
def test_what_a_law_is_off_by_takes_no_other_name():
    nearly = Stranger(
        "dry friction that rises by 2 % with speed", ("coulomb_friction",), (2.0, 0.0, 0.005, 0.0)
    )
    found = asked(nearly)
    assert likely(found) == {"coulomb_friction"}
    assert found.probability("viscous_friction") < 0.3
