"""Rivals against what their authors promise, so that ours is held against the real thing."""

from __future__ import annotations

import numpy as np
import pytest
from optimise_machines import PAPER, rigid, task

from schwung.motion import Motion
from schwung.optimise.comparison import contender, contenders, model_for, optimise, shortest_profile
from schwung.optimise.dynamics import follow, follow_demand, merits_of, sampled
from schwung.optimise.rivals import chebyshev_stroke, shaped_demand, toppra_stroke
from schwung.optimise.solve import best_stroke


def test_zv_takes_the_vibration_that_it_is_shaped_for() -> None:
    """A constant load without damping: what is left after ZV and ZVD is a thousandth of the bare profile's."""
    load = PAPER.load.model_copy(
        update={"inertia_table": None, "inertia_kgm2": 0.1, "viscous_friction_nms": 0.0}
    )
    coupling = PAPER.coupling.model_copy(update={"damping_nms": 0.5}) if PAPER.coupling else None
    machine = PAPER.model_copy(update={"load": load, "coupling": coupling})
    model = model_for(machine, task(), 0.1)
    time = sampled(machine, 0.1)
    bare = follow(machine, Motion(kind="third", distance_rad=np.pi, duration_s=0.1), 0.0)
    residual = merits_of(machine, bare).residual_rad
    for shaper in ("zv", "zvd"):
        demand = shaped_demand(model, shaper, np.pi, 0.1, np.pi, time)  # a literal
        assert demand is not None
        assert demand.position_rad[-1] == pytest.approx(np.pi)
        merits = merits_of(machine, follow_demand(machine, demand, 0.1, 0.0))
        assert merits.residual_rad < 0.01 * residual
    assert shaped_demand(model, "zvd", np.pi, 0.01, np.pi, time) is None


def test_the_genetic_algorithm_finds_the_cubic_of_a_constant_inertia_where_it_may() -> None:
    """With rest of acceleration too, the least ∫T² is above the parabola's 12 and falls with more coefficients."""
    model = model_for(rigid(), task(0.2, distance_rad=1.0), 0.2)
    u = np.linspace(0, 1, 2001)
    costs = []
    for free in (2, 6):
        found = chebyshev_stroke(model, task(0.2, distance_rad=1.0), 0.2, free=free)
        share, speed, acceleration = found.shares(u)
        np.testing.assert_allclose(
            [share[0], share[-1] - 1, *speed[[0, -1]], *acceleration[[0, -1]]], 0, atol=1e-6
        )
        costs.append(float(np.trapezoid(acceleration**2, u)))
    assert 12 < costs[1] < costs[0] < 14.5


def test_toppra_is_bang_bang_on_one_mass() -> None:
    machine = rigid(peak_torque_nm=10.0)
    found = toppra_stroke(model_for(machine, task(None, distance_rad=1.0), 0.2), task(None, distance_rad=1.0))
    assert found.duration_s == pytest.approx(0.2, rel=2e-3)
    demand = found.demand(np.linspace(0, found.duration_s, 1000))
    assert demand.position_rad[-1] == pytest.approx(1.0)


def test_our_fastest_is_within_a_hundredth_of_toppra_on_a_stiff_plant() -> None:
    motor = PAPER.motor.model_copy(update={"viscous_friction_nms": 0.0})
    load = PAPER.load.model_copy(update={"viscous_friction_nms": 0.0})
    machine = PAPER.model_copy(update={"coupling": None, "motor": motor, "load": load})
    theirs = toppra_stroke(model_for(machine, task(None), 0.08), task(None)).duration_s
    assert best_stroke(machine, task(None)).duration_s < 1.01 * theirs


def test_ours_is_never_worse_and_rivals_break_what_they_do_not_know() -> None:
    found = optimise(PAPER, task())
    assert found.ours.broken == ()
    assert "torque" in found.reference.broken
    for rival in found.rivals:
        assert found.ours.merits.copper_n2m2s <= rival.merits.copper_n2m2s
    assert found.ours.merits.residual_rad < 0.1 * found.reference.merits.residual_rad
    fastest = [c for c in contenders(PAPER, task(None), 0.08) if c.name == "TOPP-RA"]
    assert fastest[0].broken == ("torque",)


@pytest.mark.long
def test_there_and_back_take_one_time_where_the_fastest_is_asked_for() -> None:
    found = optimise(PAPER, task(None), rivals=False)
    assert found.stroke.duration_s == pytest.approx(found.back.duration_s, rel=1e-9)
    motion = found.stroke.motion(found.back)
    end = motion.demand(np.array([motion.end_s])).position_rad[0]
    assert end == pytest.approx(0.0, abs=1e-7)


def test_the_shortest_standard_profile_keeps_the_limits_and_no_shorter_one_does() -> None:
    shortest = shortest_profile(PAPER, task(None), "scurve")
    for factor, keeps in ((1.0, True), (0.99, False)):
        motion = Motion(kind="scurve", distance_rad=np.pi, duration_s=factor * shortest)
        judged = contender(PAPER, task(None), "", follow(PAPER, motion, 0.0))
        assert (judged.broken == ()) is keeps
