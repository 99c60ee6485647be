"""Learned torques and inertias that are curves: tables over a coordinate, with or without a name.

`[[physics]]` of machine.toml holds them as `table`. A `residual` has no name; its `coordinate` says what it is over
(`residual_plane.py`: over two at once).
Rows are [x, forward, backward], or [x, both] where the direction of motion does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from scipy.interpolate import PchipInterpolator

from schwung.drivetrain.inertia import LoadTorqueTable
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.drivetrain.residual_plane import is_plane
from schwung.errors import InputError
from schwung.motion import Array

#: What a table is over. Motor's angle, speed |ω|, torque |T| and run (0…1 of the session) act on the motor by its
#: direction; the load's angle on the load by that of the load; its acceleration and the time in the motion on the load;
#: the coupling's wind-up beyond its play on the load, and back on the motor, beside what its stiffness says.
Over = Literal[
    "position", "speed", "torque", "run", "load_position", "acceleration", "time_in_motion", "wind_up"
]
OVER: tuple[Over, ...] = get_args(Over)
#: Those that do not ask for the direction of motion.
UNDIRECTED: tuple[Over, ...] = ("acceleration", "time_in_motion", "wind_up")
UNITS: Mapping[Over, str] = {
    "position": "rad",
    "speed": "rad/s",
    "torque": "N·m",
    "run": "",
    "load_position": "rad",
    "acceleration": "rad/s²",
    "time_in_motion": "s",
    "wind_up": "rad",
}
#: By how many times its secants the cubic between points is steeper, at most (Fritsch and Carlson).
_PCHIP = 3.0
#: Names whose numbers are a table, and how many numbers a row of it has.
TABLES: Mapping[str, tuple[int, ...]] = {
    "load_torque": (2,),
    "friction_over_angle": (2,),
    "direction_dependent_load": (3,),
    "inertia_profile": (2,),
    "residual": (2, 3),
}


@dataclass(frozen=True, eq=False)
class Residual:
    """Torque (N·m) over a coordinate, the machine moving forward and backward; (n,) each, constant beyond."""

    over: Over
    x: Array
    forward_nm: Array
    backward_nm: Array

    def at(self, x: Array, direction: Array) -> Array:
        """At coordinates, the direction −1…1, (m,) each: cubic between the points, as it is simulated."""
        inside = np.clip(x, self.x[0], self.x[-1])
        forward = np.asarray(PchipInterpolator(self.x, self.forward_nm)(inside))
        if self.over in UNDIRECTED:
            return forward
        backward = np.asarray(PchipInterpolator(self.x, self.backward_nm)(inside))
        return np.asarray(forward * np.maximum(direction, 0.0) + backward * np.maximum(-direction, 0.0))

    def slope(self, x: Array) -> Array:
        """Of one that does not ask for the direction, by its coordinate (m,); none beyond the points."""
        inside = (x >= self.x[0]) & (x <= self.x[-1])
        slope = PchipInterpolator(self.x, self.forward_nm).derivative()
        return np.where(inside, slope(np.clip(x, self.x[0], self.x[-1])), 0.0)

    @property
    def highest_nm(self) -> float:
        """Of either direction."""
        return float(max(np.max(np.abs(self.forward_nm)), np.max(np.abs(self.backward_nm))))

    @property
    def steepest(self) -> float:
        """By how much it rises most, by its coordinate."""
        return float(max(np.max(np.diff(self.forward_nm) / np.diff(self.x)), 0.0)) * _PCHIP

    def plus(self, other: Residual) -> Residual:
        """The sum of two over one coordinate, at the points of both."""
        x = np.union1d(self.x, other.x)
        ahead = np.ones_like(x)
        return Residual(
            self.over, x, self.at(x, ahead) + other.at(x, ahead), self.at(x, -ahead) + other.at(x, -ahead)
        )


def law_of(term: PhysicsTerm) -> str:
    """The law that a term follows: a residual may be `like` one without being it."""
    like = term.parameters.get("like")
    return like if term.name == "residual" and isinstance(like, str) else term.name


def residuals_of(terms: Sequence[PhysicsTerm]) -> dict[Over, Residual]:
    """The torques that are tables, added up over each coordinate; the load torque's is `load_torque_table`.

    Raises InputError for what is no such table.
    """
    found: dict[Over, Residual] = {}
    for term in terms:
        one = _residual(term)
        if one is not None:
            found[one.over] = found[one.over].plus(one) if one.over in found else one
    return found


def _residual(term: PhysicsTerm) -> Residual | None:
    law = law_of(term)
    if law == "friction_over_angle":
        angle, level = rows_of(term)
        return Residual("position", angle, -level, level)
    if law == "direction_dependent_load":
        return Residual("load_position", *rows_of(term))
    if law != "residual" or is_plane(term.parameters):
        return None
    over = term.parameters.get("coordinate")
    if over not in OVER:
        raise InputError(
            "physics.residual", f"coordinate is {over!r}", f"It has to be one of {', '.join(OVER)}."
        )
    rows = rows_of(term)
    if over in UNDIRECTED and len(rows) > 2:
        raise InputError(
            "physics.residual", f"has two directions over {over}", "Write rows of [x, N·m] without direction."
        )
    return Residual(over, rows[0], rows[1], rows[-1])


def load_torque_table(terms: Sequence[PhysicsTerm]) -> LoadTorqueTable | None:
    """The learned load torque that is given as a table of pairs (rad, N·m); None without one.

    Raises InputError for what is no such table, and for two of them.
    """
    tables = [term for term in terms if law_of(term) == "load_torque" and "table" in term.parameters]
    if len(tables) > 1:
        raise InputError("physics.load_torque", "has two tables", "Add them up in one.")
    return LoadTorqueTable(*rows_of(tables[0])) if tables else None


def inertia_added(terms: Sequence[PhysicsTerm], angle: Array) -> Array:
    """What learned profiles add to the load's inertia (kg·m²) at load angles (rad), (n,) each."""
    total = np.zeros_like(angle)
    for term in terms:
        if law_of(term) == "inertia_profile":
            x, added = rows_of(term)
            total = total + PchipInterpolator(x, added)(np.clip(angle, x[0], x[-1]))
    return total


def inertia_points(terms: Sequence[PhysicsTerm]) -> Array:
    """The angles (rad) at which learned profiles are given, (n,)."""
    return np.concatenate([np.zeros(0), *(rows_of(t)[0] for t in terms if law_of(t) == "inertia_profile")])


def rows_of(term: PhysicsTerm) -> tuple[Array, ...]:
    """The columns of a term's table. Raises InputError where it is none, or its first column does not increase."""
    place, widths = f"physics.{term.name}", TABLES[law_of(term)]
    wanted = (
        "Write [[rad, N·m], [rad, N·m], …]."
        if widths == (2,)
        else "Write [[x, N·m forward, N·m backward], …]."
    )
    given = term.parameters.get("table")
    table = given if isinstance(given, list | tuple) else []
    rows = [row for row in table if isinstance(row, list | tuple) and len(row) in widths]
    numbers = all(isinstance(x, int | float) and not isinstance(x, bool) for row in rows for x in row)
    alike = len({len(row) for row in rows}) == 1
    if len(table) < 2 or len(rows) < len(table) or not numbers or not alike or not np.all(np.isfinite(rows)):
        what = "pairs of numbers" if widths == (2,) else "rows of numbers"
        raise InputError(place, f"table is not made of {what}", wanted)
    if any(left[0] >= right[0] for left, right in pairwise(rows)):
        raise InputError(place, "the angles of its table do not increase" if widths == (2,) else "the first numbers "
                         "of its table's rows do not increase", "Sort the rows, drop duplicates.")  # fmt: skip
    return tuple(np.array(rows, dtype=float).T)
