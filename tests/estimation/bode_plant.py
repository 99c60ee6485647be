"""A two-mass machine at standstill under a sampled cascade, stepped by matrix exponentials: exact, and independent.

Written from the equations alone. The drive runs at 8 kHz; the bus holds the injected torque for a millisecond and
samples angle and torque at its end. Reported torque passes a first-order filter, as in drives.
"""

from math import pi

import numpy as np
from numba import njit
from scipy.linalg import expm

from schwung.motion import Excitation
from schwung.session import Run, Session

ROTOR, ROTOR_FRICTION, STIFFNESS, DAMPING, LOAD_FRICTION = 0.012, 0.2, 24963.0, 8.62, 0.1
K_PP, K_PS, T_N = 60.0, 7.0, 20e-3
TICK = 125e-6
COUNT = 2 * pi / 2**20
LINES = np.unique(np.rint(np.geomspace(8, 400, 36) / 2)) * 2


def multisine(amplitude=4.0, lines=LINES, seed=1, periods=3, rate=1000.0, settle=1.0):
    """Random phases, base frequency 2 Hz; weak at low frequencies, where the axis would wander."""
    phases = np.random.default_rng(seed).uniform(-pi, pi, lines.size)
    amplitudes = amplitude * np.minimum(1, lines / 30)
    return Excitation(
        waveform="multisine",
        frequency_hz=2.0,
        amplitude_nm=float(amplitudes.sum()),
        frequencies_hz=tuple(lines.tolist()),
        amplitudes_nm=tuple(amplitudes.tolist()),
        phases_rad=tuple(phases.tolist()),
        ramp_s=0.05,
        settle_s=settle,
        end_s=0.1 + settle + periods / 2.0,
        hold_s=1 / rate,
    )


def sine(frequency, amplitude=20.0, steady=0.8, settle=1.0):
    """One line of a stepped sine."""
    end = 0.1 + settle + steady
    return Excitation(
        frequency_hz=frequency, amplitude_nm=amplitude, ramp_s=0.05, settle_s=settle, end_s=end, hold_s=1e-3
    )


def step_matrices(load, rotor=ROTOR, stiffness=STIFFNESS, damping=DAMPING):
    """x = (motor angle, motor speed, wind-up, load speed) after one tick of held torque."""
    k, b = stiffness, damping
    a = np.array([
        [0, 1, 0, 0],
        [0, -(b + ROTOR_FRICTION) / rotor, -k / rotor, b / rotor],
        [0, 1, 0, -1],
        [0, b / load, k / load, -(b + LOAD_FRICTION) / load],
    ])  # fmt: skip
    whole = np.zeros((5, 5))
    whole[:4, :4], whole[1, 4] = a, 1 / rotor
    moved = expm(whole * TICK)
    return moved[:4, :4], moved[:4, 4]


@njit(cache=True)
def _row(row, x):
    return row[0] * x[0] + row[1] * x[1] + row[2] * x[2] + row[3] * x[3]


@njit(cache=True)
def _stepped(ahead, push, added, ticks, count, share, latency_ticks):
    """Reported angle, torque and speed at the end of each sample's ticks, (n, 3)."""
    rows, past = np.empty((added.size, 3)), np.zeros(latency_ticks + 1)
    x, seen, speed, integral, reported = (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0
    for n in range(added.size):
        for _ in range(ticks):
            error = -K_PP * seen - speed
            motor = K_PS * error + integral + added[n]
            integral += K_PS * error * TICK / T_N
            x = (
                _row(ahead[0], x) + push[0] * motor,
                _row(ahead[1], x) + push[1] * motor,
                _row(ahead[2], x) + push[2] * motor,
                _row(ahead[3], x) + push[3] * motor,
            )
            before, seen = seen, (np.floor(x[0] / count) * count if count > 0 else x[0])
            speed += share * ((seen - before) / TICK - speed)
            reported += share * (motor - reported)
            for late in range(latency_ticks, 0, -1):
                past[late] = past[late - 1]
            past[0] = seen
        rows[n, 0], rows[n, 1], rows[n, 2] = past[latency_ticks], reported, speed
    return rows


def record(
    angle,
    load,
    excitation,
    *,
    rate=1000,
    count=COUNT,
    noise_nm=0.02,
    seed=0,
    filter_s=100e-6,
    latency_ticks=0,
    **plant,
):
    """One run, sampled at the end of each step; `latency_ticks`: the angle is reported so much later."""
    ahead, push = step_matrices(load, **plant)
    rng = np.random.default_rng(seed)
    time = np.arange(round((excitation.end_s + 0.1) * rate)) / rate
    added = excitation.torque(time)
    share = 1 - np.exp(-TICK / filter_s)
    ticks = round(1 / (rate * TICK))
    position, torque, speeds = _stepped(ahead, push, added, ticks, count, share, latency_ticks).T.copy()
    torque = torque + noise_nm * rng.normal(size=torque.size)
    return Run(
        role="excited",
        repeat=seed,
        sample_rate_hz=float(rate),
        time_s=time,
        position_rad=position + angle,
        speed_rad_s=speeds,
        torque_nm=torque,
        torque_added_nm=added,
        excitation=excitation,
        name=f"angle {angle:g}",
    )


def session(*runs):
    return Session(runs=tuple(runs), created="2026-01-01T00:00:00+00:00", source="exact physics")
