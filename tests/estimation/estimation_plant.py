"""A two-mass machine under cascade control, integrated finely: exact physics that estimates are held to.

Written from the paper's equations alone, on purpose without the product's own profiles, simulation or
response. Machine of Table 1; its load inertia is inferred (a slider-crank), as the paper only draws it.
"""

from dataclasses import dataclass, replace
from math import ceil, cos, pi, sin, sqrt, tanh

import numpy as np
from numba import njit

from schwung.motion import Excitation, Motion
from schwung.session import Run, Session

ROTOR, ROTOR_FRICTION, STIFFNESS, DAMPING, LOAD_FRICTION, PEAK = 0.012, 0.2, 24963.0, 8.62, 0.1, 233.0
K_PP, K_PS, T_N = 60.0, 7.0, 8e-3
FREQUENCY = 50.0
AMPLITUDE = 0.2 * PEAK
SPEED_NOISE, TORQUE_NOISE = 0.02, 0.1
RAMP = 0.04
SMOOTH = 0.02  # rad/s, within which dry friction turns round
#: Longest step of the integration (s): a thirtieth of a radian of the fastest oscillation, 1440/s.
STEP = 2e-5


def crank(angle):
    """Inferred J_l(θ), kg·m²; scalar or array."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return 0.055 + 0.105 * (sine + 0.25 * sine * cosine / np.sqrt(1 - (0.25 * sine) ** 2)) ** 2


@njit(cache=True)
def _crank(angle):
    sine, cosine = sin(angle), cos(angle)
    root = sqrt(1 - 0.0625 * sine**2)
    rise = sine + 0.25 * sine * cosine / root
    slope = cosine + 0.25 * ((cosine**2 - sine**2) / root + 0.0625 * sine**2 * cosine**2 / root**3)
    return 0.055 + 0.105 * rise**2, 0.21 * rise * slope


@njit(cache=True)
def _third(u):
    if u <= 0 or u >= 1:
        return 0.0 if u <= 0 else 1.0
    if u < 1 / 3:
        return 2.25 * u * u
    return 0.25 + 1.5 * (u - 1 / 3) if u < 2 / 3 else 1 - 2.25 * (1 - u) ** 2


@njit(cache=True)
def _controller(t, theta, omega, integral, asked, sine, peak):
    """Following error of the speed (rad/s) and torque (N·m). `asked`, `sine`: as `record` makes them."""
    distance, duration, out, back = asked
    amplitude, frequency, phase, end = sine
    demand = distance * (_third((t - out) / duration) - _third((t - back) / duration))
    share = max(0.0, min(1.0, t / RAMP, (end - t) / RAMP))
    injected = amplitude * (1 - cos(pi * share)) / 2 * sin(2 * pi * frequency * t + phase)
    error = K_PP * (demand - theta) - omega
    return error, max(-peak, min(peak, K_PS * (error + integral / T_N) + injected))


@njit(cache=True)
def _rates(t, x, asked, sine, peak, inertia, rigid, hidden):
    """d/dt of motor angle and speed, load angle and speed, integral."""
    theta_r, omega_r, theta_l, omega_l, integral = x
    coulomb, viscous, gravity, load_torque = hidden
    error, torque = _controller(t, theta_r, omega_r, integral, asked, sine, peak)
    j, slope = _crank(theta_r if rigid else theta_l)
    if inertia > 0:
        j, slope = inertia, 0.0
    if rigid:
        drive = torque - (ROTOR_FRICTION + LOAD_FRICTION) * omega_r - slope * omega_r**2 / 2
        return omega_r, drive / (ROTOR + j), 0.0, 0.0, error
    shaft = DAMPING * (omega_r - omega_l) + STIFFNESS * (theta_r - theta_l)
    load = shaft - LOAD_FRICTION * omega_l - slope * omega_l**2 / 2
    load += load_torque - gravity * cos(theta_l)
    rub = (ROTOR_FRICTION + viscous) * omega_r + coulomb * tanh(omega_r / SMOOTH)
    return omega_r, (torque - shaft - rub) / ROTOR, omega_l, load / j, error


@njit(cache=True)
def _ahead(x, h, rates):
    """x + h·rates."""
    return (
        x[0] + h * rates[0],
        x[1] + h * rates[1],
        x[2] + h * rates[2],
        x[3] + h * rates[3],
        x[4] + h * rates[4],
    )


@njit(cache=True)
def _stepped(samples, rate, substeps, x, asked, sine, peak, inertia, rigid, hidden):
    """Motor angle, motor speed, torque, (n, 3), by Runge and Kutta's fourth order."""
    rows, h = np.empty((samples, 3)), 1 / (rate * substeps)
    for n in range(samples):
        rows[n, 0], rows[n, 1] = x[0], x[1]
        rows[n, 2] = _controller(n / rate, x[0], x[1], x[4], asked, sine, peak)[1]
        for m in range(substeps):
            t = n / rate + m * h
            a = _rates(t, x, asked, sine, peak, inertia, rigid, hidden)
            b = _rates(t + h / 2, _ahead(x, h / 2, a), asked, sine, peak, inertia, rigid, hidden)
            c = _rates(t + h / 2, _ahead(x, h / 2, b), asked, sine, peak, inertia, rigid, hidden)
            d = _rates(t + h, _ahead(x, h, c), asked, sine, peak, inertia, rigid, hidden)
            x = _ahead(_ahead(_ahead(_ahead(x, h / 6, a), h / 3, b), h / 3, c), h / 6, d)
    return rows


@dataclass(frozen=True)
class Hidden:
    """What the machine file does not mention: dry and viscous friction of the motor, weight of the load's arm."""

    coulomb: float = 0.0  # N·m
    viscous: float = 0.0  # N·m·s/rad
    gravity: float = 0.0  # N·m at the horizontal, as −gravity·cos θ on the load
    load_torque: float = 0.0  # N·m, constant, on the load


NOTHING = Hidden()


def record(
    motion,
    excitation=None,
    *,
    rate=4000.0,
    inertia=None,
    repeat=0,
    noise=1.0,
    rigid=False,
    peak=PEAK,
    hidden=NOTHING,
):
    """One run, sampled at `rate` with the feasibility study's noise times `noise`.

    `inertia`: None for the slider-crank, or a constant. Friction and the torque limit `peak` are always there;
    `hidden` adds to the two-mass machine what its file does not mention.
    """
    out, back = motion.start_time_s, motion.start_time_s + motion.duration_s + motion.dwell_s
    time = np.arange(round((back + motion.duration_s + motion.dwell_s) * rate) + 1) / rate
    asked = motion.distance_rad, motion.duration_s, out, back
    sine = 0.0, 0.0, 0.0, 0.0
    if excitation is not None:
        sine = (
            excitation.amplitude_nm,
            excitation.frequency_hz,
            excitation.phase_rad,
            float(excitation.end_s),
        )
    held = (
        0.0 if rigid else hidden.gravity - hidden.load_torque
    )  # at rest at angle 0, the integrator carries it
    start = 0.0, 0.0, -held / STIFFNESS, 0.0, held * T_N / K_PS
    theta, omega, torque = _stepped(
        time.size,
        float(rate),
        ceil(1 / (rate * STEP)),
        start,
        asked,
        sine,
        float(peak),
        float(inertia or 0.0),
        rigid,
        (hidden.coulomb, hidden.viscous, hidden.gravity, hidden.load_torque),
    ).T.copy()
    clean = Run(
        role="reference" if excitation is None else "excited",
        repeat=repeat,
        sample_rate_hz=rate,
        time_s=time,
        position_rad=theta,
        speed_rad_s=omega,
        torque_nm=torque,
        motion=motion,
        excitation=excitation,
        name=f"{'excited' if excitation else 'reference'} {repeat}",
    )
    return noisy(clean, repeat, noise)


def noisy(run, repeat, noise=1.0):
    """The same run once more, as another repeat: only the noise differs. Saves an integration."""
    phase = 0 if run.excitation is None else round(1e6 * run.excitation.phase_rad)
    rng = np.random.default_rng([repeat, run.role == "excited", *([phase] if phase else [])])
    return replace(
        run,
        repeat=repeat,
        speed_rad_s=run.speed_rad_s + noise * SPEED_NOISE * rng.normal(size=len(run)),
        torque_nm=run.torque_nm + noise * TORQUE_NOISE * rng.normal(size=len(run)),
    )


def motion_of(duration_s, distance_rad=pi):
    return Motion(distance_rad=distance_rad, duration_s=duration_s, start_time_s=0.1, dwell_s=0.1)


def sine_for(motion, frequency_hz=FREQUENCY, amplitude_nm=AMPLITUDE, phase_rad=0.0):
    return Excitation(
        frequency_hz=frequency_hz,
        amplitude_nm=amplitude_nm,
        phase_rad=phase_rad,
        ramp_s=RAMP,
        end_s=motion.total_s,
    )


def session_of(*runs, **attributes):
    return Session(
        runs=tuple(runs), created="2024-02-28T09:00:00+00:00", source="exact physics", **attributes
    )


def pair(duration_s, frequency_hz=FREQUENCY, **options):
    """Session of one reference and one excited run."""
    motion = motion_of(duration_s)
    return session_of(record(motion, **options), record(motion, sine_for(motion, frequency_hz), **options))


def phases(duration_s, frequency_hz=FREQUENCY, count=4, **options):
    """Session of excited runs with equally spaced phases, and no reference."""
    motion = motion_of(duration_s)
    return session_of(
        *(
            record(motion, sine_for(motion, frequency_hz, phase_rad=2 * pi * m / count), **options)
            for m in range(count)
        )
    )


def thinned(session, step):
    """The same session sampled `step` times more slowly."""

    def thin(run):
        return replace(
            run,
            sample_rate_hz=run.sample_rate_hz / step,
            **{
                name: getattr(run, name)[::step]
                for name in ("time_s", "position_rad", "speed_rad_s", "torque_nm")
            },
        )

    return replace(session, runs=tuple(thin(run) for run in session.runs))
