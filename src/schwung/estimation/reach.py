"""What a recording could tell at best, beside what its table tells: would a better method help, or only better data?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.errors import SchwungError
from schwung.estimation.bound import cramer_rao
from schwung.estimation.values import Estimate
from schwung.session.model import Session

#: More samples than this are not gone through once more for one line of a report.
MOST_SAMPLES = 40_000
#: Up to so many times the bound, a table is as good as the recording.
NEAR = 2.0
#: Methods that use all that a recording holds.
_WHOLE = ("trajectory", "multiphase")


@dataclass(frozen=True)
class Reach:
    """Standard deviations, median over the table's angles (kg·m²; kg on a linear axis)."""

    table_kgm2: float
    bound_kgm2: float
    method: str
    unit: str = "kg·m²"

    @property
    def ratio(self) -> float:
        """How many times the least possible the table's is."""
        return self.table_kgm2 / self.bound_kgm2

    @property
    def text(self) -> str:
        """One sentence for people."""
        head = f"The table is good to ±{self.table_kgm2:.2g} {self.unit} (1σ), this recording allows"
        least = f"±{self.bound_kgm2:.2g}"
        if self.ratio <= NEAR:
            return f"{head} {least}: only a better recording would tell more (more injection or runs, less noise)."
        if self.method in _WHOLE:
            return (
                f"{head} {least}: not noise makes the error, but what the model or the sampling leaves out."
            )
        remedy = "--method trajectory, or --phases 4 when it is recorded"
        return f"{head} {least}: a better method would tell more ({remedy})."

    def to_json(self) -> dict[str, Any]:
        """For machines."""
        return {
            "table_std_kgm2": self.table_kgm2,
            "cramer_rao_std_kgm2": self.bound_kgm2,
            "ratio": self.ratio,
            "text": self.text,
        }


def reach_of(session: Session, machine: Machine, estimate: Estimate) -> Reach | None:
    """The session's Cramér-Rao bound at the estimated curve, with the noise found in it, against the table's band.

    None where there is no band or no verdict to speak of, where the recording is very long, or has no bound.
    """
    table = estimate.table
    if table.std_kgm2 is None or estimate.trust.verdict == "unusable":
        return None
    if sum(len(run) for run in session.runs) > MOST_SAMPLES:
        return None
    plain = InertiaTable(table.position_rad, table.inertia_kgm2)
    load = machine.load.model_copy(update={"inertia_kgm2": None, "inertia_table": plain})
    try:
        bound = cramer_rao(session, machine.model_copy(update={"load": load}), points=table.position_rad.size)
    except (SchwungError, np.linalg.LinAlgError):
        return None
    at = (bound.position_rad >= table.position_rad[0]) & (bound.position_rad <= table.position_rad[-1])
    least, own = float(np.median(bound.std_kgm2[at])), float(np.median(table.std_kgm2))
    if not (np.isfinite(least) and least > 0 and np.isfinite(own)):
        return None
    return Reach(own, least, estimate.method, "kg" if session.axis == "linear" else "kg·m²")
