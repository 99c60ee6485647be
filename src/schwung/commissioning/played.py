"""What the played motions cost, as the drive reports them, beside what was predicted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from schwung.drivetrain import Machine, Simulated
from schwung.motion import Array, Motion
from schwung.session import Run

#: An axis has settled that stays within this share of the stroke.
SETTLED_SHARE = 1e-3


@dataclass(frozen=True)
class Cost:
    """One motion there and back, by what the drive reports of it, both dwells included; SI."""

    copper_n2m2s: float  # ∫T² dt, less what holding at rest takes
    rms_torque_nm: float  # over the time of the strokes
    peak_torque_nm: float
    mechanical_j: float  # ∫max(Tω, 0) dt
    drawn_j: float | None  # with regeneration; None without [motor.electrical]
    peak_following_rad: float
    rms_following_rad: float
    settling_s: float  # after the end of a stroke, the longer of both
    residual_rad_s: float  # RMS of the motor's speed after a stroke


@dataclass(frozen=True)
class Interval:
    """A mean and half its 95 % interval; None with one value alone."""

    mean: float
    half: float | None


@dataclass(frozen=True, eq=False)
class Played:
    """Both motions as measured, each repeat, and as predicted."""

    reference: tuple[Cost, ...]
    optimised: tuple[Cost, ...]
    predicted_reference: Cost
    predicted_optimised: Cost

    def saving(self, of: Callable[[Cost], float]) -> Interval | None:
        """Measured share by which the optimised motion costs less than the reference beside it.

        None where a reference has nothing of it: an axis that follows at once has settled in no time.
        """
        pairs = list(zip(self.reference, self.optimised, strict=True))
        if any(of(a) == 0 for a, _ in pairs):
            return None
        return interval([1 - of(b) / of(a) for a, b in pairs])

    def predicted_saving(self, of: Callable[[Cost], float]) -> float | None:
        """The same as predicted."""
        base = of(self.predicted_reference)
        return 1 - of(self.predicted_optimised) / base if base else None


def interval(values: Sequence[float]) -> Interval:
    """Mean and half its 95 % interval by Student's t."""
    n = len(values)
    if n < 2:
        return Interval(float(np.mean(values)), None)
    half = float(stdtrit(n - 1, 0.975)) * float(np.std(values, ddof=1)) / math.sqrt(n)
    return Interval(float(np.mean(values)), half)


def cost_of_run(run: Run, machine: Machine) -> Cost:
    """What a recorded motion cost."""
    assert run.motion is not None
    demand = run.motion.demand(run.time_s).position_rad + run.position_rad[0]
    wanted = demand if run.position_demand_rad is None else run.position_demand_rad
    return _cost(run.motion, machine, run.time_s, wanted, run.position_rad, run.speed_rad_s, run.torque_nm)


def cost_of_simulated(simulated: Simulated, motion: Motion, machine: Machine) -> Cost:
    """What a simulated motion costs, sampled as a run is."""
    s = simulated
    return _cost(motion, machine, s.time_s, s.demand_position_rad, s.position_rad, s.speed_rad_s, s.torque_nm)


def _cost(
    motion: Motion, machine: Machine, time: Array, wanted: Array, position: Array, speed: Array, torque: Array
) -> Cost:
    step = float(np.mean(np.diff(time)))
    squares = torque**2 - _resting_squares(motion, time, torque)
    power, drawn = torque * speed, None
    electrical = machine.motor.electrical
    if electrical is not None:
        lost = electrical.copper_w_nm2 * squares + electrical.iron_loss_nms * speed**2
        drawn = float(np.sum(power + lost)) * step
    error, copper = wanted - position, float(np.sum(squares)) * step
    strokes = len(motion.stroke_starts_s) * motion.duration_s
    settling, after = [], []
    for start in motion.stroke_starts_s:
        rest = (time > start + motion.duration_s) & (time <= start + motion.duration_s + motion.dwell_s)
        away = np.abs(wanted[rest] - position[rest]) > SETTLED_SHARE * abs(motion.distance_rad)
        last = int(np.flatnonzero(away)[-1]) + 1 if np.any(away) else 0
        settling.append(last * step)
        after.append(speed[rest])
    return Cost(
        copper_n2m2s=copper,
        rms_torque_nm=math.sqrt(max(copper, 0.0) / strokes),
        peak_torque_nm=float(np.max(np.abs(torque))),
        mechanical_j=float(np.sum(np.maximum(power, 0.0))) * step,
        drawn_j=drawn,
        peak_following_rad=float(np.max(np.abs(error))),
        rms_following_rad=float(np.sqrt(np.mean(error**2))),
        settling_s=max(settling),
        residual_rad_s=float(np.sqrt(np.mean(np.concatenate(after) ** 2))),
    )


def _resting_squares(motion: Motion, time: Array, torque: Array) -> Array:
    """Square of the torque that holds the axis (N²m²), (n,): at the end of each rest, for as long as that lasts."""
    squares = np.zeros_like(time)
    for start in motion.stroke_starts_s:
        end = start + motion.duration_s
        rest = (time > end) & (time <= end + motion.dwell_s)
        last = rest & (time > end + 0.8 * motion.dwell_s)
        if np.any(last):
            squares[rest] = float(np.mean(torque[last])) ** 2
    before = time < motion.start_time_s
    if np.any(before):
        squares[before] = torque[before] ** 2
    return squares
