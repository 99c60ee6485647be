"""The physics that a plain two-mass belief leaves out: compiled equations of every term.

One room for them all: the closed-loop simulation drives them, and `schwung explain` fits them. Parameters are those of
`effects`. Dry friction is regularised as tanh(ω/ω_s).
"""

from __future__ import annotations

import numpy as np

from schwung.compiled import inlined
from schwung.drivetrain.effects import Effects


@inlined
def drift(e: Effects, share: float) -> float:
    """What dry friction has gained (N·m) after a share of the session, 0…1: evenly, or settling."""
    if abs(e.drift_settling) < 1e-3:
        return e.drift_nm * share
    return float(e.drift_nm * np.expm1(-e.drift_settling * share) / np.expm1(-e.drift_settling))


@inlined
def bump(share: float, sharpness: float) -> float:
    """A raised cosine over 0…1 to a power: 1 in the middle, 0 at the ends and beyond."""
    if not 0.0 < share < 1.0:
        return 0.0
    height = 0.5 * (1.0 - np.cos(2.0 * np.pi * share))
    return float(height if sharpness == 1.0 else height**sharpness)


@inlined
def dry_friction(e: Effects, angle: float, speed: float, share: float) -> float:
    """Level of dry friction on the motor (N·m, not negative): direction, Stribeck, tight spot, drift.

    `share`: how far through the session the run is, 0…1.
    """
    level = e.coulomb_positive_nm if speed > 0.0 else e.coulomb_negative_nm
    level += drift(e, share)
    if e.stribeck_rise_nm != 0.0:
        ratio = abs(speed) / e.stribeck_speed_rad_s
        level += e.stribeck_rise_nm * np.exp(-(ratio**e.stribeck_exponent))
    if e.local_friction_nm != 0.0:
        away = angle - e.local_centre_rad
        away -= 2.0 * np.pi * np.round(away / (2.0 * np.pi))  # a tight spot comes back every turn
        level += e.local_friction_nm * bump(0.5 + away / e.local_width_rad, e.local_sharpness)
    return max(level, 0.0)


@inlined
def smooth_torque(e: Effects, angle: float, speed: float, time: float, phase: float, share: float) -> float:
    """The same but dry friction; `time`: since the run began (s); `phase`: of the periodic disturbance then (rad)."""
    torque = e.offset_nm - (e.viscous_nms + e.drag_nms2 * abs(speed)) * speed
    torque += share * (e.offset_drift_nm - e.viscous_drift_nms * speed)
    torque -= 0.5 * e.viscous_difference_nms * abs(speed)
    if e.cogging_amplitude_nm != 0.0:
        torque += e.cogging_amplitude_nm * np.sin(e.cogging_order * angle + e.cogging_phase_rad)
    if e.cogging_second_nm != 0.0:
        torque += e.cogging_second_nm * np.sin(2.0 * e.cogging_order * angle + e.cogging_second_phase_rad)
    if e.periodic_amplitude_nm != 0.0:
        torque += e.periodic_amplitude_nm * np.sin(2.0 * np.pi * e.periodic_frequency_hz * time + phase)
    return torque


@inlined
def motor_torque(
    e: Effects, angle: float, speed: float, time: float, phase: float, share: float, smoothing: float
) -> float:
    """What friction and disturbances add to the motor's torque (N·m; positive accelerates).

    `smoothing`: speed within which dry friction changes sign (rad/s); the rest as `smooth_torque` takes it.
    """
    rubbing = dry_friction(e, angle, speed, share) * float(np.tanh(speed / smoothing))
    return smooth_torque(e, angle, speed, time, phase, share) - rubbing


@inlined
def load_torque(e: Effects, angle: float, speed: float, motion_time: float) -> float:
    """What acts on the load (N·m): viscous friction and drag, a torque over its angle, springs at its ends, one event
    at a time in the motion."""
    torque = -(e.load_viscous_nms + e.load_drag_nms2 * abs(speed)) * speed
    if e.end_high_nm_rad != 0.0:
        torque -= e.end_high_nm_rad * max(angle - e.end_high_rad, 0.0)
    if e.end_low_nm_rad != 0.0:
        torque += e.end_low_nm_rad * max(e.end_low_rad - angle, 0.0)
    if e.load_amplitude_nm != 0.0:
        torque += e.load_amplitude_nm * np.sin(angle + e.load_phase_rad)
    if e.event_peak_nm != 0.0:
        torque += e.event_peak_nm * bump(
            (motion_time - e.event_time_s) / e.event_duration_s, e.event_sharpness
        )
    return torque


@inlined
def encoder_off(e: Effects, angle: float) -> tuple[float, float]:
    """What an encoder reports too much at an angle of the motor (rad), and by what share of the speed (rad/rad)."""
    turned = angle + e.eccentricity_phase_rad
    off, share = e.eccentricity_rad * np.sin(turned), e.eccentricity_rad * np.cos(turned)
    if e.harmonic_rad != 0.0:
        turned = e.harmonic_order * angle + e.harmonic_phase_rad
        off += e.harmonic_rad * np.sin(turned)
        share += e.harmonic_rad * e.harmonic_order * np.cos(turned)
    return off, share


@inlined
def stiffness_at(e: Effects, stiffness: float, angle: float) -> float:
    """Of the coupling at an angle of the motor (N·m/rad)."""
    if e.stiffness_share == 0.0:
        return stiffness
    return float(
        stiffness * (1.0 + e.stiffness_share * np.sin(e.stiffness_order * angle + e.stiffness_phase_rad))
    )


@inlined
def driven(e: Effects, angle: float) -> tuple[float, float]:
    """To which angle an angle of the motor drives the coupling (rad), and how much further by each radian more.

    By that factor the motor feels the coupling's torque: no gear makes power (virtual work).
    """
    driven, ratio = angle, 1.0
    if e.kinematic_rad != 0.0:
        turned = e.kinematic_order * angle + e.kinematic_phase_rad
        driven += e.kinematic_rad * np.sin(turned)
        ratio += e.kinematic_rad * e.kinematic_order * np.cos(turned)
    if e.kinematic_second_rad != 0.0:
        turned = 2.0 * e.kinematic_order * angle + e.kinematic_second_phase_rad
        driven += e.kinematic_second_rad * np.sin(turned)
        ratio += 2.0 * e.kinematic_second_rad * e.kinematic_order * np.cos(turned)
    return float(driven), float(ratio)


@inlined
def coupling_torque(e: Effects, stiffness: float, damping: float, twist: float, twist_speed: float) -> float:
    """What the coupling takes from the motor and gives to the load (N·m). With play it can only push."""
    if e.gap_rad <= 0.0:
        return (stiffness + e.cubic_nm_rad3 * twist * twist) * twist + damping * twist_speed
    wound = abs(twist) - 0.5 * e.gap_rad
    if wound <= 0.0:
        return 0.0
    side = 1.0 if twist > 0.0 else -1.0
    push = (stiffness + e.cubic_nm_rad3 * wound * wound) * wound + damping * side * twist_speed
    return side * max(push, 0.0)


@inlined
def wound_up(e: Effects, twist: float) -> float:
    """How far the coupling is wound up beyond its play (rad)."""
    return twist - min(max(twist, -0.5 * e.gap_rad), 0.5 * e.gap_rad)


@inlined
def third_torque(e: Effects, twist: float, twist_speed: float, load_speed: float) -> float:
    """What the load passes on to the third mass behind it (N·m)."""
    stiffer = e.third_inertia_kgm2 * e.third_speed_share * load_speed**2
    return (e.third_stiffness_nm_rad + stiffer) * twist + e.third_damping_nms * twist_speed
