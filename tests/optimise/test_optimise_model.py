"""The optimiser's equations against the simulation's: another set of terms for the same physics."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from optimise_machines import COARSE, PAPER, rigid, task, with_physics

from schwung.drivetrain import physics
from schwung.drivetrain.effects import effects_of
from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.errors import InputError
from schwung.optimise.dynamics import follow
from schwung.optimise.model import Model, models_of, not_planned
from schwung.optimise.series import series_of
from schwung.optimise.solve import best_stroke

TERMS = {
    "stribeck_friction": {"coulomb_torque_nm": 3.0, "breakaway_torque_nm": 5.0, "stribeck_speed_rad_s": 2.0},
    "viscous_friction": {"coefficient_nms": 0.3},
    "quadratic_drag": {"coefficient_nms2": 0.01},
    "cogging": {"order": 12.0, "amplitude_nm": 1.5, "phase_rad": 0.4},
    "torque_offset": {"torque_nm": 0.8},
    "local_friction": {"torque_nm": 4.0, "centre_rad": 1.0, "width_rad": 0.6},
}
LEARNED = with_physics(PAPER, **TERMS)  # keyword names are data


def model_of(machine: object = LEARNED) -> Model:
    return models_of(machine, (0.0, np.pi), 30.0, 233.0)[0]  # type: ignore[arg-type]


@settings(deadline=None)  # the first call compiles
@given(st.floats(0.0, np.pi), st.floats(1.5, 60.0), st.sampled_from([1.0, -1.0]))
def test_friction_is_the_simulations_away_from_standstill(angle: float, speed: float, sign: float) -> None:
    model, e = model_of(), effects_of(LEARNED.physics)
    theirs = 0.2 * sign * speed - physics.motor_torque(e, angle, sign * speed, 0.0, 0.0, 1.0, 0.02)
    # the tight spot's ends are rounded within a hundredth of its width
    assert model.motor_needs(angle, sign * speed) == pytest.approx(theirs, abs=0.05)


def test_numbers_and_symbols_are_one_expression() -> None:
    model, angle, speed = model_of(), ca.SX.sym("angle"), ca.SX.sym("speed")
    for function in (model.motor_needs, model.load_needs):
        symbolic = ca.Function("f", [angle, speed], [function(angle, speed)])
        assert float(symbolic(1.1, -20.0)) == pytest.approx(float(function(1.1, -20.0)), rel=1e-12)


def test_the_two_integrators_agree_on_torque_and_load() -> None:
    machine = with_physics(
        PAPER,
        load_torque={"amplitude_nm": 15.0, "phase_rad": 0.3},
        coulomb_friction={"torque_nm": 2.0},
        nonlinear_stiffness={"cubic_nm_rad3": 1e7},
    )
    stroke = best_stroke(machine, task(0.12))
    made = follow(machine, stroke.motion(), 0.0)
    inside = slice(5, -5)  # at standstill dry friction is rounded differently
    at_nodes = np.interp(stroke.time_s[inside], made.time_s, made.torque_nm)
    assert np.max(np.abs(at_nodes - stroke.torque_nm[inside])) < 0.01 * 233
    load = np.interp(stroke.time_s, made.time_s, made.load_position_rad)
    np.testing.assert_allclose(load, stroke.load_position_rad, atol=3e-5)


def test_a_series_follows_a_table_but_not_its_noise() -> None:
    angle = np.linspace(0, 3, 61)
    smooth = 0.1 + 0.05 * np.cos(angle)
    noisy = InertiaTable(angle, smooth + 2e-4 * np.random.default_rng(3).standard_normal(61))
    exact = series_of(lambda x: 0.1 + 0.05 * np.cos(x), 0.0, 3.0)
    assert exact.misfit < 1e-4 * 0.15
    np.testing.assert_allclose(
        exact.slope().at(angle), -0.05 * np.sin(angle), atol=2e-4
    )  # n² times the misfit at the ends
    calm = series_of(noisy.at, 0.0, 3.0, uncertainty=2e-4)
    assert calm.coefficients.size < series_of(noisy.at, 0.0, 3.0).coefficients.size
    assert np.max(np.abs(calm.slope().at(angle) + 0.05 * np.sin(angle))) < 0.003


def test_what_is_not_planned_with_is_named() -> None:
    machine = with_physics(PAPER, backlash={"gap_rad": 1e-4}, coulomb_friction={"torque_nm": 1.0})
    assert not_planned(machine) == ("backlash",)
    like = PhysicsTerm.model_validate(
        {"name": "residual", "like": "viscous_friction", "coefficient_nms": 0.1}
    )
    timed = PhysicsTerm.model_validate(
        {"name": "residual", "coordinate": "time_in_motion", "table": [[0.0, 0.0], [0.1, -2.5]]}
    )
    known = PAPER.model_copy(update={"physics": (like, timed)})
    assert not_planned(known) == ("residual over time in motion (up to 2.5 N·m)",)


def test_learned_curves_are_planned_with() -> None:
    """Against the integrator of the simulation, which has the curves as tables."""
    x, fast = np.linspace(-0.5, 4.0, 46), np.linspace(0.0, 60.0, 31)
    terms = (
        {"name": "residual", "coordinate": "speed",
         "table": np.stack([fast, -1.5 * np.sqrt(fast + 1), 2 * np.sqrt(fast + 1)], 1).tolist()},
        {"name": "friction_over_angle", "table": np.stack([x, 6 + 4 * np.cos(2 * x)], 1).tolist()},
        {"name": "direction_dependent_load",
         "table": np.stack([x, 5 * np.sin(x), -7 * np.cos(x)], 1).tolist()},
        {"name": "load_side_friction", "torque_nm": 4.0},
        {"name": "viscous_drift", "change_nms": 0.2},
        {"name": "viscous_friction", "load_coefficient_nms": 0.1},
        {"name": "quadratic_drag", "load_coefficient_nms2": 0.01},
        {"name": "end_spring", "stiffness_nm_rad": 15.0, "position_rad": 1.4},
    )  # fmt: skip
    machine = PAPER.model_copy(update={"physics": tuple(PhysicsTerm.model_validate(one) for one in terms)})
    assert not_planned(machine) == ()
    stroke = best_stroke(machine, task(0.2), COARSE)
    made = follow(machine, stroke.motion(), stroke.start_rad)
    inside = slice(5, -5)  # at standstill dry friction is rounded differently
    at_nodes = np.interp(stroke.time_s[inside], made.time_s, made.torque_nm)
    plain = best_stroke(PAPER, task(0.2), COARSE)
    assert np.max(np.abs(plain.torque_nm - stroke.torque_nm)) > 5.0
    assert np.max(np.abs(at_nodes - stroke.torque_nm[inside])) < 0.01 * 233


def test_a_band_needs_deviations_and_bears_on_the_limits() -> None:
    with pytest.raises(InputError, match="std_kgm2"):
        best_stroke(PAPER, task(band_sigmas=2.0))
    table = PAPER.load.inertia_table
    assert table is not None
    banded = InertiaTable(table.position_rad, table.inertia_kgm2, 0.003 * table.inertia_kgm2)
    load = PAPER.load.model_copy(update={"inertia_table": banded})
    machine = PAPER.model_copy(update={"load": load, "coupling": None})
    slow = best_stroke(machine, task(None, band_sigmas=20.0)).duration_s
    assert slow > 1.01 * best_stroke(machine, task(None)).duration_s


def test_a_rigid_machine_is_planned_without_a_load_state() -> None:
    machine = rigid()
    stroke = best_stroke(machine, task(0.2, distance_rad=1.0))
    np.testing.assert_array_equal(stroke.load_position_rad, stroke.start_rad + stroke.share)
