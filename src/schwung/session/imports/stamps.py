"""Stamps of the clock on the wall, written as text: dates with times, or times of day, in seconds since the first."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from schwung.motion import Array

_DAY_S = 86_400
_DATES = (
    r"(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})",  # ISO 8601, and as Asia writes it
    r"(?P<d>\d{1,2})\.(?P<m>\d{1,2})\.(?P<y>\d{4})",  # as Europe writes it
    r"(?P<m>\d{1,2})/(?P<d>\d{1,2})/(?P<y>\d{4})",  # as America writes it
)
_TIME = r"(?P<h>\d{1,2}):(?P<min>\d{2}):(?P<s>\d{2})(?:[.,](?P<f>\d+))?(?:\s?(?:Z|UTC|[+-]\d{2}:?\d{2}))?"
_FORMS = tuple(re.compile(rf"{day}{_TIME}$") for day in (*(rf"{each}[T\s]+" for each in _DATES), ""))


def read_stamps(cells: Sequence[str]) -> Array | None:
    """Seconds (n,) since the first stamp, NaN where a cell is empty; None where they are no dates or times of day.

    All are of one form; times of day go on after midnight.
    """
    first = next((cell for cell in cells if cell), "")
    form = next((form for form in _FORMS if form.match(first)), None)
    if form is None:
        return None
    seconds = np.full(len(cells), np.nan)
    origin: float | None = None
    days = 0
    last = 0.0
    for row, cell in enumerate(cells):
        if not cell:
            continue
        found = form.match(cell)
        if found is None:
            return None
        parts = found.groupdict()
        try:
            day = (
                date(int(parts["y"]), int(parts["m"]), int(parts["d"])).toordinal() if "y" in parts else days
            )
        except ValueError:
            return None
        whole = int(parts["h"]) * 3600 + int(parts["min"]) * 60 + int(parts["s"])
        if "y" not in parts and row and whole < last - _DAY_S / 2:
            days += 1
            day = days
        last = whole
        if origin is None:
            origin = day * _DAY_S + whole
        seconds[row] = (day * _DAY_S + whole - origin) + float(f"0.{parts['f'] or 0}")
    return seconds
