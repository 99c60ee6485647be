"""The multi-body slider-crank against a closed form of its own, and against the two-mass machine."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from schwung_sim.errors import BenchError
from schwung_sim.plants import EFFECTS, TICK_S, Profile, make_plant, parse_conceal
from schwung_sim.plants.slider_crank import SliderCrankMachine, SliderCrankPlant

Array = NDArray[np.float64]
MACHINE = SliderCrankMachine()


def reflected_inertia(angle: Array, m: SliderCrankMachine = MACHINE) -> Array:
    """Twice the kinetic energy at 1 rad/s of the crank, from the bodies' own speeds (Lagrange)."""
    across = m.crank_m / m.rod_m * np.sin(angle)
    rod_speed = m.crank_m / m.rod_m * np.cos(angle) / np.sqrt(1 - across**2)
    slider = m.crank_m * np.sin(angle) + m.rod_m * across * rod_speed
    centre_x = m.crank_m * np.sin(angle) + m.rod_m / 2 * across * rod_speed
    centre_y = m.crank_m * np.cos(angle) / 2
    rod = m.rod_kg * (centre_x**2 + centre_y**2 + m.rod_m**2 / 12 * rod_speed**2)
    return np.asarray(m.crank_inertia_kgm2 + rod + m.slider_kg * slider**2)


def scripted_torque(ticks: int) -> Array:
    """A stroke with a 50 Hz sine on it, from a jerk."""
    time = np.arange(ticks) * TICK_S
    return np.asarray(
        30 * np.sin(2 * np.pi * 3.3 * time) + 20 * np.sin(2 * np.pi * 50 * time) + 60 * (time < 0.01)
    )


def driven(conceal: str = "", name: str = "slider-crank", motions: int = 1, **options: object) -> Array:
    """Rows of motor angle and (mean over the tick) motor speed under the scripted torque."""
    plant = make_plant(name, conceal, **options)
    rows = []
    for _ in range(motions):
        plant.begin_motion()
        for torque in scripted_torque(1600):
            before = plant.motor_rad
            plant.step(torque)
            rows.append((plant.motor_rad, (plant.motor_rad - before) / TICK_S))
    return np.array(rows)


@pytest.fixture(scope="module")
def same_inertia() -> Profile:
    """The closed form's inertia, for the two-mass machine."""
    return Profile.of_turn(reflected_inertia)


def test_true_inertia_follows_from_the_masses() -> None:
    angle = np.linspace(-7, 7, 211)
    np.testing.assert_allclose(SliderCrankPlant().true_inertia(angle), reflected_inertia(angle), rtol=1e-9)


def test_true_inertia_is_about_the_papers() -> None:
    inertia = SliderCrankPlant().true_inertia(np.linspace(0, np.pi, 61))
    assert inertia[[0, -1]] == pytest.approx([0.055, 0.055], abs=1e-3)
    assert 0.155 < inertia.max() < 0.17


def test_other_masses_other_inertia() -> None:
    light = SliderCrankMachine(slider_kg=1.0)
    angle = np.linspace(0, np.pi, 31)
    np.testing.assert_allclose(
        SliderCrankPlant(light).true_inertia(angle), reflected_inertia(angle, light), rtol=1e-9
    )


def test_motion_agrees_with_the_lagrangian_equations() -> None:
    """Motor speed within 1e-4 of its size (rms), over 0.3 s: Runge-Kutta on Lagrange's equations beside it."""
    m = MACHINE.drive
    h = TICK_S / 2

    def rates(y: Array, torque: float) -> Array:
        motor, motor_speed, crank, speed = y
        shaft = m.stiffness_nm_rad * (motor - crank) + m.damping_nms * (motor_speed - speed)
        j, slope = (
            reflected_inertia(crank),
            (reflected_inertia(crank + 1e-5) - reflected_inertia(crank - 1e-5)) / 2e-5,
        )
        return np.array([
            motor_speed,
            (torque - shaft - m.rotor_viscous_nms * motor_speed) / m.rotor_inertia_kgm2,
            speed,
            float((shaft - m.load_viscous_nms * speed - slope * speed**2 / 2) / j),
        ])  # fmt: skip

    plant, y = SliderCrankPlant(), np.zeros(4)
    errors, speeds, closure = [], [], []
    for torque in scripted_torque(2400):
        plant.step(torque)
        for _ in range(2):
            a = rates(y, torque)
            b = rates(y + h / 2 * a, torque)
            c = rates(y + h / 2 * b, torque)
            y = y + h / 6 * (a + 2 * b + 2 * c + rates(y + h * c, torque))
        errors.append(plant.data.qvel[0] - y[1])
        speeds.append(y[1])
        closure.append(float(np.max(np.abs(plant.data.efc_pos))))
    assert np.sqrt(np.mean(np.square(errors))) < 1e-4 * np.sqrt(np.mean(np.square(speeds)))
    assert max(closure) < 2e-6  # m: the loop stays closed


def test_the_coupling_is_as_stiff_as_the_machine_says() -> None:
    """Small vibrations of the whole band at standstill, against two masses in closed form with other k, b, J_r."""
    ticks, drive = 1200, MACHINE.drive
    time, chance = np.arange(ticks) * TICK_S, np.random.default_rng(1)
    lines = np.geomspace(8.0, 420.0, 40)
    torque = 0.02 * np.sin(np.multiply.outer(time, 2 * np.pi * lines) + chance.uniform(0, 6.28, 40)).sum(1)

    def closed_form(rotor: float, stiffness: float, damping: float) -> Array:
        load = float(reflected_inertia(np.array(0.0)))
        a = np.zeros((4, 4))
        a[0] = [-(damping + drive.rotor_viscous_nms) / rotor, damping / rotor, -stiffness / rotor, 1 / rotor]
        a[1, :3] = np.array([damping, -damping - drive.load_viscous_nms, stiffness]) / load
        a[2, :2] = 1.0, -1.0
        step, state, speeds = expm(a * TICK_S), np.zeros(4), np.empty(ticks)
        for i, state[3] in enumerate(torque):
            state = step @ state
            speeds[i] = state[0]
        return speeds

    believed = np.array([drive.rotor_inertia_kgm2, drive.stiffness_nm_rad, drive.damping_nms])
    plant, seen = SliderCrankPlant(), np.empty(ticks)
    for i, value in enumerate(torque):
        plant.step(value)
        seen[i] = plant.data.qvel[0]
    expected, share = closed_form(*believed), 1e-3
    columns = [(closed_form(*(believed * (1 + share * one))) - expected) / share for one in np.eye(3)]
    off = np.linalg.lstsq(np.stack(columns, 1), seen - expected, rcond=None)[0]
    np.testing.assert_array_less(np.abs(off), [4e-3, 2e-3, 6e-3])  # J_r, k, b


def test_energy_is_kept_without_friction() -> None:
    plant = SliderCrankPlant()
    plant.parameters["rotor_viscous_nms"] = 0.0
    plant.model.dof_damping[:] = 0.0
    plant.parameters["damping_nms"] = 0.0
    for _ in range(400):
        plant.step(25.0)

    def energy() -> float:
        motor, crank = plant.data.qvel[:2]
        inertia = float(reflected_inertia(np.array(plant.data.qpos[1])))
        twist = plant.data.qpos[0] - plant.data.qpos[1]
        return float(0.012 * motor**2 + inertia * crank**2 + 24963.0 * twist**2) / 2

    before = energy()
    values = []
    for _ in range(4000):
        plant.step(0.0)
        values.append(energy())
    assert np.mean(values[-400:]) == pytest.approx(before, rel=2e-3)


def test_gravity_turns_the_hanging_crank_only_when_asked() -> None:
    """At 0 the rod's weight hangs half on the crank pin: a torque of -½ m g r."""
    flat, upright = SliderCrankPlant(gravity=True), SliderCrankPlant()
    for _ in range(40):
        flat.step(0.0)
        upright.step(0.0)
    assert upright.motor_rad == 0.0
    torque = -0.5 * MACHINE.rod_kg * 9.80665 * MACHINE.crank_m
    momentum = 0.012 * flat.data.qvel[0] + 0.055 * flat.data.qvel[1]
    assert momentum == pytest.approx(torque * 40 * TICK_S, rel=0.03)


@pytest.mark.parametrize("name", sorted(set(EFFECTS) - {"measurement_delay", "encoder_eccentricity"}))
def test_concealed_effects_are_the_two_mass_machines(name: str, same_inertia: Profile) -> None:
    """Two models that share neither bodies nor integrator move alike with the same effect, and unlike without it."""
    motions = 2 if name == "friction_drift" else 1
    text = "friction_drift:motions=2" if motions == 2 else name
    here = driven(text, motions=motions)
    there = driven(text, "two-mass", motions, inertia=same_inertia)
    plain = driven(motions=motions)
    apart, effect = (np.sqrt(np.mean((here - other) ** 2, axis=0)) for other in (there, plain))
    assert apart[0] < 5e-3
    assert apart[1] < 0.05
    assert effect[1] > 3 * apart[1]


def test_concealed_inertia_is_in_the_truth() -> None:
    angle = np.linspace(0, 3, 7)
    shifted = make_plant("slider-crank", "inertia_profile_shift=0.2")
    np.testing.assert_allclose(shifted.true_inertia(angle), reflected_inertia(angle + 0.2), rtol=1e-9)
    loaded = make_plant("slider-crank", "load_inertia:scale=1.1:delta_kgm2=0.01")
    np.testing.assert_allclose(loaded.true_inertia(angle), 1.1 * reflected_inertia(angle) + 0.01, rtol=1e-9)


def test_dry_friction_holds_the_rotor() -> None:
    plant = SliderCrankPlant(concealed=parse_conceal("coulomb_friction=3"))
    for _ in range(400):
        plant.step(2.9)
    assert plant.motor_rad == 0.0


def test_taking_more_inertia_than_there_is_is_refused() -> None:
    with pytest.raises(BenchError, match="leaves the crank"):
        make_plant("slider-crank", "load_inertia:delta_kgm2=-0.05")
