"""The best stroke against closed forms, against a finer grid, and against its own limits by a second integrator."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from optimise_machines import COARSE, MEASURED, PAPER, rigid, task, with_physics

from schwung.drivetrain import Electrical, Machine
from schwung.errors import InputError
from schwung.motion import Motion
from schwung.optimise.closed_loop import followed_by_the_drive, require_followed
from schwung.optimise.collocation import DEGREE, radau
from schwung.optimise.dynamics import follow, merits_of
from schwung.optimise.front import front
from schwung.optimise.solve import NoMotionError, best_stroke
from schwung.optimise.values import Stroke


@cache
def best_of_the_paper(duration_s: float | None = 0.1) -> Stroke:
    """Of least copper, or the fastest: solved once, where several tests look at it."""
    return best_stroke(PAPER, task(duration_s))


def test_least_copper_of_one_mass_is_the_parabola_of_speed() -> None:
    """Euler-Lagrange: ∫α² is least where the acceleration falls on a straight line; ∫T² = 12 J² Δθ²/T³."""
    stroke = best_stroke(rigid(), task(0.2, distance_rad=1.0))
    u = stroke.time_s / 0.2
    np.testing.assert_allclose(stroke.share, 3 * u**2 - 2 * u**3, atol=1e-6)
    merits = merits_of(rigid(), follow(rigid(), stroke.motion(), 0.0))
    assert merits.copper_n2m2s == pytest.approx(12 * 0.1**2 / 0.2**3, rel=2e-3)


def test_least_peak_and_the_fastest_of_one_mass_are_bang_bang() -> None:
    """T = 4 J Δθ/τ²: the peak for a time, and the time for a peak. One interval turns the torque round."""
    least = best_stroke(rigid(), task(0.2, distance_rad=1.0, weights={"peak": 1.0}))
    assert np.max(np.abs(least.torque_nm)) == pytest.approx(4 * 0.1 / 0.2**2, rel=0.01)
    fastest = best_stroke(rigid(peak_torque_nm=10.0), task(None, distance_rad=1.0))
    assert fastest.duration_s == pytest.approx(0.2, rel=0.005)
    assert fastest.active["torque"] > 0.95


def test_varying_inertia_moves_the_motion_where_it_is_light() -> None:
    """Below the standard profiles in copper and in what is put in, though their constant-inertia optimum is near."""
    machine = PAPER.model_copy(update={"coupling": None})
    ours = merits_of(machine, follow(machine, best_stroke(machine, task(0.2)).motion(), 0.0))
    for kind in ("third", "poly5", "scurve", "cosine"):
        motion = Motion(kind=kind, distance_rad=np.pi, duration_s=0.2)  # a literal
        rival = merits_of(machine, follow(machine, motion, 0.0))
        assert ours.copper_n2m2s < 0.75 * rival.copper_n2m2s
        assert ours.mechanical_j < rival.mechanical_j


def test_it_is_within_one_per_cent_of_a_three_times_finer_grid() -> None:
    """Of fifth order: its errors are a hundredth there. benchmarks/optimise.py compares with a ten times finer one."""
    coarse = best_stroke(MEASURED, task())
    fine = best_stroke(MEASURED, task(), intervals=3 * (coarse.share.size - 1))
    figures = [merits_of(MEASURED, follow(MEASURED, s.motion(), 0.0)).copper_n2m2s for s in (coarse, fine)]
    assert figures[0] < 1.01 * figures[1]


def test_another_start_leads_to_the_same_motion() -> None:
    skew = best_stroke(PAPER, task(0.1, weights={"vibration": 1.0}), COARSE)
    again, usual = best_stroke(PAPER, task(), start=skew), best_of_the_paper()
    assert again.objective == pytest.approx(usual.objective, rel=1e-4)


@pytest.mark.parametrize(
    "limits",
    [
        {},
        {"speed_max_rad_s": 42.0},
        {"jerk_max_rad_s3": 1e6},
        {"position_min_rad": -1e-4, "position_max_rad": np.pi + 1e-4},
        {"torque_max_nm": 215.0},
    ],
)
def test_every_limit_is_kept_by_motor_and_load(limits: dict[str, float]) -> None:
    stroke = best_stroke(PAPER, task(limits=limits)) if limits else best_of_the_paper()
    made = follow(PAPER, stroke.motion(), 0.0)
    merits = merits_of(PAPER, made)
    assert merits.peak_torque_nm <= limits.get("torque_max_nm", 233.0)
    for speed in (made.speed_rad_s, made.load_speed_rad_s):
        assert np.max(np.abs(speed)) < 1.01 * limits.get("speed_max_rad_s", np.inf)
    for speed in (made.acceleration_rad_s2, np.gradient(made.load_speed_rad_s, made.time_s)):
        inside = made.time_s < made.duration_s - 1e-3
        jerk = np.diff(speed[inside]) / np.diff(made.time_s[inside])
        assert np.max(np.abs(jerk)) < 1.02 * limits.get("jerk_max_rad_s3", np.inf)
    for angle in (made.position_rad, made.load_position_rad):
        assert limits.get("position_min_rad", -np.inf) - 2e-4 < np.min(angle)
        assert np.max(angle) < limits.get("position_max_rad", np.inf) + 2e-4
    assert merits.residual_rad < 1e-5


@pytest.mark.long
def test_torque_over_speed_is_kept_where_the_motor_is_fast() -> None:
    curve = ((0.0, 233.0), (30.0, 233.0), (60.0, 33.0))
    motor = PAPER.motor.model_copy(update={"torque_over_speed": curve})
    machine = PAPER.model_copy(update={"motor": motor})
    free, held = best_of_the_paper(None), best_stroke(machine, task(None))
    made = follow(machine, held.motion(), 0.0)
    allowed = np.interp(np.abs(made.speed_rad_s), *np.array(curve).T)
    assert np.max(np.abs(made.torque_nm) - allowed) < 0.02 * 233
    assert held.duration_s > 1.05 * free.duration_s
    assert "torque over speed" in held.active


def test_a_load_that_hangs_is_held_at_both_ends() -> None:
    """Gravity: the torque at rest is the load's, the coupling is wound up by it, and nothing swings afterwards."""
    machine = with_physics(PAPER, load_torque={"amplitude_nm": 20.0, "phase_rad": 1.0})
    stroke = best_stroke(machine, task(0.15))
    made = follow(machine, stroke.motion(), 0.0)
    at_rest = -20.0 * np.sin(made.load_position_rad[-1] + 1.0)
    assert made.torque_nm[-1] == pytest.approx(at_rest, abs=0.01)
    assert merits_of(machine, made).residual_rad < 1e-5


def test_named_gravity_changes_the_best_motion_for_the_better() -> None:
    machine = with_physics(
        PAPER, load_torque={"amplitude_nm": 25.0, "phase_rad": 0.5}, coulomb_friction={"torque_nm": 6.0}
    )
    knowing, blind = (best_stroke(planned, task(0.25), COARSE) for planned in (machine, PAPER))
    figures = [merits_of(machine, follow(machine, s.motion(), 0.0)).copper_n2m2s for s in (knowing, blind)]
    assert figures[0] < 0.95 * figures[1]


def test_every_payload_keeps_the_torque_limit() -> None:
    stroke = best_stroke(PAPER, task(0.12, payloads_kgm2=(0.0, 0.04)))
    load = PAPER.load.model_copy(update={"inertia_table": None, "inertia_kgm2": None})
    table = PAPER.load.inertia_table
    assert table is not None
    heavier = type(table)(table.position_rad, table.inertia_kgm2 + 0.04)
    machine = PAPER.model_copy(update={"load": load.model_copy(update={"inertia_table": heavier})})
    assert merits_of(machine, follow(machine, stroke.motion(), 0.0)).peak_torque_nm < 1.02 * 233
    alone = best_stroke(PAPER, task(0.12))
    assert merits_of(machine, follow(machine, alone.motion(), 0.0)).peak_torque_nm > 1.05 * 233


def electrical(machine: Machine) -> Machine:
    motor = machine.motor.model_copy(
        update={"electrical": Electrical(resistance_ohm=0.4, torque_constant_nm_a=1.6, iron_loss_nms=0.02)}
    )
    return machine.model_copy(update={"motor": motor})


@cache
def of_least_copper() -> Stroke:
    return best_stroke(electrical(PAPER), task(0.2))


@pytest.mark.parametrize("regeneration", [True, False])
def test_drawn_energy_is_less_than_that_of_least_copper(regeneration: bool) -> None:
    machine = electrical(PAPER)

    def drawn(stroke: Stroke) -> float:
        merits = merits_of(machine, follow(machine, stroke.motion(), 0.0))
        found = merits.drawn_j if regeneration else merits.drawn_one_way_j
        assert found is not None
        return found

    frugal = best_stroke(machine, task(0.2, weights={"energy": 1.0}, regeneration=regeneration))
    assert drawn(frugal) < drawn(of_least_copper()) * 0.999


@pytest.mark.long
def test_too_short_a_time_names_the_limit_and_a_time_that_does() -> None:
    with pytest.raises(NoMotionError, match=r"torque.*--max-torque.*takes (\d+\.?\d*) ms") as told:
        best_stroke(PAPER, task(0.05), COARSE)
    shortest = float(str(told.value).split("takes ")[1].split(" ms")[0]) * 1e-3
    assert best_stroke(PAPER, task(1.001 * shortest)).duration_s > shortest
    # one mass, at 100 rad/s² to 3.4 rad/s: 1/3.4 + 3.4/100 s
    slow = task(0.3, distance_rad=1.0, limits={"speed_max_rad_s": 3.4})
    with pytest.raises(NoMotionError, match=r"speed.*takes (\d+\.?\d*) ms") as told:
        best_stroke(rigid(peak_torque_nm=10.0), slow)
    shortest = float(str(told.value).split("takes ")[1].split(" ms")[0])
    assert shortest == pytest.approx(328.1, rel=0.005)


def test_what_may_not_be_built_upon_is_refused() -> None:
    unusable = PAPER.load.model_copy(update={"trust": "unusable"})
    with pytest.raises(InputError, match="unusable"):
        best_stroke(PAPER.model_copy(update={"load": unusable}), task())
    with pytest.raises(InputError, match=r"covers 0 … 3\.142 rad, the stroke goes from 0 to 4 rad"):
        best_stroke(MEASURED, task(distance_rad=4.0))
    with pytest.raises(InputError, match=r"motor\.electrical.*is missing"):
        best_stroke(PAPER, task(weights={"energy": 1.0}))
    with pytest.raises(InputError, match="window"):
        task(limits={"position_max_rad": 1.0})


def test_radau_integrates_exactly_to_its_order() -> None:
    points, derivative, weights = radau()
    for power in range(2 * DEGREE - 1):
        assert weights @ points**power == pytest.approx(1 / (power + 1))
    nodes = np.concatenate([[0.0], points])
    np.testing.assert_allclose(nodes**3 @ derivative, 3 * points**2, atol=1e-12)


@pytest.mark.long
def test_a_front_trades_one_merit_for_another() -> None:
    over_time = front(PAPER, task(None), points=3)
    copper = [point.merits.copper_n2m2s for point in over_time]
    assert copper == sorted(copper, reverse=True)
    assert over_time[-1].duration_s == pytest.approx(3 * over_time[0].duration_s)
    between = front(PAPER, task(0.15, weights={"copper": 1.0, "peak": 1.0}), points=3)
    peaks = [point.merits.peak_torque_nm for point in between]
    assert peaks == sorted(peaks, reverse=True)
    assert [p.merits.copper_n2m2s for p in between] == sorted(p.merits.copper_n2m2s for p in between)
    with pytest.raises(InputError, match="two in --objective"):
        front(PAPER, task())


def test_a_following_error_that_is_too_large_is_refused() -> None:
    """The closed loop with the torque beside is off by far less than without, and by more than nothing."""
    stroke = best_stroke(PAPER, task(0.15))
    worst = followed_by_the_drive(PAPER, stroke).peak_following_error_rad
    assert 1e-5 < worst < 0.005
    require_followed(PAPER, task(0.15, limits={"following_error_rad": 1.1 * worst}), stroke)
    with pytest.raises(InputError, match="--following-error: is"):
        require_followed(PAPER, task(0.15, limits={"following_error_rad": 0.9 * worst}), stroke)


def test_strong_dry_friction_over_a_long_stroke_is_found_by_rounder_ones() -> None:
    """Where friction takes more than accelerating does; the parabola is then no longer the best, and is beaten."""
    machine = with_physics(rigid(0.1, 20.0), coulomb_friction={"torque_nm": 4.0})
    stroke = best_stroke(machine, task(2.0, distance_rad=1.0, limits={"torque_max_nm": 20.0}), COARSE)
    best = merits_of(machine, follow(machine, stroke.motion(), 0.0)).copper_n2m2s
    parabola = merits_of(
        machine, follow(machine, best_stroke(rigid(), task(2.0, distance_rad=1.0)).motion(), 0.0)
    )
    assert best < parabola.copper_n2m2s
    assert stroke.share[-1] == pytest.approx(1.0)


def test_a_coupling_that_swings_too_fast_for_any_grid_is_planned_as_stiff() -> None:
    assert PAPER.coupling is not None
    coupling = PAPER.coupling.model_copy(update={"stiffness_nm_rad": 1e8, "damping_nms": 50.0})
    stiff = PAPER.model_copy(update={"coupling": coupling})
    stroke = best_stroke(stiff, task(0.2))
    np.testing.assert_array_equal(stroke.load_position_rad, stroke.start_rad + np.pi * stroke.share)
    merits = merits_of(stiff, follow(stiff, stroke.motion(), 0.0))
    assert merits.copper_n2m2s == pytest.approx(
        np.trapezoid(stroke.torque_nm**2, stroke.time_s),
        rel=0.02,  # the rest swings out of the last step
    )
