"""Late speed and late torque: what the time shifts between angle, speed and torque say.

Every drive filters and samples, so that speed and torque are both reported a little after the angle, as late as each
other; a torque that is held for a period belongs to its middle. Beyond that, a speed that comes later than the torque
is delayed, and a torque that acts later than it is reported has a lag. The sum of the two is all that the times say;
which of them it is follows from how late the drive's filter would be: as late as the torque is after the motion, were
the speed delayed, and as late as the speed is after the angle, were it the torque that lags. Filters bend the speed the
more the later they are and a delay does not, and no filter is ahead of time. What that leaves open is said to be open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.filtered import LONGEST_FILTER_S, SPREAD, USUAL
from schwung.explain.signals import Prepared

#: Shifts below this are what filters do (s). Sampling's own are half or a whole period, but for this much.
SMALLEST_S, SAMPLING_S = 1.5e-5, 5e-6
#: A channel closer than this to the angle is on time (s).
ON_TIME_S = 1e-5
_DEVIATIONS = 6.0
#: In logarithms of likelihood: odds that leave nothing open, and how unlikely it is that a lag is as long as the
#: filter, or a filter shorter than half of the controller's period, over which a speed is taken.
SURE, COINCIDENCE, SHORT = 4.5, 2.0, 1.0
#: Above this mean square over the noise's, a shift may stand in for whatever else is missed.
UNSETTLED = 4.0
_APART = "speed and torque are {:.2g} ms apart, which may stand in for what is not explained: no delay or lag is named"


@dataclass(frozen=True)
class Shift:
    """What was found: `name` is "measurement_delay" or "torque_lag", `seconds` how much; None where nothing is odd."""

    name: str | None
    seconds: float = 0.0
    std_s: float = 0.0
    doubtful: bool = False  # could as well be the other one
    note: str = ""


@dataclass(frozen=True)
class Times:
    """Shifts as the best model has them, each with its standard deviation (s).

    `timing_s`: motion ahead of the torque; `lag_s`: the torque's lag beyond that, by the shape of its response.
    `misfit`: mean square of what the model misses over the noise's: what it misses may pass for a shift.
    """

    timing_s: float
    timing_std_s: float
    lag_s: float
    lag_std_s: float
    misfit: float = 1.0


def shift(prepared: Prepared, machine: Machine, times: Times) -> Shift:
    """Judge the shifts: a delay of the speed, a lag of the torque, or what filters and sampling do."""
    smallest = SMALLEST_S * max(1.0, times.misfit) ** 2
    if times.lag_s > max(smallest, _DEVIATIONS * times.lag_std_s):
        return Shift("torque_lag", times.lag_s, times.lag_std_s)
    period = _period(prepared, machine)
    if not np.isfinite(prepared.speed_delay_std_s):  # a speed that was worked out from the angle says nothing
        if times.timing_s > max(LONGEST_FILTER_S, period):
            return Shift("torque_lag", times.timing_s, times.timing_std_s, doubtful=True)
        return Shift(None, note=_slow(times.timing_s, period))
    later = prepared.speed_delay_s + times.timing_s
    std = float(np.hypot(prepared.speed_delay_std_s, times.timing_std_s))
    note = _ordinary(later, max(smallest, _DEVIATIONS * std), times.timing_s, prepared, machine)
    if note is None and times.misfit > UNSETTLED:
        note = _APART.format(1e3 * later)
    if note is not None:
        return Shift(None, note=note)
    control = 1 / machine.control.sample_rate_hz if machine.control else 0.0
    return _named(later, std, times.timing_s, prepared, control)


def _ordinary(
    later: float, smallest: float, timing_s: float, prepared: Prepared, machine: Machine
) -> str | None:
    """What to say of a speed that is `later` than the torque where that is ordinary; None where it is not."""
    period = _period(prepared, machine)
    if LONGEST_FILTER_S < later < period:
        return _slow(later, period)
    long = later > LONGEST_FILTER_S and timing_s < ON_TIME_S  # no torque that belongs to another instant
    if abs(later) < smallest or (not long and _of_sampling(later, prepared, machine)):
        return _filtered(prepared.speed_delay_s)
    return (
        None
        if later > 0
        else f"torque is reported {-1e3 * later:.2g} ms after the speed: a filter of its own"
    )


def _period(prepared: Prepared, machine: Machine) -> float:
    """How long a torque may be held (s): the controller's period where it is known, else the recording's."""
    return 1 / (machine.control.sample_rate_hz if machine.control else prepared.source_rate_hz)


def _named(later: float, std: float, timing_s: float, prepared: Prepared, period_s: float) -> Shift:
    """Late speed or late torque: by what a filter can do, and where it could do both, by what is likelier."""
    if prepared.speed_delay_s > LONGEST_FILTER_S:
        return Shift("measurement_delay", later, std)
    if timing_s > ON_TIME_S:
        return Shift("torque_lag", later, std)
    odds = _odds(prepared, timing_s, period_s)
    return Shift("torque_lag" if odds > 0 else "measurement_delay", later, std, doubtful=abs(odds) < SURE)


def _odds(prepared: Prepared, timing_s: float, period_s: float) -> float:
    """Logarithm of how much likelier a lag of the torque is than a delay of the speed."""
    odds = _likely(prepared, prepared.speed_delay_s) - _likely(prepared, -timing_s)
    if abs(timing_s) < ON_TIME_S:
        odds -= COINCIDENCE
    elif -timing_s < 0.5 * period_s - ON_TIME_S:
        odds += SHORT
    return odds


def _likely(prepared: Prepared, filtered_s: float) -> float:
    """Logarithm of the likelihood of the speed's bend, if the drive's filter is so late."""
    if not np.isfinite(prepared.seen_bend_std_s2):
        return 0.0
    late = 0.5 * max(filtered_s, 0.0) ** 2
    variance = (SPREAD * late) ** 2 + prepared.seen_bend_std_s2**2
    return float(-0.5 * (prepared.seen_bend_s2 - USUAL * late) ** 2 / variance - 0.5 * np.log(variance))


def _of_sampling(later: float, prepared: Prepared, machine: Machine) -> bool:
    """Whether a shift is half or a whole period of the recording or of the controller."""
    periods = [1 / prepared.source_rate_hz]
    if machine.control is not None:
        periods.append(1 / machine.control.sample_rate_hz)
    return any(abs(later - share * period) < SAMPLING_S for period in periods for share in (0.5, 1.0))


def _slow(late_s: float, period_s: float) -> str:
    if abs(late_s) < max(LONGEST_FILTER_S, 0.1 * period_s):
        return ""
    return (
        f"motion and torque are {1e3 * abs(late_s):.2g} ms apart, within one sampling period: sampling and holding "
        "do as much; that was allowed for"
    )


def _filtered(delay_s: float) -> str:
    if abs(delay_s) < 5e-5:
        return ""
    return f"speed and torque are reported {1e3 * delay_s:.2g} ms after the angle, as filters do; that was allowed for"
