"""Friction that bends before it slides, against laws of another formula: Maxwell's slipping elements, Bouc and Wen."""

import numpy as np
import pytest
from sealed_sessions import fewer
from strangers import STRANGERS, Stranger, belief_of, session_of

from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.presliding import bent
from schwung.explain.publishing.learned import Found, learned
from schwung.explain.weighing.weigh import weigh

DISTANCE = 0.4


def stroke():
    """There and back with a pause, then half of the way there, rad."""
    half = 1.5 * (1 - np.cos(np.linspace(0, np.pi, 400)))
    return np.concatenate([half, np.full(50, half[-1]), half[::-1], 0.5 * half])


def slipping(angle, distance, elements=40):
    """Springs in parallel, each of which slips at its own bend; limits such that a first bend is exponential."""
    limits = distance / 2 * -np.log((np.arange(elements) + 0.5) / elements)
    bends, share = np.zeros(elements), np.zeros(angle.size)
    for i, way in enumerate(np.diff(angle), 1):
        bends = np.clip(bends + way, -limits, limits)
        share[i] = np.sum(bends) / np.sum(limits)
    return share


def missed(target, *columns):
    """Share of the variance that columns leave."""
    matrix = np.stack(columns, 1)
    rest = target - matrix @ np.linalg.lstsq(matrix, target, rcond=None)[0]
    return float(np.var(rest) / np.var(target))


def test_slipping_elements_bend_alike():
    angle = stroke()
    truth, first = slipping(angle, DISTANCE), bent(angle, DISTANCE, 1.0) - bent(angle, DISTANCE, 0.0)
    assert missed(truth, bent(angle, DISTANCE, 0.0), first) < 0.005
    assert missed(truth, np.sign(np.gradient(angle))) > 0.1


def test_a_distance_is_found_by_what_it_leaves():
    angle = stroke()
    truth = slipping(angle, DISTANCE)
    tried = np.geomspace(0.05, 3.0, 60)
    left = [missed(truth, bent(angle, x, 0.0), bent(angle, x, 1.0) - bent(angle, x, 0.0)) for x in tried]
    assert tried[int(np.argmin(left))] == pytest.approx(DISTANCE, rel=0.1)


def test_nothing_slides_at_rest():
    resting = np.full(10, 0.3)
    assert bent(resting, DISTANCE, 0.7) == pytest.approx(np.full(10, 0.7))


@pytest.mark.long
def test_a_stranger_that_bends_is_named():
    hidden = Stranger("bends", ("presliding_friction",), bends=(1.2, 0.5))
    found = weigh(fewer(session_of(hidden, 5, every=8, times=(0.25,)), 1), belief_of(hidden))
    assert found.probability("presliding_friction") > 0.5
    named = next(one for one in found.names if one.name == "presliding_friction").parameters
    assert named["torque_nm"].value == pytest.approx(1.2, rel=0.1)
    assert found.probability("load_torque") < 0.5


@pytest.mark.long
def test_what_another_law_does_beyond_ours_is_no_load_by_direction():
    """Strokes of one place begin at one angle each way, so that it follows from angle and direction as well: 0.78."""
    hidden = STRANGERS[7]
    found = weigh(session_of(hidden, 5, every=8, times=(0.25, 0.4)), belief_of(hidden))
    assert {one.name for one in found.names if one.probability > 0.5} == {"presliding_friction"}


def test_what_is_found_beside_what_is_believed_is_one_term():
    had = {"torque_nm": 1.0, "stiffness_nm_rad": 4.0}
    term = PhysicsTerm.model_validate({"name": "presliding_friction", **had})
    believed = belief_of(Stranger("", ())).model_copy(update={"physics": (term,)})
    found = Found("presliding_friction", True, {"torque_nm": 0.2, "stiffness_nm_rad": 0.5}, {})
    (one,) = learned(believed, [found]).physics
    assert one.parameters == {"torque_nm": pytest.approx(1.2), "stiffness_nm_rad": pytest.approx(4.5)}
