"""Filters without lag: Butterworth's low-pass, and Wiener's."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.fft import dst, idst
from scipy.special import expit, gammainc, gammaln

from schwung.compiled import compiled_or
from schwung.motion import Array

#: Frequencies on either side that a signal's power is averaged over, and that of a draw of noise, which has no lines.
_BESIDE, _BROADLY = 7, 15
#: What the filter still knows of a sample after so many of its slowest time constants is rounding.
_FORGOTTEN = 34.0
#: What it remembers longer than so many lengths of the signal is worked out by sines.
_LONGEST = 4


def low_passed(values: Array, edge: float, order: int) -> Array:
    """Signals (n, …) passed through a Butterworth filter there and back; `edge`: share of the highest frequency, 0…1.

    The gain is that of the bilinear transform, 1/(1 + (tan πf/tan πf_c)^(2·order)) for both ways. A signal goes on
    beyond either end as its own reflection about the end point, so that it is a straight line and a sine series.
    """
    if values.shape[0] < 3:
        return values
    each = np.ascontiguousarray(values.reshape(values.shape[0], -1).T, dtype=float)
    within = abs(np.tan(np.pi * edge / 2))
    least = 2 * np.sin(np.pi / (2 * order)) * within  # of the section that forgets most slowly
    forgets = np.log((1 + least + within**2) / (1 - least + within**2)) / 2  # in a sample
    if forgets * _LONGEST * values.shape[0] < _FORGOTTEN:
        passed = _by_sines(each, within, order, 0)
    else:
        passed = _there_and_back(each, within, order, int(np.ceil(_FORGOTTEN / forgets)))
    return np.asarray(np.ascontiguousarray(passed.T).reshape(values.shape))


def _by_sines(each: Array, within: float, order: int, ahead: int) -> Array:
    """Signals (c, n), frequency by frequency; `within`: tan πf_c; `ahead` only matters sample by sample."""
    del ahead
    values = each.T
    line, sines = _in_sines(values)
    frequency = np.arange(1, values.shape[0] - 1) / (2 * (values.shape[0] - 1))
    gain = 1 / (1 + (np.tan(np.pi * frequency) / within) ** (2 * order))
    return _from_sines(line, sines * gain[:, None]).T


@compiled_or(_by_sines)
def _there_and_back(each: Array, within: float, order: int, ahead: int) -> Array:
    """The same sample by sample, sections of second order one after another; `order` is even.

    Before its first sample the filter has run through the reflection for as long as it remembers anything, `ahead`.
    """
    number, count = each.shape
    period = 2 * (count - 1)
    signal, result = np.empty(count + 2 * ahead), np.empty((number, count))
    for c in range(number):
        values = each[c]
        first, rise = values[0], (values[count - 1] - values[0]) / (count - 1)
        for k in range(-ahead, count + ahead):
            at = k % period
            if at < count:
                signal[k + ahead] = values[at] - first - rise * at
            else:
                signal[k + ahead] = first + rise * (period - at) - values[period - at]
        for _ in range(2):
            for section in range(order // 2):
                width = 2.0 * np.sin(np.pi * (2 * section + 1) / (2 * order))
                scale = 1.0 / (1.0 + width * within + within * within)
                b = within * within * scale
                a1, a2 = (
                    2.0 * (within * within - 1.0) * scale,
                    (1.0 - width * within + within * within) * scale,
                )
                one, two = 0.0, 0.0
                for k in range(signal.size):
                    value = signal[k]
                    passed = b * value + one
                    one = 2.0 * b * value - a1 * passed + two
                    two = b * value - a2 * passed
                    signal[k] = passed
            signal = signal[::-1].copy()
        for k in range(count):
            result[c, k] = signal[k + ahead] + first + rise * k
    return result


def loudness(noise: Array) -> Array:
    """Power of noise alone (n,) in each sine, averaged broadly, (n − 2,); of too short a signal nothing is known."""
    if noise.size < 4 * _BROADLY:
        return np.zeros(max(noise.size - 2, 0))
    return _averaged(_in_sines(noise)[1] ** 2, _BROADLY)


def heard(values: Array, noise: float | Array) -> Array:
    """What is expected of a signal (n,) in noise (Wiener): at each frequency the share of the power about it that is
    not noise's. `noise`: its deviation, where it is white, or its `loudness` (n − 2,).

    Used as a regressor, a noisy signal meets its own noise in what it shall explain; its expectation does not.
    """
    if values.size < 4 * _BROADLY:
        return values
    line, sines = _in_sines(values)
    # of each of the unnormalised sines
    loud = 2 * (values.size - 1) * noise**2 if isinstance(noise, float) else noise
    power = np.maximum(_averaged(sines**2, _BESIDE), 1e-300)
    return _from_sines(line, sines * np.clip(1 - loud / power, 0.0, 1.0))


def surely_heard(values: Array, noise: float) -> Array:
    """The same of what is surely more than white noise. Of nothing but noise, half of the averages are above it by
    chance: at each frequency there is as often nothing as a signal of any loudness up to the loudest that there is.
    """
    if values.size < 4 * _BROADLY:
        return values
    line, sines = _in_sines(values)
    power = np.maximum(_averaged(sines**2, _BESIDE), 1e-300)
    at, odds, left = _signals()
    over = np.maximum(np.log(power) - np.log(max(2 * (values.size - 1) * noise**2, 1e-300)), at[0])
    open_to = np.log(max(float(np.max(over)), 1.0))
    there = expit(np.interp(over, at, odds) - open_to)
    return _from_sines(line, sines * there * (1 - np.interp(over, at, left) * np.exp(-over)))


@lru_cache(maxsize=1)
def _signals() -> tuple[Array, Array, Array]:
    """Of the logarithm of a power over the noise's, averaged as they are heard, (k,): log odds that there is a signal,
    but for how far its loudness is open (log), and how much of the noise's power is then expected to be in it.

    Of a power of 1 + s the average of m sines is a gamma distribution; with u = 1/(1 + s) anywhere in its logarithm
    u's is one as well, which ends at 1.
    """
    half, over = (2 * _BESIDE + 1) / 2, np.linspace(-6.0, 5.0, 2000)
    seen = half * np.exp(over)
    odds = gammaln(half) + np.log(gammainc(half, seen)) - half * np.log(seen) + seen
    return over, odds, gammainc(half + 1, seen) / gammainc(half, seen)


def _averaged(power: Array, beside: int) -> Array:
    """With as many on either side, fewer at the ends."""
    whole = np.convolve(power, np.ones(2 * beside + 1))[beside : beside + power.size]
    return np.asarray(whole / _counted(power.size, beside))


@lru_cache(maxsize=64)
def _counted(count: int, beside: int) -> Array:
    """How many there are within so many on either side, of each of `count`."""
    here = np.arange(count)
    return np.asarray(np.minimum(here, beside) + np.minimum(count - 1 - here, beside) + 1.0)


def _in_sines(values: Array) -> tuple[Array, Array]:
    """The straight line between the ends, and the sine series (type 1, not normalised) of the rest."""
    along = np.linspace(0.0, 1.0, values.shape[0]).reshape(-1, *(1,) * (values.ndim - 1))
    line = values[:1] + (values[-1:] - values[:1]) * along
    return line, np.asarray(dst((values - line)[1:-1], type=1, axis=0))


def _from_sines(line: Array, sines: Array) -> Array:
    result = line.copy()
    result[1:-1] += idst(sines, type=1, axis=0)
    return np.asarray(result)
