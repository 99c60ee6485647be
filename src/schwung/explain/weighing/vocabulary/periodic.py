"""A disturbance of fixed frequency, A sin(2πf t + φ) on the motor, its phase each run's own.

Frequencies are too many to have columns for each, so one is looked for where a round misses most torque beyond what it
misses at the frequencies nearby.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter

from schwung.explain.weighing.along import Along, Ranges
from schwung.explain.weighing.candidate import Candidate, Missed, Shape, column
from schwung.innovations.effect import Effect
from schwung.motion import Array

NAME = "periodic_disturbance"
#: Places in the spectrum for each frequency that a run tells apart, and of these as many frequencies are nearby.
_FINER, _NEARBY = 4, 16
#: What falls by half of its power over less than so many periods of the whole record is no line, but a slope.
_LEAST_PERIODS = 3.0


def periodic(of: Ranges, torque_nm: float) -> Candidate:
    """The family's only one; `torque_nm`: a natural torque."""
    told_apart = 1 / max(of.longest_s, 1e-9)

    def effect(along: Along, shape: Shape) -> Effect:
        found = np.zeros((along.speed.size, 2 * of.runs))
        found[:, 2 * along.number : 2 * along.number + 2] = waves(along, shape[0])
        return Effect(found)

    def whole(along: Along, shape: Shape, coefficients: Array) -> Effect:
        own = coefficients[2 * along.number : 2 * along.number + 2]
        return Effect(column(waves(along, shape[0]) @ own))

    return Candidate(
        NAME, effect, (torque_nm,) * (2 * of.runs),
        lambda c, s: {"frequency_hz": s[0], "amplitude_nm": _amplitude(c)},
        shapes=(), sought=lambda missed: strongest(missed, of), choices=max(round(of.band_hz / told_apart), 1),
        spacing=(0.5 * told_apart,), logarithmic=(False,), bounds=((told_apart, 2 * of.band_hz),),
        coordinate="frequency", whole=whole, each_run=True,
    )  # fmt: skip


def waves(along: Along, frequency_hz: float) -> Array:
    """Sine and cosine of the run's time, (n, 2)."""
    turned = 2 * np.pi * frequency_hz * along.time_s
    return np.stack([np.sin(turned), np.cos(turned)], 1)


def _amplitude(coefficients: Array) -> float:
    """Mean of the runs', weighted by their power, so that runs that were not fitted do not count."""
    each = np.hypot(coefficients[::2], coefficients[1::2])
    return float(np.sum(each**3) / max(float(np.sum(each**2)), 1e-300))


def strongest(missed: Sequence[Missed], of: Ranges) -> tuple[Shape, ...]:
    """The frequency whose line stands out of the spectra of what is missed, if one does.

    Of R runs whose power there is ρ times what it is nearby on average, a line of one size and any phases is likelier
    than none by R (ρ − 1 − log ρ); it has to be as likely as that any of the places looked at is chance.
    """
    span = _FINER * of.longest_s
    frequency = np.arange(int(of.band_hz * span) + 1) / span
    over = []
    for one in missed:
        smooth = one.torque_nm * np.hanning(one.torque_nm.size)
        power = np.abs(np.fft.rfft(smooth, round(span / one.step_s))[: frequency.size]) ** 2
        nearby = median_filter(power, _FINER * _NEARBY + 1, mode="reflect") / np.log(2)
        share = power / np.maximum(nearby, 1e-300)
        for line in one.injected_hz:  # there, it may be the answer to the injection
            share[np.abs(frequency - line) < 2 / of.longest_s] = 1.0
        over.append(np.pad(share, (0, frequency.size - share.size), constant_values=1.0))
    if not over:
        return ()
    mean = np.maximum(np.mean(over, axis=0), 1.0)
    gain = np.where(frequency * of.longest_s < _LEAST_PERIODS, 0.0, len(over) * (mean - 1 - np.log(mean)))
    top = int(np.argmax(gain))
    return ((float(frequency[top]),),) if gain[top] > np.log(frequency.size) else ()
