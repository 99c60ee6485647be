"""A belief that was itself measured: a smooth curve through the table's scatter.

The torque that a motion needs holds the slope of the inertia, ½J'ω², and the slope of scattered points is nothing but
scatter: a table of 0.11 ± 0.001 kg·m² would miss 10 N·m. So a table with standard deviations is taken as a curve of few
B-splines, fitted by them. A table without deviations (CAD) is taken as it is.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Machine

#: Points of the table for each cubic B-spline, and the fewest and most splines: too few would bend the truth.
POINTS_PER_SPLINE, FEWEST, MOST = 3.5, 10, 48
#: Points of the table that the curve becomes.
POINTS = 401
#: An estimate is off by at least this share of its mean, whatever its deviations say.
_LEAST = 2e-4


def smooth(machine: Machine) -> Machine:
    """The machine with its table as a curve; as it is, where that has no deviations, or few points."""
    table = machine.load.inertia_table
    if table is None or table.std_kgm2 is None or table.position_rad.size < 2 * FEWEST:
        return machine
    given, low, high = table.position_rad, float(table.position_rad[0]), float(table.position_rad[-1])
    splines = int(min(max(given.size / POINTS_PER_SPLINE, FEWEST), MOST))
    knots = np.r_[[low] * 3, np.linspace(low, high, splines - 2), [high] * 3]
    mean = float(np.mean(table.inertia_kgm2))
    deviation = np.maximum(table.std_kgm2, _LEAST * mean)
    weighted = BSpline.design_matrix(given, knots, 3).toarray() / deviation[:, None]
    information = weighted.T @ weighted
    information += 1e-9 * np.trace(information) / splines * np.eye(splines)
    aim = table.inertia_kgm2 / deviation
    curve = np.linalg.solve(information, weighted.T @ aim)
    angle = np.linspace(low, high, POINTS)
    fine = BSpline.design_matrix(angle, knots, 3).toarray()
    inertia = np.maximum(fine @ curve, 0.1 * float(np.min(table.inertia_kgm2)))
    curved = InertiaTable(angle, np.maximum(inertia, 1e-12), np.interp(angle, given, table.std_kgm2))
    return machine.model_copy(update={"load": machine.load.model_copy(update={"inertia_table": curved})})
