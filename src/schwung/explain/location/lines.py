"""Lines: a ripple locked to the angle, and a disturbance fixed in frequency with its phase free in every run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import chi2
from scipy.stats import f as f_law

from schwung.explain.location.columns import TURN, Samples, Shape
from schwung.motion import Array
from schwung.session.model import Axis

HIGHEST_ORDER = 130.0  # per turn
FINEST = 400.0  # periods over the visited range, on a linear axis
MEDIAN_WORTH = 0.5  # what a median knows of a level, in mean values of as many
FEWEST = 3.0  # periods over the visited range
HIGHEST_RATE = 0.45  # of the sampling rate
FEWEST_IN_TIME = 5.0  # periods in a run; slower ones have no spectrum below them to be judged by


@dataclass(frozen=True, eq=False)
class Line:
    """The strongest line: where (rad/rad or Hz), the energy it predicts, and its columns (n, k)."""

    place: float
    gain: float
    columns: Array
    shape: Shape


@dataclass(frozen=True, eq=False)
class Comb:
    """Where the position lines may be: bins of position and the wave numbers of their transform."""

    bins: NDArray[np.int64]
    count: int
    step: float
    wave: NDArray[Any]

    @classmethod
    def of(cls, samples: Samples, axis: Axis) -> Comb | None:
        """None where the motion is too short for a line."""
        reach = float(np.ptp(samples.position))
        if reach <= 0:
            return None
        lowest = FEWEST * TURN / reach
        sampled = 0.8 * np.pi * samples.rate_hz / max(float(np.percentile(np.abs(samples.speed), 75)), 1e-12)
        highest = min(HIGHEST_ORDER if axis == "rotary" else FINEST * TURN / reach, sampled)
        if highest <= lowest:
            return None
        step = TURN / (12 * highest)
        bins = ((samples.position - np.min(samples.position)) / step).astype(np.int64)
        count = 1 << int(np.ceil(np.log2(4 * (int(np.max(bins)) + 1))))
        wave = TURN * np.fft.rfftfreq(count, step)
        wave[(wave < lowest) | (wave > highest)] = np.nan
        return cls(bins, count, step, wave)

    def powers(self, remainder: Array) -> Array:
        """Energy that a line of each wave number predicts (waves,), 0 outside the comb."""
        held = np.bincount(self.bins, weights=remainder, minlength=self.count)
        power = np.abs(np.fft.rfft(held)) ** 2 * 2 / remainder.size
        return np.where(np.isnan(self.wave), 0.0, power)

    def strongest(self, samples: Samples, remainder: Array) -> Line:
        """The line that predicts most."""
        guess = float(self.wave[int(np.argmax(self.powers(remainder)))])
        near = TURN / (self.count * self.step)

        def lost(wave: float) -> float:
            return -float(np.abs(remainder @ np.exp(-1j * wave * samples.position)) ** 2)

        found = minimize_scalar(
            lost, bounds=(guess - near, guess + near), method="bounded", options={"xatol": near / 50}
        )
        angle = float(found.x) * samples.position
        columns = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        gain = -float(found.fun) * 2 / remainder.size
        return Line(float(found.x), gain, columns, Shape("position", "line", np.eye(2), 4.0))


def frequency_line(samples: Samples, remainder: Array) -> tuple[Line, float] | None:
    """The strongest line in time, its phase free in every run, and its p-value against the spectrum around it.

    Sought in runs without injection, where there are any; otherwise beside what was injected and its harmonics. The
    sum over the runs of their periodograms follows χ² with two degrees of freedom per run, times the noise's spectrum,
    for which the median beside the peak stands.
    """
    spans = [samples.grid_s[end - 1] - samples.grid_s[start] for start, end in samples.bounds]
    lowest = FEWEST_IN_TIME / float(np.median(spans))
    longest = max(int(samples.grid_s[end - 1] * samples.rate_hz) + 2 for _, end in samples.bounds)
    size = 1 << int(np.ceil(np.log2(2 * longest)))
    frequency: Array = np.fft.rfftfreq(size, 1 / samples.rate_hz).astype(np.float64)
    width = max(round(size / longest), 1)  # bins of one independent frequency
    allowed = (frequency >= lowest) & (frequency <= HIGHEST_RATE * samples.rate_hz)
    # what only runs with an injection have is their answer to that, and no frequency of the machine's
    plain = np.array([not lines for lines in samples.injected_hz])
    if not np.any(plain):
        remainder = remainder - _answered(samples, remainder)
        allowed &= ~_answers(samples, frequency, width * frequency[1])
    if np.count_nonzero(allowed) < 20:
        return None
    powers = np.zeros((len(samples.bounds), frequency.size))
    for held, (start, end) in zip(powers, samples.bounds, strict=True):
        row = np.zeros(longest)
        row[np.round(samples.grid_s[start:end] * samples.rate_hz).astype(np.int64)] = remainder[start:end]
        held[:] = np.abs(np.fft.rfft(row, size)) ** 2 * 2 / (end - start)
    alone = powers[plain] if np.any(plain) else powers
    power, degrees = alone.sum(axis=0), 2 * alone.shape[0]
    peak = int(np.argmax(np.where(allowed, power, 0.0)))
    height, others = _level(power, peak, width)
    level = height / float(chi2.median(degrees))
    tries = 2 * np.count_nonzero(allowed) / width
    ratio = power[peak] / (degrees * level) if level > 0 else 0.0
    p_value = min(1.0, tries * float(f_law.sf(ratio, degrees, MEDIAN_WORTH * others * degrees)))
    place = _top(frequency, power, peak)
    angle = TURN * place * samples.grid_s
    columns = np.zeros((remainder.size, 2 * len(samples.bounds)))
    for i, (start, end) in enumerate(samples.bounds):
        columns[start:end, 2 * i] = np.cos(angle[start:end])
        columns[start:end, 2 * i + 1] = np.sin(angle[start:end])
    gain = float(np.sum(powers[:, peak])) - columns.shape[1] * level
    return Line(place, gain, columns, Shape("frequency", "line", np.eye(columns.shape[1]), 6.0)), p_value


def _harmonics(lines: Sequence[float], highest_hz: float) -> list[float]:
    """Injected frequencies and their harmonics (Hz)."""
    return [line * harmonic for line in lines for harmonic in range(1, int(highest_hz / line) + 1)]


def _answered(samples: Samples, remainder: Array) -> Array:
    """What of each run's remainder goes with an injected frequency or a harmonic of it (n,)."""
    answer = np.zeros_like(remainder)
    for lines, (start, end) in zip(samples.injected_hz, samples.bounds, strict=True):
        waves = np.outer(samples.grid_s[start:end], _harmonics(lines, HIGHEST_RATE * samples.rate_hz)) * TURN
        columns = np.concatenate([np.cos(waves), np.sin(waves)], axis=1)
        answer[start:end] = columns @ np.linalg.lstsq(columns, remainder[start:end])[0]
    return answer


def _answers(samples: Samples, frequency: Array, resolved_hz: float) -> NDArray[np.bool_]:
    """Frequencies that cannot be told from those (bins,)."""
    lines = sorted({line for lines in samples.injected_hz for line in lines})
    near = [
        np.abs(frequency - answer) <= resolved_hz
        for answer in _harmonics(lines, HIGHEST_RATE * samples.rate_hz)
    ]
    return np.asarray(np.any(near, axis=0))


def _level(power: Array, peak: int, width: int) -> tuple[float, float]:
    """Median power beside a peak, the higher of its two sides: at the foot of a slope nothing is a line.

    Also how many independent frequencies it rests on.
    """
    sides = [(0.0, 1.0)]
    for direction in (-1, 1):
        places = peak + direction * np.arange(2 * width + 1, 10 * width)
        places = places[(places >= width // 2) & (places < power.size)]
        if places.size >= width:
            sides.append((float(np.median(power[places])), places.size / width))
    return max(sides)


def _top(places: NDArray[Any], heights: Array, peak: int) -> float:
    """Where a parabola through the peak and its neighbours is highest."""
    if not 0 < peak < heights.size - 1:
        return float(places[peak])
    left, top, right = heights[peak - 1 : peak + 2]
    bend = left - 2 * top + right
    off = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float(places[peak] + np.clip(off, -0.5, 0.5) * (places[1] - places[0]))
