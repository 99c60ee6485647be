"""What is made of position alone where a recording lacks more: unwrapped angles, and speed without lag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from schwung.motion import Array

_ORDER = 4
#: Windows tried in turn, in samples; the first whose noise is small enough is taken.
_WINDOWS = (5, 7, 9, 11, 15, 21, 31, 41, 61)
_NOISE_SHARE = 2e-3  # of the highest speed
#: Ranges that an angle is wrapped into: a turn in rad, degrees, turns, and counts of usual encoders.
_TURN = 2 * np.pi
_MOST_WRAPS_SHARE = 0.25  # more jumps than this share of the samples are noise, not wraps


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """An angle (n,) without its wraps, how many there were, and where the first was."""

    position: Array
    wraps: int
    first: int


def unwrap(position_rad: Array, turn: float = _TURN) -> Unwrapped:
    """Undo jumps of a whole turn (0…2π or ±π) between neighbouring samples.

    A jump counts where it is within a quarter turn of a whole one and the position before stood near one end of the
    turn and the position after near the other; a position that never jumps is returned as it is.
    """
    step = np.diff(position_rad)
    turns = np.rint(step / turn)
    low, high = float(position_rad.min()), float(position_rad.max())
    within_one_turn = high - low <= turn * (1 + 1e-6)
    jumps = np.flatnonzero((turns != 0) & (np.abs(step) > turn / 2)) if within_one_turn else np.array([], int)
    if not jumps.size or jumps.size > _MOST_WRAPS_SHARE * step.size:
        return Unwrapped(position_rad, 0, -1)
    correction = np.concatenate(([0.0], np.cumsum(-turns * turn)))
    return Unwrapped(position_rad + correction, int(jumps.size), int(jumps[0]) + 1)


@dataclass(frozen=True, eq=False)
class DerivedSpeed:
    """Speed (n,) from position, and how it was made, for people."""

    speed: Array
    how: str


def derive_speed(position: Array, sample_rate_hz: float) -> DerivedSpeed:
    """Speed from position (n,) by a local polynomial of 4th order, symmetric about each sample: it has no lag.

    The window is the narrowest whose noise stays below 0.2 % of the highest speed; noise is judged from the third
    differences of position, which a smooth motion hardly has.
    """
    noise = white_noise(position)
    windows = [width for width in _WINDOWS if width <= max(5, position.size // 4 | 1)]
    for width in windows:
        order = min(_ORDER, width - 1)
        speed = np.asarray(savgol_filter(position, width, order, deriv=1, delta=1 / sample_rate_hz))
        gain = float(np.linalg.norm(savgol_coeffs(width, order, deriv=1, delta=1 / sample_rate_hz)))
        if noise * gain <= _NOISE_SHARE * float(np.percentile(np.abs(speed), 99.5)):
            break
    how = (
        f"derived from position (polynomial of order {order} over {width} samples, without lag), not measured"
    )
    return DerivedSpeed(speed, how)


def white_noise(samples: Array) -> float:
    """Standard deviation of the white noise (quantisation included) in samples (n,) of a smooth signal.

    From the third differences, whose variance is 20 times that of the noise; by their median, so that single steps
    in the signal do not count.
    """
    third = np.diff(samples, 3)
    if not third.size:
        return 0.0
    spread = float(np.median(np.abs(third))) / 0.6745
    return float((spread or np.sqrt(np.mean(third**2))) / np.sqrt(20))
