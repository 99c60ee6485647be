"""From traces to one inertia table: every stroke and repeat on one uniform grid of angles, with a band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.inertia import InertiaTable
from schwung.errors import InputError
from schwung.estimation.values import Trace
from schwung.motion import Array

DEFAULT_POINTS = 64
#: Samples bunched closer than this share of the kernel's reach give no slope.
MIN_SPREAD = 0.05


@dataclass(frozen=True)
class Combined:
    """The table and what had to be said about it."""

    table: InertiaTable
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Stroke:
    """One stroke on the grid, (points,): local value, standard error, imaginary part; NaN without samples."""

    number: int  # which stroke of its run
    inertia: Array
    error: Array
    imaginary: Array


def combine(traces: Sequence[Trace], window: Sequence[int], points: int | None = None) -> Combined:
    """Inertia over load angle from all traces; `window`: samples per period of each trace.

    Every stroke of every run gives one curve on the grid (a local straight line at each point, so that
    samples spread unevenly do not pull it sideways); the table is their mean, each with the weight that its own noise
    and its distance from the others deserve (`_weights`). The grid is uniform between the smallest and the largest
    angle visited; points without a sample nearby are left out. Negative inertias are dropped and noted.

    The band is √(scatter² + noise² + imaginary² + bend²): `scatter` the standard deviation among strokes and repeats
    over √strokes, `noise` the standard error within them (overlapping windows counted once), `imaginary` the rms of
    the strokes' imaginary parts over √strokes, for what the model does not explain, and `bend` how far the curve's
    mean over a window is from its middle, which is what a window cannot resolve.

    Raises InputError when fewer than two points are left.
    """
    count = DEFAULT_POINTS if points is None else points
    if count < 2:
        raise InputError("points", f"is {count}", "An inertia table needs two or more.")
    negative = total = 0
    valid: list[NDArray[np.bool_]] = []
    for trace in traces:
        finite = np.isfinite(trace.inertia_kgm2)
        positive = finite & (np.nan_to_num(trace.inertia_kgm2, nan=-1.0) > 0)
        negative, total = negative + int(np.sum(finite & ~positive)), total + int(np.sum(finite))
        valid.append(positive)
    angles = np.concatenate([trace.position_rad[ok] for trace, ok in zip(traces, valid, strict=True)])
    if angles.size == 0 or np.ptp(angles) <= 0:
        raise InputError(
            "session",
            "holds no angle range with a positive inertia",
            "Look at the signals: is the machine moving, does the speed follow the torque?",
        )
    grid = np.linspace(angles.min(), angles.max(), count)
    strokes = [
        _on_grid(trace, int(stroke), ok & (_stroke_of(trace) == stroke), grid, samples)
        for trace, ok, samples in zip(traces, valid, window, strict=True)
        for stroke in np.unique(_stroke_of(trace)[ok])
    ]
    notes = []
    if negative:
        notes.append(f"{negative} of {total} samples gave a negative inertia and were dropped.")
    return _mean_of(strokes, grid, _paths(traces, valid, window), notes)


def _stroke_of(trace: Trace) -> NDArray[np.int64]:
    return np.zeros(trace.time_s.size, dtype=np.int64) if trace.stroke is None else trace.stroke


def _on_grid(trace: Trace, number: int, chosen: NDArray[np.bool_], grid: Array, window: int) -> _Stroke:
    """The local value of one stroke at every grid point."""
    angle = trace.position_rad[chosen]
    # one grid step to either side; fast strokes may pass more than that between two samples
    reach = max(float(grid[1] - grid[0]), float(np.max(np.abs(np.diff(angle)), initial=0.0)))
    inertia, imaginary = trace.inertia_kgm2[chosen], trace.imaginary_kgm2[chosen]
    found = np.array([_local(angle - point, inertia, imaginary, reach, window) for point in grid])
    return _Stroke(number, *found.T)


def _local(
    offset: Array, inertia: Array, imaginary: Array, reach: float, window: int
) -> tuple[float, float, float]:
    """Value, its standard error and imaginary part at offset 0: local straight line, triangular weights."""
    near = np.abs(offset) < reach
    if not near.any():
        return np.nan, np.nan, np.nan
    offset, inertia, imaginary = offset[near], inertia[near], imaginary[near]
    weight = 1 - np.abs(offset) / reach
    weight = weight / weight.sum()
    centre, mean = float(weight @ offset), float(weight @ inertia)
    spread = float(weight @ (offset - centre) ** 2)
    # a straight line needs samples on both sides, or else it extrapolates
    two_sided = offset.min() < 0 < offset.max() and spread > (MIN_SPREAD * reach) ** 2
    slope = float(weight @ ((offset - centre) * (inertia - mean))) / spread if two_sided else 0.0
    value = mean - slope * centre
    variance = float(weight @ (inertia - value - slope * offset) ** 2)
    independent = max(1.0, 1 / float(weight @ weight) / window)  # windows overlap: one period counts once
    return value, float(np.sqrt(variance / independent)), float(weight @ imaginary)


def _weights(strokes: Sequence[_Stroke]) -> Array:
    """Weight of each stroke, (strokes,): one over its variance, by medians over the grid, which no bump moves.

    Its own, from the noise within it and the imaginary part, plus the square of its distance from the median of all
    (of two, which cannot be told apart, both are as far). No stroke counts as better than half the usual deviation:
    that would be chance.
    Among repeats of one stroke; all strokes of a run together weigh the same, as what friction adds on the way there
    it takes off on the way back.
    """
    every = np.vstack([stroke.inertia for stroke in strokes])
    own = np.array([_middle(s.error**2 + s.imaginary**2) for s in strokes])
    visited = every[:, np.isfinite(every).any(axis=0)]
    own += np.array([_middle(off**2) for off in visited - np.nanmedian(visited, axis=0)])
    weight = 1 / np.maximum(own, max(float(np.median(own)) / 4, 1e-300))
    numbers = np.array([stroke.number for stroke in strokes])
    return np.asarray(weight / np.bincount(numbers, weight)[numbers])


def _middle(values: Array) -> float:
    """Median of what is there, 0 of nothing."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else 0.0


def _paths(
    traces: Sequence[Trace], valid: Sequence[NDArray[np.bool_]], window: Sequence[int]
) -> list[tuple[Array, NDArray[np.bool_], int]]:
    return [(trace.position_rad, ok, n) for trace, ok, n in zip(traces, valid, window, strict=True)]


def _bend(grid: Array, inertia: Array, paths: Sequence[tuple[Array, NDArray[np.bool_], int]]) -> Array:
    """How far the curve's mean over one window is from its value in the middle (kg·m²), on the grid, (points,)."""
    off, count = np.zeros(grid.size), np.zeros(grid.size)
    for angle, ok, window in paths:
        along = np.interp(angle, grid, inertia)
        mean = np.convolve(np.pad(along, window, mode="edge"), np.ones(window) / window, "same")[
            window:-window
        ]
        cell = np.rint((angle[ok] - grid[0]) / (grid[1] - grid[0])).astype(int)
        off += np.bincount(cell, (mean - along)[ok], grid.size)
        count += np.bincount(cell, minlength=grid.size)
    return np.interp(grid, grid[count > 0], off[count > 0] / count[count > 0])


def _mean_of(
    strokes: Sequence[_Stroke],
    grid: Array,
    paths: Sequence[tuple[Array, NDArray[np.bool_], int]],
    notes: list[str],
) -> Combined:
    inertia = np.vstack([stroke.inertia for stroke in strokes])
    there = np.isfinite(inertia)
    share = np.where(there, _weights(strokes)[:, None], 0.0)
    share = share / np.maximum(share.sum(0), 1e-300)
    count = there.sum(0)
    keep = count > 0
    mean = (share * np.where(there, inertia, 0.0)).sum(0)
    scatter = share * np.where(there, inertia - mean, 0.0)
    between = (scatter**2).sum(0) * count / np.maximum(count - 1, 1)
    within = np.nansum((share * np.vstack([stroke.error for stroke in strokes])) ** 2, axis=0)
    imaginary = np.nansum((share * np.vstack([stroke.imaginary for stroke in strokes])) ** 2, axis=0)
    keep &= mean > 0
    if keep.sum() < 2:
        raise InputError("session", "gives fewer than two angles with a positive inertia",
                         "Record the whole motion with the injection at full amplitude.")  # fmt: skip
    bend = _bend(grid, np.interp(grid, grid[keep], mean[keep]), paths)
    band = np.sqrt(between + within + imaginary + bend**2)
    if not keep.all():
        notes.append(f"{int(np.sum(~keep))} of {grid.size} angles hold no usable sample and were left out.")
    return Combined(InertiaTable(grid[keep], mean[keep], band[keep]), tuple(notes))


def combine_tables(tables: Sequence[InertiaTable]) -> tuple[InertiaTable, list[float]]:
    """One table from several of the same machine, each angle weighted by inverse variance; and each one's share.

    On the angles of the finest. Where the tables disagree by more than their bands say, the band is widened by
    that factor (Birge). A table without a band weighs as much as the widest.
    """
    finest = max(tables, key=lambda table: table.position_rad.size)
    angle = finest.position_rad
    widest = max((float(np.max(t.std_kgm2)) for t in tables if t.std_kgm2 is not None), default=1.0)
    values = np.vstack([table.at(angle) for table in tables])
    std = np.vstack([_band_at(table, angle, widest) for table in tables])
    weight = np.where(np.isfinite(std), 1 / np.maximum(std, 1e-12) ** 2, 0.0)
    total = weight.sum(0)
    mean = (weight * values).sum(0) / total
    count = np.maximum((weight > 0).sum(0), 1)
    disagreement = (weight * (values - mean) ** 2).sum(0) / np.maximum(count - 1, 1)
    shares = (weight / total).mean(1)
    band = np.sqrt(np.maximum(disagreement, 1.0) / total)
    return InertiaTable(angle, mean, band), [float(share) for share in shares]


def _band_at(table: InertiaTable, angle: Array, otherwise: float) -> Array:
    """Standard deviation at the angles, infinite outside the table (which is only held constant there)."""
    if table.std_kgm2 is None:
        return np.full(angle.size, otherwise)
    step = float(np.max(np.diff(table.position_rad)))
    inside = (angle > table.position_rad[0] - step) & (angle < table.position_rad[-1] + step)
    return np.where(inside, np.interp(angle, table.position_rad, table.std_kgm2), np.inf)
