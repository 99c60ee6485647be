"""Tables over the load angle: inertia, which all of this is about, and load torque; and their files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from schwung.errors import InputError
from schwung.files import replace_file
from schwung.motion import Array
from schwung.quantities import Effort


@dataclass(frozen=True, eq=False)
class InertiaTable:
    """Load inertia J_l over the load angle; arrays (n,), position increasing. Held constant outside.

    Interpolated by PCHIP: monotone between points, so that a table never dips below zero between two
    good values.
    """

    position_rad: Array
    inertia_kgm2: Array
    std_kgm2: Array | None = None
    effort: Effort = "torque"  # "current": inertias are in A·s²/rad, and N·m per A is unknown

    def __post_init__(self) -> None:
        n = self.position_rad.size
        if n < 2 or self.inertia_kgm2.size != n or (self.std_kgm2 is not None and self.std_kgm2.size != n):
            raise InputError("inertia table", "needs two points or more and columns of one length")
        if not (np.all(np.isfinite(self.position_rad)) and np.all(np.diff(self.position_rad) > 0)):
            raise InputError("inertia table", "position_rad does not increase", "Sort it, drop duplicates.")
        bad = np.flatnonzero(~(np.isfinite(self.inertia_kgm2) & (self.inertia_kgm2 > 0)))
        if bad.size:
            raise InputError(
                "inertia table",
                f"inertia_kgm2 is {self.inertia_kgm2[bad[0]]:g} at {self.position_rad[bad[0]]:g} rad",
                "An inertia is a positive number.",
            )
        if self.std_kgm2 is not None and not np.all(np.isfinite(self.std_kgm2) & (self.std_kgm2 >= 0)):
            raise InputError("inertia table", "std_kgm2 is not a number from 0 up", "Drop those points.")

    def at(self, position_rad: Array) -> Array:
        """J_l (kg·m²) at the given angles (rad)."""
        inside = np.clip(position_rad, self.position_rad[0], self.position_rad[-1])
        return np.asarray(self._curve(inside), dtype=float)

    def slope_at(self, position_rad: Array) -> Array:
        """dJ_l/dθ (kg·m²/rad) at the given angles (rad); 0 outside the table."""
        inside = (position_rad >= self.position_rad[0]) & (position_rad <= self.position_rad[-1])
        slope = self._curve.derivative()
        clipped = np.clip(position_rad, self.position_rad[0], self.position_rad[-1])
        return np.where(inside, slope(clipped), 0.0)

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.position_rad, self.inertia_kgm2)


@dataclass(frozen=True)
class Deviation:
    """How far an estimated table is from a reference over the angles that both have (kg·m²)."""

    rmse_kgm2: float
    max_kgm2: float


def deviation(table: InertiaTable, reference: InertiaTable | None) -> Deviation | None:
    """Compare at the table's own points; None where there is no reference or no angle in common."""
    if reference is None:
        return None
    position = table.position_rad
    shared = (position >= reference.position_rad[0]) & (position <= reference.position_rad[-1])
    if not shared.any():
        return None
    error = table.inertia_kgm2[shared] - reference.at(position[shared])
    return Deviation(float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error))))


def slider_crank_inertia(
    position_rad: Array, base_kgm2: float = 0.055, swing_kgm2: float = 0.105, ratio: float = 0.25
) -> Array:
    """J_0 + A (sin θ + λ sin θ cos θ / √(1 − λ² sin² θ))², kg·m².

    A crank with a light rod of length r/λ and a mass on the slider. The defaults are *inferred*: the paper
    only draws its J_l(θ) (Fig. 8); with these, MIV and DPR come out as it reports.
    """
    sine, cosine = np.sin(position_rad), np.cos(position_rad)
    slider_speed = sine + ratio * sine * cosine / np.sqrt(1 - (ratio * sine) ** 2)
    return np.asarray(base_kgm2 + swing_kgm2 * slider_speed**2)


@dataclass(frozen=True, eq=False)
class LoadTorqueTable:
    """Torque that the load exerts on its shaft over its angle (positive accelerates it); arrays (n,).

    Held constant outside, PCHIP between points, as the inertia.
    """

    position_rad: Array
    load_torque_nm: Array

    def __post_init__(self) -> None:
        if self.position_rad.size < 2 or self.load_torque_nm.size != self.position_rad.size:
            raise InputError("load torque table", "needs two points or more and columns of one length")
        if not (np.all(np.isfinite(self.position_rad)) and np.all(np.diff(self.position_rad) > 0)):
            raise InputError(
                "load torque table", "position_rad does not increase", "Sort it, drop duplicates."
            )
        if not np.all(np.isfinite(self.load_torque_nm)):
            raise InputError("load torque table", "load_torque_nm is not finite", "Drop those points.")

    def at(self, position_rad: Array) -> Array:
        """Load torque (N·m) at the given load angles (rad), same shape."""
        inside = np.clip(position_rad, self.position_rad[0], self.position_rad[-1])
        return np.asarray(PchipInterpolator(self.position_rad, self.load_torque_nm)(inside), dtype=float)


#: Magnitudes beyond these are mistakes of unit (degrees would pass: a stroke may be many turns).
_HIGHEST = {
    "position_rad": 1e6, "inertia_kgm2": 1e5, "std_kgm2": 1e5, "load_torque_nm": 1e6, "inertia_as2_rad": 1e6,
    "std_as2_rad": 1e6,
}  # fmt: skip
#: Columns of a table of which nobody knows how many N·m an ampere makes: A·s²/rad.
_IN_AMPERES = ("inertia_as2_rad", "std_as2_rad")


def read_inertia_csv(path: str | Path) -> InertiaTable:
    """Read `inertia.csv` (files.md). Raises InputError that names the file, the line and the remedy."""
    path = Path(path)
    if _is_in_amperes(path):
        columns = _read_columns(path, ("position_rad", _IN_AMPERES[0]), (_IN_AMPERES[1],))
        inertia, std = columns[_IN_AMPERES[0]], columns.get(_IN_AMPERES[1])
        return InertiaTable(columns["position_rad"], inertia, std, "current")
    columns = _read_columns(path, ("position_rad", "inertia_kgm2"), ("std_kgm2",))
    return InertiaTable(columns["position_rad"], columns["inertia_kgm2"], columns.get("std_kgm2"))


def _is_in_amperes(path: Path) -> bool:
    """Whether a table's header says that its inertias are those of a current."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            return _IN_AMPERES[0] in [name.strip() for name in file.readline().split(",")]
    except (OSError, ValueError):
        return False  # the reader says what is wrong


def read_load_torque_csv(path: str | Path) -> LoadTorqueTable:
    """Read `load_torque.csv` (files.md). Raises InputError that names the file, the line and the remedy."""
    columns = _read_columns(Path(path), ("position_rad", "load_torque_nm"))
    return LoadTorqueTable(columns["position_rad"], columns["load_torque_nm"])


def write_inertia_csv(table: InertiaTable, path: str | Path) -> None:
    """Write `inertia.csv` (files.md), all at once and without loss of digits."""
    inertia, std = _IN_AMPERES if table.effort == "current" else ("inertia_kgm2", "std_kgm2")
    columns = {"position_rad": table.position_rad, inertia: table.inertia_kgm2}
    if table.std_kgm2 is not None:
        columns[std] = table.std_kgm2
    _write_columns(Path(path), columns)


def write_load_torque_csv(table: LoadTorqueTable, path: str | Path) -> None:
    """Write `load_torque.csv` (files.md), all at once and without loss of digits."""
    _write_columns(Path(path), {"position_rad": table.position_rad, "load_torque_nm": table.load_torque_nm})


def _write_columns(path: Path, columns: dict[str, Array]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([repr(float(value)) for value in row] for row in zip(*columns.values(), strict=True))
    replace_file(path, text.getvalue())


def _read_columns(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
    """The named columns of a CSV file, checked; columns of other names are left alone."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be read: {reason}", "Name an existing CSV file.") from None
    except UnicodeDecodeError:
        raise InputError(str(path), "is not UTF-8 text", "Name a CSV file.") from None
    except ValueError:  # a NUL in the name
        raise InputError(repr(str(path)), "is no file name", "Name an existing CSV file.") from None
    wanted_header = ",".join(required) + "".join(f"[,{name}]" for name in optional)
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    if not set(required) <= set(header) or len(set(header)) != len(header):
        found = f"is {lines[0][:60]!r}" if lines else "is missing"
        raise InputError(f"{path}:1", f"the header {found}", f"Write it as {wanted_header}.")
    columns: dict[str, list[float]] = {name: [] for name in header if name in (*required, *optional)}
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        cells = line.split(",")
        if len(cells) != len(header):
            raise InputError(f"{path}:{number}", f"has {len(cells)} columns, the header {len(header)}",
                             "Use commas between and points within numbers.")  # fmt: skip
        for name, cell in zip(header, cells, strict=True):
            if name in columns:
                columns[name].append(_cell(f"{path}:{number}", name, cell))
        angles = columns["position_rad"]
        if len(angles) > 1 and angles[-1] <= angles[-2]:
            raise InputError(f"{path}:{number}", f"position_rad {angles[-1]:g} does not increase",
                             "Sort the rows, drop duplicates.")  # fmt: skip
    if len(columns["position_rad"]) < 2:
        raise InputError(str(path), "has fewer than two rows", "A table needs two points or more.")
    return {name: np.array(values) for name, values in columns.items()}


def _cell(place: str, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    positive = np.nextafter(0, 1)
    least = {"inertia_kgm2": positive, "inertia_as2_rad": positive, "std_kgm2": 0.0, "std_as2_rad": 0.0}
    lowest = least.get(name, -_HIGHEST[name])
    if not lowest <= value <= _HIGHEST[name]:
        wanted = {"inertia_kgm2": "a positive number in kg·m²", "std_kgm2": "a number from 0 up in kg·m²"}
        raise InputError(place, f"{name} is {cell.strip()!r}",
                         f"Give {wanted.get(name, 'a finite number in SI units')}.")  # fmt: skip
    return value
