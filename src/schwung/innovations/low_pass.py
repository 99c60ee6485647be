"""Butterworth's low-pass without lag."""

from __future__ import annotations

import numpy as np
from scipy.fft import dst, idst

from schwung.motion import Array


def low_passed(values: Array, edge: float, order: int) -> Array:
    """Signals (n, …) passed through a Butterworth filter there and back; `edge`: share of the highest frequency, 0…1.

    The gain is that of the bilinear transform, 1/(1 + (tan πf/tan πf_c)^(2·order)) for both ways. A signal goes on
    beyond either end as its own reflection about the end point, so that it is a straight line and a sine series.
    """
    n = values.shape[0]
    if n < 3:
        return values
    along = np.linspace(0.0, 1.0, n).reshape(-1, *(1,) * (values.ndim - 1))
    line = values[:1] + (values[-1:] - values[:1]) * along
    frequency = np.arange(1, n - 1) / (2 * (n - 1))
    gain = 1 / (1 + (np.tan(np.pi * frequency) / np.tan(np.pi * edge / 2)) ** (2 * order))
    sines = dst((values - line)[1:-1], type=1, axis=0) * gain.reshape(-1, *(1,) * (values.ndim - 1))
    result = line
    result[1:-1] += idst(sines, type=1, axis=0)
    return np.asarray(result)
