"""A two-mass machine under cascade control, integrated by scipy: exact physics that estimates are held to.

Written from method.md alone, on purpose without the product's own simulation or response.
"""

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from schwung.motion import Excitation, Motion
from schwung.session import Run, Session

ROTOR, ROTOR_FRICTION, STIFFNESS, DAMPING, LOAD_FRICTION, PEAK = 0.012, 0.2, 24963.0, 8.62, 0.1, 233.0
K_PP, K_PS, T_N = 60.0, 7.0, 8e-3
FREQUENCY = 50.0
AMPLITUDE = 0.2 * PEAK
SPEED_NOISE, TORQUE_NOISE = 0.02, 0.1


def crank(angle):
    """J_l(θ) of method.md (inferred)."""
    return 0.055 + 0.105 * _rise(angle) ** 2


def crank_slope(angle):
    step = 1e-6
    return (crank(angle + step) - crank(angle - step)) / (2 * step)


def _rise(angle):
    sine = np.sin(angle)
    return sine + 0.25 * sine * np.cos(angle) / np.sqrt(1 - (0.25 * sine) ** 2)


def record(
    motion, excitation=None, *, rate=4000.0, inertia=crank, slope=crank_slope, repeat=0, noise=True,
    clip=True, rigid=False,
):  # fmt: skip
    """One run of the machine, sampled at `rate` with the feasibility study's noise."""
    time = motion.time(rate)

    def controller(t, theta, omega, integral):
        demand = motion.demand(np.array([t])).position_rad[0]
        error = K_PP * (demand - theta) - omega
        torque = K_PS * (error + integral / T_N)
        if excitation is not None:
            torque += excitation.torque(np.array([t]))[0]
        return error, float(np.clip(torque, -PEAK, PEAK)) if clip else torque

    def two_mass(t, x):
        theta_r, omega_r, theta_l, omega_l, integral = x
        error, torque = controller(t, theta_r, omega_r, integral)
        shaft = DAMPING * (omega_r - omega_l) + STIFFNESS * (theta_r - theta_l)
        load = shaft - LOAD_FRICTION * omega_l - slope(theta_l) * omega_l**2 / 2
        rotor = torque - shaft - ROTOR_FRICTION * omega_r
        return [omega_r, rotor / ROTOR, omega_l, load / inertia(theta_l), error]

    def one_mass(t, x):
        theta, omega, _, _, integral = x
        error, torque = controller(t, theta, omega, integral)
        drive = torque - (ROTOR_FRICTION + LOAD_FRICTION) * omega - slope(theta) * omega**2 / 2
        return [omega, drive / (ROTOR + inertia(theta)), 0.0, 0.0, error]

    model = one_mass if rigid else two_mass
    solved = solve_ivp(model, (0.0, time[-1]), np.zeros(5), "RK45", time, rtol=1e-6, atol=1e-8, max_step=1e-3)
    theta, omega, _, _, integral = solved.y
    torque = np.array([controller(*row)[1] for row in zip(time, theta, omega, integral, strict=True)])
    rng = np.random.default_rng([repeat, excitation is not None, 7])
    level = 1.0 if noise else 0.0
    return Run(
        role="reference" if excitation is None else "excited",
        repeat=repeat,
        sample_rate_hz=rate,
        time_s=time,
        position_rad=theta,
        speed_rad_s=omega + level * SPEED_NOISE * rng.normal(size=time.size),
        torque_nm=torque + level * TORQUE_NOISE * rng.normal(size=time.size),
        motion=motion,
        excitation=excitation,
        name=f"run {repeat} {'excited' if excitation else 'reference'}",
    )


def motion_of(duration_s, **changes):
    return Motion(distance_rad=np.pi, duration_s=duration_s, start_time_s=0.1, dwell_s=0.1, **changes)


def sine_for(motion, frequency_hz=FREQUENCY, amplitude_nm=AMPLITUDE):
    return Excitation(frequency_hz=frequency_hz, amplitude_nm=amplitude_nm, ramp_s=0.04, end_s=motion.total_s)


def session_of(*runs, **attributes):
    return Session(
        runs=tuple(runs), created="2024-02-28T09:00:00+00:00", source="exact physics", **attributes
    )


def noisy_copy(run, repeat, seed):
    """The same motion once more: only the noise differs. Saves an integration."""
    rng = np.random.default_rng(seed)
    return replace(
        run,
        repeat=repeat,
        speed_rad_s=run.speed_rad_s + SPEED_NOISE * rng.normal(size=len(run)),
        torque_nm=run.torque_nm + TORQUE_NOISE * rng.normal(size=len(run)),
    )
