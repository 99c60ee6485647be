"""Frequency response of a machine: the two-mass model with its frictions, open loop and within the cascade.

method.md (1)–(3). With s = j2πf, Z = J_l s + b_l the load and c = b + k/s the coupling,

    Y = T_m/ω_r = J_r s + b_r + c Z / (c + Z)          rigid (c → ∞): Y = (J_r + J_l) s + b_r + b_l

and with the cascade T_c = C (K_pp (θ* − θ_r) − ω_r), C = K_ps (1 + 1/(T_n s)), T_m = T_c + T_add,

    ω_r / T_add = 1 / (Y + C (1 + K_pp/s)).

Continuous time: the drive's sampling (125 µs) is neglected. The load stands at one angle, so the terms with
J_l' vanish. Inertias J_l (kg·m²) and frequencies (Hz) are positive numbers or arrays that broadcast against
each other; results have the broadcast shape; whatever is not positive is an InputError.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.motion import Array

ComplexArray = NDArray[np.complex128]


def _positive(name: str, values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=float)
    if not np.all(np.isfinite(array) & (array > 0)):
        raise InputError(name, "is not a positive number", f"Give {name} above 0.")
    return array


def _laplace(frequency_hz: ArrayLike) -> ComplexArray:
    return np.asarray(2j * np.pi * _positive("frequency_hz", frequency_hz))


def motor_to_load(machine: Machine, inertia_kgm2: ArrayLike, frequency_hz: ArrayLike) -> ComplexArray:
    """ω_l/ω_r: how the load's speed follows the motor's (1)."""
    s = _laplace(frequency_hz)
    load = _positive("inertia_kgm2", inertia_kgm2) * s + machine.load.viscous_friction_nms
    if machine.coupling is None:
        return np.ones_like(load)
    coupling = machine.coupling.damping_nms * s + machine.coupling.stiffness_nm_rad  # c·s: finite at low f
    return np.asarray(coupling / (coupling + load * s))


def _torque_per_speed(machine: Machine, inertia_kgm2: ArrayLike, frequency_hz: ArrayLike) -> ComplexArray:
    """Y = T_m/ω_r of the open loop, N·m·s/rad."""
    s = _laplace(frequency_hz)
    load = np.asarray(inertia_kgm2) * s + machine.load.viscous_friction_nms
    motor = machine.motor.inertia_kgm2 * s + machine.motor.viscous_friction_nms
    return np.asarray(motor + motor_to_load(machine, inertia_kgm2, frequency_hz) * load)


def _controller(machine: Machine, s: ComplexArray) -> ComplexArray:
    """C = K_ps (1 + 1/(T_n s)). Raises InputError where the machine has no [control]."""
    control = machine.required_control()
    return np.asarray(control.speed_gain_nms * (1 + 1 / (control.speed_integral_time_s * s)))


def torque_to_speed(machine: Machine, inertia_kgm2: ArrayLike, frequency_hz: ArrayLike) -> ComplexArray:
    """ω_r/T_m of the open loop (3), frictions included, rad/s per N·m."""
    return np.asarray(1 / _torque_per_speed(machine, inertia_kgm2, frequency_hz))


def injection_to_speed(machine: Machine, inertia_kgm2: ArrayLike, frequency_hz: ArrayLike) -> ComplexArray:
    """ω_r/T_add of the closed loop, rad/s per N·m. Raises InputError where the machine has no [control]."""
    s = _laplace(frequency_hz)
    feedback = _controller(machine, s) * (1 + machine.required_control().position_gain_per_s / s)
    return np.asarray(1 / (_torque_per_speed(machine, inertia_kgm2, frequency_hz) + feedback))


def injection_to_torque(machine: Machine, inertia_kgm2: ArrayLike, frequency_hz: ArrayLike) -> ComplexArray:
    """T_m/T_add: the total motor torque that an injected one results in, the controller having answered."""
    speed = injection_to_speed(machine, inertia_kgm2, frequency_hz)
    return np.asarray(speed * _torque_per_speed(machine, inertia_kgm2, frequency_hz))


def position_demand_to_position(
    machine: Machine, inertia_kgm2: ArrayLike, frequency_hz: ArrayLike, speed_feed_forward: float = 0.0
) -> ComplexArray:
    """θ_r/θ* of the closed loop; `speed_feed_forward`: the share (0…1) of demanded speed that is added."""
    s = _laplace(frequency_hz)
    drive = _controller(machine, s) * (
        machine.required_control().position_gain_per_s + speed_feed_forward * s
    )
    return np.asarray(injection_to_speed(machine, inertia_kgm2, frequency_hz) * drive / s)


def position_demand_to_speed(
    machine: Machine, inertia_kgm2: ArrayLike, frequency_hz: ArrayLike, speed_feed_forward: float = 0.0
) -> ComplexArray:
    """ω_r/θ* of the closed loop, 1/s; `speed_feed_forward` as in `position_demand_to_position`."""
    position = position_demand_to_position(machine, inertia_kgm2, frequency_hz, speed_feed_forward)
    return np.asarray(position * _laplace(frequency_hz))


def anti_resonance_hz(machine: Machine, inertia_kgm2: ArrayLike) -> Array:
    """√(k/J_l)/2π: where the load shakes and the motor stands still. Infinite for a rigid machine."""
    inertia = _positive("inertia_kgm2", inertia_kgm2)
    stiffness = np.inf if machine.coupling is None else machine.coupling.stiffness_nm_rad
    return np.asarray(np.sqrt(stiffness / inertia) / (2 * np.pi))


def resonance_hz(machine: Machine, inertia_kgm2: ArrayLike) -> Array:
    """√(k (1/J_r + 1/J_l))/2π: where motor and load swing against each other. Infinite if rigid."""
    inertia = _positive("inertia_kgm2", inertia_kgm2)
    stiffness = np.inf if machine.coupling is None else machine.coupling.stiffness_nm_rad
    return np.asarray(np.sqrt(stiffness * (1 / machine.motor.inertia_kgm2 + 1 / inertia)) / (2 * np.pi))


def disturbance_to_position_ratio(
    machine: Machine,
    inertia_kgm2: ArrayLike,
    *,
    distance_rad: float,
    duration_s: float,
    frequency_hz: ArrayLike,
    amplitude_nm: ArrayLike,
) -> Array:
    """DPR (7): speed of the injected sine over speed of the motion, each taken as one sine, closed loop.

    |T_add| |ω_r/T_add|(f_est) / (½ Δθ |ω_r/θ*|(f_RtR)), f_RtR = 1/(2 t_RtR). The paper prints position in the
    numerator and says speed in the text; with speed its 0.075 comes out. Wanted above 0.05 by the former
    method. Raises InputError where the machine has no [control] or an argument is not positive (distance:
    not zero).
    """
    distance = _positive("distance_rad", abs(distance_rad))
    motion_hz = 0.5 / _positive("duration_s", duration_s)
    amplitude = _positive("amplitude_nm", amplitude_nm)
    injected = amplitude * np.abs(injection_to_speed(machine, inertia_kgm2, frequency_hz))
    moved = distance / 2 * np.abs(position_demand_to_speed(machine, inertia_kgm2, motion_hz))
    return np.asarray(injected / moved)
