"""Filters without lag, by the spectrum of a whole run."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schwung.motion import Array

#: Of the zero-phase low-pass, 1/(1 + (f/f_c)^ORDER).
ORDER = 8

Trend = Literal["keep", "slope", "drop"]


class Spectrum:
    """Zero-phase filters for signals of one length, by FFT with the ends mirrored about their last values."""

    def __init__(self, samples: int, rate_hz: float, pad_s: float) -> None:
        self.samples, self.rate_hz = samples, rate_hz
        self.pad = min(samples - 1, max(8, round(pad_s * rate_hz)))
        size = samples + 2 * self.pad
        self.size = 1 << (size - 1).bit_length() if size < 4096 else -(-size // 1024) * 1024
        self.frequency_hz = np.fft.rfftfreq(self.size, 1 / rate_hz)
        self.omega = 2j * np.pi * self.frequency_hz

    def low_pass(self, cutoff_hz: float) -> Array:
        """Gain of the low-pass at each line."""
        return np.asarray(1 / (1 + (self.frequency_hz / cutoff_hz) ** ORDER))

    def apply(self, values: Array, gain: NDArray[Any], trend: Trend = "keep") -> Array:
        """Signals (…, n) filtered by a gain (a low-pass, or its product with jω).

        The straight line from end to end would leap where the spectrum wraps around, so it goes apart: it is kept, or
        replaced by its slope (for a derivative), or dropped (for a gain of zero at rest).
        """
        first, last = values[..., :1], values[..., -1:]
        pad = self.pad
        before = 2 * first - values[..., pad:0:-1]
        after = 2 * last - values[..., -2 : -2 - pad : -1]
        long = np.concatenate([before, values, after], axis=-1)
        slope = (long[..., -1:] - long[..., :1]) / (long.shape[-1] - 1)
        ramp = long[..., :1] + slope * np.arange(long.shape[-1])
        flat = np.fft.irfft(np.fft.rfft(long - ramp, self.size, axis=-1) * gain, self.size, axis=-1)
        here = slice(pad, pad + self.samples)
        line = {"keep": ramp[..., here], "slope": slope * self.rate_hz, "drop": 0.0}[trend]
        return np.asarray(flat[..., here] + line)
