"""Basis expansion: the inertia over angle as a B-spline, by least squares on the load's torque balance.

Source: de Boor, A Practical Guide to Splines (the basis); the paper's family of indirect estimators [4, 6, 10, 13]
(expansion into basis functions, here of the angle, which the inertia really depends on). The balance is linear in
the coefficients, J' included: with J(θ) = Σ c_j B_j(θ),

    C + T_l − b_l ω_l = Σ c_j (B_j ω̇_l + ½ B_j' ω_l²) + B ω_l + F sign ω_l + c

B, F and c stand for friction and an offset that the machine file does not know. The motion itself tells the inertia,
too, so that reference runs are used as well and none is needed. Knots are as far apart as the load travels in one
period of the sine at its highest speed (rule of `common`). The band is that of the regression, its residual counted
as noise of the pass band; or, where the residual turns out to have a colour, as with physics that the balance leaves
out, the wider one that its sums over stretches of time call for (the "sandwich", White 1982).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from schwung.drivetrain.inertia import InertiaTable
from schwung.errors import InputError
from schwung.estimation.methods import Outcome, Task
from schwung.estimation.rivals.common import refuse_inversion
from schwung.estimation.rivals.loadside import STOP, LoadSide, load_side
from schwung.estimation.sdft import samples_per_window
from schwung.estimation.table import DEFAULT_POINTS
from schwung.estimation.values import Trace
from schwung.motion import Array
from schwung.session.model import Run

DEGREE = 3
MIN_INTERVALS, MAX_INTERVALS = 4, 48
BLOCK = 50_000  # samples
#: Below this share of the highest speed the sign in dry friction is smoothed.
SLOW = 0.01
#: Residuals further apart than so many periods of the sine are taken as independent.
STRETCH_PERIODS = 2
#: Angles whose band is wider than this share of the inertia hold no information and are left out.
WIDEST_BAND = 0.5


@dataclass(frozen=True, eq=False)
class _Balance:
    """One run: load angle, its motion, and the torque that is to be explained, (n,) each."""

    run: Run
    angle_rad: Array
    load: LoadSide
    torque_nm: Array


@dataclass(frozen=True)
class BSplineExpansion:
    """One regression over all runs of the session."""

    name: str = "bspline"
    needs_reference: bool = False

    def traces(self, task: Task) -> Outcome:
        """A table of its own, and the curve along each excited run.

        Raises InputError where the load does not move, or where no angle is told apart.
        """
        refuse_inversion(task, self.name)
        balances = [_balance(task, run) for run in (*task.excited, *task.session.references)]
        fastest = max(float(np.max(np.abs(balance.load.speed_rad_s))) for balance in balances)
        angles = np.concatenate([balance.angle_rad for balance in balances])
        knots = knots_for(angles, fastest / task.frequency_hz)
        fit = _regression(balances, knots, fastest, task)
        grid = np.linspace(knots[0], knots[-1], task.points or DEFAULT_POINTS)
        basis = _basis(knots)(grid)
        inertia = basis @ fit.coefficients
        white = np.einsum("ij,jk,ik->i", basis, fit.covariance, basis)
        std = np.sqrt(np.maximum(white, np.sum((basis @ fit.scores) ** 2, axis=1)))
        if np.mean(inertia > 0) < 0.5:
            raise InputError(
                "session",
                f"gives a negative inertia at {100 * np.mean(inertia <= 0):.0f} % of its angles",
                "Check the sign and the unit of torque and speed, rotor inertia and stiffness.",
            )
        told = (inertia > 0) & (std < WIDEST_BAND * inertia)
        if told.sum() < 2:
            raise InputError("session", "does not tell the inertia at two angles or more",
                             "Inject more, or move further.")  # fmt: skip
        notes: tuple[str, ...] = ()
        if not told.all():
            notes = (
                f"{int(np.sum(~told))} of {grid.size} angles are not told by the runs and were left out.",
            )
        excited = balances[: len(task.excited)]
        traces = tuple(_trace(balance, knots, fit.coefficients, task) for balance in excited)
        table = InertiaTable(grid[told], inertia[told], std[told])
        return Outcome(traces=traces, notes=notes, table=table, windowed=False)


def knots_for(angle_rad: Array, travel_rad: float) -> Array:
    """Knots (m,) of a cubic spline over the angles visited, about `travel_rad` apart, the ends repeated."""
    low, high = float(angle_rad.min()), float(angle_rad.max())
    if not (high - low > 1e-6 and travel_rad > 0):
        raise InputError("session", "holds no motion: the load stays at one angle", "Record a motion.")
    count = int(np.clip(np.ceil((high - low) / travel_rad), MIN_INTERVALS, MAX_INTERVALS))
    inner = np.linspace(low, high, count + 1)
    return np.concatenate([np.full(DEGREE, low), inner, np.full(DEGREE, high)])


def _balance(task: Task, run: Run) -> _Balance:
    samples_per_window(run.sample_rate_hz, task.frequency_hz)  # raises where they are too few
    load = load_side(task.machine, run.torque_nm, run.speed_rad_s, run.sample_rate_hz, task.frequency_hz)
    angle = run.position_rad - load.twist_rad
    return _Balance(run, angle, load, load.torque_nm + task.machine.load_torque_at(angle))


@dataclass(frozen=True, eq=False)
class _Fit:
    coefficients: Array  # (k,) of the spline
    covariance: Array  # (k, k), if the residual were noise of the pass band
    scores: Array  # (k, stretches): what the residual of each stretch of time moves the coefficients by


def _regression(balances: list[_Balance], knots: Array, fastest: float, task: Task) -> _Fit:
    """Normal equations summed block by block, so that long recordings stay small in memory."""
    basis = _basis(knots)
    slope = basis.derivative()
    count = knots.size - DEGREE - 1

    def blocks() -> Iterator[tuple[Array, Array]]:
        """Columns (n, count + 3) and torque (n,)."""
        for balance in balances:
            for first in range(0, balance.angle_rad.size, BLOCK):
                part = slice(first, first + BLOCK)
                angle = np.clip(balance.angle_rad[part], knots[0], knots[-1])
                speed = balance.load.speed_rad_s[part, None]
                inertial = basis(angle) * balance.load.acceleration_rad_s2[part, None]
                inertial += slope(angle) * speed**2 / 2
                friction = [speed, np.tanh(speed / (SLOW * fastest)), np.ones_like(speed)]
                yield np.hstack([inertial, *friction]), balance.torque_nm[part]

    gram, right, power, samples = np.zeros((count + 3, count + 3)), np.zeros(count + 3), 0.0, 0
    for columns, torque in blocks():
        gram, right = gram + columns.T @ columns, right + columns.T @ torque
        power, samples = power + float(torque @ torque), samples + torque.size
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0] = 1.0
    inverse = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(
        scale, scale
    )
    found = inverse @ right
    left_over = max(power - float(2 * found @ right - found @ gram @ found), 0.0)
    # samples of a band-limited noise overlap: so many are independent
    share = min(1.0, 2 * STOP * task.frequency_hz / balances[0].run.sample_rate_hz)
    variance = left_over / max(share * (samples - found.size), 1.0)
    stretch = STRETCH_PERIODS * samples_per_window(balances[0].run.sample_rate_hz, task.frequency_hz)
    scores = [
        np.add.reduceat(columns * (torque - columns @ found)[:, None], np.arange(0, torque.size, stretch))
        for columns, torque in blocks()
    ]
    moved = inverse[:count] @ np.concatenate(scores).T
    return _Fit(found[:count], variance * inverse[:count, :count], moved)


def _basis(knots: Array) -> BSpline:
    """All basis functions at once: angles (n,) to (n, k)."""
    return BSpline(knots, np.eye(knots.size - DEGREE - 1), DEGREE)


def _trace(balance: _Balance, knots: Array, coefficients: Array, task: Task) -> Trace:
    """The curve along a run, (n,): no window, no age, no imaginary part and no amplitudes (NaN)."""
    run = balance.run
    inertia = _basis(knots)(np.clip(balance.angle_rad, knots[0], knots[-1])) @ coefficients
    period = samples_per_window(run.sample_rate_hz, task.frequency_hz)
    variation, nothing = np.full_like(inertia, np.nan), np.full_like(inertia, np.nan)
    variation[period:] = inertia[period:] - inertia[:-period]
    return Trace(run.time_s, balance.angle_rad, inertia, nothing, variation, nothing, nothing, name=run.name)
