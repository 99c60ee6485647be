"""Machines with one of every term, and their own simulation, against which every export is held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain import InertiaTable, Machine, Simulated, paper_machine, simulate, slider_crank_inertia
from schwung.drivetrain.machine import Load
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.motion import Array, Excitation, Motion

RATE_HZ = 8000.0
TIME = np.arange(1601) / RATE_HZ
MOTION = Motion(kind="poly5", distance_rad=2.5, duration_s=0.16, start_time_s=0.01)
START_RAD = 0.3

#: Every term once. Those of the first half together, those of the second together, and a rigid machine with the rest.
FRICTION = (
    PhysicsTerm(
        name="stribeck_friction",
        coulomb_torque_nm=3.0, breakaway_torque_nm=5.0, stribeck_speed_rad_s=0.7, exponent=1.3,
    ),
    PhysicsTerm(name="coulomb_friction", torque_nm=0.5),
    PhysicsTerm(
        name="asymmetric_friction",
        torque_positive_nm=1.0, torque_negative_nm=2.0, coefficient_difference_nms=0.02,
    ),
    PhysicsTerm(name="viscous_friction", coefficient_nms=0.1),
    PhysicsTerm(name="quadratic_drag", coefficient_nms2=0.004),
    PhysicsTerm(name="local_friction", torque_nm=2.0, centre_rad=1.0, width_rad=0.5, sharpness=2.0),
    PhysicsTerm(name="friction_drift", change_nm=0.7, settling=2.0),
    PhysicsTerm(name="torque_offset", torque_nm=0.4),
    PhysicsTerm(name="backlash", gap_rad=1e-3),
    PhysicsTerm(name="torque_saturation", limit_nm=60.0),
    PhysicsTerm(name="encoder_eccentricity", amplitude_rad=2e-3, phase_rad=0.2),
    PhysicsTerm(name="encoder_harmonic", order=7.0, amplitude_rad=1e-3, phase_rad=0.6),
    PhysicsTerm(name="load_inertia", delta_kgm2=0.01, scale=1.1),
    PhysicsTerm(name="load_torque", table=[[0.0, 1.0], [1.0, 4.0], [3.0, -1.0]]),
)  # fmt: skip
SHAFT = (
    PhysicsTerm(name="load_torque", amplitude_nm=5.0, phase_rad=0.1),
    PhysicsTerm(name="end_spring", stiffness_nm_rad=30.0, position_rad=0.32),
    PhysicsTerm(name="load_event", time_s=0.05, duration_s=0.03, peak_nm=8.0, sharpness=1.5),
    PhysicsTerm(name="periodic_disturbance", frequency_hz=70.0, amplitude_nm=2.0, phase_rad=0.3),
    PhysicsTerm(
        name="cogging",
        order=12.0,
        amplitude_nm=1.0,
        phase_rad=0.3,
        second_amplitude_nm=0.4,
        second_phase_rad=1.1,
    ),
    PhysicsTerm(name="torque_constant", gain=1.05),
    PhysicsTerm(name="torque_lag", time_constant_s=3e-4),
    PhysicsTerm(name="motor_inertia", inertia_kgm2=0.015),
    PhysicsTerm(name="coupling_stiffness", stiffness_nm_rad=2e4),
    PhysicsTerm(name="coupling_damping", damping_nms=6.0),
    PhysicsTerm(name="nonlinear_stiffness", cubic_nm_rad3=1e8),
    PhysicsTerm(name="stiffness_over_angle", order=3.0, share=0.2, phase_rad=0.4),
    PhysicsTerm(name="coupling_hysteresis", torque_nm=6.0, stiffness_nm_rad=8e3, exponent=1.4),
    PhysicsTerm(
        name="kinematic_error",
        order=5.0,
        amplitude_rad=2e-3,
        phase_rad=0.7,
        second_amplitude_rad=6e-4,
        second_phase_rad=1.9,
    ),
    PhysicsTerm(
        name="extra_compliance", inertia_kgm2=0.01, stiffness_nm_rad=9000.0, damping_nms=1.0, speed_share=40.0
    ),
    PhysicsTerm(name="inertia_profile_shift", shift_rad=0.05),
)
#: What is learned as a curve, and names of the same vocabulary.
CURVES = (
    PhysicsTerm(name="friction_over_angle", table=[[0.0, 1.0], [1.0, 2.0], [3.0, 1.5]]),
    PhysicsTerm(name="viscous_drift", change_nms=0.1),
    PhysicsTerm(name="load_dependent_friction", share=0.05),
    PhysicsTerm(name="presliding_friction", torque_nm=3.0, stiffness_nm_rad=12.0),
    PhysicsTerm(name="direction_dependent_load", table=[[0.0, 1.0, 2.0], [1.5, 2.0, -1.0], [3.0, 0.0, 1.0]]),
    PhysicsTerm(name="end_spring", stiffness_nm_rad=20.0, position_rad=1.1, side=-1.0),
    PhysicsTerm(name="offset_drift", change_nm=2.0),
    PhysicsTerm(name="torque_constant_drop", share_at_peak=0.05, peak_nm=80.0, order=1.7),
    PhysicsTerm(name="torque_constant_fade", share_at_peak=0.3, peak_nm=80.0, time_constant_s=0.3, start_heat=0.2),
    PhysicsTerm(name="torque_ripple", order=4.0, share=0.04, phase_rad=0.5),
    PhysicsTerm(name="inertia_profile", table=[[0.0, 0.02], [1.0, -0.01], [2.0, 0.01], [3.0, 0.0]]),
    PhysicsTerm(name="residual", coordinate="speed", table=[[0.0, -0.2, 0.3], [10.0, -3.0, 3.0], [30.0, 2.0, 1.0]]),
    PhysicsTerm(name="residual", coordinate="torque", table=[[0.0, 0.0, 1.0], [90.0, -4.0, 3.0]]),
    PhysicsTerm(name="residual", coordinate="run", table=[[0.0, 0.0, 1.0], [1.0, -2.0, 0.0]]),
    PhysicsTerm(name="residual", coordinate="acceleration", table=[[-2e3, 3.0], [0.0, 0.5], [2e3, -4.0]]),
    PhysicsTerm(name="residual", coordinate="time_in_motion", table=[[0.0, 0.0], [0.05, 3.0], [0.1, 1.0]]),
    PhysicsTerm(
        name="residual", coordinates=["position", "speed"], points=[[0.0, 1.0, 3.0], [-20.0, 0.0, 30.0]],
        table=[[1.0, 0.2, -1.0], [3.0, 0.5, -2.0], [0.0, -1.0, 4.0]],
    ),
    PhysicsTerm(
        name="residual", coordinates=["position", "torque"], points=[[0.0, 2.0], [-50.0, 10.0, 50.0]],
        table=[[1.0, 0.2, -1.0], [3.0, 0.5, -2.0]],
    ),
    PhysicsTerm(
        name="residual", coordinates=["torque", "time_in_motion"], points=[[-50.0, 50.0], [0.0, 0.05, 0.1]],
        table=[[1.0, 0.2, -1.0], [3.0, 0.5, -2.0]],
    ),
    PhysicsTerm(name="residual", like="cogging", order=9.0, amplitude_nm=0.5, phase_rad=0.1),
)  # fmt: skip
BEHIND = (
    PhysicsTerm(name="load_side_friction", torque_nm=2.0),
    PhysicsTerm(name="viscous_friction", load_coefficient_nms=0.15),
    PhysicsTerm(name="quadratic_drag", load_coefficient_nms2=0.004),
    PhysicsTerm(
        name="residual", coordinate="wind_up", table=[[-2e-3, -9.0], [0.0, 0.0], [1e-3, 2.0], [2e-3, 8.0]]
    ),
)
LATE = (PhysicsTerm(name="measurement_delay", delay_s=3.3e-4),)


@dataclass(frozen=True)
class Case:
    """A machine, and how far through a session it is."""

    machine: Machine
    share: float = 0.0


def cases() -> dict[str, Case]:
    """Machines by what is special about them."""
    plain = paper_machine()
    angle = np.linspace(0.0, np.pi, 61)
    load = Load(viscous_friction_nms=0.1, inertia_table=InertiaTable(angle, slider_crank_inertia(angle)))
    plain = plain.model_copy(update={"load": load})
    rigid = plain.model_copy(update={"coupling": None, "physics": LATE})
    geared = plain.model_copy(update={"coupling": None, "physics": CURVES})
    return {
        "plain": Case(plain),
        "friction": Case(plain.model_copy(update={"physics": FRICTION}), share=0.4),
        "shaft": Case(plain.model_copy(update={"physics": SHAFT})),
        "rigid, read late": Case(rigid),
        "curves": Case(plain.model_copy(update={"physics": (*CURVES, *BEHIND)}), share=0.5),
        "rigid, curves": Case(geared, share=0.5),
    }


def simulated(case: Case, substeps: int | None = None) -> Simulated:
    """Our own simulation of the case."""
    added: Array = Excitation(frequency_hz=50, amplitude_nm=15.0).torque(TIME)
    return simulate(
        case.machine, MOTION.demand(TIME), TIME, added,
        start_rad=START_RAD, session_share=case.share, substeps=substeps,
    )  # fmt: skip


def leaves_rest_s() -> float:
    """When our simulation takes the motion to begin (s): the tick before the demand moves."""
    moving = MOTION.demand(TIME).position_rad != 0
    return float(TIME[int(np.argmax(moving)) - 1])


def apart(told: Array, ours: Array) -> float:
    """Largest difference over the largest value."""
    return float(np.max(np.abs(told - ours)) / np.max(np.abs(ours)))
