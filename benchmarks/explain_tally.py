"""Rates of weighed sessions and the calibration of their probabilities, each with an interval of 95 %.

A tally is a file with a line of JSON for each session, as `explain_rates.py --tally` writes it. A probability is
right as often as it says: names are sorted into bins by it, and the expected calibration error is the mean distance
between the bins' mean probability and the share that was true, weighted by their counts (Naeini et al. 2015). Its
interval is that of sessions drawn again, with replacement; of rates it is Wilson's.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

#: More probable than this is said.
LIKELY, MOST_OF_IT = 0.5, 0.8
#: Ends of the bins: the last are those of names that are as good as sure.
EDGES = (0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)
_DRAWS = 2000


@dataclass(frozen=True)
class Told:
    """A session: what is hidden, names with their probabilities, share of the held-out excess taken, seconds; whether
    the first coordinate is right, and how many intervals hold their number, of how many."""

    kind: str
    seed: int
    truth: tuple[str, ...]
    names: Mapping[str, float]
    taken: float
    seconds: float
    said: str = ""
    placed: bool | None = None
    held: tuple[int, int] = (0, 0)

    @property
    def likely(self) -> list[str]:
        """Names that are said, the first first."""
        return [name for name, p in self.names.items() if p > LIKELY]

    @property
    def wrong(self) -> bool:
        """Whether one of them is not hidden there."""
        return bool(set(self.likely) - set(self.truth))

    @property
    def right(self) -> bool:
        """Whether the first name is hidden there, or none is said where none is."""
        named = self.kind not in ("none", "foreign")
        return self.likely[:1] != [] and self.likely[0] in self.truth if named else not self.wrong

    @property
    def complete(self) -> bool:
        """Whether all that has a name is named."""
        return self.kind == "foreign" or set(self.truth) <= set(self.likely)


@dataclass(frozen=True)
class Bin:
    """Names of about one probability: how many, their mean probability, and how many were true."""

    low: float
    high: float
    count: int
    mean: float
    true: int


def write_tally(file: Path, told: Told) -> None:
    """Add a session."""
    with file.open("a", encoding="utf-8") as lines:
        lines.write(json.dumps(asdict(told)) + "\n")


def read_tally(file: Path) -> list[Told]:
    """All sessions of a file."""
    rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines() if line]
    pairs = dict.fromkeys(("truth", "held"), tuple)
    return [Told(**{key: pairs.get(key, lambda v: v)(value) for key, value in row.items()}) for row in rows]


def bins_of(sessions: Sequence[Told]) -> list[Bin]:
    """The reliability of all names told."""
    pairs = np.array([(p, name in one.truth) for one in sessions for name, p in one.names.items()])
    pairs = pairs.reshape(-1, 2)
    found = []
    for low, high in itertools.pairwise(EDGES):
        last = high == EDGES[-1]
        inside = pairs[(pairs[:, 0] >= low) & ((pairs[:, 0] < high) | last)]
        if len(inside):
            found.append(Bin(low, high, len(inside), float(inside[:, 0].mean()), int(inside[:, 1].sum())))
    return found


def calibration_error(sessions: Sequence[Told]) -> float:
    """Expected calibration error of the names told; 0 where none was."""
    bins = bins_of(sessions)
    count = sum(one.count for one in bins)
    return sum(abs(one.mean * one.count - one.true) for one in bins) / count if count else 0.0


def calibration_interval(sessions: Sequence[Told]) -> tuple[float, float]:
    """Of the same, over sessions drawn again."""
    chance = np.random.default_rng(0)
    drawn = chance.integers(len(sessions), size=(_DRAWS, len(sessions)))
    errors = [calibration_error([sessions[i] for i in draw]) for draw in drawn]
    low, high = np.percentile(errors, [2.5, 97.5])
    return float(low), float(high)


def interval_of_rate(hits: int, total: int) -> tuple[float, float]:
    """Of 95 %, by Wilson."""
    interval = binomtest(hits, max(total, 1)).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def _rate(hits: int, total: int) -> str:
    low, high = interval_of_rate(hits, total)
    return f"{hits}/{total} ({100 * low:.0f} to {100 * high:.0f} %)"


def printed(sessions: Sequence[Told]) -> str:
    """A line for each kind, then the bins of the probabilities and their error."""
    lines = []
    for kind in sorted({one.kind for one in sessions}):
        mine = [one for one in sessions if one.kind == kind]
        count, seconds = len(mine), sorted(one.seconds for one in mine)
        parts = {
            "right": [one.right for one in mine],
            "all named": [one.complete for one in mine],
            "a wrong name": [one.wrong for one in mine],
            f"{MOST_OF_IT:.0%} of the excess taken": [one.taken >= MOST_OF_IT for one in mine],
        }
        rates = ", ".join(f"{what} {_rate(sum(which), count)}" for what, which in parts.items())
        if placed := [one.placed for one in mine if one.placed is not None]:
            rates += f", right coordinate first {_rate(sum(placed), len(placed))}"
        lines.append(f"{kind:8} {rates}, {seconds[count // 2]:.0f} s, worst {seconds[-1]:.0f} s")
    held, intervals = (sum(one.held[i] for one in sessions) for i in (0, 1))
    lines.append(f"intervals of 95 % that hold their number: {_rate(held, intervals)}" if intervals else "")
    lines.append("")
    for one in bins_of(sessions):
        lines.append(
            f"said {one.low:.2f} to {one.high:.2f}: mean {one.mean:.3f}, true {_rate(one.true, one.count)}"
        )
    low, high = calibration_interval(sessions) if sessions else (0.0, 0.0)
    error = f"{calibration_error(sessions):.3f} ({low:.3f} to {high:.3f})"
    lines.append(f"expected calibration error {error}, {len(sessions)} sessions")
    return "\n".join(lines)
