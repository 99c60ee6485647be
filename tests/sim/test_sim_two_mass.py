"""The two-mass machine: facts of mechanics that hold whatever the integrator."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from schwung_sim.drives.axis import ServoAxis
from schwung_sim.errors import BenchError
from schwung_sim.plants import TICK_S, Profile, TwoMassMachine, TwoMassPlant, make_plant
from schwung_sim.plants.profile import PROFILES, four_bar, slider_crank

FREE = TwoMassMachine(rotor_viscous_nms=0.0, damping_nms=0.0, load_viscous_nms=0.0)
LOADS = {
    "slider-crank": PROFILES["slider-crank"](),
    "four-bar": PROFILES["four-bar"](),
    "constant": Profile.constant(0.1),
    "table": Profile.of_pairs(np.linspace(-30, 30, 80), 0.1 + 0.03 * np.sin(np.linspace(-30, 30, 80))),
}


def energy(plant: TwoMassPlant) -> float:
    """Kinetic energy and what the coupling holds (J)."""
    s = plant.state[0]
    p = plant.parameters[0]
    inertia = float(plant.true_inertia(np.array([s["load_rad"]]))[0])
    kinetic = p["rotor_inertia_kgm2"] * s["motor_rad_s"] ** 2 + inertia * s["load_rad_s"] ** 2
    return float(kinetic + p["stiffness_nm_rad"] * (s["motor_rad"] - s["load_rad"]) ** 2) / 2


@pytest.mark.parametrize("name", LOADS)
def test_energy_is_kept_without_friction_whatever_the_inertia_does(name: str) -> None:
    plant = TwoMassPlant(FREE, LOADS[name])
    plant.state["motor_rad_s"] = plant.state["load_rad_s"] = 20.0
    before = energy(plant)
    lowest = highest = 20.0
    for _ in range(8000):
        plant.step(0.0)
        lowest = min(lowest, plant.state["load_rad_s"][0])
        highest = max(highest, plant.state["load_rad_s"][0])
    assert energy(plant) == pytest.approx(before, rel=1e-5)
    if name != "constant":
        assert highest - lowest > 1.0  # the varying inertia did trade speed for inertia


def test_work_of_the_motor_becomes_energy() -> None:
    plant = TwoMassPlant(FREE)
    work = 0.0
    for _ in range(1600):
        angle = plant.motor_rad
        plant.step(25.0)
        work += 25.0 * (plant.motor_rad - angle)
    assert energy(plant) == pytest.approx(work, rel=1e-5)


def test_free_oscillation_has_the_two_mass_resonance() -> None:
    inertia = 0.11
    plant = TwoMassPlant(FREE, Profile.constant(inertia))
    plant.state["motor_rad_s"], plant.state["load_rad_s"] = 1.0, -0.012 / inertia
    twist = []
    for _ in range(8000):
        plant.step(0.0)
        twist.append(plant.state["motor_rad"][0] - plant.state["load_rad"][0])
    values = np.array(twist)
    rising = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    instants = rising - values[rising] / (values[rising + 1] - values[rising])
    measured = (len(instants) - 1) / ((instants[-1] - instants[0]) * TICK_S)
    expected = np.sqrt(24963.0 * (1 / 0.012 + 1 / inertia)) / (2 * np.pi)
    assert measured == pytest.approx(expected, rel=1e-4)


def test_frequency_response_is_equation_3() -> None:
    """Torque to motor speed at 50 Hz against the closed form with friction (method.md)."""
    inertia, frequency = 0.11, 50.0
    plant = TwoMassPlant(inertia=Profile.constant(inertia))
    n = 6400
    time = np.arange(n) * TICK_S
    torque = 20 * np.cos(2 * np.pi * frequency * (time + TICK_S / 2))  # held: its middle counts
    speed = np.empty(n)
    for i in range(n):
        plant.step(torque[i])
        speed[i] = plant.state["motor_rad_s"][0]
    last = slice(n - 1600, n)  # ten periods
    angle = 2 * np.pi * frequency * (time[last] + TICK_S)
    terms = np.stack([np.cos(angle), np.sin(angle), np.ones(1600), time[last], time[last] ** 2], axis=1)
    cosine, sine, *_ = np.linalg.lstsq(terms, speed[last], rcond=None)[0]
    measured = (cosine - 1j * sine) / 20
    s = 2j * np.pi * frequency
    through = 1 / (1 / (inertia * s + 0.1) + 1 / (8.62 + 24963.0 / s))
    assert measured == pytest.approx(1 / (0.012 * s + 0.2 + through), rel=3e-3)


def test_defaults_are_table_1_with_the_inferred_inertia() -> None:
    angle = np.linspace(0, np.pi, 181)
    inertia = make_plant("two-mass").true_inertia(angle)
    sine, cosine = np.sin(angle), np.cos(angle)
    lever = sine + 0.25 * sine * cosine / np.sqrt(1 - 0.0625 * sine**2)
    np.testing.assert_allclose(inertia, 0.055 + 0.105 * lever**2, rtol=1e-9)
    resonance = np.sqrt(24963.0 / np.array([inertia.max(), inertia.min()])) / 2 / np.pi
    assert resonance == pytest.approx([62, 107], abs=1)


@pytest.mark.parametrize("function", [slider_crank, four_bar])
def test_profile_and_its_slope_fit_together(function: object) -> None:
    assert callable(function)
    profile = Profile.of_turn(function)
    angle = np.linspace(-10, 10, 1237)
    np.testing.assert_allclose(profile.at(angle), function(angle), rtol=1e-9)
    h = 1e-6
    slope = (profile.at(angle + h) - profile.at(angle - h)) / (2 * h)
    np.testing.assert_allclose(profile.slope_at(angle), slope, atol=1e-7)


def test_four_bar_inertia_is_the_square_of_the_rockers_speed_ratio() -> None:
    def rocker(theta: float) -> float:
        """Angle of the rocker by bisection of the coupler's length: links 1, 3, 2.5, ground 3.5."""
        low, high = 0.5, np.pi
        pin = np.array([np.cos(theta), np.sin(theta)])

        def excess(psi: float) -> float:
            end = np.array([3.5 + 2.5 * np.cos(psi), 2.5 * np.sin(psi)])
            return float(np.hypot(*(end - pin)) - 3.0)

        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if excess(middle) > 0 else (low, middle)
        return low

    for theta in (0.3, 1.0, 2.0, 3.5, 5.0):
        ratio = (rocker(theta + 1e-4) - rocker(theta - 1e-4)) / 2e-4
        assert four_bar(np.array([theta]))[0] == pytest.approx(0.06 + 0.16 * ratio**2, rel=1e-5)


def test_table_goes_through_its_points_and_is_constant_outside() -> None:
    profile = Profile.of_pairs(np.array([0.0, 1.0, 3.0]), np.array([0.05, 0.15, 0.1]))
    angle = np.array([-5.0, 0.0, 1.0, 3.0, 9.0])
    np.testing.assert_allclose(profile.at(angle), [0.05, 0.05, 0.15, 0.1, 0.1], atol=2e-6)
    assert np.all(profile.slope_at(angle[[0, -1]]) == 0)


@pytest.mark.parametrize("angles", [[0.0], [0.0, 0.0], [1.0, 0.0]])
def test_table_that_does_not_increase_is_refused(angles: list[float]) -> None:
    with pytest.raises(BenchError, match="increasing"):
        Profile.of_pairs(np.array(angles), np.ones(len(angles)))


def test_finer_steps_change_nothing() -> None:
    def final(substeps: int) -> NDArray[np.float64]:
        plant = TwoMassPlant()
        plant.parameters["substeps"], plant.parameters["substep_s"] = substeps, TICK_S / substeps
        for i in range(1600):
            plant.step(60.0 if i < 400 else 40 * np.sin(0.05 * i))
        return np.array([plant.state[0][name] for name in ("motor_rad", "motor_rad_s", "load_rad_s")])

    np.testing.assert_allclose(final(4), final(16), rtol=1e-5)


def test_divergence_is_loud() -> None:
    axis = ServoAxis(make_plant("two-mass", "coupling_stiffness=1e12"))
    axis.energise(True)
    axis.set_torque_offset(50.0)
    with pytest.raises(BenchError, match="diverged"):
        axis.advance(0.1)


def test_unknown_plant_names_those_that_exist() -> None:
    with pytest.raises(BenchError, match="two-mass, slider-crank"):
        make_plant("three-mass")
