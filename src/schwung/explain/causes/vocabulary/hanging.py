"""A further mass that the load's speed stiffens, as what hangs on an arm, or sloshes on it, does: k + J c ω_l².

Its resonance goes up and down again within a stroke, so that no spectrum shows it. Where it may be is sought by how
much of what is missed each of many would explain; the few that explain most have columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schwung.explain.causes.along import Along, Ranges
from schwung.explain.causes.candidate import Candidate, Missed, Shape
from schwung.explain.causes.curves import column
from schwung.explain.causes.joined import run_by_run
from schwung.explain.causes.third_mass import explained, stiffened
from schwung.innovations.effect import Effect
from schwung.motion import Array

#: Where it is looked for: its frequency at rest, and how many times as stiff it is besides at the highest speed. Over a
#: stroke of ten swings those are as far apart as takes it half a swing out of phase.
_HZ, _STIFFER, _RATIO = np.geomspace(3, 50, 72), np.geomspace(0.2, 50, 42), 0.05
#: It is sought in so few runs, at so many samples a second, and so many of what is found have columns.
_RUNS, _RATE_HZ, _FOUND = 4, 500.0, 3


def hanging(of: Ranges, deviation_kgm2: float, known_to_kgm2: float) -> Candidate:
    """The cause; `deviation_kgm2`: a natural inertia of it."""
    fastest = of.peak_speed_rad_s

    @run_by_run
    def swung(along: Along, shape: Shape) -> Effect:
        rate, ratio, stiffer = shape
        square = rate**2 * (1 + stiffer * (along.load_speed / fastest) ** 2)
        return Effect(
            on_load=column(-stiffened(along.load_acceleration, square, ratio * rate, along.run.step_s))
        )

    def sought(missed: Sequence[Missed]) -> tuple[Shape, ...]:
        return _strongest(missed, fastest, of.band_hz)

    return Candidate(
        "extra_compliance", swung, (deviation_kgm2,),
        lambda c, s: {"inertia_kgm2": c[0], "stiffness_nm_rad": c[0] * s[0] ** 2, "damping_nms": 2 * c[0] * s[0] * s[1],
                      "speed_share": s[2] * (s[0] / fastest) ** 2},
        shapes=(), sought=sought, choices=_HZ.size * _STIFFER.size, spacing=(0.04, 0.7, 0.1),
        logarithmic=(True, True, True), bounds=((2 * np.pi, 2 * np.pi * of.band_hz), (0.005, 0.5), (0.1, 100.0)),
        positive=(0,), coordinate="frequency", known_to=known_to_kgm2, swings=True, felt=lambda s: 1 / (2 * s[1]),
        limit="extra_compliance", causes=3,
    )  # fmt: skip


def _strongest(missed: Sequence[Missed], fastest_rad_s: float, band_hz: float) -> tuple[Shape, ...]:
    """The shapes that explain most of what is missed, none a neighbour of another."""
    rates = 2 * np.pi * _HZ[band_hz > _HZ]
    picked = [one for one in missed[:: -(-len(missed) // _RUNS)] if one.along is not None]
    if not picked or not rates.size:
        return ()
    step_s = picked[0].step_s
    every = max(round(1 / (_RATE_HZ * step_s)), 1)
    parts = [[_slow(values, every) for values in signals] for signals in map(_signals, picked)]
    torque, acceleration, speed = (np.concatenate(signals) for signals in zip(*parts, strict=True))
    starts = np.cumsum([0, *(part[0].size for part in parts)])
    scores = explained(
        -torque,
        acceleration,
        (speed / fastest_rad_s) ** 2,
        starts,
        every * step_s,
        rates,
        _STIFFER,
        _RATIO,
    )
    found = []
    for _ in range(_FOUND):
        row, at = np.unravel_index(int(np.argmax(scores)), scores.shape)
        found.append((float(rates[row]), _RATIO, float(_STIFFER[at])))
        scores[max(row - 2, 0) : row + 3, max(at - 2, 0) : at + 3] = 0.0
    return tuple(found)


def _signals(one: Missed) -> tuple[Array, Array, Array]:
    """What is missed (N·m), and the load's acceleration and speed."""
    assert one.along is not None
    return one.torque_nm, one.along.load_acceleration, one.along.load_speed


def _slow(values: Array, every: int) -> Array:
    """The mean of so many samples at a time."""
    whole = values[: values.size // every * every]
    return np.ascontiguousarray(whole.reshape(-1, every).mean(axis=1))
