"""The Cramér-Rao bound: it scales as theory says, and the trajectory fit comes near it."""

from dataclasses import replace

import numpy as np
import pytest
from estimation_plant import crank, noisy

from schwung.drivetrain import InertiaTable, Load
from schwung.errors import InputError
from schwung.estimation.bound import cramer_rao
from schwung.estimation.trajectory_fit import fit
from schwung.innovations.likelihood import Noise

GIVEN = Noise(torque_nm=0.1, speed_rad_s=0.02, position_rad=1e-5)


@pytest.fixture(scope="module")
def true_machine(machine):
    angle = np.linspace(-0.5, np.pi + 0.5, 400)
    load = Load(viscous_friction_nms=0.1, inertia_table=InertiaTable(angle, crank(angle)))
    return machine.model_copy(update={"load": load})


@pytest.fixture(scope="module")
def usual(bus_rate, true_machine):
    """The bound that the others are compared with."""
    return cramer_rao(bus_rate, true_machine, noise=GIVEN)


def test_the_bound_scales_with_the_noise(usual, bus_rate, true_machine):
    twice = cramer_rao(bus_rate, true_machine, noise=Noise(0.2, 0.04, 2e-5))
    np.testing.assert_allclose(twice.std_kgm2, 2 * usual.std_kgm2, rtol=0.03)


def test_twice_the_recordings_are_worth_the_square_root_of_two(usual, bus_rate, true_machine):
    twice = replace(bus_rate, runs=bus_rate.runs + bus_rate.runs)
    ratio = usual.rms_kgm2 / cramer_rao(twice, true_machine, noise=GIVEN).rms_kgm2
    assert ratio == pytest.approx(np.sqrt(2), rel=0.02)


def test_what_is_not_known_costs(usual, bus_rate, true_machine):
    """Known frictions, load and coupling can only help; finer detail can only cost."""
    assert np.all(
        cramer_rao(bus_rate, true_machine, noise=GIVEN, all_else_known=True).std_kgm2 < usual.std_kgm2
    )
    assert cramer_rao(bus_rate, true_machine, noise=GIVEN, pieces=32).rms_kgm2 > usual.rms_kgm2


def test_the_noise_is_found_where_it_is_not_given(bus_rate, true_machine):
    found = cramer_rao(bus_rate, true_machine).noise
    assert found.torque_nm == pytest.approx(0.1, rel=0.25)
    assert found.speed_rad_s == pytest.approx(0.02, rel=0.15)


def test_the_trajectory_fit_comes_within_one_and_a_half_times_the_bound(bus_rate, machine, true_machine):
    """Angle with 0.1 mrad of noise beside the usual, so that noise and not the sampling decides; rms of three."""
    squares, bounds = [], []
    for seed in range(3):
        rng = np.random.default_rng([7, seed])
        runs = tuple(
            replace(r, position_rad=r.position_rad + 1e-4 * rng.normal(size=len(r)))
            for r in (noisy(run, 10 + seed, 3.0) for run in bus_rate.runs)
        )
        session = replace(bus_rate, runs=runs)
        bound = cramer_rao(session, true_machine, all_else_known=False)
        inertia, _ = fit(runs, machine).inertia_at(bound.position_rad)
        squares.append(np.mean((inertia - crank(bound.position_rad)) ** 2))
        bounds.append(bound.rms_kgm2**2)
    assert np.sqrt(np.mean(squares)) < 1.5 * np.sqrt(np.mean(bounds))


def test_an_unknown_inertia_has_no_bound(bus_rate, machine):
    with pytest.raises(InputError, match=r"load\.inertia is not known"):
        cramer_rao(bus_rate, machine)
