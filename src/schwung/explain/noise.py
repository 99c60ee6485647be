"""What no model can explain: the noise of the residual, from repeats of one motion, and a filter that whitens it.

Repeats differ by noise alone, so half the variance of their difference is the floor. Neighbours in time are taken, so
that slow drift is not mistaken for noise. A precise machine counts alike in each repeat: what its channels have beyond
a smooth motion, and repeats have in common, is added. Without repeats the floor follows from what each channel has
beyond a smooth motion, carried through the belief's equations. The whitening filter is autoregressive and short: it
must not learn a disturbance that happens to differ between repeats.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.ndimage import convolve1d
from scipy.signal import czt

from schwung.drivetrain.machine import Machine
from schwung.explain.channels import Noise
from schwung.explain.signals import MOTION_BAND, Prepared, Signals, speed_share
from schwung.motion import Array

#: Coefficients of the whitening filter.
ORDER = 6
#: Fewer compared samples of repeats than this say too little of the noise's colour.
MIN_SAMPLES = 150
#: Share of the floor's variance from which on it is said to come of counts that fall alike.
ALIKE_SHARE = 0.2
#: Lines that a difference of repeats may hold; one does that is so many times the median around it.
MOST_LINES, NEIGHBOURS, STANDS_OUT = 2, 60, 25.0
_RIDGE = 1e-3

#: A density over frequencies (Hz), (n,) -> (n,).
Spectral = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Whitener:
    """Turns noise into white noise of deviation 1; `torque_nm` is the noise's own deviation before."""

    coefficients: Array  # (ORDER,), of the samples before
    innovation_nm: float
    torque_nm: float
    how: str

    def white(self, residual_nm: Array, valid: NDArray[np.bool_]) -> Array:
        """Whitened residuals (…, n) -> (…, m), the samples whose whole past is valid."""
        taps = np.r_[1.0, -self.coefficients]
        filtered = convolve1d(residual_nm, taps, axis=-1, mode="constant", origin=-(ORDER // 2))
        return np.asarray(np.compress(usable(valid), filtered, axis=-1) / self.innovation_nm)


def usable(valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Samples which, with the ORDER samples before them, are valid; (n,)."""
    result = valid.copy()
    for lag in range(1, ORDER + 1):
        result[lag:] &= valid[:-lag]
        result[:lag] = False
    return result


def whitener(
    prepared: Prepared, machine: Machine, residuals: Sequence[Array], seen: Sequence[int] | None = None
) -> Whitener:
    """The noise of residuals (one (n,) per run, on the compared grid), by repeats where there are any.

    `seen`: the runs that may be looked at (None: all). Where none of them repeats another, all are.
    """
    numbers = tuple(range(len(prepared.runs)))

    def expected(frequency_hz: Array) -> Array:
        return _density(prepared, machine, prepared.noise, frequency_hz)

    pairs = _differences(prepared, residuals, numbers if seen is None else seen, expected)
    more = ""
    if seen is not None and not _enough(pairs):
        pairs, more = _differences(prepared, residuals, numbers, expected), ", the runs kept aside among them"
    covariance = _believed_covariance(prepared, machine, prepared.noise)
    how = "the channels' own noise: the session has no repeats of one motion, which would measure it"
    if _enough(pairs):
        alike = _believed_covariance(prepared, machine, prepared.alike)
        covariance = _covariance(pairs) + alike
        how = f"repeats of one motion ({len(pairs)} pair{'s' if len(pairs) > 1 else ''}{more})"
        if alike[0] > ALIKE_SHARE * covariance[0]:
            how += ", and the counts that fall alike in each of them"
    ridge = covariance.copy()
    ridge[0] *= 1 + _RIDGE
    coefficients = solve_toeplitz(ridge[:ORDER], ridge[1 : ORDER + 1])
    innovation = ridge[0] - coefficients @ ridge[1 : ORDER + 1]
    return Whitener(np.asarray(coefficients), float(np.sqrt(innovation)), float(np.sqrt(covariance[0])), how)


def _enough(pairs: Sequence[tuple[Array, NDArray[np.bool_]]]) -> bool:
    """Whether differences of repeats hold samples enough to tell the noise's colour."""
    return sum(int(valid.sum()) for _, valid in pairs) >= MIN_SAMPLES


def _differences(
    prepared: Prepared, residuals: Sequence[Array], numbers: Sequence[int], expected: Spectral
) -> list[tuple[Array, NDArray[np.bool_]]]:
    """What each run differs by from its last repeat, over √2: as much as the noise of one; and its valid samples."""
    last: dict[int, int] = {}
    pairs: list[tuple[Array, NDArray[np.bool_]]] = []
    for number in numbers:
        run = prepared.runs[number]
        before = last.get(run.group)
        last[run.group] = number
        if before is None:
            continue
        size = min(residuals[number].size, residuals[before].size)
        valid = run.considered[:: prepared.every][:size]
        valid = valid & prepared.runs[before].considered[:: prepared.every][:size]
        if valid.sum() < MIN_SAMPLES // 4:
            continue
        difference = (residuals[number][:size] - residuals[before][:size]) / np.sqrt(2)
        pairs.append((_without_physics(difference, valid, run, prepared, expected), valid))
    return pairs


def _without_physics(
    difference: Array, valid: NDArray[np.bool_], run: Signals, prepared: Prepared, expected: Spectral
) -> Array:
    """A difference of repeats, (n,), without what physics may change between them, which is not noise.

    That is friction (a level, its sign and its slope over speed), and a vibration with a phase of its own in each run,
    where a line stands out of the spectrum that noise is expected to have.
    """
    size, every = difference.size, prepared.every
    speed, time = run.speed_rad_s[::every][:size], run.time_s[::every][:size]
    peak = max(float(np.max(np.abs(speed))), 1e-300)
    shapes = [np.ones(size), np.tanh(speed / (0.02 * peak)), speed / peak]
    for _ in range(MOST_LINES):
        columns = np.stack(shapes, axis=1)
        left = difference - columns @ np.linalg.lstsq(columns[valid], difference[valid], rcond=None)[0]
        line = _line(left, valid, time, prepared.band_hz, expected)
        if line is None:
            return np.asarray(left)
        shapes += [np.sin(2 * np.pi * line * time), np.cos(2 * np.pi * line * time)]
    columns = np.stack(shapes, axis=1)
    return np.asarray(
        difference - columns @ np.linalg.lstsq(columns[valid], difference[valid], rcond=None)[0]
    )


def _line(
    left: Array, valid: NDArray[np.bool_], time: Array, band_hz: float, expected: Spectral
) -> float | None:
    """Frequency (Hz) of a line that holds far more than its neighbourhood; None where there is none.

    Both over the density that is expected: a load on its spring makes a peak of the angle's noise, which is no line.
    """
    used, span = np.where(valid, left, 0.0), float(np.ptp(time[valid]))
    apart = float(np.median(np.diff(time)))
    frequencies = np.arange(2 / span, min(0.45 / apart, band_hz), 0.3 / span)
    if frequencies.size == 0:
        return None
    turn = 2j * np.pi * apart
    power = np.abs(czt(used, frequencies.size, np.exp(-turn * 0.3 / span), np.exp(turn * 2 / span))) ** 2
    power /= expected(frequencies)
    best = int(np.argmax(power))
    around = power[max(0, best - NEIGHBOURS) : best + NEIGHBOURS]
    return float(frequencies[best]) if power[best] > STANDS_OUT * np.median(around) else None


def _covariance(pairs: Sequence[tuple[Array, NDArray[np.bool_]]]) -> Array:
    """Autocovariance at lags 0…ORDER over valid samples, tapered so that it stays positive definite."""
    result = np.zeros(ORDER + 1)
    for lag in range(ORDER + 1):
        total, count = 0.0, 0
        for values, valid in pairs:
            both = valid[lag:] & valid[: valid.size - lag]
            total += float(np.sum((values[lag:] * values[: values.size - lag])[both]))
            count += int(both.sum())
        result[lag] = total / max(count, 1)
    return np.asarray(result * 0.995 ** np.arange(ORDER + 1))


def _believed_covariance(prepared: Prepared, machine: Machine, noise: Noise) -> Array:
    """The same from noise of the channels, by the belief's mechanical impedance."""
    rate = prepared.rate_hz / prepared.every
    density = _density(prepared, machine, noise, np.linspace(0.0, rate / 2, 513))
    covariance = np.fft.irfft(density) * rate / prepared.source_rate_hz
    return np.asarray(covariance[: ORDER + 1])


def _density(prepared: Prepared, machine: Machine, noise: Noise, frequency_hz: Array) -> Array:
    """Variance per sample, as of white noise, of the residual at each frequency (N²·m²), (n,)."""
    low = 1 / (1 + (frequency_hz / prepared.band_hz) ** 8)
    return np.asarray(low**2 * (noise.torque_nm**2 + motion_noise(prepared, machine, noise, frequency_hz)))


def motion_noise(prepared: Prepared, machine: Machine, noise: Noise, frequency_hz: Array) -> Array:
    """Variance per sample, as of white noise, of the needed torque at each frequency (N²·m²), (n,)."""
    omega = 2 * np.pi * np.maximum(frequency_hz, 1e-3)
    share = speed_share(prepared.noise, omega)
    speed = ((1 - share) * omega * noise.position_rad) ** 2
    if np.isfinite(noise.speed_rad_s):
        speed = speed + (share * noise.speed_rad_s) ** 2
    motion = 1 / (1 + (frequency_hz / (MOTION_BAND * prepared.band_hz)) ** 8)
    return np.asarray(speed * np.abs(motion * impedance(machine, omega)) ** 2)


def impedance(machine: Machine, omega_rad_s: Array) -> NDArray[np.complex128]:
    """Motor torque over motor speed at the mean load inertia (N·m·s/rad), (n,)."""
    load = machine.load_inertia
    inertia = 0.0 if load is None else load if isinstance(load, float) else float(np.mean(load.inertia_kgm2))
    s = 1j * omega_rad_s
    hung: NDArray[Any] = inertia * s + machine.load.viscous_friction_nms
    if machine.coupling is not None:
        shaft = machine.coupling.damping_nms + machine.coupling.stiffness_nm_rad / s
        hung = shaft * hung / (shaft + hung)
    return np.asarray(machine.motor.inertia_kgm2 * s + machine.motor.viscous_friction_nms + hung)
