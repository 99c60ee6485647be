"""A machine's load inertia at angles, with its slope and its bend."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Machine
from schwung.motion import Array

#: Over which slopes by the angle are taken.
DIFFERENCE_RAD = 1e-3


def inertia_of(machine: Machine, angle: Array) -> tuple[Array, Array, Array]:
    """J_l of a machine at angles (n,), its slope and its bend.

    Where there are more angles than differences within their range, those are worked out, and cubics go through
    them.
    """
    h, inertia_at = DIFFERENCE_RAD, machine.load_inertia_at
    if isinstance(machine.load_inertia, float):
        return inertia_at(angle), np.zeros_like(angle), np.zeros_like(angle)
    first, span = float(np.min(angle)), float(np.ptp(angle))
    if span < 2 * h * angle.size and np.isfinite(span):
        every = inertia_at(first + h * np.arange(-1.0, int(span / h) + 4.0))
        middle, steep = every[1:-1], (every[2:] - every[:-2]) / (2 * h)
        bent = (every[2:] - 2 * middle + every[:-2]) / h**2
        left = ((angle - first) / h).astype(int)
        x = (angle - first) / h - left
        found = _through(middle, steep, left, x), _through(steep, bent, left, x)
        return *found, bent[left] * (1 - x) + bent[left + 1] * x
    low, middle, high = inertia_at(angle - h), inertia_at(angle), inertia_at(angle + h)
    return middle, (high - low) / (2 * h), (high - 2 * middle + low) / h**2


def _through(values: Array, slopes: Array, left: NDArray[np.intp], x: Array) -> Array:
    """Cubics through values `DIFFERENCE_RAD` apart, of these slopes, at the share x of the way behind those `left`."""
    y = 1 - x
    ends = y**2 * (1 + 2 * x) * values[left] + x**2 * (1 + 2 * y) * values[left + 1]
    return np.asarray(ends + DIFFERENCE_RAD * x * y * (y * slopes[left] - x * slopes[left + 1]))
