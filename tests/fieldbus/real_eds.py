"""Vendors' own EDS files, where there are any: `SCHWUNG_REAL_EDS`, or a folder shared/eds beside the repository."""

from __future__ import annotations

import os
from pathlib import Path

VARIABLE = "SCHWUNG_REAL_EDS"
MISSING = f"no vendors' EDS files: set {VARIABLE} to the folder that holds elmo-gold/"


def real_eds_files() -> list[Path]:
    """All of them; an empty list where they are not on this computer."""
    named = os.environ.get(VARIABLE)
    places = [parent / "shared" / "eds" for parent in Path(__file__).parents]
    found = next(
        (place for place in ([Path(named)] if named else places) if (place / "elmo-gold").is_dir()), None
    )
    return (
        [] if found is None else sorted(p for p in found.glob("*/*") if p.suffix.lower() in (".eds", ".dcf"))
    )
