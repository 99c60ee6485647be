"""A Kalman filter as a Fourier transform: one oscillator per frequency, gains fixed.

Source: Nevaranta, Derammelaere, Parkkinen et al., "Online identification of a two-mass system in frequency domain
using a Kalman filter", Modeling, Identification and Control 37(2) (2016) 133, doi 10.4173/mic.2016.2.5, after
Bitmead, Tsoi and Parker, "A Kalman filtering approach to short-time Fourier analysis" (1986).

The states are a constant and the cosine and sine of each oscillator, turned by one step per sample; the gain is
the steady one of a filter whose process noise is in proportion to its covariance. That is Fourier analysis over an
exponential window, and the window's time constant (rule of `common`) is all there is to tune. Oscillators: f_est
only, beside the constant, as a whole window would null the harmonics and this one does not need to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.compiled import compiled
from schwung.estimation.inversion import invert_complex, invert_magnitude
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.rivals.common import age_s, labelled, memory_s, started
from schwung.estimation.sdft import ComplexArray
from schwung.motion import Array

#: Of f_est; 0 is the constant.
ORDERS = (0.0, 1.0)
#: The steady gain is the sum over so many time constants.
_LONG = 30


@dataclass(frozen=True)
class KalmanFourier:
    """Denoised signals, one filter for torque and one for speed, inversion as for the SDFT."""

    name: str = "kalman_fourier"
    needs_reference: bool = True

    def traces(self, task: Task) -> Outcome:
        """One recursion per signal. Raises InputError as the denoised method does."""
        start, traces = started(task, self.name, in_time=False), []
        memory = memory_s(task.frequency_hz)
        for pair, trace in zip(start.denoised, start.traces, strict=True):
            rate = pair.excited.sample_rate_hz
            torque, speed = (
                kalman_phasor(values, rate, task.frequency_hz, memory)
                for values in (pair.torque_nm, pair.speed_rad_s)
            )
            inertia = invert_complex(task.machine, task.frequency_hz, torque, speed)
            if task.inversion == "magnitude":
                real = invert_magnitude(task.machine, task.frequency_hz, torque, speed)
                inertia = real + 1j * inertia.imag
            traces.append(labelled(trace, pair, task, inertia, age=age_s(rate, task.frequency_hz)))
        return replace(start, traces=tuple(traces))


def kalman_phasor(values: Array, sample_rate_hz: float, frequency_hz: float, memory_s: float) -> ComplexArray:
    """Complex amplitude of `values` (n,) at each sample, in a frame that turns with the sine.

    x(t) = Re(phasor) at the sample's own instant, so that phasors of one instant may be divided.
    """
    turn = 2 * np.pi * frequency_hz / sample_rate_hz * np.array(ORDERS)
    keep = np.exp(-1 / (memory_s * sample_rate_hz))
    gain = steady_gain(turn, keep, int(_LONG * memory_s * sample_rate_hz))
    states = _filter(values, turn, gain.real.copy(), gain.imag.copy())
    return np.asarray(states[:, 0] + 1j * states[:, 1])


def steady_gain(turn_rad: Array, keep: float, samples: int) -> ComplexArray:
    """Gains of the oscillators (k,) that turn so far per sample, of the steady Kalman filter.

    The information about the states, Σ keepⁱ φᵢ φᵢᵀ over the past samples, is inverted and laid upon the newest
    one. `keep`: weight that a sample keeps per step.
    """
    age = np.arange(samples)
    angle = -np.outer(age, turn_rad)
    basis = np.concatenate([np.cos(angle), -np.sin(angle)], axis=1)  # x = Re(state·e^{j·angle})
    constant = np.concatenate([np.zeros(turn_rad.size, dtype=bool), turn_rad == 0])
    basis[:, constant] = 0.0
    information = basis.T @ (basis * (keep**age)[:, None])
    information[constant, constant] = 1.0
    gain = np.linalg.solve(information, basis[0])
    return np.asarray(gain[: turn_rad.size] + 1j * gain[turn_rad.size :])


@compiled
def _filter(values: Array, turn: Array, gain_real: Array, gain_imaginary: Array) -> Array:
    """Predict by turning each state, correct by the gain; the last oscillator's state, (n, 2)."""
    count = turn.size
    cosine, sine = np.cos(turn), np.sin(turn)
    real, imaginary = np.zeros(count), np.zeros(count)
    out = np.empty((values.size, 2))
    for i in range(values.size):
        miss = values[i]
        for k in range(count):
            turned = cosine[k] * real[k] - sine[k] * imaginary[k]
            imaginary[k] = sine[k] * real[k] + cosine[k] * imaginary[k]
            real[k] = turned
            miss -= turned
        for k in range(count):
            real[k] += gain_real[k] * miss
            imaginary[k] += gain_imaginary[k] * miss
        out[i, 0], out[i, 1] = real[count - 1], imaginary[count - 1]
    return out
