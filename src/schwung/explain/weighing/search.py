"""Sets of causes by their evidence: how probable each is, and the table of those that were visited.

A set's log probability is its evidence, shapes and sizes integrated over their grids, plus the prior of so many causes.
All sets that were visited are kept, and share the probability.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.inexact import SHARES, deviations_of
from schwung.explain.weighing.data import Atom, Data
from schwung.explain.weighing.refine import refined
from schwung.explain.weighing.work import CUBED, SCORED
from schwung.innovations.evidence import Weighed, weigh
from schwung.innovations.statistics import Numbers
from schwung.motion import Array

#: So many causes are expected among all that there are.
EXPECTED = 1.0
#: No set holds more causes: what needs more is not understood, and each costs a search of its own.
MOST = 6
#: What is so much less probable (log) is not looked at closely.
HOPELESS = 50.0
#: Probabilities below this are not told.
TOLD = 0.01
#: The error of a law whose largest share is not worth so much (log) is not looked at.
_SEEN = 1.0


@dataclass(frozen=True)
class Pick:
    """An atom of a set, and which of its sizes."""

    atom: int
    scale: float


Set = tuple[Pick, ...]


def logsumexp(logs: Array) -> float:
    """log Σ exp."""
    top = float(np.max(logs))
    return top + float(np.log(np.sum(np.exp(logs - top))))


@dataclass(frozen=True, eq=False)
class Scored:
    """A set with its log probability (but for a constant) and coefficients."""

    picks: Set
    log: float
    found: Weighed
    which: Numbers  # its columns: what is always there, the picks', the errors of their laws
    deviations: Array
    exact: Array  # coefficients if its laws had no errors: those of what is always there, and of the picks


@dataclass(eq=False)
class Search:
    """The table of visited sets."""

    data: Data
    always: tuple[int, ...]  # candidates that are in every set
    table: dict[frozenset[int], Scored] = field(default_factory=dict)
    known: dict[Set, Scored] = field(default_factory=dict)
    closely: dict[tuple[Set, Pick], Scored] = field(default_factory=dict)  # what `with_pick` found
    kept: dict[frozenset[int], float] = field(default_factory=dict)  # at rest, less what was promised (log)
    doubts: dict[frozenset[int], float] = field(
        default_factory=dict
    )  # not asked there, less what was promised
    asked: dict[frozenset[Pick], float] = field(default_factory=dict)  # at rest, less the set at hand (log)
    resting: frozenset[int] = frozenset()  # the kind of set that all is linearised about
    hidden: frozenset[int] = frozenset()  # candidates that are no further cause unless they are asked for
    inexact: float = 0.0  # what all that is missed may be worth to laws that are a little off (log)

    def __post_init__(self) -> None:
        free = len({c.name for i, c in enumerate(self.data.candidates) if i not in self.always})
        share = EXPECTED / free
        #: Of a cause before anything was seen (log), and what each cause of a set has to make up for.
        self.odds = float(np.log(share / (1 - share)))
        self.handicap = self.odds - self.inexact

    def candidate(self, pick: Pick) -> Candidate:
        """Whose atom it is."""
        return self.data.candidates[self.data.atoms[pick.atom].candidate]

    def name(self, pick: Pick) -> str:
        """The candidate's."""
        return self.candidate(pick).name

    def index(self, pick: Pick) -> int:
        """Its candidate's number."""
        return self.data.atoms[pick.atom].candidate

    def kind(self, picks: Set) -> frozenset[int]:
        """Which candidates a set holds, whatever their shapes and sizes."""
        return frozenset(self.index(pick) for pick in picks)

    def columns(self, picks: Set) -> tuple[Numbers, Array]:
        """Numbers and prior deviations of a set's columns, the errors of its laws among them."""
        scored = self.score(picks)
        return scored.which, scored.deviations

    def _exact(self, picks: Iterable[Pick]) -> tuple[Numbers, Array]:
        """Those without the errors, what is always there first."""
        which, deviations = [], []
        for index in self.always:
            atom = self.data.atoms[self.first_atom(index)]
            which.append(np.arange(atom.where.start, atom.where.stop))
            deviations.append(np.array(self.data.candidates[index].deviations))
        for pick in picks:
            where = self.data.atoms[pick.atom].where
            which.append(np.arange(where.start, where.stop))
            deviations.append(pick.scale * np.array(self.candidate(pick).deviations))
        return np.concatenate(which), np.concatenate(deviations)

    def first_atom(self, index: int) -> int:
        """The number of a candidate's first atom."""
        return next(i for i, atom in enumerate(self.data.atoms) if atom.candidate == index)

    def score(self, picks: Set) -> Scored:
        """The set's log probability; the best one of each kind is kept in the table."""
        if picks in self.known:
            return self.known[picks]
        which, deviations = self._exact(picks)
        first = len(which) - sum(self.candidate(p).size for p in picks)
        found = weigh(self.data.at(which), deviations)
        evidence, exact = found.log_evidence, found.coefficients
        errors = self._errors(picks, exact[first:])
        if errors is not None:
            where, sizes = errors
            which = np.concatenate([which, where])
            each = [np.concatenate([deviations, share * sizes]) for share in SHARES]
            statistics = self.data.at(which)
            weighed = [weigh(statistics, one) for one in each]
            logs = np.array([one.log_evidence for one in weighed])
            top = int(np.argmax(logs))
            found, deviations = weighed[top], each[top]
            evidence = logsumexp(logs) - float(np.log(len(SHARES)))
        each_own = self._of_each(picks, exact[first:])
        if any(
            self.candidate(one).is_another(mine, self.data.atoms[one.atom].shape) for one, mine in each_own
        ):
            evidence = -np.inf
        times = 1 if errors is None else 1 + len(SHARES)
        self.data.work.add(SCORED + times * CUBED * which.size**3)
        scored = Scored(picks, evidence + self._log(picks, found), found, which, deviations, exact)
        self.known[picks] = scored
        kind = self.kind(picks)
        if kind not in self.table or self.table[kind].log < scored.log:
            self.table[kind] = scored
        return scored

    def _of_each(self, picks: Set, coefficients: Array) -> Iterator[tuple[Pick, Array]]:
        """Every cause of a set with its own."""
        at = 0
        for pick in picks:
            size = self.candidate(pick).size
            yield pick, coefficients[at : at + size]
            at += size

    def _errors(self, picks: Set, coefficients: Array) -> tuple[Numbers, Array] | None:
        """Columns of the errors of a set's laws, and their deviations if they were as large as the laws."""
        which, sizes = [], []
        for pick, mine in self._of_each(picks, coefficients):
            atom = self.data.atoms[pick.atom]
            gram = self.data.statistics.gram[atom.where, atom.where]
            seen = float(mine @ gram @ mine)
            where = self.data.error(atom) if SHARES[-1] ** 2 * seen > _SEEN else None
            if where is not None:
                which.append(np.arange(where.start, where.stop))
                sizes.append(deviations_of(mine, gram, where.stop - where.start))
        return (np.concatenate(which), np.concatenate(sizes)) if which else None

    def _log(self, picks: Set, found: Weighed) -> float:
        """Of the prior alone, and of what signs are forbidden."""
        log, spread, at = self.prior(picks), found.spread, 0
        every = [(self.data.candidates[i], 1.0) for i in self.always]
        for candidate, scale in (*every, *((self.candidate(pick), pick.scale) for pick in picks)):
            own = slice(at, at + candidate.size)
            log += candidate.allowed(
                found.coefficients[own], spread[own], scale * np.array(candidate.deviations)
            )
            at += candidate.size
        return log

    @staticmethod
    def _shape_log(atom: Atom, candidate: Candidate) -> float:
        return candidate.shape_log if atom.refined is None else atom.refined

    def additions(self, picks: Set, among: Container[int] | None = None) -> list[tuple[float, Pick]]:
        """The best atom of every candidate that is not in the set, by what it would add, the best first; `among`: of
        these alone."""
        which, deviations = self.columns(picks)
        taken = [self.candidate(pick) for pick in picks]
        inside = {*self.always, *(self.hidden if among is None else ())}
        inside |= {i for i, c in enumerate(self.data.candidates) if any(c.excludes(t) for t in taken)}
        grouped = groupby(enumerate(self.data.atoms), lambda pair: pair[1].candidate)
        asked = [
            (index, list(group))
            for index, group in grouped
            if index not in inside and (among is None or index in among)
        ]
        if not asked:
            return []
        # of one block that is asked for, nothing has to be worked out of all others
        lone = asked[0][1][0][1].where if len(asked) == 1 and len(asked[0][1]) == 1 else None
        beyond = None if lone else self.data.beyond(which, deviations)
        found = []
        for index, numbered in asked:
            candidate = self.data.candidates[index]
            scales, own = candidate.scales, np.array(candidate.deviations)
            if beyond is None:
                gains = self.data.gain(which, deviations, numbered[0][1].where, own, scales)[None]
            else:
                gains = beyond.gains([atom.where for _, atom in numbered], own, scales)
            shares = np.array([self._shape_log(atom, candidate) for _, atom in numbered])
            gains = gains + candidate.causes * self.handicap + shares[:, None] - np.log(len(scales))
            row, size = np.unravel_index(int(np.argmax(gains)), gains.shape)
            found.append((logsumexp(gains), Pick(numbered[row][0], scales[size])))
        merged: dict[int, tuple[float, Pick]] = {}
        for log, pick in found:
            index = self.index(pick)
            if index not in merged or merged[index][0] < log:
                merged[index] = (log, pick)
        return sorted(merged.values(), key=lambda pair: -pair[0])

    def prior(self, picks: Set) -> float:
        """Log prior of so many causes, in these shapes and sizes."""
        return sum(
            self.candidate(pick).causes * self.handicap
            + self._shape_log(self.data.atoms[pick.atom], self.candidate(pick))
            - float(np.log(len(self.candidate(pick).scales)))
            for pick in picks
        )

    def opening(self) -> Pick | None:
        """The first of what opens a gap; None: nothing does."""
        each = enumerate(self.data.atoms)
        return next((Pick(i, 1.0) for i, one in each if self.data.candidates[one.candidate].opens), None)

    def nearest(self, index: int, shape: Shape) -> Pick:
        """A candidate in a shape of its grid that is near one."""
        own = [i for i, atom in enumerate(self.data.atoms) if atom.candidate == index]
        off = [abs(self.data.atoms[i].shape[0] - shape[0]) for i in own]
        return Pick(own[int(np.argmin(off))], 1.0)

    def with_pick(self, picks: Set, pick: Pick) -> Scored:
        """One more, in its best shape and sizes all about."""
        if (picks, pick) not in self.closely:
            scored = self.score((*picks, pick))
            if self.candidate(pick).spacing:
                scored = self.shaped(scored, len(picks))
            self.closely[picks, pick] = self.sized(scored)
        return self.closely[picks, pick]

    def shaped(self, scored: Scored, place: int) -> Scored:
        """With the shape of one of its picks refined, where that is better."""
        pick = scored.picks[place]
        others = (*scored.picks[:place], *scored.picks[place + 1 :])
        which, deviations = self.columns(others)
        atom = refined(self.data, self.data.atoms[pick.atom], which, deviations, pick.scale)
        if atom is None:
            return scored
        number = self.data.atoms.index(atom)
        moved = (*scored.picks[:place], Pick(number, pick.scale), *scored.picks[place + 1 :])
        return max(scored, self.score(moved), key=lambda one: one.log)

    def sized(self, scored: Scored) -> Scored:
        """With the size of every curve that is best beside the others'."""
        for place, pick in enumerate(scored.picks):
            scales = self.candidate(pick).scales
            if len(scales) == 1:
                continue
            others = (*scored.picks[:place], *scored.picks[place + 1 :])
            which, deviations = self.columns(others)
            own = np.array(self.candidate(pick).deviations)
            gains = self.data.gain(which, deviations, self.data.atoms[pick.atom].where, own, scales)
            new = Pick(pick.atom, scales[int(np.argmax(gains))])
            if new != pick:
                moved = self.score((*scored.picks[:place], new, *scored.picks[place + 1 :]))
                scored = max(scored, moved, key=lambda one: one.log)
        return scored

    def tempered(self, ratio: float) -> Search:
        """The same sets as so many times fewer samples would tell them apart, but for those that are together no more
        than a hundredth of what is told then.

        ∫ p^(1/r) π ≤ (∫ p π)^(1/r), for the root is concave: so a set's log evidence, over r, is the most that it has
        then, whatever size of its curves is best there. How large a law is, is known by then: what is more than natural
        would be less unlikely as two names' in parts.
        """
        other = Search(self.data.tempered(ratio), self.always, inexact=self.inexact / ratio)
        other.kept = {kind: log / ratio for kind, log in self.kept.items()}
        other.doubts = {kind: log / ratio for kind, log in self.doubts.items()}
        other.resting = self.resting
        upper = []
        for kind, one in self.table.items():
            unlikely, large = self._as_large(one)
            most = (one.log + unlikely - self.prior(one.picks)) / ratio + other.prior(one.picks)
            upper.append((most + other.unkept(kind), large))
        best = -np.inf
        for most, large in sorted(upper, key=lambda pair: -pair[0]):
            if most + np.log(len(upper)) < best + np.log(TOLD / 100):
                break
            found = other.score(large)
            log = (found if self.data.work.late else other.sized(found)).log
            best = max(best, log + other.unkept(self.kind(large)))
        # to size a curve its set is scored without it, which may have been forgotten
        other.table = {kind: one for kind, one in other.table.items() if kind in self.table}
        for picks in other._said_alike():
            other.score(self._as_large(self.score(picks))[1])
        return other

    def _said_alike(self) -> set[Set]:
        """Sets that say a name by fewer or more numbers, as the likeliest set does, in place of those that say it
        otherwise, laws in their natural size: of fewer samples less can be told, and who compares one with the other
        compares that."""
        if not self.table:
            return set()
        _, likeliest = self.shares()[0]
        as_there = {
            self.name(pick): Pick(pick.atom, 1.0) if self.candidate(pick).is_law else pick
            for pick in likeliest.picks
        }
        found = {tuple(as_there.get(self.name(p), p) for p in one.picks) for one in self.table.values()}
        return {picks for picks in found if self.kind(picks) not in self.table}

    def _as_large(self, one: Scored) -> tuple[float, Set]:
        """How unlikely (log) more than natural sizes of a set's laws are, and its picks with laws as large as found."""
        unlikely, large = 0.0, []
        for pick, where in zip(one.picks, slices(self, one), strict=True):
            candidate = self.candidate(pick)
            over = float(np.max(np.abs(one.exact[where]) / (pick.scale * np.array(candidate.deviations))))
            if len(candidate.scales) > 1 or over < 1:
                large.append(pick)
                continue
            unlikely += 0.5 * over**2
            large.append(Pick(pick.atom, pick.scale * over))
        return unlikely, tuple(large)

    def note(self, kind: frozenset[int], at_rest: float, promised: float) -> None:
        """How probable a set is at rest (log), and how probable it was by the linear model: of what is worth nothing
        there, rest says no more."""
        self.kept[kind] = at_rest - promised if np.isfinite(promised) else 0.0

    def unkept(self, kind: frozenset[int]) -> float:
        """By how much a set's log probability differs at rest; of one that was not brought there, what was promised but
        not kept of the same causes with fewer beside them, or else by whichever set with other causes kept the most.
        A cause that comes to nothing at rest says nothing of others.
        """
        known = self.kept.get(kind, self.doubts.get(kind))
        if known is not None:
            return known
        beyond = {other - self.resting: log for other, log in self.kept.items()}
        fewer = [log for other, log in beyond.items() if frozenset() < other <= kind]
        most = max((log for other, log in beyond.items() if other and np.isfinite(log)), default=0.0)
        return min(0.0, min(fewer, default=most if kind - self.resting else 0.0))

    def doubt(self, start: Scored) -> None:
        """Of sets that promise more than one at rest, and that there was no work left to bring there, it is not known
        which of them keep it: together they are as probable as that one, and each as any other of them.

        The work being over says nothing for what was found: what might stand in its place is not asked.
        """
        promised = {kind: one.log + self.unkept(kind) for kind, one in self.table.items()}
        beyond = [kind for kind, log in promised.items() if log > start.log and kind != self.resting]
        each = start.log - float(np.log(max(len(beyond), 1)))
        self.doubts = {kind: each - self.table[kind].log for kind in beyond}

    def shares(self) -> list[tuple[float, Scored]]:
        """Every visited kind of set with its probability, the most probable first."""
        told = [(one.log + self.unkept(kind), one) for kind, one in self.table.items()]
        told.sort(key=lambda pair: -pair[0])
        logs, sets = np.array([log for log, _ in told]), [one for _, one in told]
        return list(zip(np.exp(logs - logsumexp(logs)).tolist(), sets, strict=True))


def slices(search: Search, best: Scored) -> list[slice]:
    """Where each pick's coefficients are among a set's."""
    at = sum(search.data.candidates[i].size for i in search.always)
    result = []
    for pick in best.picks:
        size = search.candidate(pick).size
        result.append(slice(at, at + size))
        at += size
    return result
