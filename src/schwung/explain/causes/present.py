"""The machine that the filter moves: the belief, and what of the causes that are present belongs to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Load, Machine
from schwung.explain.causes.along import Along, Pairs, Parts, Ranges
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.innovations.effect import Effect
from schwung.innovations.values import FurtherMass
from schwung.motion import Array

#: Points of an inertia over the angle; of a spindle's, which turns on and on, no more than so many.
_POINTS_PER_RAD, _MOST_POINTS = 100, 20_000
#: No change leaves less than this share of what is believed: nothing moves without inertia or stiffness.
LEAST_SHARE = 0.05


def _points_of(span_rad: float) -> int:
    """How many points an inertia has over a range of angles."""
    return min(3 + int(_POINTS_PER_RAD * span_rad), _MOST_POINTS)


@dataclass(frozen=True, eq=False)
class Changed(InertiaTable):
    """An inertia whose values at angles (n,) another function says, between the table's ends.

    A table of its values would have other slopes wherever the believed table's bend: at 28 rad/s, points 10 mrad apart
    made of that ten times the noise of a quiet drive.
    """

    law: Callable[[Array], Array] = field(kw_only=True)

    def at(self, position_rad: Array) -> Array:
        """J_l (kg·m²) at the given angles (rad)."""
        return self.law(np.clip(position_rad, self.position_rad[0], self.position_rad[-1]))


def changed(law: Callable[[Array], Array], low_rad: float, high_rad: float) -> Changed:
    """An inertia (kg·m²) by its law at angles (n,), from a little below the lowest to a little above the highest."""
    margin = 0.05 * max(high_rad - low_rad, 1e-9)
    angle = np.linspace(low_rad - margin, high_rad + margin, _points_of(high_rad - low_rad))
    return Changed(angle, law(angle), law=law)


@dataclass(frozen=True, eq=False)
class Member:
    """A candidate in one of its shapes, with coefficients (p,) and their prior deviations (p,)."""

    candidate: Candidate
    shape: Shape
    coefficients: Array
    deviations: Array


def moves(machine: Machine, members: Sequence[Member], of: Ranges) -> bool:
    """Whether every inertia is more than the least that a machine has: what is below has no acceleration."""
    heavier = [m for m in members if m.candidate.inertia is not None]
    if not heavier:
        return True
    angle, believed = _believed(machine, of)
    return bool(np.all(believed + _added(angle, heavier) > LEAST_SHARE * believed))


def _believed(machine: Machine, of: Ranges) -> tuple[Array, Array]:
    """Angles (rad), a little beyond those visited, and the inertia that is believed there (kg·m²)."""
    margin = 0.05 * of.span_rad
    angle = np.linspace(of.low_rad - margin, of.high_rad + margin, _points_of(of.span_rad))
    return angle, machine.load_inertia_at(angle)


def _added(angle: Array, heavier: Sequence[Member]) -> Array:
    return np.asarray(
        sum((m.candidate.inertia_added(angle, m.shape, m.coefficients) for m in heavier), np.zeros(()))
    )


def with_members(machine: Machine, members: Sequence[Member], of: Ranges) -> Machine:
    """The believed machine with the members' inertias, stiffness and damping."""
    coupling, load, motor = machine.coupling, machine.load, machine.motor
    rotor = sum(m.candidate.rotor * float(m.coefficients[0]) for m in members)
    if rotor:
        least = LEAST_SHARE * motor.inertia_kgm2
        motor = motor.model_copy(update={"inertia_kgm2": max(motor.inertia_kgm2 + rotor, least)})
    stiffness = sum(m.candidate.coupling[0] * float(m.coefficients[0]) for m in members)
    damping = sum(m.candidate.coupling[1] * float(m.coefficients[0]) for m in members)
    damping += sum(float(m.coefficients[1]) for m in members if m.candidate.opens)
    if coupling is not None and (stiffness or damping):
        total = {
            "stiffness_nm_rad": max(
                coupling.stiffness_nm_rad + stiffness, LEAST_SHARE * coupling.stiffness_nm_rad
            ),
            "damping_nms": max(coupling.damping_nms + damping, LEAST_SHARE * coupling.damping_nms),
        }
        # not asked whether a machine file may hold it: where a step leads too far, the runs are less likely
        coupling = coupling.model_copy(update=total)
    heavier = [m for m in members if m.candidate.inertia is not None]
    if heavier:

        def law(angle: Array) -> Array:
            believed = machine.load_inertia_at(angle)
            return np.maximum(believed + _added(angle, heavier), LEAST_SHARE * believed)

        load = Load(
            viscous_friction_nms=load.viscous_friction_nms,
            inertia_table=changed(law, of.low_rad, of.high_rad),
            torque_nm=load.torque_nm,
            torque_table=load.torque_table,
        )
    return machine.model_copy(update={"motor": motor, "coupling": coupling, "load": load})


def gap_of(known_rad: float, members: Sequence[Member]) -> float:
    """The coupling's gap (rad): what is known, and the members'."""
    added = sum(m.candidate.coupling[2] * float(m.coefficients[0]) for m in members)
    return max(known_rad + added, 0.0)


def besides_of(known: Callable[[Along], Array], members: Sequence[Member]) -> Parts:
    """What the coupling carries beside a spring and a damper (N·m): what is `known`, and the members'."""
    bending = [m for m in members if m.candidate.tangent is not None and np.any(m.coefficients)]
    return known, *(partial(_carried, member) for member in bending)


def _carried(member: Member, along: Along) -> Array:
    _, on_load, _, _ = member.candidate.done(along, member.shape, member.coefficients).alone
    return np.asarray(on_load + 0.0 * along.speed)


def eases_of(known: Callable[[Along], Array] | None, members: Sequence[Member]) -> Parts:
    """How much stiffer the coupling is about its wind-up: as `known`, None: no more; and by the members."""
    bending = [m for m in members if m.candidate.tangent is not None and np.any(m.coefficients)]
    return *(() if known is None else (known,)), *(partial(_eases, member) for member in bending)


def _eases(member: Member, along: Along) -> Array:
    assert member.candidate.tangent is not None
    return member.candidate.tangent(along, member.shape, member.coefficients)


def drives_of(known: Callable[[Along], tuple[Array, Array]], members: Sequence[Member]) -> Pairs:
    """How much further and faster the coupling is driven: as `known`, and by the members."""
    return known, *(partial(_driven, m) for m in members if m.candidate.drives and np.any(m.coefficients))


def _driven(member: Member, along: Along) -> tuple[Array, Array]:
    assert member.candidate.drives is not None
    return member.candidate.drives(along, member.shape, member.coefficients)


def carried_by(known: FurtherMass, known_gap_rad: float, members: Sequence[Member]) -> Member | None:
    """The one whose further mass is a state of the filter's; None: none, or the `known` one is.

    What such a mass takes follows from the load's acceleration, and that from what it takes: of one that rings, each
    round of the two would be further off. A coupling with a gap is passed in another way, without it.
    """
    if known.rate > 0 or gap_of(known_gap_rad, members) > 0:
        return None
    behind = (m for m in members if m.candidate.further is not None and m.coefficients[0] > 0)
    return next(behind, None)


def further_of(known: FurtherMass, known_gap_rad: float, members: Sequence[Member]) -> FurtherMass:
    """The further mass that is a state of the filter's."""
    if gap_of(known_gap_rad, members) > 0:
        return FurtherMass()
    carried = carried_by(known, known_gap_rad, members)
    if carried is None or carried.candidate.further is None:
        return known
    return carried.candidate.further(carried.coefficients, carried.shape)


def passes_of(known: Callable[[Along], Array], members: Sequence[Member]) -> Parts:
    """What the motor gives more for a torque more that it is asked for: as `known`, and by the members."""
    return known, *(partial(_passes, m) for m in members if m.candidate.passes and np.any(m.coefficients))


def _passes(member: Member, along: Along) -> Array:
    assert member.candidate.passes is not None
    return member.candidate.passes(along, member.shape, member.coefficients)


def pushes_of(known: Callable[[Along], Effect], members: Sequence[Member]) -> Pairs:
    """What acts on motor and load beside what belongs to the machine: as `known`, and by the members that are at a
    place."""
    acting = [
        m for m in members if m.candidate.coordinate and not m.candidate.of_machine and np.any(m.coefficients)
    ]
    return lambda along: known(along).alone[:2], *(partial(_pushes, member) for member in acting)


def _pushes(member: Member, along: Along) -> tuple[Array | float, Array | float]:
    return member.candidate.done(along, member.shape, member.coefficients).alone[:2]


def held_late_of(members: Sequence[Member]) -> float:
    """By what share of a step the drive takes a held injection later than it was sampled."""
    return sum(float(m.coefficients[0]) for m in members if m.candidate.holds)


def filter_of(known_s: float, members: Sequence[Member]) -> float:
    """By how much a filter delays the reported torque (s): what is known, and the members'."""
    return known_s + sum(float(m.coefficients[0]) for m in members if m.candidate.unfilters)
