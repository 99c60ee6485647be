"""A measured table as a curve with its uncertainty."""

from __future__ import annotations

import numpy as np

from schwung.drivetrain import Coupling, InertiaTable, Load, Machine, Motor
from schwung.drivetrain.inertia import slider_crank_inertia
from schwung.explain.measured import BIAS, measured


def _machine(table: InertiaTable) -> Machine:
    return Machine(
        name="measured",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_table=table),
    )


def test_the_slope_of_scatter_is_gone_and_what_is_left_is_within_what_is_allowed() -> None:
    angle, chance = np.linspace(0.0, np.pi, 64), np.random.default_rng(3)
    truth = slider_crank_inertia(angle)
    table = InertiaTable(angle, truth + 0.001 * chance.standard_normal(64), np.full(64, 0.001))
    curve = measured(_machine(table))
    assert curve is not None
    smooth = curve.machine.load.inertia_table
    assert smooth is not None
    inside = np.linspace(0.2, np.pi - 0.2, 200)
    step = 1e-4
    slope = (slider_crank_inertia(inside + step) - slider_crank_inertia(inside - step)) / (2 * step)
    scattered, settled = (np.std(t.slope_at(inside) - slope) for t in (table, smooth))
    assert settled < 0.5 * scattered
    error = smooth.inertia_kgm2 - slider_crank_inertia(curve.angle_rad)
    allowed = np.sqrt(np.sum(curve.directions_kgm2**2, axis=0))
    assert 0.2 < np.sqrt(np.mean((error / allowed) ** 2)) < 1.5
    assert np.all(allowed > BIAS * 0.3 * truth.mean())


def test_a_table_by_geometry_is_taken_as_it_is() -> None:
    angle = np.linspace(0.0, np.pi, 64)
    assert measured(_machine(InertiaTable(angle, slider_crank_inertia(angle)))) is None


def test_one_direction_moves_the_belief_by_what_it_says() -> None:
    angle = np.linspace(0.0, np.pi, 64)
    curve = measured(_machine(InertiaTable(angle, slider_crank_inertia(angle), np.full(64, 1e-4))))
    assert curve is not None
    assert len(curve.directions_kgm2) == 18
    before, after = curve.machine.load.inertia_table, curve.moved(4).load.inertia_table
    assert before is not None
    assert after is not None
    assert np.allclose(after.inertia_kgm2 - before.inertia_kgm2, curve.directions_kgm2[4])
