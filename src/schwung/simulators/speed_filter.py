"""How a drive's own filter changes the speed that it reports: held against the slope of the angle, which has none.

A low-pass of first order with time constant τ is late by τ and has the gain 1/√(1 + 2·bend·ω²), bend = τ²/2; a mean
over a span T is late by T/2 and bends by T²/24; a pure delay does not bend. The delay is seen at all frequencies, the
bend where the motion is fast. As far as that leaves it open, a filter bends as filters do that are so late.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schwung.motion import Array
from schwung.session.model import Run
from schwung.simulators.spectrum import Spectrum

#: No drive filters its speed for longer (s): beyond that it is a delay.
LONGEST_FILTER_S = 2.5e-4
#: What filters bend, over half the square of what they are late: mean and deviation, from delays to low-passes.
USUAL, SPREAD = 0.6, 0.3
#: A bend is looked for where the motion has so many times the power of the angle's noise, and up to there in the band.
STANDS_OUT, HIGHEST = 1e3, 1.3
_ITERATIONS = 3
_LEAST_S2 = 1e-10


@dataclass(frozen=True)
class SpeedFilter:
    """What lies between the angle's slope and the reported speed; nothing is known of the delay by default."""

    delay_s: float = 0.0
    bend_s2: float = 0.0

    def undone(self, omega: NDArray[Any]) -> Array:
        """Gain at jω (rad/s), (n,), that takes the filter back."""
        return np.asarray(np.exp(omega * self.delay_s) / bent(omega, self.bend_s2))


def bent(omega: NDArray[Any], bend_s2: float) -> NDArray[Any]:
    """Gain at jω (rad/s), (n,), of a low-pass of first order but for its delay; of one that there could be."""
    time_constant = np.sqrt(2 * min(max(bend_s2, 0.0), 0.5 * LONGEST_FILTER_S**2))
    return np.asarray(np.exp(omega * time_constant) / (1 + omega * time_constant))


def speed_filter(
    runs: Sequence[Run],
    jumps: Sequence[Array],
    band_hz: float,
    angle_noise_rad: float,
    speed_noise_rad_s: float,
) -> SpeedFilter:
    """The filter of the reported speed.

    `jumps`: of a held injection, (n,) per run. What its images leave in the speed has their shape, and is fitted along.
    """
    delay, spread = 0.0, np.inf
    for _ in range(_ITERATIONS):
        more, spread = _later(runs, jumps, band_hz, delay)
        delay += more
    if not np.isfinite(spread):
        return SpeedFilter()
    filtered = 0.5 * min(abs(delay), LONGEST_FILTER_S) ** 2
    usual, usual_std = USUAL * filtered, max(SPREAD * filtered, _LEAST_S2)
    seen, seen_std = _bend(runs, band_hz, delay, angle_noise_rad, speed_noise_rad_s)
    share = usual_std**2 / (usual_std**2 + seen_std**2)
    return SpeedFilter(delay, max(usual + share * (seen - usual), 0.0))


def _later(
    runs: Sequence[Run], jumps: Sequence[Array], band_hz: float, delay_s: float
) -> tuple[float, float]:
    """How late the speed is beyond a delay (s), small, and its standard deviation."""
    normal, towards, error, samples = np.zeros((2, 2)), np.zeros(2), 0.0, 0
    for run, jumping in zip(runs, jumps, strict=True):
        spectrum = Spectrum(len(run), run.sample_rate_hz, 4 / band_hz)
        low = spectrum.low_pass(band_hz)
        delayed = low * spectrum.omega * np.exp(-spectrum.omega * delay_s)
        derived = spectrum.apply(run.position_rad, delayed, "slope")
        change = spectrum.apply(derived, low * spectrum.omega, "slope")
        late = spectrum.apply(run.speed_rad_s, low) - derived
        inside = slice(spectrum.pad // 2, -spectrum.pad // 2)
        columns = np.stack([-change[inside], spectrum.apply(jumping, low)[inside]])
        normal += columns @ columns.T
        towards += columns @ late[inside]
        error += float(late[inside] @ late[inside])
        samples += columns.shape[1]
    if normal[0, 0] == 0:
        return 0.0, np.inf
    inverse = np.linalg.pinv(normal, rcond=1e-12)
    fitted = inverse @ towards
    left = max(error - float(fitted @ towards), 0.0) / samples
    independent = 2 * band_hz / runs[0].sample_rate_hz  # share of the samples
    return float(fitted[0]), float(np.sqrt(left * inverse[0, 0] / independent))


def _bend(
    runs: Sequence[Run], band_hz: float, delay_s: float, angle_noise_rad: float, speed_noise_rad_s: float
) -> tuple[float, float]:
    """The bend (s²) and its standard deviation, from all lines of all runs on which the motion stands out."""
    columns: list[NDArray[Any]] = []
    for run in runs:
        spectrum = Spectrum(len(run), run.sample_rate_hz, 4 / band_hz)
        low, window = spectrum.low_pass(band_hz), np.hanning(len(run))
        late = low * spectrum.omega * np.exp(-spectrum.omega * delay_s)
        of_angle = np.fft.rfft(window * spectrum.apply(run.position_rad, late, "slope"))
        of_speed = np.fft.rfft(window * spectrum.apply(run.speed_rad_s, low))
        frequency = np.fft.rfftfreq(len(run), 1 / run.sample_rate_hz)
        omega, energy = 2 * np.pi * frequency, float(np.sum(window**2))
        noise = (omega * angle_noise_rad) ** 2 * energy
        seen = (np.abs(of_angle) ** 2 > STANDS_OUT * noise) & (frequency < HIGHEST * band_hz)
        if np.isfinite(speed_noise_rad_s):
            noise = noise + speed_noise_rad_s**2 * energy
        shapes = np.stack([omega**2 * of_angle, 1j * omega * of_angle, of_angle - of_speed])
        columns.append(shapes[:, seen] / np.sqrt(np.maximum(noise[seen], 1e-300)))
    bending, later, missed = np.concatenate(columns, axis=1)
    matrix = np.stack([np.r_[bending.real, bending.imag], np.r_[later.real, later.imag]], axis=1)
    if matrix.shape[0] < 20:
        return 0.0, np.inf
    aim = np.r_[missed.real, missed.imag]
    inverse = np.linalg.pinv(matrix.T @ matrix, rcond=1e-14)
    fitted = inverse @ (matrix.T @ aim)
    level = max(float(np.mean((aim - matrix @ fitted) ** 2)) * 2, 1.0)
    return float(fitted[0]), float(np.sqrt(level * inverse[0, 0]))
