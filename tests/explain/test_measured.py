"""A measured table as a curve."""

from __future__ import annotations

import numpy as np

from schwung.drivetrain import Coupling, InertiaTable, Load, Machine, Motor
from schwung.drivetrain.inertia import slider_crank_inertia
from schwung.explain.measured import smooth


def _machine(table: InertiaTable) -> Machine:
    return Machine(
        name="measured",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=233.0),
        coupling=Coupling(stiffness_nm_rad=24963.0, damping_nms=8.62),
        load=Load(viscous_friction_nms=0.1, inertia_table=table),
    )


def test_the_slope_of_scatter_is_gone() -> None:
    angle, chance = np.linspace(0.0, np.pi, 64), np.random.default_rng(3)
    truth = slider_crank_inertia(angle)
    table = InertiaTable(angle, truth + 0.001 * chance.standard_normal(64), np.full(64, 0.001))
    curve = smooth(_machine(table)).load.inertia_table
    assert curve is not None
    inside = np.linspace(0.2, np.pi - 0.2, 200)
    step = 1e-4
    slope = (slider_crank_inertia(inside + step) - slider_crank_inertia(inside - step)) / (2 * step)
    scattered, settled = (np.std(t.slope_at(inside) - slope) for t in (table, curve))
    assert settled < 0.5 * scattered
    error = curve.inertia_kgm2 - slider_crank_inertia(curve.position_rad)
    assert np.sqrt(np.mean(error**2)) < 0.5 * 0.001


def test_a_table_by_geometry_is_taken_as_it_is() -> None:
    angle = np.linspace(0.0, np.pi, 64)
    machine = _machine(InertiaTable(angle, slider_crank_inertia(angle)))
    assert smooth(machine) is machine
