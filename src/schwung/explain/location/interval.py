"""On which interval of a coordinate a contribution lives."""

from __future__ import annotations

import numpy as np

from schwung.motion import Array

#: Share of the amplitude (mean size per visited place) that the interval holds. A raised cosine has 0.84 of its width
#: there, a half sine 0.92, a rectangle all of it.
HELD = 0.993
#: An interval this large a part of the visited range is no place any more: the effect is everywhere.
EVERYWHERE = 0.5
BINS = 400


def interval_of(
    coordinate_values: Array, contribution: Array, *, period: float | None = None, held: float = HELD
) -> tuple[float, float]:
    """The shortest range of a coordinate that holds nearly all of what a term contributes, relative to what is visited.

    `coordinate_values`, `contribution`: (n,), any units. Places are weighted equally, however long the motion stayed
    there. An effect on more than half of the visited range is given the whole of it. With `period` the values are
    folded (a place that comes back every turn); then `lo` is within [0, period) and `hi` may pass its end. `held`:
    the share to hold; less suits a curve that is itself uncertain.
    """
    values = np.asarray(coordinate_values, dtype=np.float64)
    if period is not None:
        return _folded(values, contribution, period, held)
    lowest, highest = float(np.min(values)), float(np.max(values))
    if highest <= lowest:
        return lowest, highest
    size = _mean_size(values, contribution, lowest, highest)
    first, last = _shortest(size, held)
    step = (highest - lowest) / BINS
    if (last - first) > EVERYWHERE * BINS:
        return lowest, highest
    return lowest + first * step, lowest + last * step


def _folded(values: Array, contribution: Array, period: float, held: float) -> tuple[float, float]:
    size = _mean_size(np.mod(values, period), contribution, 0.0, period)
    quietest = int(np.argmin(np.convolve(np.r_[size, size], np.ones(BINS // 4), "valid")[:BINS]))
    start = (quietest + BINS // 8) % BINS  # cut the circle where least happens
    first, last = _shortest(np.roll(size, -start), held)
    if (last - first) > EVERYWHERE * BINS:
        return 0.0, period
    lo = (start + first) % BINS
    return lo * period / BINS, (lo + last - first) * period / BINS


def _mean_size(values: Array, contribution: Array, lowest: float, highest: float) -> Array:
    """Mean |contribution| per bin (BINS,); bins that nothing visited are 0."""
    bins = np.minimum(((values - lowest) / (highest - lowest) * BINS).astype(np.int64), BINS - 1)
    visits = np.bincount(bins, minlength=BINS)
    total = np.bincount(bins, weights=np.abs(contribution), minlength=BINS)
    size: Array = np.where(visits > 0, total / np.maximum(visits, 1), 0.0)
    return size


def _shortest(size: Array, held: float) -> tuple[int, int]:
    """Edges [first, last) of the shortest run of bins that holds that share of the sum."""
    sums = np.r_[0.0, np.cumsum(size)]
    if sums[-1] <= 0:
        return 0, size.size
    last = np.searchsorted(sums, sums + held * sums[-1] * (1 - 1e-12))
    possible = np.flatnonzero(last <= size.size)
    best = int(possible[np.argmin(last[possible] - possible)])
    return best, int(last[best])
