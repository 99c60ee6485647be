"""What explanations are made of: located mismatch, quantities with intervals, runs for pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schwung.motion import Array

Verdict = Literal["consistent", "explained", "partly_explained", "unexplained"]
Coordinate = Literal[
    "position", "speed", "direction", "acceleration", "torque", "time_in_motion", "frequency", "run"
]
#: What of a recording a model misses.
Signal = Literal["torque", "speed"]
#: Which model misses it.
Model = Literal["the belief", "the file"]


@dataclass(frozen=True)
class Located:
    """Where a mismatch is: over which coordinate, on which interval, with which share of its energy."""

    coordinate: Coordinate
    interval: tuple[float, float]
    unit: str
    share_of_energy: float  # 0…1
    p_value: float
    text: str
    of: Signal = "torque"

    def to_json(self) -> dict[str, Any]:
        """For explanation.json."""
        return {
            "coordinate": self.coordinate,
            "interval": list(self.interval),
            "unit": self.unit,
            "share_of_energy": self.share_of_energy,
            "p_value": self.p_value,
            "text": self.text,
            "of": self.of,
        }


@dataclass(frozen=True, eq=False)
class Quantity:
    """A parameter with its 95 % interval; `value` is a table of pairs where the parameter is one."""

    value: float | tuple[tuple[float, float], ...]
    unit: str
    ci95: tuple[float, float] | None  # None for tables


@dataclass(frozen=True, eq=False)
class Overlay:
    """One run for pictures: what was measured, and what the belief needed before and after; arrays (n,)."""

    run: int
    heldout: bool
    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array  # as recorded, within the band that is compared
    before_nm: Array  # torque that the belief needs for the recorded motion
    after_nm: Array  # the same with the named physics
    terms_nm: Mapping[str, Array]  # what each named term changes in it
    considered: NDArray[np.bool_]  # whether the sample is compared (not at standstill, nor at the edges)
    motion_time_s: Array | None = None  # since the demand left rest; None: not known
    #: Reported speed beyond what follows from the belief, and from the same with the named physics; None: not measured.
    speed_before_rad_s: Array | None = None
    speed_after_rad_s: Array | None = None
