"""Learned torques over two coordinates at once: `[[physics]] name = "residual"` with two `coordinates`.

`points` holds the values of each, `table` a row for each value of the first with a torque (N·m) for each of the second.
Between the points it is bilinear, beyond them constant; both coordinates have their sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from schwung.compiled import compiled
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.errors import InputError
from schwung.motion import Array

Pair = tuple[str, str]
#: Which two there are. Of position and speed those of the load are meant, and the torque acts on it; of position and
#: torque the motor's and what acts on its shaft; with the time in the motion likewise.
PAIRS: tuple[Pair, ...] = (("position", "speed"), ("position", "torque"), ("torque", "time_in_motion"))
#: Those that act on the load; the others on the motor.
ON_LOAD: tuple[Pair, ...] = PAIRS[:1]
#: Highest slope over the torque that a table may have: beyond it more torque would do less.
_STEEPEST = 0.9


class Sheet(NamedTuple):
    """Torque (n, m) over x (n,) and y (m,); as kernels take it."""

    x: Array
    y: Array
    torque: Array


@compiled
def sheet_at(sheet: Sheet, x: float, y: float) -> float:
    """Bilinear between the points, constant beyond."""
    x = min(max(x, sheet.x[0]), sheet.x[-1])
    y = min(max(y, sheet.y[0]), sheet.y[-1])
    i = min(int(np.searchsorted(sheet.x, x, side="right")) - 1, sheet.x.size - 2)
    j = min(int(np.searchsorted(sheet.y, y, side="right")) - 1, sheet.y.size - 2)
    u = (x - sheet.x[i]) / (sheet.x[i + 1] - sheet.x[i])
    v = (y - sheet.y[j]) / (sheet.y[j + 1] - sheet.y[j])
    low = (1.0 - u) * sheet.torque[i, j] + u * sheet.torque[i + 1, j]
    high = (1.0 - u) * sheet.torque[i, j + 1] + u * sheet.torque[i + 1, j + 1]
    return float((1.0 - v) * low + v * high)


@compiled
def _along(sheet: Sheet, x: Array, y: Array) -> Array:
    found = np.empty_like(x)
    for i in range(x.size):
        found[i] = sheet_at(sheet, x[i], y[i])
    return found


#: Nothing anywhere.
NOTHING = Sheet(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros((2, 2)))


@dataclass(frozen=True, eq=False)
class Plane:
    """A learned torque (N·m), (n, m), over two coordinates, (n,) and (m,)."""

    over: Pair
    x: Array
    y: Array
    torque_nm: Array

    @property
    def sheet(self) -> Sheet:
        """For the kernels."""
        return Sheet(self.x, self.y, self.torque_nm)

    def at(self, x: Array, y: Array) -> Array:
        """At places (k,) each."""
        return np.asarray(_along(self.sheet, x, y))

    def steepest(self, axis: int) -> float:
        """The largest slope over the first (0) or second (1) coordinate, unsigned."""
        steps = np.diff((self.x, self.y)[axis])
        slopes = np.diff(self.torque_nm, axis=axis) / (steps[:, None] if axis == 0 else steps)
        return float(np.max(np.abs(slopes)))

    def plus(self, other: Plane) -> Plane:
        """The sum of two over the same pair, exactly."""
        x, y = np.union1d(self.x, other.x), np.union1d(self.y, other.y)
        places = np.repeat(x, y.size), np.tile(y, x.size)
        total = self.at(*places) + other.at(*places)
        return Plane(self.over, x, y, total.reshape(x.size, y.size))

    def parameters(self, digits: int = 7) -> dict[str, Any]:
        """As a file holds it."""

        def rounded(values: Array) -> list[float]:
            return [float(f"{value:.{digits}g}") for value in values.tolist()]

        return {
            "coordinates": list(self.over),
            "points": [rounded(self.x), rounded(self.y)],
            "table": [rounded(row) for row in self.torque_nm],
        }


def is_plane(parameters: Mapping[str, Any]) -> bool:
    """Whether a residual's parameters are over two coordinates."""
    return "coordinates" in parameters


def planes_of(terms: Sequence[PhysicsTerm]) -> dict[Pair, Plane]:
    """All of them, added up over each pair. Raises InputError for what is none."""
    found: dict[Pair, Plane] = {}
    for term in terms:
        if term.name == "residual" and is_plane(term.parameters):
            one = plane_of(term.parameters)
            found[one.over] = found[one.over].plus(one) if one.over in found else one
    for pair, plane in found.items():
        if "torque" in pair and plane.steepest(pair.index("torque")) > _STEEPEST:
            raise InputError(
                _PLACE, f"grows by more than {_STEEPEST} with the torque itself", "Smooth its table."
            )
    return found


_PLACE = "physics.residual"


def plane_of(parameters: Mapping[str, Any]) -> Plane:
    """What a term's parameters say. Raises InputError where that is no table over two known coordinates."""
    given = parameters["coordinates"]
    over = tuple(given) if isinstance(given, list | tuple) else ()
    if over not in PAIRS:
        known = ", ".join(f'["{one}", "{other}"]' for one, other in PAIRS)
        raise InputError(_PLACE, f"coordinates is {given!r}", f"It has to be one of {known}.")
    if "coordinate" in parameters or "like" in parameters:
        raise InputError(
            _PLACE, "has coordinate or like beside coordinates", "Keep one of them, or make two terms."
        )
    points = parameters.get("points")
    if not isinstance(points, list | tuple) or len(points) != 2:
        raise InputError(_PLACE, "points are not two lists", "Write [[x, x, …], [y, y, …]].")
    x, y = (_numbers(axis, "points are not two lists of numbers") for axis in points)
    if min(x.size, y.size) < 2 or np.any(np.diff(x) <= 0) or np.any(np.diff(y) <= 0):
        raise InputError(_PLACE, "points do not increase", "Give two or more of each, sorted, none twice.")
    table = parameters.get("table")
    table = table if isinstance(table, list | tuple) else ()
    rows = [_numbers(row, "table is not made of rows of numbers") for row in table]
    if len(rows) != x.size or any(row.size != y.size for row in rows):
        wanted = f"Write {x.size} rows of {y.size} N·m: a row for each of the first points."
        raise InputError(_PLACE, "table does not fit its points", wanted)
    return Plane((over[0], over[1]), x, y, np.array(rows))


def _numbers(row: Any, wrong: str) -> Array:
    fine = isinstance(row, list | tuple) and all(
        isinstance(x, int | float) and not isinstance(x, bool) and np.isfinite(x) for x in row
    )
    if not fine:
        raise InputError(_PLACE, wrong, "Give them as finite numbers in SI units.")
    return np.array(row, dtype=float)
