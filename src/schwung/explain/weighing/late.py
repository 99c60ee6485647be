"""Signals that come late: through a filter of first order, and between samples."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter, lfilter_zi

from schwung.explain.weighing.along import Along
from schwung.motion import Array


def lagging(along: Along, values: Array, time_s: float) -> Array:
    """Through a first-order filter (bilinear), backwards where its time is negative; at rest before."""
    step, later = along.run.step_s, abs(time_s)
    signal = values if time_s >= 0 else values[::-1]
    first = lfilter_zi([step, step], [step + 2 * later, step - 2 * later]) * signal[0] if later > 0 else None
    if first is None:
        return values
    found, _ = lfilter([step, step], [step + 2 * later, step - 2 * later], signal, zi=first)
    return np.asarray(found if time_s >= 0 else found[::-1])


def acceleration_bent(along: Along, time_s: float) -> Array:
    """Of the motor just before each sample through 1/(1 + φ d/dt), φ = `time_s` (rad/s²), (n,).

    In proportion to this a speed is late, if by twice that time then as a whole. What a held injection's steps do
    beyond the smooth curve, only the rotor follows so fast (`Along.held`): a speed that is x of a step h late misses
    h/J_r (½ (x − x²) ΔT − ⅙ (x − x³) Δ²T) of it, and nothing more after a whole one.
    """
    steps = 2 * time_s / along.run.step_s
    late = steps % 1.0 if steps > 0 else steps
    whole = late / steps if steps else 1.0
    jump, change = along.held
    return lagging(along, along.acceleration, time_s) - whole * ((1 - late) * jump - (1 - late**2) * change)
