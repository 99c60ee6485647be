"""Lines: a ripple locked to the angle, and a disturbance fixed in frequency with its phase free in every run."""

from __future__ import annotations

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

    Sought in runs without injection, where there are any. The sum over the runs of their periodograms follows χ² with
    two degrees of freedom per run, times the noise's spectrum, for which the median beside the peak stands.
    """
    spans = [samples.grid_s[end - 1] - samples.grid_s[start] for start, end in samples.bounds]
    lowest = FEWEST_IN_TIME / float(np.median(spans))
    longest = max(int(samples.grid_s[end - 1] * samples.rate_hz) + 2 for _, end in samples.bounds)
    size = 1 << int(np.ceil(np.log2(2 * longest)))
    frequency = np.fft.rfftfreq(size, 1 / samples.rate_hz)
    powers = np.zeros((len(samples.bounds), frequency.size))
    for held, (start, end) in zip(powers, samples.bounds, strict=True):
        row = np.zeros(longest)
        row[np.round(samples.grid_s[start:end] * samples.rate_hz).astype(np.int64)] = remainder[start:end]
        held[:] = np.abs(np.fft.rfft(row, size)) ** 2 * 2 / (end - start)
    # what only runs with an injection have is their answer to that, and no frequency of the machine's
    alone = powers[~samples.injected] if not np.all(samples.injected) else powers
    power, degrees = alone.sum(axis=0), 2 * alone.shape[0]
    allowed = np.flatnonzero((frequency >= lowest) & (frequency <= 0.45 * samples.rate_hz))
    if allowed.size < 20:
        return None
    peak = int(allowed[np.argmax(power[allowed])])
    width = max(round(size / longest), 1)  # bins of one independent frequency
    height, others = _level(power, peak, width)
    level = height / float(chi2.median(degrees))
    tries = 2 * allowed.size / width
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
