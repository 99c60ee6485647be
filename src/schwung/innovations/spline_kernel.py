"""The compiled inside of splines: slopes of a cubic one through even points, its values, and rows of B-splines."""

from __future__ import annotations

import numpy as np

from schwung.compiled import compiled, compiled_or
from schwung.innovations import plain
from schwung.motion import Array


@compiled
def spline_slopes(values: Array, step: float) -> Array:
    """Slopes (n, c) at evenly spaced knots of the cubic splines through values (n, c), n ≥ 4, "not a knot" at the ends.

    s₋₁ + 4 s₀ + s₁ = 3 (v₁ − v₋₁)/h inside; at the start s₀ + 2 s₁ = (−5 v₀ + 4 v₁ + v₂)/2h, at the end its mirror.
    """
    count, number = values.shape
    upper, result = np.empty(count), np.empty((count, number))
    upper[0] = 2.0
    for c in range(number):
        result[0, c] = (-5.0 * values[0, c] + 4.0 * values[1, c] + values[2, c]) / (2.0 * step)
    for k in range(1, count - 1):
        below = 1.0 / (4.0 - upper[k - 1])
        upper[k] = below
        for c in range(number):
            result[k, c] = (3.0 * (values[k + 1, c] - values[k - 1, c]) / step - result[k - 1, c]) * below
    last = count - 1
    below = 1.0 / (1.0 - 2.0 * upper[last - 1])
    for c in range(number):
        end = (5.0 * values[last, c] - 4.0 * values[last - 1, c] - values[last - 2, c]) / (2.0 * step)
        result[last, c] = (end - 2.0 * result[last - 1, c]) * below
    for k in range(last - 1, -1, -1):
        for c in range(number):
            result[k, c] -= upper[k] * result[k + 1, c]
    return result


@compiled
def spline_at(
    values: Array, slopes: Array, start: float, step: float, places: Array, derivative: int = 0
) -> Array:
    """Cubic splines with values and slopes (n, c) at knots from `start` on, or their first or second derivative, at
    places (m,), (m, c)."""
    result = np.empty((places.size, values.shape[1]))
    for i in range(places.size):
        at = (places[i] - start) / step
        left = min(max(int(at), 0), values.shape[0] - 2)
        u = at - left
        v = 1.0 - u
        if derivative == 0:
            h0, h1 = v * v * (1.0 + 2.0 * u), u * u * (1.0 + 2.0 * v)
            g0, g1 = u * v * v * step, -u * u * v * step
        elif derivative == 1:
            h0, h1 = -6.0 * u * v / step, 6.0 * u * v / step
            g0, g1 = v * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
        else:
            h0, h1 = (12.0 * u - 6.0) / (step * step), (6.0 - 12.0 * u) / (step * step)
            g0, g1 = (6.0 * u - 4.0) / step, (6.0 * u - 2.0) / step
        for c in range(values.shape[1]):
            result[i, c] = (
                h0 * values[left, c]
                + h1 * values[left + 1, c]
                + g0 * slopes[left, c]
                + g1 * slopes[left + 1, c]
            )
    return result


@compiled_or(plain.spline_rows)
def spline_rows(low: float, step: float, pieces: int, places: Array) -> tuple[Array, Array]:
    """All `pieces` + 3 uniform cubic B-splines from `low` on and their slopes at places (n,); straight on outside."""
    value, slope = np.zeros((places.size, pieces + 3)), np.zeros((places.size, pieces + 3))
    for i in range(places.size):
        whole = (places[i] - low) / step
        at = min(max(whole, 0.0), float(pieces))
        left = min(int(at), pieces - 1)
        u = at - left
        v = 1.0 - u
        value[i, left], value[i, left + 3] = v * v * v / 6.0, u * u * u / 6.0
        value[i, left + 1] = 2.0 / 3.0 - u * u + u * u * u / 2.0
        value[i, left + 2] = 2.0 / 3.0 - v * v + v * v * v / 2.0
        slope[i, left], slope[i, left + 3] = -v * v / 2.0 / step, u * u / 2.0 / step
        slope[i, left + 1] = (1.5 * u * u - 2.0 * u) / step
        slope[i, left + 2] = (2.0 * v - 1.5 * v * v) / step
        if whole != at:
            for c in range(left, left + 4):
                value[i, c] += (whole - at) * step * slope[i, c]
    return value, slope
