"""What has no name, in plain words: which simple laws come nearest to it, with which numbers, and how near.

A machine's friction is never quite a textbook's. Where a curve stands for it because no law holds to what the recording
can tell, it is dry and viscous friction to nine tenths all the same, and an engineer wants to hear that. This is least
squares, not evidence: laws without a shape of their own, one after another, by what they take of the curves' torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from schwung.explain.causes.candidate import RIGHT_TO, Candidate
from schwung.explain.publishing.judged import Shown
from schwung.explain.publishing.places import Acts
from schwung.motion import Array

#: Laws that are told together, at most.
_MOST = 3
#: Samples that are compared, of all runs, at most.
_SAMPLES = 20_000


@dataclass(frozen=True, eq=False)
class _Law:
    """A candidate and what a unit of each of its coefficients takes, (n, p)."""

    candidate: Candidate
    columns: Array


@dataclass(frozen=True, eq=False)
class Nearest:
    """Laws by their names, with their numbers, and the share of the whole (mean square) that they take together."""

    laws: Mapping[str, Mapping[str, float]]
    share: float


def nearest(curves: Sequence[Acts], candidates: Sequence[Candidate], runs: Sequence[Shown]) -> Nearest | None:
    """The few laws that come nearest to what some causes without a name take together; None where none takes half."""
    every = max(1, sum(run.missed_nm.size for run in runs) // _SAMPLES)
    whole = _joined([sum((_taken(one, run) for one in curves), 0.0 * run.missed_nm) for run in runs], every)
    energy = float(whole @ whole)
    if not curves or energy <= 0:
        return None
    laws = [law for candidate in candidates if (law := _law(candidate, runs, every)) is not None]
    chosen: tuple[_Law, ...] = ()
    numbers: tuple[Array, ...] = ()
    share = 0.0
    for _ in range(_MOST):
        if 1 - share <= RIGHT_TO**2:  # what is left is rounding, which any law takes
            break
        left = [law for law in laws if all(_together(law, other) for other in chosen)]
        tried = [fit for law in left if (fit := _fitted((*chosen, law), whole)) is not None]
        best = max(tried, key=lambda fit: fit.share, default=None)
        if best is None or 1 - best.share > _WORTH * (1 - share):
            break
        alike = [fit for fit in tried if 1 - fit.share <= _ALIKE * (1 - best.share)]
        best = min(alike, key=lambda fit: fit.size)
        chosen, share, numbers = best.laws, best.share, best.numbers
    if share < _HALF:
        return None
    told = {
        law.candidate.name: law.candidate.keys(mine, ()) for law, mine in zip(chosen, numbers, strict=True)
    }
    return Nearest({name: {key: float(v) for key, v in keys.items()} for name, keys in told.items()}, share)


#: One law more leaves less than this share of what was left, or it is not worth a word.
_WORTH = 0.7
#: Of laws that leave about as much as the best does, the one with the fewest numbers is told.
_ALIKE = 1.1
#: Less than this share is no description.
_HALF = 0.5


def _together(one: _Law, other: _Law) -> bool:
    """Whether two laws may be told beside each other: the one is no case of the other, nor another name for it."""
    if one.candidate.excludes(other.candidate):
        return False
    a, b = (np.linalg.qr(law.columns)[0] for law in (one, other))
    return bool(np.linalg.norm(a.T @ b, 2) < _SAME)


#: Laws that are so alike along these runs that no numbers of both mean anything.
_SAME = 0.99


def _law(candidate: Candidate, runs: Sequence[Shown], every: int) -> _Law | None:
    """Of a candidate without a shape and of few numbers that acts as a torque; None of others."""
    simple = candidate.named and candidate.shapes == ((),) and len(candidate.scales) == 1
    if not simple or candidate.bent is not None or any(candidate.coupling):
        return None
    units = np.eye(candidate.size)
    parts = [[_taken(Acts(candidate.name, candidate, (), unit), run) for run in runs] for unit in units]
    columns = np.stack([_joined(each, every) for each in parts], axis=1)
    sizes = np.sqrt(np.mean(columns**2, axis=0))
    return _Law(candidate, columns) if bool(np.all(sizes > 0)) else None


def _taken(cause: Acts, run: Shown) -> Array:
    taken = cause.takes(run.along)
    return 0.0 * run.missed_nm if taken is None else taken


def _joined(parts: Sequence[Array], every: int) -> Array:
    return np.concatenate([part[::every] for part in parts])


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Laws with their coefficients, and what they take of the whole (mean square), 0…1."""

    laws: tuple[_Law, ...]
    numbers: tuple[Array, ...]
    share: float

    @property
    def size(self) -> int:
        """Numbers."""
        return sum(mine.size for mine in self.numbers)


def _fitted(laws: tuple[_Law, ...], whole: Array) -> _Fitted | None:
    """By least squares; None where a coefficient has a sign that physics forbids."""
    columns = np.concatenate([law.columns for law in laws], axis=1)
    sizes = np.sqrt(np.sum(columns**2, axis=0))
    scaled = np.linalg.lstsq(columns / sizes, whole, rcond=None)[0]
    rest = whole - columns @ (scaled / sizes)
    ends = np.cumsum([law.candidate.size for law in laws])[:-1]
    numbers = tuple(np.split(scaled / sizes, ends))
    for law, mine in zip(laws, numbers, strict=True):
        if any(mine[i] < least for i, least in law.candidate.bounds_below):
            return None
    return _Fitted(laws, numbers, float(1 - rest @ rest / (whole @ whole)))
