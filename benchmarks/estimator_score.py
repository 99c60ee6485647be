"""What one method made of one session of the estimator benchmark: a line of its table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from estimator_cases import Case, Entrant


@dataclass(frozen=True)
class Score:
    """What one method made of one case; NaN where it refused. Errors in kg·m²; of the bound only `rmse`."""

    machine: str
    duration_s: float
    condition: str
    seed: int
    method: str
    runs: int
    rmse: float = np.nan
    median: float = np.nan
    p95: float = np.nan
    band: float = np.nan  # share of cells whose 95 % band holds the truth
    covered: float = np.nan  # share of the stroke that the table spans
    method_us: float = np.nan  # processor time of the method alone, per sample
    whole_us: float = np.nan  # and of the whole estimate, with preparation, checks and verdict
    moving_s: float = np.nan  # time that the machine moves for it
    refused: str = ""

    @property
    def case(self) -> Case:
        """The session it belongs to."""
        return Case(self.machine, self.duration_s, self.condition, self.seed)

    @property
    def entrant(self) -> Entrant:
        """Who made it."""
        return Entrant(self.method, self.runs)
