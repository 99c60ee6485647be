"""Sealed sessions: recordings of random machines that conceal physics, and apart from them the labels that say which.

A case is drawn from a seed (`machines`, `shapes`, `foreign`), its strength set against the noise floor (`hiding`,
`strength`), recorded and written (`cases`, `files`). Nothing here is known to the tool under test; only a scoring step
may open the labels.
"""

from schwung_sim.sealed.cases import (
    LABELS,
    LEVELS,
    CaseWishes,
    SealedCase,
    draw_case,
    likeness_of,
    read_labels,
    write_case,
)
from schwung_sim.sealed.foreign import FOREIGN_NAMES
from schwung_sim.sealed.shapes import NAMES

__all__ = [
    "FOREIGN_NAMES", "LABELS", "LEVELS", "NAMES", "CaseWishes", "SealedCase", "draw_case", "likeness_of",
    "read_labels", "write_case",
]  # fmt: skip
