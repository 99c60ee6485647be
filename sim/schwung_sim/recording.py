"""An axis played and sampled without a bus: recordings of the truth for benchmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung_sim.drives.axis import ServoAxis
from schwung_sim.errors import BenchError
from schwung_sim.plants import TICK_S

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AxisRecording:
    """What the axis reported, (n,) each; a sample stands beside the demand and the torque that led to it."""

    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array
    position_demand_rad: Array
    torque_added_nm: Array


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what is added to the reported values, and the size of one count of speed."""

    speed_rad_s: float = 0.02
    torque_nm: float = 0.1
    speed_count_rad_s: float = 0.0


def play(
    axis: ServoAxis, demand_rad: Array, torque_added_nm: Array, every: int, noise: Noise, seed: int
) -> AxisRecording:
    """Play demand and added torque, one value per control tick, (m,), and sample every so many ticks.

    The axis is energised first where it is not. Raises BenchError for arrays of two lengths.
    """
    if demand_rad.size != torque_added_nm.size or every < 1:
        raise BenchError("recording", "wants demand and torque of one length, and a whole number of ticks")
    if not axis.energised:
        axis.energise(True)
    rows = np.empty((demand_rad.size // every, 3))
    for tick, (target, torque) in enumerate(zip(demand_rad, torque_added_nm, strict=True), start=1):
        axis.set_target(float(target), TICK_S)
        axis.set_torque_offset(float(torque))
        axis.advance(TICK_S)
        if tick % every == 0 and tick // every <= rows.shape[0]:
            rows[tick // every - 1] = axis.position_rad, axis.speed_rad_s, axis.torque_nm
    chance = np.random.default_rng([seed, 17])
    speed = rows[:, 1] + noise.speed_rad_s * chance.standard_normal(rows.shape[0])
    if noise.speed_count_rad_s > 0:
        speed = np.rint(speed / noise.speed_count_rad_s) * noise.speed_count_rad_s
    last = slice(every - 1, None, every)
    return AxisRecording(
        time_s=np.arange(rows.shape[0], dtype=float) * every * TICK_S,
        position_rad=rows[:, 0].copy(),
        speed_rad_s=speed,
        torque_nm=rows[:, 2] + noise.torque_nm * chance.standard_normal(rows.shape[0]),
        position_demand_rad=demand_rad[last][: rows.shape[0]],
        torque_added_nm=torque_added_nm[last][: rows.shape[0]],
    )
