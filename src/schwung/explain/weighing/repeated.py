"""Runs that repeat one motion: what they do not share is noise, and what they have in common and nothing in the
vocabulary carries is torque over time, one curve a motion.

No curve says anything about another motion. It is what names are held against: what a name carries has to stand out
from what is left to these curves.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from scipy.signal import correlate

from schwung.explain.causes.along import Along
from schwung.explain.causes.candidate import LADDER, Candidate, Shape
from schwung.explain.causes.curves import Curve, curve_over_time
from schwung.explain.causes.joined import run_by_run
from schwung.explain.weighing.values import Lasting
from schwung.explain.weighing.wide import STRETCH_S
from schwung.innovations.effect import Effect
from schwung.session.imports import repeats
from schwung.session.model import Run, Session


def motions_of(runs: Sequence[Run]) -> list[list[int]]:
    """Which runs are of one motion, whatever is injected: commanded, or found to be the same where they were imported.

    Runs of which nothing is known stand alone.
    """
    motions: dict[Hashable, list[int]] = {}
    for number, run in enumerate(runs):
        told = run.extra.get("same_motion") if run.motion is None else run.motion.model_dump_json()
        motions.setdefault((told, number if told is None else None), []).append(number)
    return list(motions.values())


def telling_noise(session: Session) -> list[tuple[int, ...]]:
    """Runs of each motion and injection whose noise shows in what they do not share.

    Repeats most of whose samples move the same to the last count share the rounding, too: where noise is smaller than a
    count, it is rounding that is noise, and copies of one run, as a simulation makes them, show none at all.
    """
    runs = session.runs
    return [
        group for group in repeats(session) if not any(_copied(runs[group[0]], runs[i]) for i in group[1:])
    ]


def lasting(session: Session) -> Lasting | None:
    """What the repeats that are least alike differ by for longer than noise lasts; None: by less than noise.

    Noise is as large in all, and in a moment another. A motor that warms, a load that still swings from the run before
    or a seal that it left bent make a torque that goes on.
    """
    found = [
        _lasting(session.runs[one], session.runs[other])
        for group in repeats(session)
        for one, other in combinations(group, 2)
    ]
    most = max(found, key=lambda one: one.over_noise, default=Lasting(0.0, 0.0))
    return most if most.over_noise > 1 else None


def _lasting(one: Run, other: Run) -> Lasting:
    """By the most that their difference has in common with itself later, as what swings has after a period."""
    length = min(len(one), len(other))
    apart = one.torque_nm[:length] - other.torque_nm[:length]
    later = max(round(STRETCH_S * one.sample_rate_hz), 1)
    if length < 4 * later:
        return Lasting(0.0, 0.0)
    noise = float(np.mean(np.diff(apart) ** 2)) / 2
    shared = correlate(apart, apart, method="fft")[length - 1 :] / np.arange(length, 0, -1)
    stays = float(np.max(shared[later : length // 2]))
    if noise == 0 or stays <= 0:
        return Lasting(0.0, 0.0)
    return Lasting(float(np.sqrt(stays / 2)), float(np.sqrt(stays / noise)))


def _copied(one: Run, other: Run) -> bool:
    """Whether most samples of two runs are the same in angle and speed."""
    length = min(len(one), len(other))
    same = one.position_rad[:length] == other.position_rad[:length]
    same &= one.speed_rad_s[:length] == other.speed_rad_s[:length]
    return bool(2 * np.count_nonzero(same) > length)


@dataclass(frozen=True, eq=False)
class Shared:
    """What the runs of a motion have in common, and which they are: nothing acts in others."""

    curve: Candidate
    runs: Sequence[int]


def repeated(runs: Sequence[Run], torque_nm: float) -> list[Shared]:
    """A curve for each motion of several runs; `torque_nm`: a natural torque."""
    return [
        Shared(_curve(runs, numbers, torque_nm), numbers) for numbers in motions_of(runs) if len(numbers) > 1
    ]


def _curve(runs: Sequence[Run], numbers: Sequence[int], torque_nm: float) -> Candidate:
    curve = curve_over_time(max(float(runs[number].time_s[-1]) for number in numbers))
    effect = partial(_over_time, curve=curve, numbers=frozenset(numbers))
    return Candidate("motion", effect, (torque_nm,) * curve.size, scales=LADDER, named=False)


@run_by_run
def _over_time(along: Along, _shape: Shape, curve: Curve, numbers: frozenset[int]) -> Effect:
    if along.number not in numbers:
        return Effect(on_load=np.zeros((along.speed.size, curve.size)))
    return Effect(on_load=curve.at(along.time_s))
