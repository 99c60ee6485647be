"""A disturbance of fixed frequency on the motor, its amplitude and phase each run's own: a sine A sin θ with
θ = 2πf t + φ, or a waveform A (sin θ + Σ pₖ sin kθ + qₖ cos kθ), whose shares p and q are the same in all runs.

A waveform of bounded variation has harmonics of 1/k at most (a rectangular one has 1/k at odd k), of which those beyond
half the sampling rate show nothing. Evidence decides which of the two it is; a file holds the sine alone.

Frequencies are too many to have columns for each, so one is looked for where a round misses most torque beyond what it
misses at the frequencies nearby.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import Candidate, Missed, Shape
from schwung.explain.causes.curves import column
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.vocabulary.line import FINER, LEAST_PERIODS, beyond_nearby, line_of
from schwung.innovations.effect import Effect
from schwung.motion import Array

NAME = "periodic_disturbance"
#: Harmonics of a waveform.
_ORDERS = np.arange(2, 9)


def periodic(of: Ranges, torque_nm: float) -> list[Candidate]:
    """The family: a sine and a waveform, of which a set holds one; `torque_nm`: a natural torque."""
    told_apart, runs = 1 / max(of.longest_s, 1e-9), 2 * of.runs

    @run_by_run
    def effect(along: Along, shape: Shape) -> Effect:
        found = np.zeros((along.speed.size, runs))
        if along.number < of.runs:  # the phase of a run that is yet to come is anything
            found[:, 2 * along.number : 2 * along.number + 2] = waves(along, shape[0])
        return Effect(found)

    @run_by_run
    def whole(along: Along, shape: Shape, coefficients: Array) -> Effect:
        if along.number >= of.runs:
            return Effect(column(np.zeros(along.speed.size)))
        own = coefficients[2 * along.number : 2 * along.number + 2]
        return Effect(column(waves(along, shape[0]) @ own))

    sine = Candidate(
        NAME, effect, (torque_nm,) * runs,
        lambda c, s: {"frequency_hz": s[0], "amplitude_nm": _amplitude(c[:runs])},
        shapes=(), sought=lambda missed: strongest(missed, of), choices=max(round(of.band_hz / told_apart), 1),
        spacing=(0.5 * told_apart,), logarithmic=(False,), bounds=((told_apart, 2 * of.band_hz),),
        coordinate="frequency", whole=whole, each_run=True,
    )  # fmt: skip
    return [sine, _waveform(sine)]


def _waveform(sine: Candidate) -> Candidate:
    """With the harmonics' shares p, then q, behind the runs' own coefficients."""
    runs = sine.size

    @run_by_run
    def bent(along: Along, shape: Shape, coefficients: Array) -> tuple[Effect, Effect]:
        mine = slice(2 * along.number, 2 * along.number + 2)
        more = np.zeros((along.speed.size, coefficients.size))
        if mine.stop > runs:
            return Effect(more), Effect(column(np.zeros(along.speed.size)))
        amplitude = float(np.hypot(*coefficients[mine]))
        base = waves(along, shape[0])
        more[:, mine] = base
        if amplitude == 0:  # of a run whose phase is not known, nothing is known of its harmonics
            return Effect(more), Effect(column(np.zeros(along.speed.size)))
        cosine, sine = coefficients[mine] / amplitude  # of φ
        turned = 2 * np.pi * shape[0] * along.time_s + np.arctan2(sine, cosine)
        share = _ORDERS * shape[0] * along.run.step_s  # of the sampling rate
        shown = np.where(
            share < 0.5, 1 / np.sinc(share) ** 2, 0.0
        )  # straight between samples a sine is smaller by that
        angle = turned[:, None] * _ORDERS
        harmonics = np.concatenate([np.sin(angle) * shown, np.cos(angle) * shown], axis=1)
        p, q = coefficients[runs:].reshape(2, -1)
        added = harmonics @ coefficients[runs:]
        slope = harmonics @ np.concatenate(
            [-_ORDERS * q, _ORDERS * p]
        )  # by θ, which the run's own two turn, too
        more[:, mine] += np.stack([cosine * added - sine * slope, sine * added + cosine * slope], 1)
        more[:, runs:] = amplitude * harmonics
        return Effect(more), Effect(column(base @ coefficients[mine] + amplitude * added))

    def effect(along: Along, shape: Shape) -> Effect:
        return bent(along, shape, np.zeros(deviations.size))[0]

    deviations = np.array([*sine.deviations, *(1 / _ORDERS), *(1 / _ORDERS)])
    return replace(
        sine, effect=effect, deviations=tuple(deviations.tolist()), whole=None, bent=bent,
        unsaid=lambda c, spread, s, unit: _harmonics(_amplitude(c[:runs]), c[runs:], spread[runs:], s[0], unit),
    )  # fmt: skip


def _harmonics(amplitude_nm: float, shares: Array, spread: Array, frequency_hz: float, unit: str) -> str:
    """Those that chance alone would not show in 19 of 20, in words; empty: there are none."""
    each, deviations = (np.hypot(*values.reshape(2, -1)) for values in (shares, spread))
    beyond = float(np.sqrt(-np.log(0.05)))  # Rayleigh's distribution
    told = [
        f"{amplitude_nm * share:.2g} {unit} at {order * frequency_hz:.4g} Hz"
        for order, share, deviation in zip(_ORDERS, each, deviations, strict=True)
        if share > beyond * deviation
    ]
    return f"its harmonics ({', '.join(told)})" if told else ""


def waves(along: Along, frequency_hz: float) -> Array:
    """Sine and cosine of the run's time, (n, 2)."""
    turned = 2 * np.pi * frequency_hz * along.time_s
    return np.stack([np.sin(turned), np.cos(turned)], 1)


def _amplitude(coefficients: Array) -> float:
    """Mean of the runs', weighted by their power, so that runs that were not fitted do not count."""
    each = np.hypot(coefficients[::2], coefficients[1::2])
    return float(np.sum(each**3) / max(float(np.sum(each**2)), 1e-300))


def strongest(missed: Sequence[Missed], of: Ranges) -> tuple[Shape, ...]:
    """The frequency whose line stands out of the spectra of what is missed, if one does."""
    span = FINER * of.longest_s
    frequency = np.arange(int(of.band_hz * span) + 1) / span
    over = []
    for one in missed:
        smooth = one.torque_nm * np.hanning(one.torque_nm.size)
        share = beyond_nearby(smooth, round(span / one.step_s), frequency.size)
        for (
            line
        ) in one.injected_hz:  # there, it may be the answer to the injection, of what bends, yields or sticks
            away = np.abs(frequency - line * np.maximum(np.round(frequency / line), 1.0))
            share[away < 2 / of.longest_s] = 1.0
        over.append(share)
    return line_of(over, frequency, frequency * of.longest_s >= LEAST_PERIODS)
