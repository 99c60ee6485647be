"""The whitened dictionary: every shape of every candidate as columns, with what sets of them are compared by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from schwung.explain.weighing.candidate import Candidate, Shape
from schwung.explain.weighing.inexact import error_of
from schwung.explain.weighing.round import Linearised
from schwung.innovations.effect import joined
from schwung.innovations.statistics import Statistics
from schwung.motion import Array

#: Columns that are made room for whenever there is none.
_ROOM = 64


@dataclass(frozen=True, eq=False)
class Atom:
    """A candidate in one shape, and where its columns are."""

    candidate: int
    shape: Shape
    where: slice
    refined: float | None = None  # log of the share of the shapes that are as good as this one
    spread: Shape = ()  # standard deviations of the shape's numbers


@dataclass(eq=False)
class Data:
    """Columns of all runs, and their statistics over those that are fitted."""

    about: Linearised
    candidates: Sequence[Candidate]
    target: list[Array]
    train: Sequence[int]
    excess: float
    atoms: list[Atom] = field(default_factory=list)
    store: list[Array] = field(default_factory=list)  # with room for columns to come
    width: int = 0
    errors: dict[tuple[int, Shape], slice | None] = field(default_factory=dict)
    statistics: Statistics = field(init=False)

    @classmethod
    def of(
        cls,
        about: Linearised,
        candidates: Sequence[Candidate],
        target: list[Array],
        train: Sequence[int],
        excess: float,
    ) -> Data:
        """Whiten every shape of every candidate."""
        data = cls(about, candidates, target, train, excess)
        at = 0
        for index, candidate in enumerate(candidates):
            for shape in candidate.shapes:
                data.atoms.append(Atom(index, shape, slice(at, at + candidate.size)))
                at += candidate.size
        for passed, where in zip(about.passed, about.alongs, strict=True):
            effects = [candidates[atom.candidate].effect(where, atom.shape) for atom in data.atoms]
            data.store.append(passed.whitened(joined(effects, where.speed.size)))
        data.width = at
        data.statistics = data.over(train)
        return data

    @property
    def rows(self) -> list[Array]:
        """All columns of each run, (2n, P)."""
        return [stored[:, : self.width] for stored in self.store]

    def over(self, runs: Sequence[int]) -> Statistics:
        """Statistics of some runs, tempered."""
        rows = self.rows
        total = Statistics.of(rows[runs[0]], self.target[runs[0]])
        for run in runs[1:]:
            total = total + Statistics.of(rows[run], self.target[run])
        return total.tempered(self.excess)

    def part(self, members: Array) -> list[Array]:
        """These columns of every run that is fitted."""
        return [self.store[run][:, members] for run in self.train]

    def beside(
        self, part: list[Array], both: Statistics, candidate: Candidate, shape: Shape
    ) -> tuple[Statistics, list[Array]]:
        """Statistics of columns (`part` and `both`) and, behind them, a candidate in a shape that is no atom yet."""
        added = self.about.rows(candidate, shape)
        cross, gram, slope = np.zeros(()), np.zeros(()), np.zeros(())
        for mine, run in zip(part, self.train, strict=True):
            cross = cross + mine.T @ added[run]
            gram = gram + added[run].T @ added[run]
            slope = slope + added[run].T @ self.target[run]
        whole = np.block([[both.gram, cross / self.excess], [cross.T / self.excess, gram / self.excess]])
        stacked = np.concatenate([both.slope, slope / self.excess])
        return Statistics(whole, stacked, both.square, both.count), added

    def append(self, index: int, shape: Shape, refined: float, spread: Shape = ()) -> Atom:
        """Make a shape an atom."""
        atom = Atom(index, shape, self._appended(self.candidates[index], shape), refined, spread)
        self.atoms = [*self.atoms, atom]
        return atom

    def error(self, atom: Atom) -> slice | None:
        """Where the columns of the error of an atom's law are; None: it has none."""
        key = (atom.candidate, atom.shape)
        if key not in self.errors:
            error = error_of(self.candidates[atom.candidate])
            self.errors[key] = None if error is None else self._appended(error, atom.shape)
        return self.errors[key]

    def _appended(self, candidate: Candidate, shape: Shape) -> slice:
        """Columns behind all others."""
        every = [self.store[run][:, : self.width] for run in self.train]
        self.statistics, added = self.beside(every, self.statistics, candidate, shape)
        size, first = added[0].shape[1], self.width
        if self.store[0].shape[1] < first + size:
            self.store = [np.pad(old, ((0, 0), (0, _ROOM))) for old in self.store]
        for stored, new in zip(self.store, added, strict=True):
            stored[:, first : first + size] = new
        self.width = first + size
        return slice(first, self.width)
