"""What an explanation is: located mismatch, named physics with intervals, proof on held-out runs, and its JSON.

The JSON's names and units are the contract of `explanation.json`; everything here is immutable and plot-free.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Machine
from schwung.motion import Array
from schwung.session.model import Axis

Verdict = Literal["consistent", "explained", "partly_explained", "unexplained"]
Coordinate = Literal[
    "position", "speed", "direction", "acceleration", "torque", "time_in_motion", "frequency", "run"
]


@dataclass(frozen=True)
class Located:
    """Where a mismatch is: over which coordinate, on which interval, with which share of its energy."""

    coordinate: Coordinate
    interval: tuple[float, float]
    unit: str
    share_of_energy: float  # 0…1
    p_value: float
    text: str

    def to_json(self) -> dict[str, Any]:
        """For explanation.json."""
        return {
            "coordinate": self.coordinate,
            "interval": list(self.interval),
            "unit": self.unit,
            "share_of_energy": self.share_of_energy,
            "p_value": self.p_value,
            "text": self.text,
        }


@dataclass(frozen=True, eq=False)
class Quantity:
    """A parameter with its 95 % interval; `value` is a table of pairs where the parameter is one."""

    value: float | tuple[tuple[float, float], ...]
    unit: str
    ci95: tuple[float, float] | None  # None for tables


@dataclass(frozen=True, eq=False)
class Finding:
    """One named physics term."""

    physics: str
    parameters: Mapping[str, Quantity]
    where: Located
    indistinguishable_from: tuple[str, ...]
    evidence: Mapping[str, float]
    text: str


@dataclass(frozen=True)
class Misfit:
    """Root mean square of what the model misses, over the runs that it is judged by."""

    torque_rmse_nm: float
    speed_rmse_rad_s: float


@dataclass(frozen=True)
class HeldOut:
    """The proof: runs that took no part in choosing or fitting, before and after."""

    train_runs: tuple[int, ...]
    heldout_runs: tuple[int, ...]
    before: Misfit
    after: Misfit


@dataclass(frozen=True)
class NoiseFloor:
    """What no model can explain, in torque, and how it was found."""

    torque_nm: float
    how: str


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


@dataclass(frozen=True, eq=False)
class Explanation:
    """Everything that `schwung explain` says."""

    verdict: Verdict
    axis: Axis
    noise_floor: NoiseFloor
    mismatch: tuple[Located, ...]
    findings: tuple[Finding, ...]
    fit: HeldOut
    machine: Machine  # the belief with the learned terms
    overlays: tuple[Overlay, ...]
    notes: tuple[str, ...] = ()  # plain sentences: what limits this explanation, and what would help
    remainder: tuple[Located, ...] = field(default=())  # where structure is left after the named terms

    def to_json(self) -> dict[str, Any]:
        """The document of `explanation.json`: as that of names with probabilities, which this way does not know."""
        fit, floor = self.fit, self.noise_floor.torque_nm
        before, after = (of.torque_rmse_nm / floor for of in (fit.before, fit.after))
        beyond = before**2 - 1
        left = min(1.0, max(after**2 - 1, 0.0) / beyond) if beyond > 0 else 0.0
        return {
            "format": "schwung-explanation",
            "version": 2,
            "verdict": self.verdict,
            "names": [
                {
                    "physics": finding.physics,
                    "probability": None,
                    "in_file": True,
                    "formula": None,
                    "where": finding.where.to_json(),
                    "parameters": {key: _quantity(value) for key, value in finding.parameters.items()},
                    "indistinguishable_from": list(finding.indistinguishable_from),
                    "evidence": dict(finding.evidence),
                    "text": finding.text,
                }
                for finding in self.findings
            ],
            "unnamed": [],
            "plain": None,
            "runners_up": [],
            "noise": {"torque_nm": floor, "how": self.noise_floor.how},
            "proof": {
                "runs": list(fit.heldout_runs),
                "fitted_runs": list(fit.train_runs),
                "before": before,
                "after": after,
                "taken": 1 - left,
                "before_nm": fit.before.torque_rmse_nm,
                "after_nm": fit.after.torque_rmse_nm,
                "before_rad_s": fit.before.speed_rmse_rad_s,
                "after_rad_s": fit.after.speed_rmse_rad_s,
            }
            if fit.heldout_runs
            else None,
            "mismatch": [where.to_json() for where in self.mismatch],
            "remainder": [where.to_json() for where in self.remainder],
            "left": left if fit.heldout_runs else None,
            "notes": list(self.notes),
        }


def _quantity(quantity: Quantity) -> dict[str, Any]:
    value = quantity.value if isinstance(quantity.value, float) else [list(pair) for pair in quantity.value]
    return {
        "value": value,
        "unit": quantity.unit,
        "ci95": None if quantity.ci95 is None else list(quantity.ci95),
    }
