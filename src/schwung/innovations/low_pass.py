"""Filters without lag: Butterworth's low-pass, and Wiener's."""

from __future__ import annotations

import numpy as np
from scipy.fft import dst, idst

from schwung.motion import Array

#: Frequencies on either side that a signal's power is averaged over.
_BESIDE = 7


def low_passed(values: Array, edge: float, order: int) -> Array:
    """Signals (n, …) passed through a Butterworth filter there and back; `edge`: share of the highest frequency, 0…1.

    The gain is that of the bilinear transform, 1/(1 + (tan πf/tan πf_c)^(2·order)) for both ways. A signal goes on
    beyond either end as its own reflection about the end point, so that it is a straight line and a sine series.
    """
    if values.shape[0] < 3:
        return values
    line, sines = _in_sines(values)
    frequency = np.arange(1, values.shape[0] - 1) / (2 * (values.shape[0] - 1))
    gain = 1 / (1 + (np.tan(np.pi * frequency) / np.tan(np.pi * edge / 2)) ** (2 * order))
    return _from_sines(line, sines * gain.reshape(-1, *(1,) * (values.ndim - 1)))


def heard(values: Array, noise: float) -> Array:
    """What is expected of a signal (n,) in white noise of this deviation (Wiener): at each frequency the share of the
    power about it that is not noise's.

    Used as a regressor, a noisy signal meets its own noise in what it shall explain; its expectation does not.
    """
    if values.size < 4 * _BESIDE:
        return values
    line, sines = _in_sines(values)
    about = np.ones(2 * _BESIDE + 1)
    power = np.convolve(sines**2, about, "same") / np.convolve(np.ones_like(sines), about, "same")
    white = 2 * (values.size - 1) * noise**2  # of each of the unnormalised sines
    return _from_sines(line, sines * np.clip(1 - white / np.maximum(power, 1e-300), 0.0, 1.0))


def _in_sines(values: Array) -> tuple[Array, Array]:
    """The straight line between the ends, and the sine series (type 1, not normalised) of the rest."""
    along = np.linspace(0.0, 1.0, values.shape[0]).reshape(-1, *(1,) * (values.ndim - 1))
    line = values[:1] + (values[-1:] - values[:1]) * along
    return line, np.asarray(dst((values - line)[1:-1], type=1, axis=0))


def _from_sines(line: Array, sines: Array) -> Array:
    result = line.copy()
    result[1:-1] += idst(sines, type=1, axis=0)
    return np.asarray(result)
