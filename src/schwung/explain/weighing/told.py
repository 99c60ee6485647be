"""A set as it is told: of what torque and speed are late by, what is usual and what has a name are one; so are what the
coupling and what its contacts damp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schwung.explain.weighing.contact import CONTACTS, damping_of, opening_of
from schwung.explain.weighing.search import Pick, Scored, Search, slices
from schwung.explain.weighing.values import Parameter, Timing
from schwung.motion import Array


@dataclass(frozen=True, eq=False)
class _Late:
    """Of a set with one late cause: where that and what is usual of it are among its coefficients."""

    pick: Pick
    mine: int
    bend: int  # of what is usual of the same signal
    shared: int  # the filter that torque and speed share
    gain: float  # true torque over reported: of that, what is late is so many times what it is told by
    ways: list[tuple[int, tuple[float, float]]]  # by how much a unit of each is torque and speed late
    apart: Array  # how late both are together, and how much the cause's later, by each of them (2, len(ways))


def as_told(search: Search, scored: Scored) -> Scored:
    """A set as it is told: what torque and speed are apart by is the late cause's, and the rest the filter's that both
    share.

    How late each of them is, is known to microseconds; how much of that is usual, only how each bends says. What is
    told bends as a file says it, and what is usual of that signal makes up for it. In a file the torque that is late is
    the true one, of which a torque constant makes more than is reported. More late causes than one stay as they are.
    """
    late = _late(search, scored)
    if late is None:
        return replace(scored, exact=told_by(search, scored) @ scored.exact)
    cause, shape = search.candidate(late.pick), search.data.atoms[late.pick.atom].shape
    exact = told_by(search, scored) @ scored.exact
    apart = exact[late.mine]
    bends = cause.bends_told * apart**2 * (late.gain if cause.late[0] else 1.0)
    exact[late.bend] += scored.exact[late.mine] * shape[0] - bends
    return replace(scored, exact=exact)


def told_by(search: Search, scored: Scored) -> Array:
    """What each coefficient of a set is as it is told, by all as they were found, (p, p)."""
    told, late = np.eye(scored.exact.size), _late(search, scored)
    if late is not None:
        columns = [at for at, _ in late.ways]
        told[columns] = 0.0
        told[np.ix_([late.shared, late.mine], columns)] = late.apart
    gap, damping = opening_of(search, scored.picks), damping_of(search, scored.picks)
    if gap is not None and damping is not None:
        starts = {pick: where.start for pick, where in zip(scored.picks, slices(search, scored), strict=True)}
        contacts = starts[gap] + CONTACTS
        told[contacts, contacts], told[starts[damping], contacts] = 0.0, 1.0
    return told


def timing(search: Search, scored: Scored) -> Timing:
    """By how much later torque is reported than speed, of a set."""
    usual, named, gain = _ways(search, scored)
    measured = any(run.speed_measured for run in search.data.about.view.runs)
    apart = np.zeros(scored.exact.size)
    for at, (torque, speed) in (*usual, *((at, search.candidate(pick).late) for pick, at in named)):
        apart[at] = torque / gain - (speed if measured else 0.0)
    own = scored.found.covariance[: apart.size, : apart.size]
    value, spread = float(apart @ scored.exact), float(np.sqrt(apart @ own @ apart))
    off = [search.data.candidates[i] for i in search.always if measured or search.data.candidates[i].late[0]]
    usual_s = float(
        np.hypot.reduce([one.deviations[0] for one in off if any(one.late) and not all(one.late)])
    )
    return Timing(
        Parameter(value, value - 1.96 * spread, value + 1.96 * spread),
        "speed" if measured else "position",
        usual_s,
    )


#: Of each cause that makes torque or speed late: where its first coefficient is, and by how much later each is.
_Ways = list[tuple[int, tuple[float, float]]]


def _ways(search: Search, scored: Scored) -> tuple[_Ways, list[tuple[Pick, int]], float]:
    """What is usual; a set's own late causes, and where they are; and true torque over reported."""
    always = [search.data.candidates[i] for i in search.always]
    starts = np.cumsum([0, *(candidate.size for candidate in always)])
    usual = [(int(at), one.late) for one, at in zip(always, starts, strict=False) if any(one.late)]
    own = [(pick, where.start) for pick, where in zip(scored.picks, slices(search, scored), strict=True)]
    named = [(pick, at) for pick, at in own if any(search.candidate(pick).late)]
    gain = 1 + sum(float(scored.exact[at]) for pick, at in own if search.name(pick) == "torque_constant")
    return usual, named, gain


def _late(search: Search, scored: Scored) -> _Late | None:
    """None: there is none or more than one, or what is told would be early."""
    usual, named, gain = _ways(search, scored)
    shared = [at for at, late in usual if all(late)]
    if len(named) != 1 or len(shared) != 1:
        return None
    ((pick, mine),) = named
    cause = search.candidate(pick)
    ways = [(at, (torque / gain, speed)) for at, (torque, speed) in (*usual, (mine, cause.late))]
    apart = np.linalg.solve(np.column_stack([(1.0, 1.0), cause.late]), np.array([way for _, way in ways]).T)
    if np.min(apart @ scored.exact[[at for at, _ in ways]]) < 0:
        return None
    bend = next(at + 1 for at, late in usual if np.abs(late).tolist() == np.abs(cause.late).tolist())
    return _Late(pick, mine, bend, shared[0], gain, ways, apart)
