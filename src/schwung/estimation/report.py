"""How late a drive reports its controller's torque, seen in the motion without the injection.

Of an injection that a bus holds, the torque is known as sent; the controller's share is as the drive reports it, a
tick or a filter late. A controller whose speed gain is K answers a ripple by −K ω~: reported δ late, that looks like
an inertia larger by K δ, the same at every angle, and no ripple can tell the two apart. The motion can: all of its
torque is the controller's, J_l is known but for that constant, and it turns round,

    T(t + δ) = J_r dω_r/dt + b_r ω_r + C      C = d(J_l ω_l)/dt − ½ J_l' ω_l² + b_l ω_l + friction + load torque

What is not known of J_l, friction and load torque is found beside δ. Before that, δ is taken to be anything up to the
lag of the speed that the same drive reports.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial import legendre

from schwung.drivetrain.machine import Machine
from schwung.estimation.balance import fade_in_and_out
from schwung.estimation.fit import CurveFit, Nuisance
from schwung.estimation.sampling import REPORTED_SPEED
from schwung.motion import Array
from schwung.session.model import Run

#: The motion is looked at below this share of the injected frequency.
BELOW = 0.5
#: What is not known of inertia and of load torque, as polynomials of the angle: their highest degrees.
DEGREE_INERTIA, DEGREE_TORQUE = 3, 7
#: A drive without any lag in what it reports is believed to this share of a sample.
PROMPT = 0.125
#: Motion and lag of the speed disagree beyond so many standard deviations.
DOUBT = 3.0


def speed_lag(runs: Sequence[Run], frequency_hz: float) -> Nuisance:
    """How far the reported speed lags behind the angle (s), in the motion of runs made ready."""
    top = bottom = left = 0.0
    rows = 0
    for run in runs:
        rate, seen = run.sample_rate_hz, run.extra.get(REPORTED_SPEED, run.speed_rad_s)
        moved = np.gradient(run.position_rad) * rate if seen is run.speed_rad_s else run.speed_rad_s
        low = _Slow(moved.size, rate, frequency_hz)
        off, turning = low(seen - moved), low(-np.gradient(moved) * rate)
        top, bottom, left = (
            top + float(off @ turning),
            bottom + float(turning @ turning),
            left + float(off @ off),
        )
        rows += off.size
    if not bottom > 0:
        return Nuisance(0.0, np.inf)
    lag = top / bottom
    return Nuisance(lag, float(np.sqrt(max(left - lag * top, 0.0) / max(rows - 1, 1) / bottom)))


def expected(lag: Nuisance, rate: float) -> Nuisance:
    """What the torque's lag may be: none, or as much as the speed's."""
    half = max(lag.value, 0.0) / 2 if lag.clear else 0.0
    return Nuisance(half, float(np.hypot(half, PROMPT / rate)))


def controller_lag(fit: CurveFit, machine: Machine, prior: Nuisance) -> Nuisance:
    """How late the controller's torque is reported beyond what was already taken off (s), from the mean motions."""
    design, wanted = [], []
    for load, ripple in zip(fit.loads, fit.ripples, strict=True):
        rate = ripple.sample_rate_hz
        low = _Slow(ripple.time_s.size, rate, ripple.frequency_hz)
        motor, speed, angle = machine.motor, load.speed_rad_s, load.angle_rad

        def rate_of(values: Array, rate: float = rate) -> Array:
            return np.gradient(values, axis=0) * rate

        inertia, slope = fit.inertia_at(angle), fit.inertia_at(angle, 1)
        known = motor.inertia_kgm2 * rate_of(ripple.speed_rad_s)
        known = known + motor.viscous_friction_nms * ripple.speed_rad_s
        known = known + rate_of(inertia * speed) - slope * speed**2 / 2
        known = known + machine.load.viscous_friction_nms * speed + -machine.load_torque_at(angle)
        x = (2 * angle - fit.basis.low_rad - fit.basis.high_rad) / (fit.basis.high_rad - fit.basis.low_rad)
        stretch = 2 / (fit.basis.high_rad - fit.basis.low_rad)
        shapes = legendre.legvander(x, DEGREE_INERTIA)
        bends = np.column_stack(
            [legendre.legval(x, legendre.legder(row)) for row in np.eye(DEGREE_INERTIA + 1)]
        )
        more = rate_of(shapes * speed[:, None]) - stretch * bends * speed[:, None] ** 2 / 2
        columns = np.column_stack(
            [-rate_of(ripple.torque_nm), more, speed, np.sign(speed), legendre.legvander(x, DEGREE_TORQUE)]
        )
        design.append(np.column_stack([low(column) for column in columns.T]))
        wanted.append(low(ripple.torque_nm - known))
    a, y = np.vstack(design), np.concatenate(wanted)
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    values, _, rank, _ = np.linalg.lstsq(a / scale, y, rcond=1e-9)
    left = y - a / scale @ values
    variance = float(left @ left) / max(y.size - rank, 1)
    inverse = np.linalg.pinv((a / scale).T @ (a / scale), rcond=1e-14)
    seen = Nuisance(float(values[0] / scale[0]), float(np.sqrt(variance * inverse[0, 0])) / float(scale[0]))
    return _both(seen, prior)


def unknown_answer(run: Run, machine: Machine) -> float:
    """What share of an injection that is held for h may hide in the controller's answer to its images, 0…1 (1σ).

    The rotor follows the staircase's corners by ΔT h/(2 J_r) B_2(x) at the share x of a step (Bernoulli's polynomial,
    1/√180 rms), and the controller by its speed gain K: not on average, but in its samples, and where in the step is
    not known (1/√12 of it). What of that is in phase with the torque no delay makes good.
    """
    assert run.excitation is not None  # held
    assert run.torque_added_nm is not None
    if machine.control is not None:
        gain = machine.control.speed_gain_nms
    else:
        torque, moved = np.diff(run.torque_nm - run.torque_added_nm), np.diff(run.speed_rad_s)
        gain = max(0.0, -float(torque @ moved) / max(float(moved @ moved), 1e-300))
    step = 1 / run.sample_rate_hz
    turned = 2 * np.pi * run.excitation.frequency_hz * step
    return float(gain * step / machine.motor.inertia_kgm2 * turned**2 / (2 * np.sqrt(180) * np.sqrt(12)))


def _both(seen: Nuisance, prior: Nuisance) -> Nuisance:
    """Mean by inverse variance; where motion and prior are too far apart, the motion holds what the model does not."""
    apart = abs(seen.value - prior.value)
    if not apart <= DOUBT * np.hypot(prior.std, seen.std):
        seen = replace(seen, std=float(np.hypot(seen.std, apart)))
    weights = np.array([seen.std, prior.std]) ** -2.0
    return Nuisance(
        float(weights @ [seen.value, prior.value] / weights.sum()), float(1 / np.sqrt(weights.sum()))
    )


class _Slow:
    """Real Fourier coefficients of a signal, faded at its ends, below BELOW of the injected frequency."""

    def __init__(self, n: int, rate: float, frequency_hz: float) -> None:
        f = np.fft.rfftfreq(n, 1 / rate)
        self.chosen = (f > 0) & (f < BELOW * frequency_hz)
        self.fade = fade_in_and_out(n, rate, frequency_hz)

    def __call__(self, values: Array) -> Array:
        spectrum = np.fft.rfft(values * self.fade)[self.chosen]
        return np.concatenate([spectrum.real, spectrum.imag])
