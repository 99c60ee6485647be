"""The generalised DFT (m = 4, l = ±1): the faster filter that the paper tried and rejected.

Source: Liu, Hu, Chen et al., "Fast and flexible selective harmonic extraction methods based on the generalized
discrete Fourier transform", IEEE Trans. Power Electronics 33(4) (2018) 3484, doi 10.1109/TPEL.2017.2703138; named
in the paper's section 3.2 with m and l only.

Our reading: a signal that holds no harmonics but those of the orders i·m + l (i any integer) repeats itself, but
for a known turn of phase, after 1/m of a period, so that a window of N/m samples tells its amplitude. A real
signal has each order with both signs, l = +1 and l = −1; a second window tells the two families apart. m = 4
makes the odd harmonics, in 2·N/4 = half a period. Written out, that is the DFT over half a period, which equals
the least-squares fit of a sine, and no constant, over N/2 samples. It answers in half the time. The price: even
harmonics and the constant part, which an SDFT nulls, leak in, and so does more noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.estimation.inversion import invert_complex, invert_magnitude
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.rivals.common import labelled, started
from schwung.estimation.sdft import ComplexArray, samples_per_window
from schwung.motion import Array

ORDERS_APART = 4  # m


@dataclass(frozen=True)
class GeneralisedDft:
    """Denoised signals, half-period transform, inversion as for the SDFT."""

    name: str = "gdft"
    needs_reference: bool = True

    def traces(self, task: Task) -> Outcome:
        """Traces whose values belong to a quarter period before their last sample."""
        start, traces = started(task, self.name, in_time=False), []
        for pair, trace in zip(start.denoised, start.traces, strict=True):
            rate = pair.excited.sample_rate_hz
            torque, speed = (
                half_period_phasor(values, pair.time_s, rate, task.frequency_hz)
                for values in (pair.torque_nm, pair.speed_rad_s)
            )
            inertia = invert_complex(task.machine, task.frequency_hz, torque, speed)
            if task.inversion == "magnitude":
                real = invert_magnitude(task.machine, task.frequency_hz, torque, speed)
                inertia = real + 1j * inertia.imag
            age = (window_samples(rate, task.frequency_hz) / 2) / rate
            traces.append(labelled(trace, pair, task, inertia, age=age))
        return replace(start, traces=tuple(traces))


def window_samples(sample_rate_hz: float, frequency_hz: float) -> int:
    """Samples of both windows together, 2·N/m."""
    samples_per_window(sample_rate_hz, frequency_hz)  # raises where they are too few
    return round(2 * sample_rate_hz / frequency_hz / ORDERS_APART)


def half_period_phasor(
    values: Array, time_s: Array, sample_rate_hz: float, frequency_hz: float
) -> ComplexArray:
    """Complex amplitude of `values` (n,) over the half period that ends at each sample; NaN until there is one.

    x(t) = Re(phasor·e^{jωt}) in the run's own time, as `sliding_dft` has it.
    """
    window = window_samples(sample_rate_hz, frequency_hz)
    omega = 2 * np.pi * frequency_hz
    angle = omega * np.arange(1 - window, 1) / sample_rate_hz
    real, imaginary = (
        np.correlate(values, taps, "valid")
        for taps in np.linalg.pinv(np.column_stack([np.cos(angle), -np.sin(angle)]))
    )
    phasor = (real + 1j * imaginary) * np.exp(-1j * omega * time_s[window - 1 :])
    return np.concatenate([np.full(window - 1, np.nan + 0j), phasor])
