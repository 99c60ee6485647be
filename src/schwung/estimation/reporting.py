"""What a drive takes off the amplitudes that it reports: all ways of sampling, holding and filtering, weighed.

A controller of period T holds its torque from tick to tick. Of a sine the torque that acts is smaller than its samples
by γω², γ = T²/24, and stands ½T later. The rotor follows the corners of the staircase: seen at the ticks, its speed is
less than that of a smooth torque by T²/(12 J_r) dT/dt (Bernoulli's polynomial B_2(0) = 1/6), while its angle and the
mean of its speed over a tick are not. A speed is a sensor's, as at the tick, or the difference of two angles, ½T late
and less by T²/24; a filter of first order with lag τ takes off γ = ½τ(τ + T); a report late by whole ticks takes off
nothing. Torque is reported as of the tick that begins, late by whole ticks, and may have passed the speed's filter or
one of its own. A drive whose current loop smooths the ticks holds nothing, and reports its torque as it acts.

No drive says which it is. Three numbers are known with a standard deviation each: how far the speed lags behind the
angle, what it lost against it, and how far the torque lags behind what acts. Every way has its likelihood by them; a
lag that is no multiple of ticks is a delay of any length or a filter of any lag, at a price (Occam's). What is not
known of the losses is what these hypotheses leave open together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from schwung.estimation.fit import Nuisance
from schwung.motion import Array

#: Periods of the loops of servo drives, where the machine file does not tell; none is slower than the log.
LOOPS_S = (62.5e-6, 125e-6, 250e-6)
#: How likely it is that a report is late by 0, 1, … whole ticks: each is half as likely as one less.
LATE = np.array([8, 4, 2, 1]) / 15
#: Lags beyond the ticks, of filters and delays, are anything up to this.
LONGEST_S = 1e-3
#: One drive in so many reports a speed or a torque like nothing here.
UNUSUAL = 0.1
#: How far a drive's filter is from one of first order: its loss at a given lag, relative, one standard deviation.
RULE = 0.05
#: Ticks are a clock's, but how late a signal is, is not seen better than this share of one.
TICK = 0.01
#: What a band holds, and how many standard deviations that is to either side.
HELD, WIDE = 0.95, 1.96


@dataclass(frozen=True)
class Seen:
    """What a record says of its drive."""

    speed_lag_s: Nuisance  # of the reported speed behind the reported angle
    speed_loss_s2: Nuisance  # γ of it
    torque_lag_s: Nuisance  # of the reported torque behind the one that acts, on average
    swing: float  # the inertia that the injection meets over the rotor's: corners count against that


@dataclass(frozen=True)
class Losses:
    """Of an amplitude γω² was lost; `corner_s2`: the speed's samples hold so much of dT/dt over the rotor's inertia."""

    speed_s2: Nuisance
    torque_s2: Nuisance
    corner_s2: float


@dataclass(frozen=True)
class _Way:
    """One hypothesis: its weight, and the losses that follow from it, standard deviations beside."""

    weight: float
    speed: float  # without the corners
    speed_std: float
    corner: float
    torque: float
    torque_std: float


def losses(seen: Seen, period_s: float | None, step_s: float, *, held: bool) -> Losses:
    """What speed and torque lost. `period_s`: of the controller, None: not known; `step_s`: of the log.

    `held`: the injection was held by a bus and its steps are allowed for already, so that ticks take nothing off.
    """
    loops = [loop for loop in LOOPS_S if loop <= 1.01 * step_s] if period_s is None else [period_s]
    ways = [
        way
        for period in loops or [step_s]
        for smooth in ((True,) if held else (False, True))
        for way in _ways(seen, period, smooth)
    ]
    weight = np.array([way.weight for way in ways])
    weight = weight / weight.sum()
    corner = float(weight @ [way.corner for way in ways])
    speed = [_agreed(seen, way) for way in ways]
    return Losses(
        _all(weight, np.array([s.value for s in speed]), np.array([s.std for s in speed])),
        _all(weight, np.array([way.torque for way in ways]), np.array([way.torque_std for way in ways])),
        corner,
    )


def _ways(seen: Seen, period: float, smooth: bool) -> Iterator[_Way]:
    """Every way a drive of one period may report; `smooth`: no torque is held over a tick."""
    for likely, speed, speed_std, corner, filtered in _speeds(seen, period, smooth):
        for more, torque, torque_std in _torques(seen, period, smooth, filtered):
            yield _Way(likely * more, speed, speed_std, corner, torque, torque_std)


def _speeds(seen: Seen, period: float, smooth: bool) -> Iterator[tuple[float, float, float, float, float]]:
    """Weight, loss, its deviation, corner and filter's lag of every way to report a speed."""
    lag = seen.speed_lag_s
    for difference in (False, True):
        loss = period**2 / 24 if difference else 0.0
        corner = 0.0 if difference or smooth else -(period**2) / 12
        for ticks, often in enumerate(LATE):
            rest = lag.value - (ticks + difference / 2) * period
            weight = _normal(rest, np.hypot(lag.std, TICK * period))
            found = [(weight, loss, 0.0, 0.0)]
            if rest > 0:
                taken, off = _filter(rest, lag.std, period)
                found.append((1 / LONGEST_S, loss + taken, off, rest))
            for likely, taken, off, filtered in found:
                # what the injection meets on the way is not one inertia: corners compare by their mean alone
                sure = np.hypot(seen.speed_loss_s2.std, np.hypot(off, RULE * corner * seen.swing))
                seen_so = _normal(seen.speed_loss_s2.value - taken - corner * seen.swing, sure)
                yield often / 2 * likely * seen_so, taken, off, corner, filtered
    # late by any time, or filtered like nothing here: what was measured stands
    half = max(lag.value, 0.0) ** 2 / 2 + period**2 / 24
    sure = np.hypot(half, seen.speed_loss_s2.std)
    yield UNUSUAL / LONGEST_S * _normal(seen.speed_loss_s2.value, sure), 0.0, half, 0.0, 0.0


def _torques(
    seen: Seen, period: float, smooth: bool, filtered: float
) -> Iterator[tuple[float, float, float]]:
    """Weight, loss and its deviation of every way to report a torque; `filtered`: lag of the speed's filter."""
    lag = seen.torque_lag_s
    sure = float(np.hypot(lag.std, TICK * period))
    held, ahead = (0.0, 0.0) if smooth else (period**2 / 24, period / 2)
    for ticks, often in enumerate(LATE):
        rest = lag.value + ahead - ticks * period
        yield often * _normal(rest, sure), -held, 0.0
        if filtered > 0:
            either = float(np.hypot(sure, seen.speed_lag_s.std))
            taken, off = _filter(filtered, seen.speed_lag_s.std, period)
            yield often * _normal(rest - filtered, either), taken - held, off
        if rest > 0:
            taken, off = _filter(rest, lag.std, period)
            yield UNUSUAL * often / LONGEST_S, taken - held, off
    yield UNUSUAL / LONGEST_S, -held, 0.0


def _filter(lag: float, std: float, period: float) -> tuple[float, float]:
    """γ of a filter of first order in steps of the period, and its standard deviation."""
    loss = lag * (lag + period) / 2
    return loss, float(np.hypot(RULE * loss, (lag + period / 2) * min(std, lag)))


def _normal(off: float, std: float) -> float:
    return float(np.exp(-((off / std) ** 2) / 2) / (std * np.sqrt(2 * np.pi))) if np.isfinite(std) else 1.0


def _agreed(seen: Seen, way: _Way) -> Nuisance:
    """The loss of the speed beside its corners as measured and as a way would have it: mean by inverse variance."""
    corner = way.corner * seen.swing
    measured, sure = seen.speed_loss_s2.value - corner, np.hypot(seen.speed_loss_s2.std, RULE * corner)
    if way.speed_std == 0 or not np.isfinite(sure):
        return Nuisance(way.speed, way.speed_std)
    one, other = (max(float(std), 1e-18) ** -2.0 for std in (sure, way.speed_std))
    return Nuisance((one * measured + other * way.speed) / (one + other), (one + other) ** -0.5)


def _all(weight: Array, value: Array, std: Array) -> Nuisance:
    """The mean of a mixture's likely parts, and a standard deviation: theirs, and what makes a band of 95 % hold as
    much of all the mixture.
    """
    order = np.argsort(-weight)
    kept = order[: int(np.searchsorted(np.cumsum(weight[order]), HELD * weight.sum())) + 1]
    share = weight[kept] / weight[kept].sum()
    mean = float(share @ value[kept])
    far = np.abs(value - mean)
    order = np.argsort(far)
    edge = far[order][int(np.searchsorted(np.cumsum(weight[order]), HELD * weight.sum()))]
    return Nuisance(mean, float(np.hypot(edge / WIDE, np.sqrt(share @ std[kept] ** 2))))
