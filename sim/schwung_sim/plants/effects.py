"""The physics of the axis, one compiled function per family; a parameter at 0 (a gain: 1) takes no part.

`p` is one PARAMETERS record, `s` one STATE record; torques are N·m on the shaft named, positive accelerates
it. Both plants use these: the two-mass kernel in its integrator, the multi-body plant beside MuJoCo's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from schwung_sim.compiled import compiled
from schwung_sim.plants.foreign import PARAMETER_FIELDS, STATE_FIELDS
from schwung_sim.plants.profile import read_profile

_REALS = (
    # the machine of method.md, Table 1
    "rotor_inertia_kgm2", "rotor_viscous_nms", "stiffness_nm_rad", "damping_nms", "load_viscous_nms",
    # dry friction of the motor shaft
    "coulomb_positive_nm", "coulomb_negative_nm", "stribeck_rise_nm", "stribeck_speed_rad_s",
    "local_friction_nm", "local_centre_rad", "local_width_rad", "drift_nm", "drift_motions",
    # friction that grows with speed
    "drag_nms2",
    # load torque and disturbances
    "load_amplitude_nm", "load_phase_rad", "load_table", "offset_nm",
    "event_time_s", "event_duration_s", "event_peak_nm",
    "periodic_frequency_hz", "periodic_amplitude_nm", "periodic_phase_rad",
    "cogging_order", "cogging_amplitude_nm", "cogging_phase_rad",
    # the actuator
    "torque_gain", "torque_lag_s", "torque_limit_nm",
    # the coupling, and a third mass
    "gap_rad", "cubic_nm_rad3",
    "third_inertia_kgm2", "third_stiffness_nm_rad", "third_damping_nms",
    # the load's inertia: scale·J(θ + shift) + delta
    "inertia_delta_kgm2", "inertia_scale", "inertia_shift_rad",
    "substep_s",
    *PARAMETER_FIELDS,
)  # fmt: skip

#: Everything that does not change during a simulation.
PARAMETERS = np.dtype([*((name, np.float64) for name in _REALS), ("substeps", np.int64)], align=True)

#: Where the machine is. `motion_time_s` counts from the last start of a motion, negative before the first.
STATE = np.dtype(
    [
        *(
            (name, np.float64)
            for name in (
                "time_s", "motion_time_s", "motions", "true_torque_nm",
                "motor_rad", "motor_rad_s", "load_rad", "load_rad_s", "third_rad", "third_rad_s",
                *STATE_FIELDS,
            )
        ),
    ],
    align=True,
)  # fmt: skip


@compiled
def true_torque(p: Any, s: Any, command_nm: float, duration_s: float) -> Any:
    """Mean shaft torque over a sub-step: gain, clipping, then the current loop's lag, solved exactly."""
    wanted = p.torque_gain * command_nm
    wanted = min(max(wanted, -p.torque_limit_nm), p.torque_limit_nm)
    if p.torque_lag_s <= 0.0:
        s.true_torque_nm = wanted
        return wanted
    decay = np.exp(-duration_s / p.torque_lag_s)
    behind = s.true_torque_nm - wanted
    s.true_torque_nm = wanted + behind * decay
    return wanted + behind * (1.0 - decay) * p.torque_lag_s / duration_s


@compiled
def dry_friction(p: Any, s: Any, angle: float, speed: float, direction: float) -> Any:
    """Level of dry friction on the motor shaft, never negative: by direction, Stribeck, tight spot, drift."""
    level = p.coulomb_positive_nm if direction > 0.0 else p.coulomb_negative_nm
    if p.stribeck_rise_nm != 0.0:
        level += p.stribeck_rise_nm * np.exp(-((speed / p.stribeck_speed_rad_s) ** 2))
    if p.local_friction_nm != 0.0:
        away = angle - p.local_centre_rad
        away -= 2 * np.pi * np.round(away / (2 * np.pi))  # a tight spot of the shaft comes back every turn
        if abs(away) < 0.5 * p.local_width_rad:
            level += p.local_friction_nm * 0.5 * (1.0 + np.cos(2 * np.pi * away / p.local_width_rad))
    if p.drift_nm != 0.0:
        level += p.drift_nm * min(max(s.motions - 1.0, 0.0) / max(p.drift_motions - 1.0, 1.0), 1.0)
    return max(level, 0.0)


@compiled
def sliding_direction(p: Any, s: Any, angle: float, speed: float, others_nm: float) -> Any:
    """Which way the motor shaft slides: +1 or -1; 0 where dry friction holds it against the other torques."""
    if speed != 0.0:
        return np.sign(speed)
    direction = np.sign(others_nm)
    return 0.0 if abs(others_nm) <= dry_friction(p, s, angle, 0.0, direction) else direction


@compiled
def rest_on_reversal(p: Any, s: Any, speed: float, direction: float) -> Any:
    """The speed at the end of a sub-step: dry friction stops a shaft, it never turns it back."""
    return (
        0.0 if speed * direction < 0.0 and dry_friction(p, s, s.motor_rad, 0.0, -direction) > 0.0 else speed
    )


@compiled
def speed_friction(p: Any, speed: float) -> Any:
    """Viscous friction and windage on the motor shaft."""
    return -(p.rotor_viscous_nms + p.drag_nms2 * abs(speed)) * speed


@compiled
def motor_disturbance(p: Any, time_s: float, angle: float) -> Any:
    """Bias, cogging (locked to the motor angle) and a disturbance of fixed frequency."""
    torque = p.offset_nm
    if p.cogging_amplitude_nm != 0.0:
        torque += p.cogging_amplitude_nm * np.sin(p.cogging_order * angle + p.cogging_phase_rad)
    if p.periodic_amplitude_nm != 0.0:
        torque += p.periodic_amplitude_nm * np.sin(
            2 * np.pi * p.periodic_frequency_hz * time_s + p.periodic_phase_rad
        )
    return torque


@compiled
def load_disturbance(p: Any, table: Any, motion_time_s: float, angle: float) -> Any:
    """Load torque over the load angle, and one event at a time in the motion (a raised-cosine pulse)."""
    torque = 0.0
    if p.load_table != 0.0:
        torque += read_profile(table, angle)[0]
    if p.load_amplitude_nm != 0.0:
        torque += p.load_amplitude_nm * np.sin(angle + p.load_phase_rad)
    if p.event_peak_nm != 0.0:
        share = (motion_time_s - p.event_time_s) / p.event_duration_s
        if 0.0 < share < 1.0:
            torque += p.event_peak_nm * 0.5 * (1.0 - np.cos(2 * np.pi * share))
    return torque


@compiled
def coupling_torque(p: Any, twist: float, twist_speed: float) -> Any:
    """Torque that the coupling takes from the motor and gives to the load; with play it can only push."""
    if p.gap_rad == 0.0:
        return (p.stiffness_nm_rad + p.cubic_nm_rad3 * twist**2) * twist + p.damping_nms * twist_speed
    side = np.sign(twist)
    wind_up = abs(twist) - 0.5 * p.gap_rad
    if wind_up <= 0.0:
        return 0.0
    spring = (p.stiffness_nm_rad + p.cubic_nm_rad3 * wind_up**2) * wind_up
    return side * max(spring + p.damping_nms * side * twist_speed, 0.0)


@compiled
def third_mass_torque(p: Any, twist: float, twist_speed: float) -> Any:
    """Torque that the load passes on to the mass behind it."""
    return p.third_stiffness_nm_rad * twist + p.third_damping_nms * twist_speed


@compiled
def load_inertia(p: Any, table: Any, angle: float) -> Any:
    """J_l (kg·m²) and dJ_l/dθ at a load angle."""
    inertia, slope = read_profile(table, angle + p.inertia_shift_rad)
    return p.inertia_scale * inertia + p.inertia_delta_kgm2, p.inertia_scale * slope
