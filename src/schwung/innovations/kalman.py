"""Kalman's filter and the likelihood that it gives, compiled.

States have three, five or seven entries. With their number known when it is compiled, a loop over them is none any
more: the filter is three times as fast, and of the five that most machines have so again, see `five_states`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from schwung.compiled import compiled_or, inlined
from schwung.innovations import five_states, plain
from schwung.innovations.five_states import angle_updated, speed_updated
from schwung.innovations.values import Filtered, System
from schwung.motion import Array

#: Of the rigid machine, and of the flexible one with a further mass: angles, speeds, the torque's error.
SIZES = (3, 7)


@inlined
def begun(system: System, x: Array, p: Array, size: int) -> None:
    """The first state and its covariance, into x and p."""
    for i in range(size):
        x[i] = system.first[i]
        p[i, :] = 0.0
        p[i, i] = system.spread[i] ** 2


@inlined
def _outer(p: Array, one: Array, power: float, size: int) -> None:
    """Add power · one·oneᵀ to p, of the first so many states."""
    for i in range(size):
        for j in range(size):
            p[i, j] += power * one[i] * one[j]


@inlined
def _set_apart(system: System, k: int, p: Array, along: Array, size: int) -> None:
    """Add to p what torques do that act within step k alone."""
    phi, noise, apart = system.transition, system.noise, system.apart[k]
    if apart[0] > 0.0:
        _outer(p, phi[k, :, size - 1], apart[0], size - 1)
        _outer(p, noise[k], apart[0], size - 1)
    if apart[1] > 0.0:
        _outer(p, system.on_load[k, 0], apart[1], size - 1)
        _outer(p, system.on_load[k, 1], apart[1], size - 1)
    if apart[2] > 0.0:
        for i in range(size - 1):
            along[i] = phi[k, i, size - 1] + noise[k, i]
        _outer(p, along, apart[2], size - 1)


@inlined
def carried(system: System, k: int, x: Array, p: Array, ahead: Array, half: Array, size: int) -> None:
    """x and p over step k: Φ x + forcing; Φ p Φᵀ + noise·noiseᵀ·power, what torques do that are the step's alone, and
    what an open contact does."""
    phi, noise, power, last = system.transition, system.noise, system.power[k], size - 1
    for i in range(last):
        moved = system.forcing[k, i]
        for j in range(size):
            moved += phi[k, i, j] * x[j]
        ahead[i] = moved
        for j in range(size):
            onto = 0.0
            for c in range(size):
                onto += phi[k, i, c] * p[c, j]
            half[i, j] = onto
    for i in range(last):
        x[i] = ahead[i]
        for j in range(i + 1):
            both = noise[k, i] * noise[k, j] * power
            for c in range(size):
                both += half[i, c] * phi[k, j, c]
            p[i, j] = p[j, i] = both
    x[last] = system.forcing[k, last]
    for i in range(size):
        p[i, last] = p[last, i] = noise[k, i] * noise[k, last] * power
    _outer(p, system.open_contact[k], 1.0, size)
    _set_apart(system, k, p, ahead, size)


@inlined
def updated(
    system: System,
    k: int,
    x: Array,
    p: Array,
    gain: Array,
    row: Array,
    errors: Array,
    spreads: Array,
    size: int,
) -> None:
    """x and p after both samples at k; innovations, variances and gains are left in errors, spreads, gain (2, s)."""
    measured, variances = system.measured, system.variances
    for m in range(2):
        # below zero by rounding, where nearly nothing is noise
        spreads[m] = max(p[m, m], 0.0) + variances[k, m]
        errors[m] = measured[k, m] - x[m]
        for i in range(size):
            gain[m, i], row[i] = p[i, m] / spreads[m], p[m, i]
        for i in range(size):
            x[i] += gain[m, i] * errors[m]
            for j in range(i + 1):
                p[i, j] = p[j, i] = p[i, j] - gain[m, i] * row[j]
        p[m, m] = max(gain[m, m] * variances[k, m], 1e-300)


def filter_of(size: int) -> Callable[[System], Filtered]:
    """The filter of so many states, in arrays."""

    @compiled_or(plain.filtered)
    def kalman_filter(system: System) -> Filtered:
        count = system.measured.shape[0]
        errors, spreads = np.empty((count, 2)), np.empty((count, 2))
        gains = np.empty((count, 2, size))
        states, covariances = np.empty((count, size)), np.empty((count, size, size))
        x, p = np.empty(size), np.empty((size, size))
        row, ahead, half = np.empty(size), np.empty(size), np.empty((size, size))
        begun(system, x, p, size)
        for k in range(count):
            if k > 0:
                carried(system, k - 1, x, p, ahead, half, size)
            updated(system, k, x, p, gains[k], row, errors[k], spreads[k], size)
            for i in range(size):
                states[k, i] = x[i]
                for j in range(size):
                    covariances[k, i, j] = p[i, j]
        return Filtered(errors, spreads, gains, states, covariances)

    return kalman_filter


def deviance_of(size: int) -> Callable[[System], tuple[float, float]]:
    """`deviance` of so many states, in arrays."""

    @compiled_or(plain.deviance)
    def kalman_deviance(system: System) -> tuple[float, float]:
        measured, variances = system.measured, system.variances
        count = measured.shape[0]
        x, p = np.empty(size), np.empty((size, size))
        row, ahead, half = np.empty(size), np.empty(size), np.empty((size, size))
        begun(system, x, p, size)
        logs = squares = 0.0
        for k in range(count):
            if k > 0:
                carried(system, k - 1, x, p, ahead, half, size)
            for m in range(2):
                spread = max(p[m, m], 0.0) + variances[k, m]
                error = measured[k, m] - x[m]
                for i in range(size):
                    row[i] = p[m, i]
                for i in range(size):
                    gain = row[i] / spread
                    x[i] += gain * error
                    for j in range(i + 1):
                        p[i, j] -= gain * row[j]
                        p[j, i] = p[i, j]
                p[m, m] = max(row[m] / spread * variances[k, m], 1e-300)
                logs += np.log(spread)
                squares += error * error / spread
        return logs, squares

    return kalman_deviance


@compiled_or(plain.filtered)
def _filter_of_five(system: System) -> Filtered:
    measured, variances = system.measured, system.variances
    count = measured.shape[0]
    errors, spreads = np.empty((count, 2)), np.empty((count, 2))
    gains = np.empty((count, 2, 5))
    states, covariances = np.empty((count, 5)), np.empty((count, 5, 5))
    x, p = five_states.begun(system)
    for k in range(count):
        if k > 0:
            x, p = five_states.carried(system, k - 1, x, p)
        x, p, errors[k, 0], spreads[k, 0], gain = angle_updated(x, p, measured[k, 0], variances[k, 0])
        five_states.kept(gain, gains[k, 0])
        x, p, errors[k, 1], spreads[k, 1], gain = speed_updated(x, p, measured[k, 1], variances[k, 1])
        five_states.kept(gain, gains[k, 1])
        five_states.kept(x, states[k])
        five_states.kept_whole(p, covariances[k])
    return Filtered(errors, spreads, gains, states, covariances)


@compiled_or(plain.deviance)
def _deviance_of_five(system: System) -> tuple[float, float]:
    measured, variances = system.measured, system.variances
    x, p = five_states.begun(system)
    logs = squares = 0.0
    for k in range(measured.shape[0]):
        if k > 0:
            x, p = five_states.carried(system, k - 1, x, p)
        x, p, error, spread, _ = angle_updated(x, p, measured[k, 0], variances[k, 0])
        x, p, late, wide, _ = speed_updated(x, p, measured[k, 1], variances[k, 1])
        logs += np.log(spread) + np.log(wide)
        squares += error * error / spread + late * late / wide
    return logs, squares


_FILTERS = {size: filter_of(size) for size in SIZES} | {5: _filter_of_five}
_DEVIANCES = {size: deviance_of(size) for size in SIZES} | {5: _deviance_of_five}


def filtered(system: System) -> Filtered:
    """Kalman's filter."""
    return _FILTERS[system.first.size](system)


def deviance(system: System) -> tuple[float, float]:
    """Σ log of the innovations' variances, and Σ innovation²/variance: `filtered`, of which nothing else is kept."""
    return _DEVIANCES[system.first.size](system)
