"""The torque that a machine needs, against the torque that an independent simulation of the same machine took.

`drivetrain.simulate` is driven by torque and integrates both masses; `needed` is driven by the motor's motion alone.
"""

from __future__ import annotations

import numpy as np
import pytest

from schwung.drivetrain.inertia import InertiaTable, LoadTorqueTable, slider_crank_inertia
from schwung.drivetrain.machine import Control, Coupling, Load, Machine, Motor
from schwung.drivetrain.simulation import simulate
from schwung.motion import Array, Excitation, Motion
from schwung.simulators.needed import MotorMotion, can_follow, needed, substeps, taken, two_masses

RATE_HZ = 8000.0
CONTROL = Control(
    position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=8e-3, sample_rate_hz=RATE_HZ
)
ANGLES = np.linspace(-0.5, np.pi + 0.5, 301)
PROFILE = Load(
    viscous_friction_nms=0.1, inertia_table=InertiaTable(ANGLES, slider_crank_inertia(ANGLES, 0.06))
)
GRAVITY = PROFILE.model_copy(update={"torque_table": LoadTorqueTable(ANGLES, 4.0 * np.sin(ANGLES + 0.4))})
EVEN = Load(viscous_friction_nms=0.1, inertia_kgm2=0.09)
SPRING = Coupling(stiffness_nm_rad=20000.0, damping_nms=6.0)


def machine(load: Load, coupling: Coupling | None) -> Machine:
    return Machine(
        name="simulated",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=500.0),
        coupling=coupling,
        load=load,
        control=CONTROL,
    )


def recorded(of: Machine) -> tuple[MotorMotion, Array]:
    """The simulated motor's motion, and the torque that was on it: its mean over the two ticks around each instant."""
    motion = Motion(distance_rad=np.pi, duration_s=0.25, start_time_s=0.05, dwell_s=0.02)
    time = motion.time(RATE_HZ)
    added = Excitation(frequency_hz=30.0, amplitude_nm=25.0, ramp_s=0.03).torque(time)
    run = simulate(of, motion.demand(time), time, added, substeps=16)
    inner = slice(1, -1)
    moved = MotorMotion(
        run.position_rad[inner],
        run.speed_rad_s[inner],
        (run.speed_rad_s[2:] - run.speed_rad_s[:-2]) * RATE_HZ / 2,
        1 / RATE_HZ,
    )
    return moved, (run.torque_nm[:-2] + run.torque_nm[1:-1]) / 2


@pytest.mark.parametrize("load", [EVEN, PROFILE, GRAVITY], ids=["even", "profile", "gravity"])
@pytest.mark.parametrize("coupling", [None, SPRING], ids=["rigid", "spring"])
def test_simulated_torque_comes_back_as_needed_torque(load: Load, coupling: Coupling | None) -> None:
    of = machine(load, coupling)
    motion, torque = recorded(of)

    missed = needed(two_masses(of), motion) - torque

    assert np.sqrt(np.mean(missed**2)) < 3e-4 * np.sqrt(np.mean(torque**2))


def test_what_a_machine_leaves_out_does_not_come_back() -> None:
    motion, torque = recorded(machine(GRAVITY, SPRING))

    missed = needed(two_masses(machine(PROFILE, SPRING)), motion) - torque

    assert np.sqrt(np.mean(missed**2)) > 4e-2 * np.sqrt(np.mean(torque**2))


@pytest.mark.parametrize("sooner", [0.9, 1.2])
def test_what_steps_cannot_follow_is_told_before_it_grows_without_bounds(sooner: float) -> None:
    motion, _ = recorded(machine(EVEN, SPRING))
    # b/J times the finest step, against what bounds the fourth order
    damping = sooner * 2.78 * 16 * 0.09 / motion.step
    masses = two_masses(machine(EVEN, SPRING))._replace(damping=damping)
    with np.errstate(all="ignore"):
        torque = taken(masses, motion)

    grows = not np.all(np.abs(torque) < 1e6)
    assert grows == (sooner > 1)
    assert not (grows and can_follow(masses, motion.step))
    assert can_follow(masses._replace(damping=0.5 * damping), motion.step)


def test_a_rigid_load_takes_what_newton_says() -> None:
    angle = np.linspace(0.2, 3.0, 400)
    speed, acceleration = 10 + np.sin(angle), 50 * np.cos(angle)
    motion = MotorMotion(angle, speed, acceleration, 1e-3)
    of = machine(PROFILE, None)
    table = PROFILE.inertia_table
    assert table is not None

    torque = taken(two_masses(of), motion)

    exact = table.at(angle) * acceleration + 0.5 * table.slope_at(angle) * speed**2 + 0.1 * speed
    np.testing.assert_allclose(torque, exact, rtol=1e-12, atol=1e-12)


def test_beyond_its_table_an_inertia_stays_as_at_the_end() -> None:
    angle = np.array([-9.0, -0.6, 7.0, -9.0])  # to and fro: the piece is sought from the one before
    motion = MotorMotion(angle, np.full(4, 20.0), np.full(4, 100.0), 1e-3)
    table = PROFILE.inertia_table
    assert table is not None

    torque = taken(two_masses(machine(PROFILE, None)), motion)

    np.testing.assert_allclose(torque, table.at(angle) * 100.0 + 0.1 * 20.0, rtol=1e-12)


def test_the_load_is_stepped_finely_enough_for_its_spring() -> None:
    masses = two_masses(machine(EVEN, SPRING))
    swings = np.sqrt(20000.0 / 0.09)

    for step in (1e-4, 1e-3, 4e-3):
        assert step / substeps(masses, step) * swings < 0.75
