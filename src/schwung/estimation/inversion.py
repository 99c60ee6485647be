"""From torque and speed at one frequency to the load inertia: two-mass model turned round (equations 3 to 6).

(6) as printed adds terms of different units; both inversions here are derived from (3) afresh. With a rigid
machine both reduce to J_l = T/(jω ω_r) − J_r.
"""

from __future__ import annotations

import numpy as np

from schwung.drivetrain.machine import Coupling, Machine
from schwung.estimation.sdft import ComplexArray
from schwung.motion import Array


def invert_complex(
    machine: Machine, frequency_hz: float, torque_nm: ComplexArray, speed_rad_s: ComplexArray
) -> ComplexArray:
    """Complex J_l (kg·m²), (n,), from phasors of torque and speed; frictions included.

    The real part is the estimate. The imaginary part should vanish: a delay between the signals, a wrong
    friction, stiffness or damping shows there. NaN where the phasors are NaN or the speed is zero.
    """
    s = 2j * np.pi * frequency_hz
    motor, load = machine.motor, machine.load
    with np.errstate(divide="ignore", invalid="ignore"):
        behind_rotor = torque_nm / speed_rad_s - motor.inertia_kgm2 * s - motor.viscous_friction_nms
        if machine.coupling is not None:
            shaft = machine.coupling.damping_nms + machine.coupling.stiffness_nm_rad / s
            behind_rotor = 1 / (1 / behind_rotor - 1 / shaft)
        inertia = np.asarray((behind_rotor - load.viscous_friction_nms) / s, dtype=np.complex128)
    inertia[~np.isfinite(inertia)] = np.nan
    return inertia


def invert_magnitude(
    machine: Machine, frequency_hz: float, torque_nm: ComplexArray, speed_rad_s: ComplexArray
) -> Array:
    """J_l (kg·m²), (n,), from |ω_r|/|T|, frictions neglected, as the paper does.

    |G|² = g leads to a J² + c J + d = 0. Its two roots lie on either side of the inertia whose
    anti-resonance is at this frequency: both give the same magnitude, so that only the phase tells them
    apart. Root rule: of the real positive roots, the one whose model response G(J) is nearest to the
    measured complex ω_r/T. NaN where there is no such root: no inertia gives that magnitude with this
    coupling.
    """
    omega = 2 * np.pi * frequency_hz
    rotor = machine.motor.inertia_kgm2
    with np.errstate(divide="ignore", invalid="ignore"):
        measured = speed_rad_s / torque_nm
        if machine.coupling is None:
            inertia = 1 / (omega * np.abs(measured)) - rotor
            return np.where(np.isfinite(inertia), inertia, np.nan)
        roots = _roots(np.abs(measured) ** 2, omega, rotor, machine.coupling)
        response = two_mass_response(roots, omega, rotor, machine.coupling)
        distance = np.where(np.isfinite(roots) & (roots > 0), np.abs(response - measured), np.inf)
        distance[~np.isfinite(distance)] = np.inf
    best = np.argmin(distance, axis=0)
    column = np.arange(measured.size)
    return np.where(np.isfinite(distance[best, column]), roots[best, column], np.nan)


def two_mass_response(
    inertia_kgm2: Array, omega_rad_s: float, rotor_kgm2: float, coupling: Coupling
) -> ComplexArray:
    """G(jω) = ω_r/T_m without friction, equation 3, rad/s per N·m; same shape as `inertia_kgm2`."""
    s = 1j * omega_rad_s
    shaft = coupling.damping_nms * s + coupling.stiffness_nm_rad
    total = rotor_kgm2 + inertia_kgm2
    return np.asarray(
        (inertia_kgm2 * s**2 + shaft) / (rotor_kgm2 * inertia_kgm2 * s**3 + total * shaft * s),
        dtype=np.complex128,
    )


def _roots(gain_squared: Array, omega: float, rotor: float, coupling: Coupling) -> Array:
    """Both roots of the quadratic, (2, n), NaN where complex; written so as to stay exact for small a."""
    k, damping = coupling.stiffness_nm_rad, (coupling.damping_nms * omega) ** 2
    scaled = gain_squared * omega**2
    a = scaled * ((k - rotor * omega**2) ** 2 + damping) - omega**4
    c = 2 * scaled * rotor * (k * (k - rotor * omega**2) + damping) + 2 * k * omega**2
    d = scaled * rotor**2 * (k**2 + damping) - k**2 - damping
    q = -(c + np.copysign(np.sqrt(c**2 - 4 * a * d), c)) / 2
    return np.vstack([q / a, d / q])
