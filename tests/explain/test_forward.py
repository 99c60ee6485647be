"""The torque that a belief needs, against the torque that an independent simulation of the same machine took.

`drivetrain.simulate` is driven by torque and integrates both masses; `forward` is driven by the motor's motion alone.
"""

from __future__ import annotations

import numpy as np
import pytest

from schwung.drivetrain.effects import Effects, effects_of
from schwung.drivetrain.inertia import InertiaTable, slider_crank_inertia
from schwung.drivetrain.machine import Control, Coupling, Load, Machine, Motor
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.simulation import simulate
from schwung.explain import forward
from schwung.explain.spectrum import Spectrum
from schwung.motion import Array, Excitation, Motion

RATE_HZ = 8000.0
CONTROL = Control(
    position_gain_per_s=60.0, speed_gain_nms=7.0, speed_integral_time_s=8e-3, sample_rate_hz=RATE_HZ
)
ANGLES = np.linspace(-0.5, np.pi + 0.5, 301)
PROFILE = Load(
    viscous_friction_nms=0.1, inertia_table=InertiaTable(ANGLES, slider_crank_inertia(ANGLES, 0.06))
)
EVEN = Load(viscous_friction_nms=0.1, inertia_kgm2=0.09)
SPRING = Coupling(stiffness_nm_rad=20000.0, damping_nms=6.0)


def term(name: str, **parameters: float) -> PhysicsTerm:
    return PhysicsTerm(name=name, **parameters)


THIRD = term(
    "extra_compliance", inertia_kgm2=0.02, stiffness_nm_rad=0.02 * (2 * np.pi * 40) ** 2, damping_nms=0.3
)
GRAVITY = term("load_torque", amplitude_nm=4.0, phase_rad=0.4)


def machine(load: Load, coupling: Coupling | None, *physics: PhysicsTerm) -> Machine:
    return Machine(
        name="simulated",
        motor=Motor(inertia_kgm2=0.012, viscous_friction_nms=0.2, peak_torque_nm=500.0),
        coupling=coupling,
        load=load,
        control=CONTROL,
        physics=physics,
    )


def recorded(of: Machine) -> tuple[forward.Motion, Array]:
    """The simulated motor's motion, and the torque that was on it: its mean over the two ticks around each instant."""
    motion = Motion(distance_rad=np.pi, duration_s=0.25, start_time_s=0.05, dwell_s=0.02)
    time = motion.time(RATE_HZ)
    added = Excitation(frequency_hz=30.0, amplitude_nm=25.0, ramp_s=0.03).torque(time)
    run = simulate(of, motion.demand(time), time, added, substeps=16)
    inner = slice(1, -1)
    moved = forward.Motion(
        run.position_rad[inner],
        run.speed_rad_s[inner],
        (run.speed_rad_s[2:] - run.speed_rad_s[:-2]) * RATE_HZ / 2,
        time[inner] - motion.start_time_s,
        1 / RATE_HZ,
    )
    return moved, (run.torque_nm[:-2] + run.torque_nm[1:-1]) / 2


def needed(of: Machine, e: Effects, motion: forward.Motion) -> Array:
    """Torque on the motor by the explainer's equations."""
    belief = forward.believed(of)
    torque = belief.rotor_inertia * motion.acceleration + belief.motor_friction * motion.speed
    return torque + forward.coupling_needed(belief, e, motion)


@pytest.mark.parametrize(
    ("load", "coupling", "physics", "tolerance"),
    [
        (EVEN, None, (), 3e-4),
        (PROFILE, None, (), 3e-4),
        (PROFILE, None, (THIRD,), 3e-4),
        (EVEN, SPRING, (), 3e-4),
        (PROFILE, SPRING, (), 3e-4),
        (PROFILE, SPRING, (THIRD,), 3e-4),
        (PROFILE, SPRING, (GRAVITY,), 3e-4),
        (PROFILE, SPRING, (term("load_event", time_s=0.05, duration_s=0.06, peak_nm=12.0),), 3e-4),
        (PROFILE, SPRING, (term("nonlinear_stiffness", cubic_nm_rad3=2e9),), 3e-4),
        (PROFILE, SPRING, (term("load_inertia", delta_kgm2=0.01, scale=1.2),), 3e-4),
        (PROFILE, SPRING, (term("inertia_profile_shift", shift_rad=0.2),), 3e-4),
        (PROFILE, SPRING, (term("coupling_stiffness", stiffness_nm_rad=9000.0),), 3e-4),
        (PROFILE, SPRING, (term("coupling_damping", damping_nms=20.0),), 3e-4),
        (PROFILE, SPRING, (term("backlash", gap_rad=0.002), GRAVITY), 2e-2),
    ],
    ids=lambda value: "+".join(t.name for t in value) if isinstance(value, tuple) else None,
)
def test_simulated_torque_comes_back_as_needed_torque(
    load: Load, coupling: Coupling | None, physics: tuple[PhysicsTerm, ...], tolerance: float
) -> None:
    motion, torque = recorded(machine(load, coupling, *physics))

    missed = needed(machine(load, coupling), effects_of(physics), motion) - torque

    assert np.sqrt(np.mean(missed**2)) < tolerance * np.sqrt(np.mean(torque**2))


def test_impacts_take_the_same_torque_however_seldom_they_are_sampled() -> None:
    play = term("backlash", gap_rad=2e-3)
    motion, _ = recorded(machine(PROFILE, SPRING, play))
    spectrum = Spectrum(motion.angle.size, RATE_HZ, 0.02)
    smooth = forward.Motion(
        *(spectrum.apply(values, spectrum.low_pass(500.0)) for values in motion[:3]), *motion[3:]
    )
    within = {}
    for every in (1, 5):
        at = slice(None, None, every)
        seldom = forward.Motion(
            *(np.ascontiguousarray(values[at]) for values in smooth[:4]), every * smooth.step
        )
        torque = forward.coupling_needed(
            forward.believed(machine(PROFILE, SPRING)), effects_of([play]), seldom
        )
        slow = Spectrum(torque.size, RATE_HZ / every, 0.02)
        within[every] = slow.apply(torque, slow.low_pass(150.0))
    missed = within[5] - within[1][::5]

    assert np.sqrt(np.mean(missed**2)) < 2.5e-3 * np.sqrt(np.mean(within[1] ** 2))


@pytest.mark.parametrize(
    "physics",
    [
        THIRD,
        GRAVITY,
        term("load_inertia", delta_kgm2=0.01, scale=1.2),
        term("backlash", gap_rad=0.002),
    ],
    ids=lambda one: one.name,
)
def test_what_a_belief_leaves_out_does_not_come_back(physics: PhysicsTerm) -> None:
    motion, torque = recorded(machine(PROFILE, SPRING, physics))

    missed = needed(machine(PROFILE, SPRING), Effects(), motion) - torque

    assert np.sqrt(np.mean(missed**2)) > 4e-2 * np.sqrt(np.mean(torque**2))


@pytest.mark.parametrize("sooner", [0.9, 1.2])
def test_what_steps_cannot_follow_is_told_before_it_grows_without_bounds(sooner: float) -> None:
    motion, _ = recorded(machine(EVEN, SPRING))
    belief = forward.believed(machine(EVEN, SPRING))
    damping = (
        sooner * 2.78 * 16 * 0.09 / motion.step
    )  # b/J times the finest step, against what bounds the fourth order
    effects = Effects()._replace(damping_nms=damping)
    with np.errstate(all="ignore"):
        torque = forward.coupling_needed(belief, effects, motion)

    grows = not np.all(np.abs(torque) < 1e6)
    assert grows == (sooner > 1)
    assert not (grows and forward.can_follow(belief, effects, motion.step))
    assert forward.can_follow(belief, effects._replace(damping_nms=0.5 * damping), motion.step)


def test_a_rigid_load_takes_what_newton_says() -> None:
    angle = np.linspace(0.2, 3.0, 400)
    speed, acceleration = 10 + np.sin(angle), 50 * np.cos(angle)
    motion = forward.Motion(angle, speed, acceleration, np.zeros_like(angle), 1e-3)
    of = machine(PROFILE, None)
    table = PROFILE.inertia_table
    assert table is not None

    torque = forward.coupling_needed(forward.believed(of), Effects(), motion)

    exact = table.at(angle) * acceleration + 0.5 * table.slope_at(angle) * speed**2 + 0.1 * speed
    np.testing.assert_allclose(torque, exact, rtol=1e-12, atol=1e-12)


def test_beyond_its_table_an_inertia_stays_as_at_the_end() -> None:
    angle = np.array([-9.0, -0.6, 7.0, -9.0])  # to and fro: the piece is sought from the one before
    motion = forward.Motion(angle, np.full(4, 20.0), np.full(4, 100.0), np.zeros(4), 1e-3)
    table = PROFILE.inertia_table
    assert table is not None

    torque = forward.coupling_needed(forward.believed(machine(PROFILE, None)), Effects(), motion)

    np.testing.assert_allclose(torque, table.at(angle) * 100.0 + 0.1 * 20.0, rtol=1e-12)


def test_the_load_is_stepped_finely_enough_for_its_spring() -> None:
    belief = forward.believed(machine(EVEN, SPRING))
    swings = np.sqrt(20000.0 / 0.09)

    for step in (1e-4, 1e-3, 4e-3):
        assert step / forward.substeps(belief, Effects(), step) * swings < 0.75


def test_uncentred_undoes_what_an_eccentric_encoder_reports() -> None:
    amplitude, phase, step = 1e-3, 0.7, 1e-4
    true = 1.5 - 1.4 * np.cos(6 * np.arange(3000) * step)
    seen = true + amplitude * np.sin(true + phase)
    speed = np.gradient(seen, step)
    reported = forward.Motion(seen, speed, np.gradient(speed, step), np.zeros_like(seen), step)

    motion = forward.uncentred(reported, amplitude, phase)

    inner = slice(5, -5)
    np.testing.assert_allclose(motion.angle, true, atol=2 * amplitude**2)
    np.testing.assert_allclose(motion.speed[inner], np.gradient(true, step)[inner], atol=1e-4)
    np.testing.assert_allclose(
        motion.acceleration[inner], np.gradient(np.gradient(true, step), step)[inner], atol=2e-3
    )


def test_uncentred_is_exact_for_an_encoder_that_is_far_off() -> None:
    """What is neglected of five degrees would pass for a shifted inertia table."""
    amplitude, phase, t = 0.09, -0.4, np.linspace(0.0, 1.0, 200)
    true, speed, acceleration = 3 * np.sin(2 * t), 6 * np.cos(2 * t), -12 * np.sin(2 * t)
    off = true + phase
    seen = true + amplitude * np.sin(off)
    seen_speed = speed * (1 + amplitude * np.cos(off))
    seen_acceleration = acceleration * (1 + amplitude * np.cos(off)) - amplitude * np.sin(off) * speed**2
    reported = forward.Motion(seen, seen_speed, seen_acceleration, np.zeros_like(t), 0.005)

    motion = forward.uncentred(reported, amplitude, phase)

    np.testing.assert_allclose(motion.angle, true, atol=1e-11)
    np.testing.assert_allclose(motion.speed, speed, atol=1e-10)
    np.testing.assert_allclose(motion.acceleration, acceleration, atol=1e-9)
