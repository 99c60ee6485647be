"""Sliding discrete Fourier transform at one frequency (paper, equations 8 to 10), for any samples per period.

Equation 8 is a recursion whose pole lies on the unit circle: rounding errors never decay. Here each window is
evaluated afresh by one FIR filter instead, so that nothing can drift; it costs N multiplications per sample.

Where N = f_s/f is whole, the filter is exactly the DFT bin of (8). Where it is not, the window has round(N)
samples and the filter is the least-squares fit of a sine and a constant over them: the same thing for whole
N, and exact for a sine plus a constant at any N, where a DFT bin would leak.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError
from schwung.motion import Array

ComplexArray = NDArray[np.complex128]

#: With fewer samples per period the window is too short to tell the sine from what is beside it.
MIN_SAMPLES_PER_PERIOD = 8


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One signal at one frequency; arrays (n,), NaN in the first `window - 1` samples.

    x(t) = mean + Re(phasor·e^{jωt}) in the window that ends at each sample, t the run's own time: phasors of
    signals with one time base may be divided by each other.
    """

    phasor: ComplexArray  # complex amplitude, unit of the signal
    mean: Array  # constant part of the window
    residual: Array  # rms of what sine and constant leave over, degrees of freedom counted
    window: int  # samples per window, round(f_s/f)


def samples_per_window(sample_rate_hz: float, frequency_hz: float) -> int:
    """Samples of one period, rounded. Raises InputError where they are too few."""
    if not (np.isfinite(frequency_hz) and frequency_hz > 0):
        raise InputError("frequency", f"is {frequency_hz} Hz", "Give a positive number.")
    count = round(sample_rate_hz / frequency_hz)
    if count < MIN_SAMPLES_PER_PERIOD:
        raise InputError(
            "sampling rate",
            f"{sample_rate_hz:g} Hz gives {sample_rate_hz / frequency_hz:.3g} samples per period of "
            f"{frequency_hz:g} Hz, too few to find an amplitude",
            f"Sample at {MIN_SAMPLES_PER_PERIOD * frequency_hz:g} Hz or faster, or inject a lower frequency.",
        )
    return count


def sliding_dft(values: Array, time_s: Array, sample_rate_hz: float, frequency_hz: float) -> Spectrum:
    """Amplitude and phase of `values` (n,) at a frequency (Hz), for the window that ends at each sample.

    Raises InputError when a period has fewer than 8 samples or the recording is shorter than a period.
    """
    window = samples_per_window(sample_rate_hz, frequency_hz)
    if values.size < window:
        raise InputError(
            "recording",
            f"of {values.size} samples is shorter than a period of {frequency_hz:g} Hz",
            "Record on.",
        )
    local = np.arange(1 - window, 1) / sample_rate_hz  # 0 at the window's last sample
    angle = 2 * np.pi * frequency_hz * local
    fit = np.linalg.pinv(np.column_stack([np.cos(angle), -np.sin(angle), np.ones(window)]))
    level = float(np.mean(values))  # taken off for the sake of rounding: positions may be many turns away
    centred = values - level
    real, imaginary, mean = (np.correlate(centred, taps, "valid") for taps in fit)
    power = np.correlate(centred**2, np.ones(window), "valid")
    explained = _explained_power(angle, real, imaginary, mean)
    residual = np.sqrt(np.maximum(power - explained, 0.0) / (window - 3))
    end = time_s[window - 1 :]
    phasor = (real + 1j * imaginary) * np.exp(-2j * np.pi * frequency_hz * end)
    return Spectrum(
        phasor=np.concatenate([np.full(window - 1, np.nan + 0j), phasor]),
        mean=_padded(mean + level, window),
        residual=_padded(residual, window),
        window=window,
    )


def _explained_power(angle: Array, real: Array, imaginary: Array, mean: Array) -> Array:
    """Σ over the window of (fitted value)², from the Gram matrix of the basis."""
    basis = np.column_stack([np.cos(angle), -np.sin(angle), np.ones(angle.size)])
    coefficients = np.vstack([real, imaginary, mean])
    return np.asarray(np.einsum("in,ij,jn->n", coefficients, basis.T @ basis, coefficients))


def _padded(values: Array, window: int) -> Array:
    return np.concatenate([np.full(window - 1, np.nan), values])
