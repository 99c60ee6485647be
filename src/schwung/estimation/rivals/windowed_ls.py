"""Windowed least squares, "short-time linearly varying": the inertia is a straight line in time in each window.

Source: Chen et al., "short-time linearly varying" parameters of a mass-spring-damper system (2020), reference [4]
of the paper; stiffness there, inertia here. On the denoised signals the balance of the load is

    C = d(J_l ω_l)/dt = J (ω̇_l) + J̇ ((t − t_c) ω̇_l + ω_l),

linear in the inertia J at the window's middle t_c and in its slope J̇. The window is one period (rule of `common`),
the estimate belongs to its middle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.estimation.methods import Outcome, Task
from schwung.estimation.rivals.common import labelled, started
from schwung.estimation.rivals.loadside import LoadSide, load_side
from schwung.estimation.sdft import samples_per_window
from schwung.motion import Array

PERIODS = 1


@dataclass(frozen=True)
class WindowedLeastSquares:
    """Straight lines of inertia over time, by least squares in a sliding window."""

    name: str = "windowed_ls"
    needs_reference: bool = True

    def traces(self, task: Task) -> Outcome:
        """One fit per sample. Raises InputError as the denoised method does."""
        start, traces = started(task, self.name), []
        for pair, trace in zip(start.denoised, start.traces, strict=True):
            rate = pair.excited.sample_rate_hz
            load = load_side(task.machine, pair.torque_nm, pair.speed_rad_s, rate, task.frequency_hz)
            window = samples_per_window(rate, task.frequency_hz)
            inertia = sliding_line(load, window, 1 / rate)
            traces.append(labelled(trace, pair, task, inertia, age=(window - 1) / 2 / rate))
        return replace(start, traces=tuple(traces))


def sliding_line(load: LoadSide, window: int, step_s: float) -> Array:
    """Inertia in the middle of the window of so many samples that ends at each sample, (n,); NaN before.

    Normal equations from sums over the window: sums of x·tᵖ, t counted from the window's middle, are one
    correlation each.
    """
    torque, speed, acceleration = load.torque_nm, load.speed_rad_s, load.acceleration_rad_s2
    offset = (np.arange(window) - (window - 1) / 2) * step_s

    def total(values: Array, power: int) -> Array:
        return np.correlate(values, offset**power, "valid")

    # regressors: a for J, t·a + w for J̇
    level = total(acceleration**2, 0)
    mixed = total(acceleration**2, 1) + total(acceleration * speed, 0)
    slope = total(acceleration**2, 2) + 2 * total(acceleration * speed, 1) + total(speed**2, 0)
    right_level = total(torque * acceleration, 0)
    right_slope = total(torque * acceleration, 1) + total(torque * speed, 0)
    determinant = level * slope - mixed**2
    with np.errstate(divide="ignore", invalid="ignore"):
        inertia = (slope * right_level - mixed * right_slope) / determinant
    inertia[~(determinant > 1e-12 * level * slope)] = np.nan
    return np.concatenate([np.full(window - 1, np.nan), inertia])
