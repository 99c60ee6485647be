"""A line that stands out of the spectra of what is missed, over time or over the angle.

Of R runs whose power there is ρ times what it is nearby on average, a line of one size and any phases is likelier than
none by R (ρ − 1 − log ρ); it has to be as likely as that any of the places looked at is chance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from schwung.explain.causes.candidate import Missed, Shape
from schwung.motion import Array

#: Places in a spectrum for each frequency that a run tells apart, and of these as many frequencies are nearby.
FINER, _NEARBY = 4, 16
#: What falls by half of its power over less than so many periods of the whole record is no line, but a slope.
LEAST_PERIODS = 3.0
#: Of an angle's passes, for each period of the finest order.
_BINS = 4


def beyond_nearby(windowed: Array, size: int, count: int) -> Array:
    """Power over what it is nearby, at the first `count` places of a spectrum of `size` samples."""
    power = np.abs(np.fft.rfft(windowed, size)[:count]) ** 2
    nearby = median_filter(power, FINER * _NEARBY + 1, mode="reflect") / np.log(2)
    share = power / np.maximum(nearby, 1e-300)
    return np.pad(share, (0, count - share.size), constant_values=1.0)


def line_of(over: Sequence[Array], places: Array, among: NDArray[np.bool_]) -> tuple[Shape, ...]:
    """The place (m,) whose line stands out of all runs' powers over those nearby (m,), if one `among` them does."""
    if not over:
        return ()
    mean = np.maximum(np.mean(over, axis=0), 1.0)
    gain = np.where(among, len(over) * (mean - 1 - np.log(mean)), 0.0)
    top = int(np.argmax(gain))
    return ((float(places[top]),),) if gain[top] > np.log(places.size) else ()


def finest_order(
    missed: Sequence[Missed], low_rad: float, high_rad: float, orders: tuple[float, float]
) -> tuple[Shape, ...]:
    """The order of a ripple over the angle that stands out between two orders, if one does.

    What is missed at an angle is its mean, weighted by the way, of a run's passes.
    """
    span = high_rad - low_rad
    periods = orders[1] * span / (2 * np.pi)
    bins, over = int(_BINS * periods) + 1, []
    order = np.asarray(2 * np.pi * np.arange(int(FINER * periods) + 1) / (FINER * span), dtype=float)
    for one in missed:
        place = np.clip(((one.angle_rad - low_rad) / span * bins).astype(int), 0, bins - 1)
        way = np.abs(np.gradient(one.angle_rad))
        passed = np.bincount(place, way, bins)
        torque = np.bincount(place, way * one.torque_nm, bins) / np.maximum(passed, 1e-300)
        over.append(beyond_nearby(torque * np.hanning(bins), FINER * bins, order.size))
    return line_of(over, order, order >= orders[0])
