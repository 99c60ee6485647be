"""Whether a coupling with a gap touches while it winds up, as far as its wind-up is known."""

from __future__ import annotations

from math import erf

import numpy as np

from schwung.compiled import inlined

#: Parts of a step, in each of which the wind-up is as good as straight.
PARTS = 8
#: The wind-up is never surer than to this share of the gap.
SUREST = 1e-9
#: So many deviations away from where it touches, nothing is open any more.
_FAR = 9.0
#: A wind-up that changes by fewer deviations stands still.
_STILL = 1e-3
#: Deviation of max(z, 0) about the line that is likeliest through it, for a normal z of mean 0, and that of the mean z
#: over which it dies away as a normal density does, nearly: together the area under it, 0.89.
_OPEN, _WIDE = np.sqrt(0.25 - 0.5 / np.pi), 0.89335 / np.sqrt(0.25 - 0.5 / np.pi) / np.sqrt(2 * np.pi)


@inlined
def _below(z: float) -> float:
    """Share of a normal distribution below z."""
    return float(0.5 * (1.0 + erf(z / np.sqrt(2.0))))


@inlined
def _density(z: float) -> float:
    return float(np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))


@inlined
def touching(start: float, end: float, half: float, spread: float) -> tuple[float, float, float]:
    """How much of a time a coupling touches on one side, the torque over the stiffness that it lacks there (rad), and
    the deviation (rad) of what it carries beyond what a line through the wind-up says of that.

    `start`, `end`: of the time, the wind-up towards that side, straight between them, and known to `spread` (rad).
    Means over the time are exact: of Φ the integral is zΦ + φ, and of that ((z² + 1)Φ + zφ)/2.
    """
    first, last = (start - half) / spread, (end - half) / spread
    if first < -_FAR and last < -_FAR:
        return 0.0, 0.0, 0.0
    if first > _FAR and last > _FAR:
        return 1.0, half, 0.0
    moved, middle = last - first, 0.5 * (first + last)
    if abs(moved) < _STILL:
        sure, dense = _below(middle), _density(middle)
        still = _OPEN * np.exp(-0.5 * (middle / _WIDE) ** 2)
        return sure, half * sure - spread * dense, spread * still
    sure_first, sure_last, dense_first, dense_last = (
        _below(first),
        _below(last),
        _density(first),
        _density(last),
    )
    share = (last * sure_last + dense_last - first * sure_first - dense_first) / moved
    squared = (last * last + 1.0) * sure_last + last * dense_last
    squared -= (first * first + 1.0) * sure_first + first * dense_first
    carried = 0.5 * squared / moved
    swept = _OPEN * _WIDE * np.sqrt(2.0 * np.pi) * (_below(last / _WIDE) - _below(first / _WIDE)) / moved
    return share, half * share + spread * (share * middle - carried), spread * swept
