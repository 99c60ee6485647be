"""A belief that was itself measured: a smooth curve through the table's scatter, and how far it may be off.

The torque that a motion needs holds the slope of the inertia, ½J'ω², and the slope of scattered points is nothing but
scatter: a table of 0.11 ± 0.001 kg·m² would miss 10 N·m. So a table with standard deviations is taken as a curve of few
B-splines, fitted by them. What the curve may still be off is not physics that was left out: in these directions, and by
so much, a residual counts as noise does (`Residuals.soften`). A table without deviations (CAD) is taken as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine
from schwung.motion import Array

#: Points of the table for each cubic B-spline, and the fewest and most splines: too few would bend the truth.
POINTS_PER_SPLINE, FEWEST, MOST = 3.5, 10, 48
#: Points of the table that the curve becomes.
POINTS = 401
#: Points of one estimate share windows: so many times the variance of independent ones.
SHARED = 4.0
#: An estimate is off by this share of its mean even where repeats agree (windows, filters, frictions).
BIAS = 0.002
#: ... by this share as a whole (friction, delay), and by that share of its height (windows flatten a curve).
WHOLE, FLATTENED = 0.01, 0.03


@dataclass(frozen=True, eq=False)
class Measured:
    """A machine with its table as a curve, and curves (m, n) that it may be off by, each by ±1 standard deviation."""

    machine: Machine
    angle_rad: Array
    directions_kgm2: Array

    def moved(self, number: int) -> Machine:
        """The machine with its inertia off by one of the directions."""
        table = self.machine.load.inertia_table
        assert table is not None
        return _with_table(self.machine, self.angle_rad, table.inertia_kgm2 + self.directions_kgm2[number])


def measured(machine: Machine) -> Measured | None:
    """The machine's table as a curve with its uncertainty; None where it has no deviations, or few points."""
    table = machine.load.inertia_table
    if table is None or table.std_kgm2 is None or table.position_rad.size < 2 * FEWEST:
        return None
    given, low, high = table.position_rad, float(table.position_rad[0]), float(table.position_rad[-1])
    splines = int(min(max(given.size / POINTS_PER_SPLINE, FEWEST), MOST))
    knots = np.r_[[low] * 3, np.linspace(low, high, splines - 2), [high] * 3]
    mean = float(np.mean(table.inertia_kgm2))
    deviation = np.maximum(table.std_kgm2, 0.1 * BIAS * mean)
    weighted = BSpline.design_matrix(given, knots, 3).toarray() / deviation[:, None]
    information = weighted.T @ weighted
    information += 1e-9 * np.trace(information) / splines * np.eye(splines)
    aim = table.inertia_kgm2 / deviation
    curve = np.linalg.solve(information, weighted.T @ aim)
    scatter = max(float(np.sum((aim - weighted @ curve) ** 2)) / (given.size - splines), 1.0)
    covariance = SHARED * scatter * np.linalg.inv(information) + (BIAS * mean) ** 2 * np.eye(splines)
    height = curve - mean  # splines add up to one
    covariance += (WHOLE * mean) ** 2 + FLATTENED**2 * np.outer(height, height)
    angle = np.linspace(low, high, POINTS)
    fine = BSpline.design_matrix(angle, knots, 3).toarray()
    inertia = np.maximum(fine @ curve, 0.1 * float(np.min(table.inertia_kgm2)))
    directions = (fine @ np.linalg.cholesky(covariance)).T
    std = np.interp(angle, given, table.std_kgm2)
    return Measured(_with_table(machine, angle, inertia, std), angle, np.asarray(directions))


def _with_table(machine: Machine, angle: Array, inertia: Array, std: Array | None = None) -> Machine:
    table = InertiaTable(angle, np.maximum(inertia, 1e-12), std)
    return machine.model_copy(update={"load": machine.load.model_copy(update={"inertia_table": table})})
