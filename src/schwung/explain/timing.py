"""Late speed and late torque: what the time shifts between angle, speed and torque say.

Every drive filters and samples, so that speed and torque are both reported a little after the angle, as late as each
other; a torque that is held for a period belongs to its middle. Beyond that, a speed that comes later than the torque
is delayed, and a torque that acts later than it is reported has a lag. Which of the two it is can be told where the
other channel is where it ought to be, and else is left open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.machine import Machine
from schwung.explain.signals import Prepared

#: Shifts below this are what filters do (s), and so close to half or a whole period they are sampling's own.
SMALLEST_S, SAMPLING_S = 1.5e-5, 1.2e-5
#: A channel closer than this to the angle is on time (s).
ON_TIME_S = 1e-5
#: Speed or torque are not filtered for longer than this without its being worth a name (s).
LONGEST_FILTER_S = 2.5e-4
_DEVIATIONS = 6.0


@dataclass(frozen=True)
class Shift:
    """What was found: `name` is "measurement_delay" or "torque_lag", `seconds` how much; None where nothing is odd."""

    name: str | None
    seconds: float = 0.0
    std_s: float = 0.0
    doubtful: bool = False  # could as well be the other one
    note: str = ""


def shift(
    prepared: Prepared, machine: Machine, timing_s: float, timing_std_s: float, lag_s: float, lag_std_s: float
) -> Shift:
    """Judge the shifts; `timing_s`: motion ahead of the torque, `lag_s`: lag beyond it by the shape of its response."""
    late_torque = -timing_s
    std = float(np.hypot(prepared.speed_delay_std_s, timing_std_s))
    if lag_s > max(SMALLEST_S, _DEVIATIONS * lag_std_s):
        return Shift("torque_lag", lag_s, lag_std_s)
    period = 1 / prepared.source_rate_hz
    if not np.isfinite(prepared.speed_delay_std_s):
        if -late_torque > max(LONGEST_FILTER_S, period):
            return Shift("torque_lag", -late_torque, timing_std_s, doubtful=True)
        return Shift(None, note=_slow(-late_torque, period))
    later = prepared.speed_delay_s - late_torque
    if LONGEST_FILTER_S < later < period:
        return Shift(None, note=_slow(later, period))
    long = later > LONGEST_FILTER_S and late_torque > -ON_TIME_S  # no torque that belongs to another instant
    if abs(later) < max(SMALLEST_S, _DEVIATIONS * std) or (
        not long and _of_sampling(later, prepared, machine)
    ):
        return Shift(None, note=_filtered(prepared.speed_delay_s))
    if later < 0:
        return Shift(
            None, note=f"torque is reported {-1e3 * later:.2g} ms after the speed: a filter of its own"
        )
    if prepared.speed_delay_s > LONGEST_FILTER_S or abs(late_torque) < ON_TIME_S:
        return Shift("measurement_delay", later, std)
    if late_torque < -ON_TIME_S or abs(prepared.speed_delay_s) < ON_TIME_S:
        return Shift("torque_lag", later, std)
    return Shift("measurement_delay", later, std, doubtful=True)


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
