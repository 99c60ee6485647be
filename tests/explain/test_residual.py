"""Reported minus needed torque: nothing but noise under the right belief, the missing term under a wrong one."""

from __future__ import annotations

import numpy as np
import pytest

from schwung.drivetrain.effects import Effects
from schwung.drivetrain.machine import Coupling, Load, Machine, Motor
from schwung.explain.noise import whitener
from schwung.explain.residual import Residuals, Unknowns
from schwung.explain.signals import prepare
from schwung.motion import Array, Motion
from schwung.session.model import Run, Session

RATE_HZ, NOISE_NM, COULOMB_NM = 4000.0, 0.2, 1.5
MOTOR = Motor(inertia_kgm2=0.01, viscous_friction_nms=0.05, peak_torque_nm=500.0)
RIGID = Machine(name="rigid", motor=MOTOR, load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.05))
FLEXIBLE = Machine(
    name="flexible",
    motor=MOTOR,
    coupling=Coupling(stiffness_nm_rad=20000.0, damping_nms=8.0),
    load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.05),
)


def session(late_s: float = 0.0) -> Session:
    """Six runs to and fro of the rigid machine with Coulomb friction; the torque has noise and may come late."""
    rng = np.random.default_rng(5)
    runs = []
    for repeat in range(3):
        for distance in (2.0, -2.0):
            motion = Motion(distance_rad=distance, duration_s=0.4, start_time_s=0.1, dwell_s=0.1)
            time = motion.time(RATE_HZ)
            moved, then = motion.demand(time), motion.demand(time - late_s)
            torque = 0.06 * then.acceleration_rad_s2 + 0.15 * then.speed_rad_s
            torque += COULOMB_NM * np.sign(then.speed_rad_s)
            runs.append(
                Run(
                    role="reference",
                    repeat=repeat,
                    sample_rate_hz=RATE_HZ,
                    time_s=time,
                    position_rad=moved.position_rad,
                    speed_rad_s=moved.speed_rad_s,
                    torque_nm=torque + rng.normal(0.0, NOISE_NM, time.size),
                    motion=motion,
                )
            )
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="test")


@pytest.fixture(scope="module")
def residuals() -> Residuals:
    return Residuals(prepare(session(), RIGID), RIGID)


FRICTION = Effects(coulomb_positive_nm=COULOMB_NM, coulomb_negative_nm=COULOMB_NM)


def compared(of: Residuals, run: int, unknowns: Unknowns) -> Array:
    return of.residual(run, unknowns)[of.valid(run)]


def in_band(of: Residuals) -> float:
    """Deviation of the noise within the band: white noise through the zero-phase low-pass."""
    frequency = np.linspace(0.0, RATE_HZ / 2, 20001)
    return NOISE_NM * float(np.sqrt(np.mean(1 / (1 + (frequency / of.prepared.band_hz) ** 8) ** 2)))


def test_the_right_belief_leaves_the_injected_noise(residuals: Residuals) -> None:
    left = np.concatenate([compared(residuals, run, Unknowns(FRICTION)) for run in range(6)])

    assert np.std(left) == pytest.approx(in_band(residuals), rel=0.08)


def test_a_wrong_belief_leaves_the_missing_friction(residuals: Residuals) -> None:
    direction = np.sign(residuals.moving(0).speed_rad_s[residuals.valid(0)])
    left = compared(residuals, 0, Unknowns())

    for side in (1.0, -1.0):
        assert np.mean(left[direction == side]) == pytest.approx(side * COULOMB_NM, rel=0.02)


def test_floor_from_repeats_is_the_injected_noise_whatever_is_believed(residuals: Residuals) -> None:
    for effects in (Effects(), FRICTION):
        found = whitener(residuals.prepared, RIGID, residuals.all(range(6), Unknowns(effects)))

        assert found.torque_nm == pytest.approx(in_band(residuals), rel=0.1)


def test_a_late_torque_is_undone_by_its_timing() -> None:
    late = Residuals(prepare(session(late_s=4e-4), RIGID), RIGID)

    straight = np.std(compared(late, 0, Unknowns(FRICTION)))
    undone = np.std(compared(late, 0, Unknowns(FRICTION, timing_s=-4e-4)))

    assert undone == pytest.approx(in_band(late), rel=0.15)
    assert straight > 1.1 * undone


@pytest.mark.parametrize("belief", [RIGID, FLEXIBLE], ids=lambda one: one.name)
def test_several_at_once_are_what_each_is_alone(belief: Machine) -> None:
    prepared = prepare(session(), belief)
    asked = [
        Unknowns(),
        Unknowns(FRICTION, timing_s=1e-4),
        Unknowns(Effects(inertia_delta_kgm2=0.01, load_amplitude_nm=1.0)),
        Unknowns(Effects(torque_gain=1.1, torque_lag_s=2e-4, torque_limit_nm=3.0)),
        Unknowns(Effects(eccentricity_rad=1e-3, cogging_amplitude_nm=0.3, cogging_order=6.0)),
        Unknowns(Effects(periodic_amplitude_nm=0.5, periodic_frequency_hz=20.0), phases_rad={1: 0.7}),
    ]
    warm = Residuals(prepared, belief)
    together = warm.several(1, asked)

    for row, unknowns in enumerate(asked):
        alone = Residuals(prepared, belief).residual(1, unknowns)  # nothing remembered
        np.testing.assert_allclose(together[row], alone, atol=1e-10)
        np.testing.assert_allclose(warm.residual(1, unknowns), alone, atol=1e-10)
    assert np.min(np.ptp(together - together[0], axis=1)[1:]) > 1e-2  # all different


def test_every_effect_that_makes_a_torque_is_told_from_none(residuals: Residuals) -> None:
    """What is remembered is found again by what it depends on: a forgotten field would go unnoticed."""
    flexible = Residuals(residuals.prepared, FLEXIBLE)
    base = Effects(
        stribeck_rise_nm=0.5, drift_nm=0.3, local_friction_nm=0.5, load_amplitude_nm=0.5, event_peak_nm=0.5,
        periodic_amplitude_nm=0.5, cogging_amplitude_nm=0.5, eccentricity_rad=1e-3, gap_rad=1e-4,
        third_inertia_kgm2=0.01, third_stiffness_nm_rad=1000.0, coulomb_positive_nm=1.0, coulomb_negative_nm=1.0,
        event_time_s=0.15, event_duration_s=0.1, local_centre_rad=-1.0, torque_limit_nm=4.0,
    )  # fmt: skip
    before = flexible.residual(1, Unknowns(base))
    told_elsewhere = {"speed_delay_s", "periodic_phase_rad"}  # by timing, and by the phases of each run
    told_elsewhere.add("inertia_shift_rad")  # the inertia is even
    told_elsewhere |= {  # what is weighed alone: explain takes no belief that has it
        "viscous_drift_nms", "carried_share", "load_coulomb_nm", "offset_drift_nm", "torque_drop",
        "torque_drop_at_nm", "torque_drop_order", "ripple_order", "ripple_share", "ripple_phase_rad", "torque_filter_s",
        "presliding_nm", "presliding_stiffness_nm_rad",
        "end_high_nm_rad", "end_high_rad", "end_low_nm_rad", "end_low_rad",
        "stiffness_share", "stiffness_order", "stiffness_phase_rad",
        "harmonic_rad", "harmonic_order", "harmonic_phase_rad",
        "kinematic_rad", "kinematic_order", "kinematic_phase_rad",
    }  # fmt: skip

    for name in set(Effects._fields) - told_elsewhere:
        value = getattr(base, name)
        change = {
            "stiffness_nm_rad": 9000.0,
            "damping_nms": 30.0,
            "torque_limit_nm": 3.0,
            "cubic_nm_rad3": 1e9,
        }
        moved = base._replace(**{name: change.get(name, 1.2 * value if value else 0.05)})
        assert np.max(np.abs(flexible.residual(1, Unknowns(moved)) - before)) > 1e-6, name


def test_no_machine_without_inertia_is_possible(residuals: Residuals) -> None:
    impossible = Unknowns(Effects(inertia_delta_kgm2=-0.2))

    assert np.min(residuals.residual(0, impossible)) > 100 * np.max(np.abs(residuals.residual(0, Unknowns())))
