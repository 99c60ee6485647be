"""Time stamps: are they uniform, how much do they jitter, and what it takes to bring samples on a uniform grid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.model import UNIFORMITY_SAMPLES

#: A step longer than so many usual ones is a gap: samples are missing, and they are not made up.
_GAP_STEPS = 4.5
#: The pass band of the low pass before samples are thinned out, as a share of the new Nyquist frequency.
_PASS_BAND = 0.8
_LOW_PASS_ORDER = 8
_FEWEST_SAMPLES = 16


@dataclass(frozen=True)
class Clock:
    """A recording's time base. Deviations are those of the stamps from the best uniform grid, in samples."""

    start_s: float
    rate_hz: float
    worst_samples: float
    rms_samples: float
    worst_index: int
    rounded: bool  # the stamps deviate by no more than they were rounded
    pieces: tuple[slice, ...]  # between gaps; one where nothing is missing

    @property
    def uniform(self) -> bool:
        """Whether the stamps are those of a uniform grid, as the session file demands it."""
        return len(self.pieces) == 1 and (self.rounded or self.worst_samples <= UNIFORMITY_SAMPLES)

    def describe(self) -> str:
        """Rate and jitter in one phrase."""
        text = (
            f"{self.rate_hz:.6g} Hz; stamps deviate from a uniform grid by {self.rms_samples:.2g} samples rms, "
            f"{self.worst_samples:.2g} at most (sample {self.worst_index})"
        )
        gaps = len(self.pieces) - 1
        return f"{text}; {gaps} gap{'s' if gaps > 1 else ''} with samples missing" if gaps else text


def read_clock(time_s: Array, place: str) -> Clock:
    """What the time stamps (n,) in s say. Raises InputError where they do not increase or are too few."""
    if time_s.size < _FEWEST_SAMPLES:
        raise InputError(place, f"has {time_s.size} samples", f"A run needs {_FEWEST_SAMPLES} at the least.")
    step = np.diff(time_s)
    rate, offset = _uniform_grid(time_s)
    deviation = (time_s - offset) * rate - np.arange(time_s.size)
    worst = float(np.max(np.abs(deviation)))
    rounded = worst > UNIFORMITY_SAMPLES and _only_rounded(time_s, worst / rate)
    if np.any(step <= 0) and not rounded:
        at = int(np.flatnonzero(step <= 0)[0]) + 1
        what = "stands still" if step[at - 1] == 0 else "runs backwards"
        remedy = "Add --resample to drop such stamps" if step[at - 1] == 0 else "Cut the recording there"
        raise InputError(place, f"{what} at sample {at} ({time_s[at]:.9g} s after {time_s[at - 1]:.9g} s)",
                         f"{remedy}, or leave --time out and give --rate.")  # fmt: skip
    pieces: tuple[slice, ...] = (slice(0, time_s.size),)
    if not rounded:
        usual = float(np.median(step))
        cuts = np.flatnonzero(step > _GAP_STEPS * usual) + 1
        bounds = [0, *cuts.tolist(), time_s.size]
        pieces = tuple(slice(a, b) for a, b in pairwise(bounds))
        if len(pieces) > 1:  # the grid through gaps says nothing: judge the jitter within the longest piece
            longest = max(pieces, key=lambda piece: piece.stop - piece.start)
            rate, within = _uniform_grid(time_s[longest])
            deviation = (time_s[longest] - within) * rate - np.arange(longest.stop - longest.start)
            worst = float(np.max(np.abs(deviation)))
    return Clock(
        start_s=float(time_s[0]),
        rate_hz=rate,
        worst_samples=worst,
        rms_samples=float(np.sqrt(np.mean(deviation**2))),
        worst_index=int(np.argmax(np.abs(deviation))),
        rounded=rounded,
        pieces=pieces,
    )


def _uniform_grid(time_s: Array) -> tuple[float, float]:
    """Rate (Hz) and first instant (s) of the grid nearest to the stamps; a round rate where that makes no odds."""
    index = np.arange(time_s.size)
    middle, centre = index.mean(), time_s.mean()
    slope = float(np.dot(index - middle, time_s - centre) / np.sum((index - middle) ** 2))
    if slope <= 0:
        slope = float(time_s[-1] - time_s[0]) / (time_s.size - 1) or 1.0
    rate = 1 / abs(slope)
    for round_rate in (float(np.rint(rate)), 1e6 / np.rint(1e6 / rate) if rate < 1e6 else rate):
        if round_rate > 0 and abs(round_rate / rate - 1) * time_s.size < UNIFORMITY_SAMPLES / 2:
            rate = round_rate
            break
    return rate, float(centre - middle / rate)


def _only_rounded(time_s: Array, worst_s: float) -> bool:
    """Whether the stamps were written with so few decimals that their deviation is that of rounding."""
    for decimals in range(2, 10):
        digit = 10.0**-decimals
        if np.all(np.abs(time_s / digit - np.rint(time_s / digit)) < 1e-3):
            return worst_s <= 0.75 * digit  # 0.5 by rounding, or up to 1 by cutting about a shifted grid
    return False


def resample(time_s: Array, values: Array, grid_s: Array) -> Array:
    """Samples (n,) at their stamps -> at uniform instants (m,): cubic interpolation, and no aliases.

    Where the grid is coarser than the stamps, the samples go to a finer grid first, through a Butterworth low pass
    forward and backward (no lag) at 0.8 of the new Nyquist frequency, and are thinned out then.
    """
    step = float(grid_s[1] - grid_s[0])
    ratio = step / float(np.median(np.diff(time_s)))
    fine = int(np.ceil(ratio - 1e-3))
    if fine <= 1:
        return np.asarray(CubicSpline(time_s, values)(grid_s))
    dense = grid_s[0] + np.arange((grid_s.size - 1) * fine + 1) * (step / fine)
    smooth = butter(_LOW_PASS_ORDER, _PASS_BAND / fine, output="sos")
    padding = min(dense.size - 1, 10 * fine)
    return np.asarray(sosfiltfilt(smooth, CubicSpline(time_s, values)(dense), padlen=padding)[::fine])
