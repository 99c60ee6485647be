"""Sets of causes on their way from a search to rest and back: as members of the machine, and as columns of a round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.present import Member
from schwung.explain.weighing.data import Atom, Data
from schwung.explain.weighing.search import Pick, Scored, Search, slices
from schwung.explain.weighing.settling import Settled

#: Causes of one shape that are smooth along any motion, and so are present where the noise is found.
SMOOTH = (
    "torque_constant",
    "torque_lag",
    "measurement_delay",
    "coupling_stiffness",
    "coupling_damping",
)

#: Causes in their shapes, with their sizes.
Shaped = tuple[tuple[Atom, float], ...]


def is_unnamed(search: Search, one: Scored) -> bool:
    """Whether a set holds what has no name."""
    return any(not search.candidate(pick).named for pick in one.picks)


def bends(search: Search, one: Scored) -> bool:
    """Whether a set holds a coupling that is a curve, in place of its laws."""
    return any(search.candidate(pick).instead_of_laws for pick in one.picks)


def begun_from(present: Sequence[Member], members: Sequence[Member]) -> list[Member]:
    """The members with the coefficients that they have in a set at rest, or none: what a linear model promises far from
    it may be no machine at all."""
    had = {key_of(m): m.coefficients for m in present}
    return [replace(m, coefficients=had.get(key_of(m), 0 * m.coefficients)) for m in members]


def without_damping(member: Member) -> Member:
    """Of play the gap alone: what its contacts damp makes up for whatever else was not there yet."""
    if not member.candidate.opens:
        return member
    return replace(member, coefficients=member.coefficients * [1.0, 0.0])


def timed(members: Sequence[Member], late: Candidate) -> list[Member] | None:
    """The members with one late cause, the only one, in place of all that torque and speed are apart by; None where it
    would be early. What is usual stays as the filter that both share."""
    coefficients = np.array([float(m.coefficients[0]) for m in members])
    ways = np.array([m.candidate.late for m in members])
    torque, speed = coefficients @ ways
    shared, later = np.linalg.solve([[1.0, late.late[0]], [1.0, late.late[1]]], [torque, speed])
    if later <= 0:
        return None
    found = []
    for member in members:
        at = member.coefficients.copy()
        if any(member.candidate.late):
            if member.candidate.named:
                continue
            at[0] = shared if all(member.candidate.late) else 0.0
        found.append(replace(member, coefficients=at))
    assert late.bends is not None
    shape = (late.bends[0] * float(later), *late.shapes[0][1:])
    return [*found, Member(late, shape, np.array([later]), np.array(late.deviations))]


def key_of(member: Member) -> tuple[str, Shape, int]:
    """What tells members apart."""
    return member.candidate.name, member.shape, member.coefficients.size


def absent(candidate: Candidate) -> Member:
    """With coefficients of nothing."""
    return Member(candidate, candidate.shapes[0], np.zeros(candidate.size), np.array(candidate.deviations))


def everything(candidates: Sequence[Candidate], members: Sequence[Member]) -> list[Member]:
    """The members, and whatever is smooth along any motion."""
    inside = {(m.candidate.name, m.candidate.coordinate) for m in members}
    smooth = (c for c in candidates if _smooth(c) and (c.name, c.coordinate) not in inside)
    return [*members, *(absent(c) for c in smooth)]


def _smooth(candidate: Candidate) -> bool:
    if candidate.name.startswith("usual"):
        return True
    return (len(candidate.scales) > 1 and candidate.tangent is None) or candidate.name in SMOOTH


def members_of(search: Search, best: Scored, candidates: Sequence[Candidate]) -> list[Member]:
    """What is always there, and the set, with the coefficients of laws without errors, which is how they are settled;
    `candidates`: as they are about nothing."""
    result, at = [], 0
    for index in search.always:
        candidate = candidates[index]
        coefficients = best.exact[at : at + candidate.size]
        result.append(Member(candidate, candidate.shapes[0], coefficients, np.array(candidate.deviations)))
        at += candidate.size
    for pick, where in zip(best.picks, slices(search, best), strict=True):
        candidate, shape = candidates[search.index(pick)], search.data.atoms[pick.atom].shape
        deviations = pick.scale * np.array(candidate.deviations)
        result.append(Member(candidate, shape, best.exact[where], deviations))
    return result


def kept(search: Search, best: Scored, at: Settled) -> Shaped:
    """A set's atoms, in the shapes that they have come to rest in."""
    own = at.members[len(at.members) - len(best.picks) :]
    return tuple(
        (replace(search.data.atoms[pick.atom], shape=member.shape), pick.scale)
        for pick, member in zip(best.picks, own, strict=True)
    )


def carried(data: Data, picks: Sequence[tuple[Atom, float]]) -> tuple[Pick, ...]:
    """The former round's set in this round's columns."""
    found = []
    for old, scale in picks:
        same = (i for i, a in enumerate(data.atoms) if (a.candidate, a.shape) == (old.candidate, old.shape))
        number = next(same, None)
        if number is None:
            share = data.candidates[old.candidate].shape_log
            data.append(old.candidate, old.shape, share if old.refined is None else old.refined, old.spread)
            number = len(data.atoms) - 1
        found.append(Pick(number, scale))
    return tuple(found)
