"""A ripple locked to the position, of any period: the spectrum over position of what a model leaves.

A ripple is a line in that spectrum, which no broad physics makes: where one stands far out of its surroundings, alike
in both directions of motion, it is one, however much else is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.explain.fit import Fitted, Problem
from schwung.explain.noise import usable
from schwung.motion import Array

#: A line has this many times the median of the orders about it, in energy, and in either direction so much of that.
PROMINENT, EITHER_WAY = 40.0, 0.15
#: The lowest order has this many periods within the travel: slower ones are a load over position.
LEAST_PERIODS = 4.0
#: Orders times samples that are looked at, and at a time.
_MOST, _CHUNK = 6e7, 2e6


@dataclass(frozen=True)
class Ripple:
    """A line: order (1/rad), amplitude (N·m) and phase (rad) of amplitude × sin(order·θ + phase)."""

    order: float
    amplitude_nm: float
    phase_rad: float
    prominence: float


@dataclass(frozen=True, eq=False)
class _Samples:
    """Compared samples of all runs; arrays (n,)."""

    position: Array
    speed: Array
    pulled: Array  # of the whitened residual, as a torque at each sample takes part in it


def ripple(problem: Problem, fitted: Fitted) -> Ripple | None:
    """The strongest line of a model's remainder over position; None where none stands out."""
    samples = _gathered(problem, fitted)
    span = float(np.ptp(samples.position)) if samples.position.size else 0.0
    prepared = problem.residuals.prepared
    if span <= 0:
        return None
    lowest, step = 2 * np.pi * LEAST_PERIODS / span, 1.2 / span
    highest = 2 * np.pi * prepared.band_hz / max(0.5 * prepared.peak_speed_rad_s, 1e-12)
    highest = min(highest, lowest + step * _MOST / samples.position.size)
    orders = np.arange(lowest, highest, step)
    if orders.size < 20:
        return None
    pulls, norms = _spectrum(problem, samples, orders)
    gains = np.abs(pulls) ** 2 / norms
    best = int(np.argmax(gains))
    around = gains[(orders > orders[best] / 2) & (orders < 2 * orders[best])]
    prominence = float(gains[best] / np.median(around))
    if prominence < PROMINENT:
        return None
    here = orders[best : best + 1]
    parts = []
    for side in (1.0, -1.0):
        at = side * samples.speed > 0
        if np.mean(at) < 0.1:
            continue
        pull, norm = _spectrum(
            problem, _Samples(samples.position[at], samples.speed[at], samples.pulled[at]), here
        )
        parts.append(complex(pull[0] / norm[0]))
    whole = complex(pulls[best] / norms[best])
    if any((part / whole).real < EITHER_WAY for part in parts):
        return None
    # the pull of sin is minus the imaginary part of Σ u e^{-jθ}; a torque on the motor lowers what is reported
    sine, cosine = whole.imag, -whole.real
    return Ripple(
        float(orders[best]), float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine)), prominence
    )


def _gathered(problem: Problem, fitted: Fitted) -> _Samples:
    """The whitened residual brought back through the whitening filter, to hold waves that are not filtered against."""
    positions, speeds, pulls, first = [], [], [], 0
    whitener = problem.whitener
    for run in problem.runs:
        valid = problem.residuals.valid(run)
        at = usable(valid)
        white = np.zeros(valid.size)
        white[at] = fitted.white[first : first + int(at.sum())]
        first += int(at.sum())
        pull = white.copy()
        for lag, coefficient in enumerate(whitener.coefficients, start=1):
            pull[:-lag] -= coefficient * white[lag:]
        moving = problem.residuals.moving(run)
        positions.append(moving.position_rad[at])
        speeds.append(moving.speed_rad_s[at])
        pulls.append(pull[at] / whitener.innovation_nm)
    return _Samples(np.concatenate(positions), np.concatenate(speeds), np.concatenate(pulls))


def _spectrum(problem: Problem, samples: _Samples, orders: Array) -> tuple[Array, Array]:
    """Σ u e^{-j order θ} within the band (complex), and Σ of the waves' whitened energy, at each order, (orders,)."""
    prepared, whitener = problem.residuals.prepared, problem.whitener
    step_s = prepared.every / prepared.rate_hz
    hertz = np.linspace(0.0, 1.5 * prepared.band_hz, 300)
    low = 1 / (1 + (hertz / prepared.band_hz) ** 8)
    lags = np.arange(1, whitener.coefficients.size + 1)
    response = 1 - np.exp(-2j * np.pi * np.multiply.outer(hertz, lags) * step_s) @ whitener.coefficients
    energy = np.abs(low * response / whitener.innovation_nm) ** 2 / 2
    pulls, norms = np.empty(orders.size, complex), np.empty(orders.size)
    size = max(1, int(_CHUNK / max(samples.position.size, 1)))
    for begin in range(0, orders.size, size):
        here = orders[begin : begin + size]
        passing = np.multiply.outer(here, np.abs(samples.speed) / (2 * np.pi))
        gain = np.interp(passing, hertz, low, right=0.0)
        turn = np.multiply.outer(here, samples.position)
        pulls[begin : begin + size] = np.sum(gain * samples.pulled * np.exp(-1j * turn), axis=1)
        norms[begin : begin + size] = np.sum(np.interp(passing, hertz, energy, right=0.0), axis=1)
    return pulls, np.maximum(norms, 1e-300)
