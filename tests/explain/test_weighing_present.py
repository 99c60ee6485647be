"""The machine with what is present: no presence of a cause changes what the belief says beside it."""

from __future__ import annotations

import numpy as np
import pytest

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.explain.causes.along import Ranges
from schwung.explain.causes.candidate import Candidate
from schwung.explain.causes.inertia_at import inertia_of
from schwung.explain.causes.known import known
from schwung.explain.causes.present import LEAST_SHARE, Member, with_members
from schwung.explain.causes.vocabulary import vocabulary

#: Few points of a steep curve: PCHIP bends suddenly at each.
ANGLES = np.linspace(-0.4, 3.4, 24)
RANGES = Ranges(
    low_rad=0.0, high_rad=3.0, peak_speed_rad_s=30.0, peak_acceleration_rad_s2=900.0, peak_torque_nm=60.0,
    longest_s=1.0, sticking_rad_s=0.3, runs=4, band_hz=200.0,
)  # fmt: skip
WHERE = np.linspace(0.0, 3.0, 5001)


def machine(*physics: PhysicsTerm) -> Machine:
    return Machine(
        name="kinked",
        motor=Motor(inertia_kgm2=0.01, viscous_friction_nms=0.0, peak_torque_nm=100.0),
        coupling=Coupling(stiffness_nm_rad=9000.0, damping_nms=2.0),
        load=Load(inertia_table=InertiaTable(ANGLES, 0.06 + 0.04 * np.sin(2 * ANGLES) ** 2)),
        physics=physics,
    )


def candidate(name: str) -> Candidate:
    every = vocabulary(RANGES, known(machine(), RANGES.low_rad, RANGES.high_rad))
    return next(one for one in every if one.name == name)


@pytest.mark.parametrize("name", ["load_inertia", "inertia_profile", "inertia_profile_shift", "usual_table"])
def test_a_cause_of_no_size_leaves_inertia_and_slope_as_believed(name: str) -> None:
    believed = machine()
    one = candidate(name)
    none = Member(one, one.shapes[0], np.zeros(one.size), np.ones(one.size))
    for got, wanted in zip(
        inertia_of(with_members(believed, [none], RANGES), WHERE), inertia_of(believed, WHERE), strict=True
    ):
        np.testing.assert_allclose(got, wanted, rtol=1e-12)


def test_what_a_belief_has_learned_of_its_inertia_is_exact_between_points() -> None:
    delta = 0.003
    told = known(machine(PhysicsTerm(name="load_inertia", delta_kgm2=delta)), RANGES.low_rad, RANGES.high_rad)
    value, slope, _ = inertia_of(told.machine, WHERE)
    plain, steep, _ = inertia_of(machine(), WHERE)
    np.testing.assert_allclose(value, plain + delta, rtol=1e-12)
    np.testing.assert_allclose(slope, steep, rtol=1e-9, atol=1e-9)


def test_no_change_leaves_less_than_a_machine_needs() -> None:
    believed = machine()
    one = candidate("load_inertia")
    gone = Member(one, one.shapes[0], np.array([-1.0]), np.ones(1))
    left = with_members(believed, [gone], RANGES).load_inertia_at(WHERE)
    np.testing.assert_allclose(left, LEAST_SHARE * believed.load_inertia_at(WHERE))


@pytest.mark.parametrize(("change", "total"), [(1e11, 1e11 + 9000.0), (-1e11, LEAST_SHARE * 9000.0)])
def test_a_step_may_lead_to_a_coupling_that_no_machine_file_holds(change: float, total: float) -> None:
    one = candidate("coupling_stiffness")
    far = Member(one, one.shapes[0], np.array([change]), np.ones(1))
    coupling = with_members(machine(), [far], RANGES).coupling
    assert coupling is not None
    assert coupling.stiffness_nm_rad == pytest.approx(total)
