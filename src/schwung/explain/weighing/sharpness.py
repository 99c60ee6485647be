"""How sharply shapes are known: what a little of each of their numbers adds, and their deviations beside all else that
a set leaves open.
"""

from __future__ import annotations

import numpy as np

from schwung.explain.causes.along import Along
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.present import Member
from schwung.explain.weighing.round import Cause
from schwung.explain.weighing.search import Pick, Scored, Search, slices
from schwung.explain.weighing.told import told_by
from schwung.innovations.effect import Effect
from schwung.innovations.evidence import weigh
from schwung.innovations.statistics import Statistics
from schwung.motion import Array

#: Of a spacing of the grid, over which the slope by a shape is taken.
_DIFFERENCE = 0.02


def shape_slopes(member: Member) -> list[Cause]:
    """What a spacing more of each number of a member's shape adds, with its coefficients."""
    candidate, found = member.candidate, []
    for step in _DIFFERENCE * np.eye(len(candidate.spacing)):
        ends = (candidate.moved(member.shape, step), candidate.moved(member.shape, -step))

        def slope(along: Along, _shape: Shape, ends: tuple[Shape, Shape] = ends) -> Effect:
            ahead, behind = (candidate.done(along, end, member.coefficients).parts for end in ends)
            each = zip(ahead, behind, strict=True)
            return Effect(*(None if a is None or b is None else (a - b) / (2 * _DIFFERENCE) for a, b in each))

        found.append((Candidate(f"{candidate.name}, shape", slope, (1.0,), named=False), member.shape))
    return found


def covariance_of(search: Search, scored: Scored, pick: Pick) -> Array:
    """Of a cause's coefficients, as they are told, and the numbers of its shape, in the shape's unit (p + d, p + d).

    By the columns of the whole set and the slopes of all its shapes: what is not known of one leaves the others open. A
    shape is at first anywhere within its bounds.
    """
    data, picks = search.data, scored.picks
    members = [
        Member(
            search.candidate(one), data.atoms[one.atom].shape, scored.found.coefficients[where], np.zeros(0)
        )
        for one, where in zip(picks, slices(search, scored), strict=True)
    ]
    size, each = scored.which.size, [shape_slopes(member) for member in members]
    place = picks.index(pick)
    own = slices(search, scored)[place]
    causes = [slope for slopes in each for slope in slopes]
    statistics, deviations = data.at(scored.which), scored.deviations
    if causes:
        cross, gram, slope = data.beside(scored.which, causes)
        statistics = Statistics(
            np.block([[statistics.gram, cross.T], [cross, gram]]),
            np.append(statistics.slope, slope), statistics.square, statistics.count,
        )  # fmt: skip
        open_to = [reach for member in members for reach in _reach(member.candidate)]
        deviations = np.append(deviations, open_to)
    first = size + sum(len(slopes) for slopes in each[:place])
    told, count = told_by(search, scored)[own], own.stop - own.start
    numbers = np.zeros((count + len(each[place]), deviations.size))
    numbers[:count, : told.shape[1]] = told
    numbers[count:, first : first + len(each[place])] = np.diag(_units(members[place]))
    return np.asarray(numbers @ weigh(statistics, deviations).covariance @ numbers.T)


def _reach(candidate: Candidate) -> list[float]:
    """Deviations of shapes that may be anywhere within their bounds (spacings)."""
    every = (
        zip(candidate.spacing, candidate.logarithmic, candidate.bounds, strict=True)
        if candidate.spacing
        else ()
    )
    return [
        (np.log(high / low) if factor else high - low) / spacing / np.sqrt(12)
        for spacing, factor, (low, high) in every
    ]


def _units(member: Member) -> list[float]:
    """One spacing of each number, in its unit."""
    candidate = member.candidate
    every = (
        zip(candidate.spacing, candidate.logarithmic, member.shape, strict=True) if candidate.spacing else ()
    )
    return [spacing * (value if factor else 1.0) for spacing, factor, value in every]
