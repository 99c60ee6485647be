"""What a coupling with play damps: it does so only where it touches, so that a coupling that damps otherwise and
contacts that do are the same to every recording.

What is no more than contacts differ by is theirs, and has no name; what is more is another damping of the coupling. A
file has one damping, and says all of it as the coupling's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, ndtr

from schwung.explain.causes.candidate import Candidate
from schwung.explain.weighing.search import Pick, Scored, Search, Set, slices

#: Of what opens a gap, which coefficient is what its contacts damp more.
CONTACTS = 1


@dataclass(frozen=True)
class Damped:
    """How probable it is that a set's contacts damp otherwise than is believed, and by more than the belief is usually
    off by; that they do so by more than contacts differ by, if they do; and the evidence (log) that goes with it."""

    off: float = 0.0
    named: float = 0.0
    worth: float = 0.0


def opening_of(search: Search, picks: Set) -> Pick | None:
    """The cause of a set that opens a gap; None: none does."""
    return next((pick for pick in picks if search.candidate(pick).opens), None)


def damping_of(search: Search, picks: Set) -> Pick | None:
    """The cause of a set that is another damping of the coupling; None: none is."""
    return next((pick for pick in picks if _damps(search.candidate(pick))), None)


def damping_name(search: Search) -> str:
    """Of another damping; empty: there is none."""
    return next((one.name for one in search.data.candidates if _damps(one)), "")


def with_damping(search: Search, scored: Scored) -> Scored:
    """A set with a damping of the coupling beside its gap, where it has one; no search is any the wiser."""
    index = next((i for i, one in enumerate(search.data.candidates) if _damps(one)), None)
    if index is None or opening_of(search, scored.picks) is None or damping_of(search, scored.picks):
        return scored
    aside = Search(search.data, search.always, inexact=search.inexact)
    return aside.score((*scored.picks, Pick(search.first_atom(index), 1.0)))


def damped(search: Search, scored: Scored) -> Damped:
    """Of a set with a gap; of another nothing."""
    whole = with_damping(search, scored)
    gap, damping = opening_of(search, whole.picks), damping_of(search, whole.picks)
    if gap is None or damping is None:
        return Damped()
    starts = {pick: where.start for pick, where in zip(whole.picks, slices(search, whole), strict=True)}
    both, found = [starts[gap] + CONTACTS, starts[damping]], whole.found
    more, spread = (
        float(found.coefficients[both].sum()),
        float(np.sqrt(found.covariance[np.ix_(both, both)].sum())),
    )
    usual = search.candidate(gap).deviations[CONTACTS], search.candidate(damping).known_to
    named, off = (float(ndtr((abs(more) - one) / spread)) for one in usual)
    deviation = float(np.hypot(*whole.deviations[both]))
    # of a number that is known so well beside all else, by how much it is likelier than nothing
    worth = 0.5 * (more / spread) ** 2 - float(np.log(deviation / spread))
    return Damped(off * float(expit(worth + search.odds)), named, worth)


def _damps(candidate: Candidate) -> bool:
    return candidate.named and candidate.coupling[1] != 0
