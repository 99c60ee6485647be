"""The whitened dictionary: every shape of every candidate as columns, with what sets of them are compared by.

A column is a row of one large array, all runs that are fitted one behind another; the array is handed on from round to
round, for fresh memory is dear. What two columns have in common is worked out when a set first holds both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.inexact import error_of
from schwung.explain.causes.present import Member
from schwung.explain.weighing.round import Cause, Linearised, target_of
from schwung.explain.weighing.work import CUBED, PRODUCT, SCORED, Work
from schwung.innovations.evidence import Beyond
from schwung.innovations.statistics import Columns, Numbers, Statistics, products, products_with
from schwung.motion import Array

#: Room for so many times the columns of the vocabulary, for refined shapes and the errors of laws: in the statistics,
#: and in the rows, of which those that nothing is written to take no memory.
_ROOM, _ROWS = 1.25, 2.0


@dataclass(frozen=True, eq=False)
class Atom:
    """A candidate in one shape, and where its columns are."""

    candidate: int
    shape: Shape
    where: slice
    refined: float | None = None  # log of the share of the shapes that are as good as this one
    spread: Shape = ()  # standard deviations of the shape's numbers

    def tempered(self, ratio: float) -> Atom:
        """As so many times fewer samples would tell its shape."""
        if self.refined is None:
            return self
        wider = len(self.shape) / 2 * float(np.log(ratio))
        deviations = tuple(float(np.sqrt(ratio)) * deviation for deviation in self.spread)
        return replace(self, refined=min(0.0, self.refined + wider), spread=deviations)


@dataclass(eq=False)
class Data:
    """Columns of the runs that are fitted, and their statistics, tempered."""

    about: Linearised
    members: Sequence[Member]  # what is linearised about; the target is as if they were not there
    candidates: Sequence[Candidate]
    train: Sequence[int]
    excess: float
    rows: Columns  # (room, Σ2n)
    target: Array  # (Σ2n,)
    statistics: Statistics  # all columns; of two of different causes only where they have `met`
    met: NDArray[np.bool_]
    atoms: list[Atom] = field(default_factory=list)
    causes: list[tuple[slice, Cause]] = field(default_factory=list)  # behind all columns, in their order
    errors: dict[tuple[int, Shape], slice | None] = field(default_factory=dict)
    #: How many rows are taken, those of what was tempered among them: it has these as well, and later ones of its own.
    taken: list[int] = field(default_factory=lambda: [0])

    @classmethod
    def of(
        cls,
        about: Linearised,
        members: Sequence[Member],
        candidates: Sequence[Candidate],
        train: Sequence[int],
        excess: float,
        memory: Columns | None = None,
        among: frozenset[int] | None = None,
    ) -> Data:
        """Whiten every shape of every candidate, or of those `among` them; into the `memory` of a former round, which
        is lost."""
        missed = [about.missed(run) for run in train]
        every = [
            (index, shape)
            for index, c in enumerate(candidates)
            if among is None or index in among
            for shape in (c.shapes if c.sought is None else c.sought(missed))
        ]
        width = sum(candidates[index].size for index, _ in every)
        rows = about.view.work.columns(int(_ROWS * width), about.samples(train)) if memory is None else memory
        room = int(_ROOM * width)
        target = target_of(about, members, train)
        empty = Statistics(
            np.zeros((room, room)), np.zeros(room), float(target @ target) / excess, target.size / excess
        )
        data = cls(
            about, members, candidates, train, excess, rows, target, empty, np.zeros((room, room), dtype=bool)
        )
        wheres = data._stored([(candidates[index], shape) for index, shape in every])
        data.atoms = [Atom(index, shape, where) for (index, shape), where in zip(every, wheres, strict=True)]
        return data

    def tempered(self, ratio: float) -> Data:
        """As so many times fewer samples would tell."""
        return replace(
            self,
            excess=self.excess * ratio,
            statistics=self.statistics.tempered(ratio),
            met=self.met.copy(),
            atoms=[atom.tempered(ratio) for atom in self.atoms],
            causes=list(self.causes),
            errors=dict(self.errors),
        )

    @property
    def work(self) -> Work:
        """That was done for the session."""
        return self.about.view.work

    @property
    def width(self) -> int:
        """Number of columns."""
        return self.causes[-1][0].stop if self.causes else 0

    def at(self, which: Numbers) -> Statistics:
        """Of a set's columns."""
        self._meet(which)
        return self.statistics.at(which)

    def beyond(self, which: Numbers, deviations: Array) -> Beyond:
        """What all columns hold beyond a set's with these prior deviations."""
        width = self.width
        missing = ~self.met[which, :width]
        if missing.any():
            lone = which[missing.any(axis=1)]
            columns = np.flatnonzero(missing.any(axis=0))
            span = slice(int(columns[0]), int(columns[-1]) + 1)
            self._note(lone, span, self._products(self.rows[lone], span))
        known = self.statistics
        everything = Statistics(known.gram[:width, :width], known.slope[:width], known.square, known.count)
        self.work.add(SCORED + CUBED * which.size**2 * (which.size + width))
        return Beyond.of(everything, which, deviations)

    def gain(
        self, which: Numbers, deviations: Array, where: slice, own: Array, scales: Sequence[float]
    ) -> Array:
        """Log evidence that columns add to a set's, with their `own` prior deviations times each of the scales."""
        both = self.at(np.concatenate([which, np.arange(where.start, where.stop)]))
        beyond = Beyond.of(both, np.arange(which.size), deviations)
        self.work.add(SCORED + CUBED * which.size**2 * (which.size + own.size))
        return np.asarray(beyond.gains([slice(which.size, both.slope.size)], own, scales)[0])

    def beside(
        self, which: Numbers, causes: Sequence[Cause], runs: Sequence[int] | None = None
    ) -> tuple[Array, Array, Array]:
        """Of causes that are no atoms yet: their cross products with a set's columns, their own, and their slope;
        `runs`: in which of the fitted ones alone they act, None: in all."""
        added, target = self.about.whitened(causes, self.train if runs is None else runs), self.target
        if runs is None:
            cross = np.concatenate([self._products(added, segment) for segment in _segments(which)], axis=1)
        else:
            stretches = dict(zip(self.train, self.about.stretches(self.train), strict=True))
            own = np.concatenate([self.rows[which, stretches[run]] for run in runs], axis=1)
            target = np.concatenate([self.target[stretches[run]] for run in runs])
            cross = products(added, own)
            self.work.add(PRODUCT * own.size * added.shape[0])
        self.work.add(PRODUCT * added.size * added.shape[0])
        return cross / self.excess, added @ added.T / self.excess, added @ target / self.excess

    def within(self, which: Numbers, where: slice, places: Sequence[int]) -> tuple[Array, Array, Array]:
        """Of a cause's columns on some of the fitted runs alone: their cross products with a set's columns, their own,
        and their slope; `places`: of the runs among all that are fitted.
        """
        size = where.stop - where.start
        cross, gram, slope = np.zeros((which.size, size)), np.zeros((size, size)), np.zeros(size)
        stretches = self.about.stretches(self.train)
        for place in places:
            stretch = stretches[place]
            mine, others = self.rows[where, stretch], self.rows[which, stretch]
            own, pulled = products_with(self.target[stretch], mine)
            cross, gram, slope = cross + products(others, mine), gram + own, slope + pulled
            self.work.add(PRODUCT * mine.size * (which.size + size))
        return cross / self.excess, gram / self.excess, slope / self.excess

    def append(self, index: int, shape: Shape, refined: float, spread: Shape = ()) -> Atom:
        """Make a shape an atom."""
        (where,) = self._stored([(self.candidates[index], shape)])
        atom = Atom(index, shape, where, refined, spread)
        self.atoms = [*self.atoms, atom]
        return atom

    def error(self, atom: Atom) -> slice | None:
        """Where the columns of the error of an atom's law are; None: it has none."""
        key = (atom.candidate, atom.shape)
        if key not in self.errors:
            error = error_of(self.candidates[atom.candidate])
            self.errors[key] = None if error is None else self._stored([(error, atom.shape)])[0]
        return self.errors[key]

    def _stored(self, causes: Sequence[Cause]) -> list[slice]:
        """Causes as columns behind all others."""
        wheres: list[slice] = []
        first = self.taken[0]
        for candidate, _ in causes:
            begin = wheres[-1].stop if wheres else first
            wheres.append(slice(begin, begin + candidate.size))
        self._make_room(wheres[-1].stop)
        self.taken[0] = wheres[-1].stop
        self.about.whiten(causes, self.train, self.rows[first:])
        self.causes += zip(wheres, causes, strict=True)
        for where in wheres:
            gram, slope = products_with(self.target, self.rows[where])
            self.statistics.slope[where] = slope / self.excess
            self._note(where, where, gram)
        return wheres

    def _make_room(self, width: int) -> None:
        have, known = self.rows.shape[0], self.statistics
        if width > have:
            self.taken = list(self.taken)
            more = int(_ROWS * width) - have
            self.rows = np.concatenate([self.rows, np.empty((more, self.rows.shape[1]), dtype=np.float32)])
        if width <= known.slope.size:
            return
        more = int(_ROOM * width) - known.slope.size
        self.met = np.pad(self.met, (0, more))
        self.statistics = Statistics(
            np.pad(known.gram, (0, more)), np.pad(known.slope, (0, more)), known.square, known.count
        )

    def _meet(self, which: Numbers) -> None:
        """Work out what these columns have in common, where it is not known yet; the newest first."""
        if self.met[np.ix_(which, which)].all():
            return
        for mine in reversed(_segments(np.sort(which))):
            numbers = np.arange(mine.start, mine.stop)
            lone = which[~self.met[np.ix_(numbers, which)].all(axis=0)]
            for other in _segments(np.sort(lone)) if lone.size else ():
                self._note(mine, other, self._products(self.rows[mine], other))

    def _products(self, rows: Columns | Array, where: slice) -> Array:
        """Of some rows with those of columns."""
        self.work.add(PRODUCT * rows.size * (where.stop - where.start))
        return products(rows, self.rows[where])

    def _note(self, one: Numbers | slice, other: slice, found: Array) -> None:
        """Keep products of columns (one, other)."""
        gram, met, tempered = self.statistics.gram, self.met, found / self.excess
        gram[one, other], gram[other, one] = tempered, tempered.T
        met[one, other] = met[other, one] = True


def _segments(which: Numbers) -> list[slice]:
    """Numbers as stretches of successive ones, in their order."""
    ends = np.flatnonzero(np.diff(which) != 1)
    starts = np.concatenate([which[:1], which[ends + 1]])
    stops = np.concatenate([which[ends], which[-1:]]) + 1
    return [slice(int(start), int(stop)) for start, stop in zip(starts, stops, strict=True)]
