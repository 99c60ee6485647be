"""A spring at an end of the stroke: what the candidate does, and whether a stranger's machine shows it by that name."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from schwung.drivetrain import Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.known import known
from schwung.explain.causes.vocabulary import vocabulary
from schwung.explain.publishing.learned import Found, learned
from schwung.explain.publishing.publish import publish
from schwung.explain.weighing.weigh import weigh

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from stranger_plant import draw_hidden, stranger_belief, stranger_session

RANGES = Ranges(0.5, 4.5, 50.0, 2000.0, 40.0, 1.0, 0.1, 8, 160.0)
STIFFNESS, POSITION = 6.0, 3.5


def machine(*terms: dict) -> Machine:
    motor = Motor(inertia_kgm2=0.1, viscous_friction_nms=0.0, peak_torque_nm=40.0)
    physics = tuple(PhysicsTerm.model_validate(term) for term in terms)
    return Machine(name="rigid", motor=motor, load=Load(inertia_kgm2=0.1), physics=physics)


def spring(**changes):
    return {"name": "end_spring", "stiffness_nm_rad": STIFFNESS, "position_rad": POSITION, **changes}


@pytest.fixture(scope="module")
def candidates():
    return vocabulary(RANGES, known(machine(), 0.5, 4.5))


@pytest.fixture(scope="module")
def ends(candidates):
    """High, low."""
    return [one for one in candidates if one.name == "end_spring"]


@pytest.mark.parametrize(("side", "place", "position"), [(1, 0, 3.5), (-1, 1, 1.5)])
def test_it_pushes_as_the_simulation_does(ends, side, place, position):
    angle = np.linspace(0.5, 4.5, 300)
    along = SimpleNamespace(load_angle=angle)
    shape, coefficients = (1.0,), np.array([STIFFNESS])  # 1 rad from the end, where it is 6 N·m
    found = ends[place].done(along, shape, coefficients).on_load[:, 0]
    np.testing.assert_allclose(
        found, -side * STIFFNESS * np.maximum(side * (angle - position), 0.0), atol=1e-12
    )
    told = ends[place].keys(coefficients, shape)
    assert told["position_rad"] == pytest.approx(position)
    assert told["stiffness_nm_rad"] == pytest.approx(STIFFNESS)
    assert told.get("side", 1) == side


def test_one_that_is_no_end_or_the_whole_stroke_is_at_its_bound(ends):
    pushing = np.array([1.0])
    for one in ends:
        assert one.at_end((4.0,), pushing)
        assert one.at_end((0.04,), pushing)
        assert not one.at_end((1.0,), pushing)
        assert not one.possible(-pushing)  # what pulls is no spring


def test_a_set_holds_the_curve_or_the_spring_and_gravity_beside_either(candidates, ends):
    laws = {(one.name, len(one.scales) > 1): one for one in candidates if one.named}
    for one in ends:
        assert one.excludes(laws["load_torque", True])
        assert one.excludes(laws["direction_dependent_load", True])
        assert not one.excludes(laws["load_torque", False])
        assert not one.excludes(laws["friction_over_angle", True])


def test_what_is_known_of_it_is_no_longer_missed():
    angle = np.linspace(0.5, 4.5, 50)
    nothing = np.zeros(50)
    along = SimpleNamespace(
        angle=angle, load_angle=angle, speed=nothing, load_speed=nothing, time_s=nothing, motion_time_s=nothing,
        share=0.0, number=0, ranges=RANGES, run=SimpleNamespace(drive=SimpleNamespace(whole_nm=nothing)),
        reported_rate=nothing, direction=nothing, wound=nothing,
    )  # fmt: skip
    found = known(machine(spring()), 0.5, 4.5).effect(along).on_load[:, 0]
    np.testing.assert_allclose(found, -STIFFNESS * np.maximum(angle - POSITION, 0.0), atol=1e-12)


@pytest.mark.parametrize(
    ("new", "terms"),
    [
        ({}, [{"stiffness_nm_rad": 8.0, "position_rad": POSITION}]),
        ({"side": -1.0}, [{"stiffness_nm_rad": STIFFNESS}, {"stiffness_nm_rad": 2.0, "side": -1.0}]),
        ({"position_rad": 3.0}, [{"stiffness_nm_rad": STIFFNESS}, {"coordinate": "load_position"}]),
    ],
)
def test_one_beside_a_known_one(new, terms):
    curve = {"coordinate": "load_position", "table": [[0.0, 0.0, 0.0], [1.0, -1.0, -1.0]]}
    found = {"stiffness_nm_rad": 2.0, "position_rad": POSITION, **new}
    whole = learned(machine(spring()), [Found("end_spring", True, found, {}, lambda: curve)])
    assert len(whole.physics) == len(terms)
    for term, wanted in zip(whole.physics, terms, strict=True):
        assert {key: term.parameters[key] for key in wanted} == wanted


def mirrored(session):
    """The same machine from behind: what was the high end is the low one."""
    runs = [
        replace(
            run, position_rad=-run.position_rad, speed_rad_s=-run.speed_rad_s, torque_nm=-run.torque_nm,
            torque_added_nm=-run.torque_added_nm,
            motion=run.motion.model_copy(update={"distance_rad": -run.motion.distance_rad}),
            excitation=run.excitation
            and run.excitation.model_copy(update={"phase_rad": run.excitation.phase_rad + np.pi}),
        )
        for run in session.runs
    ]  # fmt: skip
    return replace(session, runs=tuple(runs))


def recorded(stranger, seed):
    """At two motion times, and the machine as it is believed, with the true inertia."""
    runs = []
    for number, longer in enumerate((1.0, 1.6)):
        one = stranger_session(replace(stranger, duration_s=longer * stranger.duration_s), seed + number)
        runs += [replace(run, name=f"{run.name}, {number}") for run in one.runs]
    belief = stranger_belief(stranger)
    load = belief.load.model_copy(update={"inertia_kgm2": stranger.mean_kgm2})
    return replace(one, runs=tuple(runs)), belief.model_copy(update={"load": load})


@pytest.fixture(scope="module")
def stranger():
    """The first with a spring whose inertia is the same everywhere."""
    every = (draw_hidden(seed) for seed in range(7, 200, 8))
    found = next(one for one in every if one.family == "constant" and one.every >= 4)
    assert found.cause == "end spring"
    return found


@pytest.mark.long
def test_a_strangers_spring_is_named_written_and_found_no_more(stranger):
    session, belief = recorded(stranger, 391)
    found = publish(session, belief)
    (name,) = [one for one in found.names if one.probability > 0.5]
    assert name.physics == "end_spring"
    assert not [one for one in found.curves if one.probability > 0.5]
    (term,) = found.machine.physics
    assert term.name == "end_spring"
    assert term.parameters["stiffness_nm_rad"] == pytest.approx(stranger.shaft.spring, rel=0.02)
    assert term.parameters["position_rad"] == pytest.approx(
        0.75 * stranger.stroke_rad, abs=0.01 * stranger.stroke_rad
    )
    assert "side" not in term.parameters
    assert found.proof is not None
    assert found.proof.before > 3
    assert found.proof.after < 1.1
    again = weigh(*recorded(stranger, 777)[:1], found.machine)
    assert again.probability("end_spring") < 0.5
    assert again.probability("load_torque") < 0.5


@pytest.mark.long
def test_the_same_from_behind_is_a_spring_at_the_low_end(stranger):
    session, belief = recorded(stranger, 391)
    found = weigh(mirrored(session), belief)
    (name,) = [one for one in found.names if one.probability > 0.5]
    assert name.name == "end_spring"
    value = {key: one.value for key, one in name.parameters.items()}
    assert value["side"] == -1
    assert value["stiffness_nm_rad"] == pytest.approx(stranger.shaft.spring, rel=0.02)
    assert value["position_rad"] == pytest.approx(-0.75 * stranger.stroke_rad, abs=0.01 * stranger.stroke_rad)
    place = name.parameters["position_rad"]
    assert 0 < place.high - place.low < 0.05 * stranger.stroke_rad


@pytest.mark.long
def test_a_strangers_weight_is_no_spring():
    every = (draw_hidden(seed) for seed in range(3, 200, 8))
    weighty = next(one for one in every if one.family == "constant" and one.every >= 4)
    assert weighty.cause == "weight"
    found = weigh(*recorded(weighty, 391))
    assert [one.name for one in found.names if one.probability > 0.5] == ["load_torque"]
