"""Torque over acceleration, the median of it: the way of the workshop, and of many drives' own autotuning.

Source: practice. Torque over acceleration, sample by sample on the load's side of the denoised signals, wherever
the acceleration is at least half its amplitude; the median over one period is the estimate. It is robust to
stray samples, and knows nothing of J̇.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.estimation.methods import Outcome, Task
from schwung.estimation.rivals.common import labelled, started
from schwung.estimation.rivals.loadside import load_side
from schwung.estimation.sdft import samples_per_window, sliding_dft
from schwung.motion import Array

#: Of the amplitude: slower accelerations say little about an inertia.
LEAST_ACCELERATION = 0.5
BLOCK = 20_000  # windows sorted at a time


@dataclass(frozen=True)
class AccelerationMedian:
    """Sliding median of torque over acceleration."""

    name: str = "acceleration_median"
    needs_reference: bool = True

    def traces(self, task: Task) -> Outcome:
        """Medians over one period. Raises InputError as the denoised method does."""
        start, traces = started(task, self.name), []
        for pair, trace in zip(start.denoised, start.traces, strict=True):
            rate = pair.excited.sample_rate_hz
            load = load_side(task.machine, pair.torque_nm, pair.speed_rad_s, rate, task.frequency_hz)
            acceleration = load.acceleration_rad_s2
            amplitude = np.abs(sliding_dft(acceleration, pair.time_s, rate, task.frequency_hz).phasor)
            large = np.abs(acceleration) > LEAST_ACCELERATION * np.nan_to_num(amplitude, nan=np.inf)
            ratio = np.where(large, load.torque_nm / np.where(large, acceleration, 1.0), np.nan)
            window = samples_per_window(rate, task.frequency_hz)
            inertia = sliding_median(ratio, window)
            traces.append(labelled(trace, pair, task, inertia, age=(window - 1) / 2 / rate))
        return replace(start, traces=tuple(traces))


def sliding_median(values: Array, window: int) -> Array:
    """Median of what is finite in the window that ends at each sample, (n,); NaN where there is nothing."""
    windows = np.lib.stride_tricks.sliding_window_view(values, window)
    medians = [_median(windows[first : first + BLOCK]) for first in range(0, len(windows), BLOCK)]
    return np.concatenate([np.full(window - 1, np.nan), *medians])


def _median(rows: Array) -> Array:
    """Median of what is finite in each row, (n,); NaN where there is nothing."""
    ordered = np.sort(rows, axis=1)  # NaN come last
    count = np.sum(np.isfinite(rows), axis=1)
    row = np.arange(count.size)
    low, high = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, rows.shape[1] - 1)
    return np.where(count > 0, (ordered[row, low] + ordered[row, high]) / 2, np.nan)
