"""What holds elsewhere: causes without a name that predict motions which they were not fitted to.

Evidence counts whatever a curve takes of the runs at hand; of a thing that only one motion shows, and that is no law of
the curve's coordinate, it takes much there, and adds an error to every other motion. So each motion in turn is left out
of the fitted runs and predicted with the coefficients that the others give; what makes that worse is no finding.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from schwung.explain.weighing.data import Data
from schwung.explain.weighing.repeated import motions_of
from schwung.explain.weighing.search import Scored, Search
from schwung.innovations.evidence import weigh
from schwung.innovations.statistics import Statistics


def holding(search: Search, best: Scored, named: Collection[str]) -> Scored:
    """The set without what is refuted where it was not fitted, the worst first; `named`: causes that stay anyway.

    One run refutes nothing, and neither does a tie.
    """
    if len(_kept_apart(search.data)) < 2:
        return best
    while True:
        doubted = [pick for pick in best.picks if search.name(pick) not in named]
        missed = missed_elsewhere(search, best) if doubted else 0.0
        fewer = [search.score(tuple(p for p in best.picks if p != pick)) for pick in doubted]
        gains = [missed - missed_elsewhere(search, one) for one in fewer]
        if not gains or max(gains) <= 0:
            return best
        best = fewer[int(np.argmax(gains))]


def missed_elsewhere(search: Search, scored: Scored) -> float:
    """Sum of squares of the innovations of each motion, about the coefficients that the others give; of two or more."""
    data = search.data
    rows, wheres = data.rows[scored.which].astype(np.float64), data.about.stretches(data.train)
    parts = []
    for group in _kept_apart(data):
        where = np.concatenate([np.arange(wheres[i].start, wheres[i].stop) for i in group])
        parts.append(Statistics.of(rows[:, where].T, data.target[where]).tempered(data.excess))
    total = 0.0
    for left in parts:
        others = [part for part in parts if part is not left]
        total += left.missed(weigh(sum(others[1:], others[0]), scored.deviations).coefficients)
    return total


def _kept_apart(data: Data) -> list[list[int]]:
    """What is left out at once: the runs of each motion; each run, where there is one motion only."""
    groups = motions_of_fitted(data)
    return groups if len(groups) > 1 else [[place] for place in range(len(data.train))]


def motions_of_fitted(data: Data) -> list[list[int]]:
    """Fitted runs of each motion, as places among all that are fitted."""
    return motions_of([data.about.view.recorded[number] for number in data.train])
