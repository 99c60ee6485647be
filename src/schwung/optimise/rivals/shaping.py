"""Input shaping: the 1/3 profile, sent in two or three portions that cancel each other's vibration.

Singer and Seering, "Preshaping command inputs to reduce system vibration", J. Dyn. Sys. Meas. Control 112 (1990):
ZV and ZVD. What swings is the load behind a motor that follows. The portions end when the stroke shall, so the profile
in them is shorter by what the shaper takes.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from schwung.motion import Array, Demand, Motion
from schwung.optimise.model import Model

Shaper = Literal["zv", "zvd"]


def shaped_demand(
    model: Model, shaper: Shaper, distance_rad: float, duration_s: float, end_rad: float, time_s: Array
) -> Demand | None:
    """The shaped 1/3 profile at instants (s), (n,); None where the stroke leaves the shaper no time.

    Shaped for the load as it is at the end, where it has to stand.
    """
    if model.stiffness_nm_rad is None:
        return None
    inertia = float(model.load_inertia(end_rad))
    natural = np.sqrt(model.stiffness_nm_rad / inertia)
    ratio = model.damping_nms / (2 * np.sqrt(model.stiffness_nm_rad * inertia))
    if ratio >= 1:
        return None
    half = np.pi / (natural * np.sqrt(1 - ratio**2))
    decay = np.exp(-ratio * np.pi / np.sqrt(1 - ratio**2))
    portions = np.array([1.0, decay] if shaper == "zv" else [1.0, 2 * decay, decay**2])
    portions /= portions.sum()
    left = duration_s - half * (portions.size - 1)
    if left <= 0:
        return None
    base = Motion(kind="third", distance_rad=distance_rad, duration_s=left, start_time_s=0.0, returns=False)
    parts = [base.demand(time_s - half * number) for number in range(portions.size)]
    return Demand(
        *(
            sum(a * getattr(part, name) for a, part in zip(portions, parts, strict=True))
            for name in vars(parts[0])
        )
    )
