"""What holds elsewhere: causes without a name that predict motions which they were not fitted to.

Evidence counts whatever a curve takes of the runs at hand; of a thing that only one motion shows, and that is no law of
the curve's coordinate, it takes much there, and adds an error to every other motion. So each motion in turn is left out
of the fitted runs and predicted with the coefficients that the others give; what makes that worse is no finding.

For a cause counts what its coefficients foretell. Against a law counts that as well, against a curve as far as the
others were sure of it: a law says something of every motion, but of places where none of the others was a curve
foretells nothing, and what it is there speaks of no error.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from schwung.explain.weighing.data import Data
from schwung.explain.weighing.repeated import motions_of
from schwung.explain.weighing.search import Scored, Search
from schwung.innovations.evidence import weigh
from schwung.innovations.statistics import Statistics
from schwung.motion import Array


def holding(search: Search, best: Scored, named: Collection[str]) -> Scored:
    """The set without what is refuted where it was not fitted, the worst first; `named`: causes that stay anyway.

    One run refutes nothing, and neither does a tie.
    """
    if len(_kept_apart(search.data)) < 2:
        return best
    while doubted := [pick for pick in best.picks if search.name(pick) not in named]:
        whole = foretold(search, best)
        fewer = [search.score(tuple(p for p in best.picks if p != pick)) for pick in doubted]
        gains = [
            whole.gains_by_leaving(foretold(search, one), curve=not search.candidate(pick).is_law)
            for pick, one in zip(doubted, fewer, strict=True)
        ]
        if max(gains) <= 0:
            return best
        best = fewer[int(np.argmax(gains))]
    return best


@dataclass(frozen=True, eq=False)
class Foretold:
    """Log likelihoods of each motion as the others foretell it, (m,), but for what is alike for all sets: about their
    coefficients alone, and with what they leave open of these."""

    plainly: Array
    openly: Array

    def gains_by_leaving(self, fewer: Foretold, *, curve: bool) -> float:
        """How much likelier all are as a set foretells them that lacks a law, or a curve."""
        plainly, openly = fewer.plainly - self.plainly, fewer.openly - self.openly
        if not curve:
            return float(np.sum(plainly))
        return float(np.sum(np.where(plainly < 0, plainly, np.clip(openly, 0.0, plainly))))


def foretold(search: Search, scored: Scored) -> Foretold:
    """Of a set; of two motions or more."""
    data = search.data
    rows, wheres = data.rows[scored.which].astype(np.float64), data.about.stretches(data.train)
    parts = []
    for group in _kept_apart(data):
        where = np.concatenate([np.arange(wheres[i].start, wheres[i].stop) for i in group])
        parts.append(Statistics.of(rows[:, where].T, data.target[where]).tempered(data.excess))
    everything = weigh(sum(parts[1:], parts[0]), scored.deviations).log_evidence
    plainly, openly = [], []
    for left in parts:
        others = [part for part in parts if part is not left]
        found = weigh(sum(others[1:], others[0]), scored.deviations)
        plainly.append(-0.5 * left.missed(found.coefficients))
        openly.append(everything - found.log_evidence)
    return Foretold(np.array(plainly), np.array(openly))


def _kept_apart(data: Data) -> list[list[int]]:
    """What is left out at once: the runs of each motion; each run, where there is one motion only."""
    groups = motions_of_fitted(data)
    return groups if len(groups) > 1 else [[place] for place in range(len(data.train))]


def motions_of_fitted(data: Data) -> list[list[int]]:
    """Fitted runs of each motion, as places among all that are fitted."""
    return motions_of([data.about.view.recorded[number] for number in data.train])
