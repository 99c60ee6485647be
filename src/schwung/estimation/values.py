"""What an estimate consists of: plain values, passed on to the report, the procedure and the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.inertia import InertiaTable
from schwung.motion import Array
from schwung.session.model import Run

Inversion = Literal["complex", "magnitude"]
Verdict = Literal["good", "doubtful", "unusable"]


@dataclass(frozen=True, eq=False)
class Denoised:
    """An excited run minus its reference (equations 11 and 16), (n,) each: the motion gone, the sine left."""

    time_s: Array
    position_rad: Array  # of the reference run
    speed_rad_s: Array
    torque_nm: Array
    position_deviation_rad: Array
    reference: Run  # where several repeats are averaged: their mean
    excited: Run


@dataclass(frozen=True, eq=False)
class Trace:
    """The inertia along one excited run, one value per sample, (n,); NaN where there is none to be had.

    Each value belongs to a window of one period; `time_s` and `position_rad` are those of the window's
    middle, half a period before its last sample. `position_rad` is the load angle: the coupling's wind-up
    is taken off.
    """

    time_s: Array
    position_rad: Array
    inertia_kgm2: Array  # real part
    imaginary_kgm2: Array  # of the complex inversion, with either inversion; should vanish
    inertia_variation_kgm2: Array  # J(i) − J(i−N), equation 15
    speed_amplitude_rad_s: Array
    torque_amplitude_nm: Array
    stroke: NDArray[np.int64] | None = None  # which stroke of the run each sample belongs to: 0, 1, …
    name: str = ""  # of the excited run


@dataclass(frozen=True)
class Trust:
    """May the estimate be believed? Numbers and the verdict drawn from them, in words."""

    dpr: float | None  # disturbance-to-position ratio (7); None where motion or controller is not known
    miv_kgm2: float  # maximum inertia variation per period (15)
    relative_miv: float  # the same over the mean inertia
    position_amplitude_rad: float  # of the sine in the position deviation (16), the median
    position_dc_rad: float  # largest mean of the position deviation over one period
    verdict: Verdict
    reasons: tuple[str, ...]
    predicted_error: float | None = (
        None  # the table's band, median over the mean inertia; None: not judged by it
    )
    left_out: float = 0.0  # of it, by squares: what no noise explains, in all cells alike


@dataclass(frozen=True, eq=False)
class Estimate:
    """Load inertia over load angle, how it came about and how far to trust it."""

    method: str
    inversion: Inversion
    frequency_hz: float
    table: InertiaTable
    traces: tuple[Trace, ...]
    denoised: tuple[Denoised, ...]
    trust: Trust
    notes: tuple[str, ...] = ()
    shown: tuple[str, ...] = ()  # physics beside inertia, friction and load that was found with it, in words

    def to_json(self) -> dict[str, Any]:
        """Everything but the samples, JSON-ready."""
        trust = self.trust
        return {
            "method": self.method,
            "inversion": self.inversion,
            "frequency_hz": self.frequency_hz,
            "table": {
                "position_rad": self.table.position_rad.tolist(),
                "inertia_kgm2": self.table.inertia_kgm2.tolist(),
                "std_kgm2": None if self.table.std_kgm2 is None else self.table.std_kgm2.tolist(),
            },
            "trust": {
                "verdict": trust.verdict,
                "reasons": list(trust.reasons),
                "dpr": trust.dpr,
                "miv_kgm2": trust.miv_kgm2,
                "relative_miv": trust.relative_miv,
                "position_amplitude_rad": _finite(trust.position_amplitude_rad),
                "position_dc_rad": _finite(trust.position_dc_rad),
                "predicted_error": trust.predicted_error,
                "left_out_error": trust.left_out,
            },
            "runs": [trace.name for trace in self.traces],
            "notes": list(self.notes),
        }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def finite(traces: Sequence[Trace], name: str) -> Array:
    """One quantity of all traces in a row, without its NaN, (n,)."""
    values = np.concatenate([np.empty(0), *(getattr(trace, name) for trace in traces)])
    return np.asarray(values[np.isfinite(values)], dtype=float)
