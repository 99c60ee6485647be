"""What candidates may be beside each other, and below what no coefficient may go."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from strangers import STRANGERS, belief_of

from schwung.drivetrain import Load, Machine, Motor
from schwung.drivetrain.hysteresis import yielded
from schwung.drivetrain.inertia import InertiaTable, slider_crank_inertia
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.candidate import RIGHT_TO
from schwung.explain.causes.known import known
from schwung.explain.causes.vocabulary import vocabulary

RANGES = Ranges(0.0, 4.0, 50.0, 2000.0, 40.0, 1.0, 0.1, 8, 160.0)


@pytest.fixture(scope="module")
def candidates():
    terms = (
        PhysicsTerm(name="coulomb_friction", torque_nm=0.8),
        PhysicsTerm(name="viscous_friction", coefficient_nms=0.01),
    )
    machine = belief_of(STRANGERS[0]).model_copy(update={"physics": terms})
    found = vocabulary(RANGES, known(machine, 0.0, 4.0))
    plain = {
        c.name: c for c in reversed(found) if c.name in ("viscous_friction", "quadratic_drag", "load_inertia")
    }
    return {c.name: c for c in found} | plain


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("coupling_stiffness", -9000.0),
        ("coupling_damping", -1.9),
        ("load_inertia", -2.2e-2),
        ("coulomb_friction", -0.8),
        ("viscous_friction", -0.017),
        ("quadratic_drag", 0.0),
        ("backlash", 0.0),
    ],
)
def test_no_total_is_negative(candidates, name, least):
    which, bound = candidates[name].bounds_below[0]
    assert which == 0
    assert bound == pytest.approx(least)


@pytest.mark.parametrize(
    ("one", "other", "apart"),
    [
        ("speed", "stribeck_friction", True),
        ("position", "friction_over_angle", True),
        ("coulomb_friction", "stribeck_friction", True),
        ("speed", "friction_over_angle", False),
        ("coulomb_friction", "viscous_friction", False),
        ("asymmetric_friction", "torque_offset", True),
        ("asymmetric_friction", "coulomb_friction", True),
    ],
)
def test_a_set_holds_a_curve_or_its_cases(candidates, one, other, apart):
    assert candidates[one].excludes(candidates[other]) is apart
    assert candidates[other].excludes(candidates[one]) is apart


def test_all_that_a_curve_does_is_what_its_coefficients_do_together(candidates):
    """Curves are folded before they are laid along a run; the columns say the same."""
    chance, time = np.random.default_rng(5), np.linspace(0.0, 1.0, 400)
    angle, speed = 2 - 2 * np.cos(2 * np.pi * time), 40 * np.sin(2 * np.pi * time)
    along = SimpleNamespace(
        angle=angle, load_angle=angle + 0.01, speed=speed, load_speed=speed + 1, direction=np.tanh(speed),
        load_direction=np.tanh(speed + 1), torque=30 * np.cos(2 * np.pi * time), motion_time_s=time,
        load_acceleration=1500 * np.cos(2 * np.pi * time), number=3, time_s=time,
        load_torque_slopes=np.stack([speed, angle], 1), push_slopes=np.stack([angle, speed], 1),
        wound=2e-3 * np.cos(2 * np.pi * time),
    )  # fmt: skip
    folded = [one for one in candidates.values() if one.whole is not None]
    assert len(folded) >= 12
    for one in folded:
        coefficients, shape = chance.standard_normal(one.size), () if one.sought is None else (30.0,)
        together = one.done(along, shape, coefficients).parts
        columns = one.effect(along, shape)
        if columns.position is not None:  # what the load is elsewhere, its states know once they are there
            columns = replace(columns, on_motor=None, on_load=None)
        for part, each in zip(together, columns.parts, strict=True):
            assert (part is None) == (each is None)
            if part is not None:
                np.testing.assert_allclose(part[:, 0], each @ coefficients, atol=1e-11)


def test_what_a_table_misses_between_its_points_is_present_in_every_set():
    """A crank's inertia at 16 points a turn: PCHIP is flat at the top of its highest point, which need not be one."""
    at, angle = np.linspace(-1.0, 5.0, 17), np.linspace(0.0, 4.0, 400)
    table, step = InertiaTable(at, slider_crank_inertia(at)), 1e-4
    load = Load(inertia_table=table)
    machine = belief_of(STRANGERS[0]).model_copy(update={"load": load})
    usual = next(c for c in vocabulary(RANGES, known(machine, 0.0, 4.0)) if c.name == "usual_table")
    along = SimpleNamespace(
        load_angle=angle, load_speed=40 * np.sin(angle), load_acceleration=900 * np.cos(angle)
    )

    def off(where):
        return slider_crank_inertia(where) - table.at(where)

    slope = (off(angle + step) - off(angle - step)) / (2 * step)
    missed = -(off(angle) * along.load_acceleration + slope * along.load_speed**2 / 2)
    found = usual.effect(along, ()).on_load[:, 0]
    assert np.std(missed - found) < 0.35 * np.std(missed)


def test_no_set_can_be_made_of_the_equation_of_motion_itself() -> None:
    """c T = c (J α + friction): scales of torque and acceleration and a friction take nothing together."""
    motor = Motor(inertia_kgm2=0.1, viscous_friction_nms=0.0, peak_torque_nm=40.0)
    machine = Machine(name="rigid", motor=motor, load=Load(inertia_kgm2=0.1))
    every = {one.name: one for one in vocabulary(RANGES, known(machine, RANGES.low_rad, RANGES.high_rad))}
    curve = every["acceleration"]
    for other in ("torque", "position, torque", "torque, time_in_motion", "torque_constant", "torque_ripple"):
        assert curve.excludes(every[other])
    assert not curve.excludes(every["speed"])
    assert not every["torque_constant"].excludes(every["load_inertia"])  # both may be believed wrong


def test_a_torque_is_late_or_early_and_not_both() -> None:
    """A lag of 14 N·m and a filter of 14 N·m took each other's place beside dry friction of 4."""
    machine = belief_of(STRANGERS[0])
    every = {one.name: one for one in vocabulary(RANGES, known(machine, RANGES.low_rad, RANGES.high_rad))}
    assert every["torque_lag"].excludes(every["torque_filter"])
    assert not every["torque_lag"].excludes(every["measurement_delay"])


def test_friction_that_differs_by_direction_is_an_offset_and_a_dry_friction_also_at_rest(candidates) -> None:
    """One name for the two: were it another torque where the shaft rests, rest would tell between the same."""
    along = SimpleNamespace(direction=np.array([-1.0, -0.4, 0.0, 0.7, 1.0]))
    ahead, back = 1.9, 0.5
    found = candidates["asymmetric_friction"].effect(along, ()).parts[0] @ [ahead, back]
    np.testing.assert_allclose(found, (back - ahead) / 2 - (ahead + back) / 2 * along.direction)


def test_a_signal_that_is_early_is_not_late(candidates) -> None:
    """Truncated, its prior alone does not keep a coefficient from where it cannot be: a sound machine's speed was
    late by −0.25 ms."""
    assert candidates["measurement_delay"].possible(np.array([2.5e-4]))
    assert not candidates["measurement_delay"].possible(np.array([-2.5e-4]))
    assert not candidates["usual_filter"].possible(
        np.array([-2.5e-4])
    )  # a late torque was a late speed, which it took
    assert not candidates["coupling_damping"].possible(np.array([-2.0]))
    assert candidates["coupling_damping"].possible(np.array([-1.0]))


def test_what_only_accelerating_shows_is_known_as_such(candidates):
    shown = {"load_inertia", "inertia_profile", "torque_constant", "torque_lag", "torque_saturation",
             "measurement_delay", "coupling_stiffness", "coupling_damping", "backlash", "extra_compliance",
             "torque_ripple", "stiffness_over_angle"}  # fmt: skip
    steady = {"coulomb_friction", "viscous_friction", "stribeck_friction", "friction_over_angle", "load_torque",
              "torque_offset", "cogging", "periodic_disturbance", "usual_filter"}  # fmt: skip
    assert all(candidates[name].shown_by_accelerating for name in shown)
    assert not any(candidates[name].shown_by_accelerating for name in steady)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_dry_friction_falls_as_steeply_as_its_exponent_says(candidates, exponent):
    law = candidates["stribeck_friction"]
    speed = np.array([-6.0, -2.0, 0.5, 2.0, 6.0])
    along = SimpleNamespace(speed=speed, direction=np.sign(speed))
    done = law.done(along, (2.0, exponent), np.array([1.0, 3.0])).of(np.ones(1))[0]
    np.testing.assert_allclose(done, -np.sign(speed) * (1 + 3 * np.exp(-(np.abs(speed / 2) ** exponent))))
    assert {shape[1] for shape in law.shapes} == {1.0, 2.0}


def test_a_law_of_which_a_part_is_nothing_is_another(candidates):
    """Friction that falls by less than a law is right to is dry friction, as sure as one likes to be of it."""
    stribeck, shape = candidates["stribeck_friction"], (5.0, 2.0)
    assert stribeck.is_another(np.array([0.3, 1e-5]), shape)
    assert stribeck.at_end(shape, np.array([0.3, 1e-5]))
    assert not stribeck.is_another(np.array([0.3, 0.01]), shape)
    assert not stribeck.is_another(np.array([0.3, -0.01]), shape)  # that is none at all, and known as such
    assert not candidates["coulomb_friction"].is_another(np.array([1e-9]), ())


@pytest.mark.parametrize(
    ("times", "exponent", "ends"), [(0.9, 20.0, False), (3.0, 2.0, False), (3.0, 6.0, True)]
)
def test_what_hardly_yields_within_what_it_is_wound_up_is_a_stiffness(candidates, times, exponent, ends):
    hysteresis = candidates["coupling_hysteresis"]
    wound = hysteresis.shapes[-1][0] / 2
    held = np.asarray(yielded(np.linspace(0.0, wound, 4001), times * wound, exponent))
    off = 1 - held[-1] * times
    assert hysteresis.at_end((times * wound, exponent), np.array([1.0])) == ends == (off < RIGHT_TO)


def test_a_shift_that_changes_the_inertia_by_less_than_is_known_of_it_is_no_finding():
    """299411, a sound machine of 118 rad/s, had a shift of 50 µrad with 0.74: of its inertia that is 0.002 %."""
    at = np.linspace(-1.0, 5.0, 65)
    load = Load(inertia_table=InertiaTable(at, slider_crank_inertia(at, 0.05, 0.05)))
    machine = belief_of(STRANGERS[0]).model_copy(update={"load": load})
    every = {one.name: one for one in vocabulary(RANGES, known(machine, RANGES.low_rad, RANGES.high_rad))}
    known_to = every["inertia_profile_shift"].known_to
    angle = np.linspace(RANGES.low_rad, RANGES.high_rad, 400)
    inertia = machine.load_inertia_at(angle)
    changed = machine.load_inertia_at(angle + known_to) - inertia
    assert np.sqrt(np.mean(changed**2)) / np.mean(inertia) == pytest.approx(0.003, rel=0.2)
    surely = np.array([[1e-12]])
    assert every["inertia_profile_shift"].beyond(np.array([known_to / 50]), surely) < 1e-6
    assert every["inertia_profile_shift"].beyond(np.array([10 * known_to]), surely) > 0.99
