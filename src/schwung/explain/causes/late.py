"""Signals that come late: through a filter of first order, and between samples."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from schwung.compiled import compiled_or
from schwung.explain.causes.along import Along
from schwung.explain.causes.joined import Joined, run_by_run
from schwung.innovations.held import corners
from schwung.innovations.splines import interpolated
from schwung.motion import Array


def lagging(along: Along, values: Array, time_s: float) -> Array:
    """Through a first-order filter (bilinear), backwards where its time is negative; at rest before."""
    if time_s == 0:
        return values
    found, later = np.array(values, dtype=float), abs(time_s)
    runs = (
        zip(along.parts, along.wheres, strict=True) if isinstance(along, Joined) else [(along, slice(None))]
    )
    for part, where in runs:
        whole = part.run.step_s + 2 * later
        _filter(found[where], part.run.step_s / whole, (2 * later - part.run.step_s) / whole, time_s < 0)
    return found


def _filter_whole(values: Array, taken: float, kept: float, backwards: bool) -> None:
    signal = values[::-1] if backwards else values
    signal[:] = lfilter([taken] * 2, [1.0, -kept], signal, zi=[(1.0 - taken) * signal[0]])[0]


@compiled_or(_filter_whole)
def _filter(values: Array, taken: float, kept: float, backwards: bool) -> None:
    """Filter a signal (n,) in place: of each value and the one before it so much is taken, of what was found so much
    kept."""
    place, way = (values.size - 1, -1) if backwards else (0, 1)
    before = found = values[place]
    for _ in range(values.size - 1):
        place += way
        value = values[place]
        found = taken * (value + before) + kept * found
        values[place], before = found, value


@run_by_run
def acceleration_bent(along: Along, time_s: float, late_s: float | None = None) -> Array:
    """Of the motor just before each sample through 1/(1 + φ d/dt), φ = `time_s` (rad/s²), (n,).

    In proportion to this a speed is late; as a whole by `late_s` (None: twice that time), or y steps h. What a held
    injection's corners do, only the rotor follows so fast (`corners`): at the share x behind one, what was y before
    misses h/J_r (½ (ΔT − y Δ²T) (B₂(x) − B₂(x + y)) + ⅓ Δ²T (B₃(x) − B₃(x + y))), and so again after a whole step.
    """
    steps, x = (2 * time_s if late_s is None else late_s) / along.run.step_s, along.beyond.held_late
    if not along.run.drive.held.is_any or steps == 0:
        return lagging(along, along.acceleration_before, time_s)
    jump, change = along.held
    here, before = corners(x), corners((x + steps) % 1.0 if steps > 0 else x + steps)
    missed = (jump - steps * change) * (here[0] - before[0]) / 2 + change * (here[1] - before[1]) / 3
    return np.asarray(lagging(along, along.acceleration, time_s) - missed / steps)


@run_by_run
def beyond_bent(along: Along, delay_s: float, bend_s: float) -> Array:
    """What a delay does to the speed beyond −δ α through 1/(1 + δ/2 d/dt), the first of Padé's (rad/s), (n,).

    That is (ωδ)³/12 of the speed: a fourth of it at 150 Hz and 1.5 ms. What bends like a filter (φ = δ) has none of it.
    """
    share = float(np.clip(2 - 2 * bend_s / delay_s, 0.0, 1.0)) if delay_s > 0 else 0.0
    if share == 0:
        return np.zeros_like(along.speed)
    speed, run = along.run.quiet(along.speed), along.run
    then = np.clip(run.time_s - delay_s, run.time_s[0], run.time_s[-1])
    exact = interpolated(speed, run.time_s[0], run.step_s, then) - speed
    return np.asarray(share * (exact + delay_s * lagging(along, along.acceleration, delay_s / 2)))
