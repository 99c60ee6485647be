"""The sliding DFT estimator as an online filter: one sample in, one estimate out, for as long as a drive runs.

The recursion of the paper, X(n) = (X(n−1) − x(n−N) + x(n)) e^{jω} (equation 8), cannot run for ever: its pole
lies on the unit circle as well as rounding allows, so that no error decays and, where the rounded |e^{jω}| is
not 1, errors grow exponentially. Two remedies here, both at constant cost per sample:

1. Samples are turned by e^{−jωm} *before* they are summed (modulated sliding DFT; Duda, IEEE Signal Processing
   Magazine 27:6, 2010). The pole is then at z = 1 exactly, and what is left is rounding in a running sum, which
   walks away like √n at best.
2. Beside the running sum a fresh one grows from zero, with every sample that comes and none taken away. After N
   samples it *is* the window's sum and takes the running one's place. No rounding is ever older than 2N
   samples, and m starts afresh too: phases come from a table of 2N factors, never from a growing angle.

So the error has a bound without n in it. A window's sum is made by at most 3N additions of terms x(m)e^{−jωm}
over the last 2N samples, and a phasor is 2/N of it: |error| ≤ 12 N u max|x| of those samples, u = 1.1e-16
(Higham, Accuracy and Stability, 4.2). That is 2e-13 of the largest sample at N = 160, after 10⁹ samples as
after 10³; measured over 10⁷ it is 5e-16.

Where N = f_s/f is not whole the window has round(N) samples, and the sums go through the least-squares fit of
sine and constant of `sdft.py`: batch and online results are the same numbers, up to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from schwung.compiled import compiled
from schwung.drivetrain.machine import Machine
from schwung.errors import InputError
from schwung.estimation.sdft import ComplexArray, samples_per_window
from schwung.motion import Array


class OnlineEstimate(NamedTuple):
    """The estimate of the window that ends with the newest sample; all NaN while there is no full window."""

    inertia_kgm2: complex  # the real part is J_l; the imaginary part should vanish
    speed_amplitude_rad_s: float
    torque_amplitude_nm: float


@dataclass(frozen=True, eq=False)
class OnlineTrace:
    """The estimates of a block of samples, (n,) each, NaN where there is no full window."""

    inertia_kgm2: ComplexArray
    speed_amplitude_rad_s: Array
    torque_amplitude_nm: Array


class OnlineEstimator:
    """Load inertia from a stream of torque and speed samples. Constant memory, some 50 N bytes in all.

    The estimate belongs to the angle `lag_s` before the newest sample: the caller, who knows where the axis was
    then, labels it. A lost sample is given as NaN; estimates are NaN until the window is free of it. For the
    paper's denoised method the reference run's samples of the same instant go in beside each sample; without
    them it is the former method.

    The compiled part loads from numba's cache or compiles, once, when the estimator is made.
    """

    def __init__(self, machine: Machine, sample_rate_hz: float, frequency_hz: float) -> None:
        """For a machine (its rotor, coupling and frictions are used), a rate and the injected frequency (Hz).

        Raises InputError when a period has fewer than 8 samples.
        """
        if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0):
            raise InputError("sampling rate", f"is {sample_rate_hz} Hz", "Give a positive number.")
        self.window = samples_per_window(sample_rate_hz, frequency_hz)
        self.frequency_hz = frequency_hz
        step = 2 * np.pi * frequency_hz / sample_rate_hz
        self._turn = np.exp(-1j * step * np.arange(2 * self.window))
        self._model = np.array([*_fit(step, self.window), *_two_mass(machine, frequency_hz)])
        self._ring = np.empty((self.window, 2))
        self._sums = np.empty((2, 3), dtype=np.complex128)
        self._place = np.empty(2, dtype=np.int64)
        self.reset()
        self.push(0.0, 0.0)  # compiles
        self.reset()

    @property
    def lag_s(self) -> float:
        """From the newest sample back to the instant that an estimate stands for: half a period (s)."""
        return 0.5 / self.frequency_hz

    @property
    def memory_bytes(self) -> int:
        """All that the filter holds, whatever has gone through it."""
        arrays = (self._turn, self._model, self._ring, self._sums, self._place)
        return sum(array.nbytes for array in arrays)

    def reset(self) -> None:
        """Forget every sample."""
        for array in (self._ring, self._sums, self._place):
            array[:] = 0

    def push(
        self,
        torque_nm: float,
        speed_rad_s: float,
        reference_torque_nm: float = 0.0,
        reference_speed_rad_s: float = 0.0,
    ) -> OnlineEstimate:
        """Take one sample in and give the estimate of the window that ends with it."""
        torque, speed = float(torque_nm - reference_torque_nm), float(speed_rad_s - reference_speed_rad_s)
        return OnlineEstimate(
            *push_sample(self._turn, self._model, self._ring, self._sums, self._place, torque, speed)
        )

    def block(
        self,
        torque_nm: Array,
        speed_rad_s: Array,
        reference_torque_nm: Array | None = None,
        reference_speed_rad_s: Array | None = None,
    ) -> OnlineTrace:
        """Take (n,) samples in, the same as pushing them one by one. Raises InputError where lengths differ."""
        torque = _minus("torque", torque_nm, reference_torque_nm)
        speed = _minus("speed", speed_rad_s, reference_speed_rad_s)
        if torque.size != speed.size:
            raise InputError(
                "online estimator", f"{torque.size} torques for {speed.size} speeds", "Give samples in pairs."
            )
        trace = OnlineTrace(np.empty(speed.size, np.complex128), np.empty(speed.size), np.empty(speed.size))
        outputs = (trace.inertia_kgm2, trace.speed_amplitude_rad_s, trace.torque_amplitude_nm)
        _push_block(self._turn, self._model, self._ring, self._sums, self._place, torque, speed, *outputs)
        return trace


def _minus(quantity: str, values: Array, reference: Array | None) -> Array:
    samples = np.ascontiguousarray(values, dtype=float)
    if reference is None:
        return samples
    if np.shape(reference) != samples.shape:
        raise InputError(
            "online estimator",
            f"{np.size(reference)} reference samples for {samples.size} of {quantity}",
            "Give the reference run's sample of the same instant with each.",
        )
    return np.asarray(samples - reference)


def _fit(step: float, window: int) -> tuple[complex, complex, complex]:
    """What Σx cos, Σ−x sin and Σx weigh in the phasor: least squares of sine and constant, local time.

    2/N, 2j/N and 0 where N is whole. Local time is 0 at the newest sample.
    """
    angle = step * np.arange(1 - window, 1)
    basis = np.column_stack([np.cos(angle), -np.sin(angle), np.ones(window)])
    cosine, sine, _ = np.linalg.inv(basis.T @ basis)
    real, imaginary, constant = cosine + 1j * sine
    return complex(real), complex(imaginary), complex(constant)


def _two_mass(machine: Machine, frequency_hz: float) -> tuple[complex, complex, complex, complex]:
    """What stands between T/ω_r and J_l: rotor, shaft (its inverse: 0 where rigid), load friction, s."""
    s = 2j * np.pi * frequency_hz
    rotor = machine.motor.inertia_kgm2 * s + machine.motor.viscous_friction_nms
    shaft = 0j
    if machine.coupling is not None:
        shaft = 1 / (machine.coupling.damping_nms + machine.coupling.stiffness_nm_rad / s)
    return rotor, shaft, machine.load.viscous_friction_nms + 0j, s


@compiled
def push_sample(
    turn: ComplexArray,
    model: ComplexArray,
    ring: Array,
    sums: ComplexArray,
    place: NDArray[np.int64],
    torque: float,
    speed: float,
) -> tuple[complex, float, float]:
    """One step, in place; for compiled callers too. Gives inertia, speed amplitude and torque amplitude.

    turn: (2N,) e^{−jωm}. model: (7,) `_fit` and `_two_mass`. ring: (N, 2) torque and speed of the last N samples.
    sums: (2, 3) running and fresh, each Σ torque·turn, Σ speed·turn, Σ torque + j Σ speed. place: (2,) index of
    the newest sample in its block of N, and how many good samples came without a gap, N at most.
    """
    window = ring.shape[0]
    i, good = place[0], min(place[1] + 1, window)
    if not (np.isfinite(torque) and np.isfinite(speed)):
        torque, speed, good = 0.0, 0.0, 0
    old_torque, old_speed = ring[i, 0], ring[i, 1]
    ring[i, 0], ring[i, 1] = torque, speed
    # the running sums count m from the start of the block before, the fresh ones from the start of this block
    joining, leaving = turn[window + i], turn[i]
    sums[0, 0] += torque * joining - old_torque * leaving
    sums[0, 1] += speed * joining - old_speed * leaving
    sums[0, 2] += complex(torque - old_torque, speed - old_speed)
    sums[1, 0] += torque * leaving
    sums[1, 1] += speed * leaving
    sums[1, 2] += complex(torque, speed)
    local_torque = sums[0, 0] * np.conj(joining)
    local_speed = sums[0, 1] * np.conj(joining)
    total = sums[0, 2]
    if i == window - 1:
        for k in range(3):  # numba would allocate for sums[0] = sums[1]
            sums[0, k] = sums[1, k]
            sums[1, k] = 0.0
        i = -1
    place[0], place[1] = i + 1, good
    if good < window:
        return complex(np.nan, np.nan), np.nan, np.nan
    torque_phasor = model[0] * local_torque.real + model[1] * local_torque.imag + model[2] * total.real
    speed_phasor = model[0] * local_speed.real + model[1] * local_speed.imag + model[2] * total.imag
    amplitude = abs(speed_phasor)
    if amplitude == 0.0:
        return complex(np.nan, np.nan), amplitude, abs(torque_phasor)
    behind_rotor = torque_phasor / speed_phasor - model[3]
    # 1/(1/z − shaft) without dividing by z, which is 0 for a bare rotor
    behind_shaft = behind_rotor / (1.0 - behind_rotor * model[4])
    return (behind_shaft - model[5]) / model[6], amplitude, abs(torque_phasor)


@compiled
def _push_block(
    turn: ComplexArray,
    model: ComplexArray,
    ring: Array,
    sums: ComplexArray,
    place: NDArray[np.int64],
    torque: Array,
    speed: Array,
    inertia: ComplexArray,
    speed_amplitude: Array,
    torque_amplitude: Array,
) -> None:
    for n in range(torque.size):
        inertia[n], speed_amplitude[n], torque_amplitude[n] = push_sample(
            turn, model, ring, sums, place, torque[n], speed[n]
        )
