"""The machine that the filter moves: the belief, and what of the causes that are present belongs to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.drivetrain.machine import Coupling, Load, Machine
from schwung.explain.weighing.along import Ranges
from schwung.explain.weighing.candidate import Candidate, Shape
from schwung.motion import Array

#: Points of an inertia over the angle; of a spindle's, which turns on and on, no more than so many.
_POINTS_PER_RAD, _MOST_POINTS = 100, 20_000
#: No change leaves less than this share of what is believed: nothing moves without inertia or stiffness.
LEAST_SHARE = 0.05


def points_of(span_rad: float) -> int:
    """How many points an inertia has over a range of angles."""
    return min(3 + int(_POINTS_PER_RAD * span_rad), _MOST_POINTS)


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
    angle = np.linspace(of.low_rad - margin, of.high_rad + margin, points_of(of.span_rad))
    return angle, machine.load_inertia_at(angle)


def _added(angle: Array, heavier: Sequence[Member]) -> Array:
    return np.asarray(
        sum((m.candidate.inertia_added(angle, m.shape, m.coefficients) for m in heavier), np.zeros(()))
    )


def with_members(machine: Machine, members: Sequence[Member], of: Ranges) -> Machine:
    """The believed machine with the members' inertia, stiffness and damping."""
    coupling, load = machine.coupling, machine.load
    stiffness = sum(m.candidate.coupling[0] * float(m.coefficients[0]) for m in members)
    damping = sum(m.candidate.coupling[1] * float(m.coefficients[0]) for m in members)
    damping += sum(float(m.coefficients[1]) for m in members if m.candidate.opens)
    if coupling is not None and (stiffness or damping):
        coupling = Coupling(
            stiffness_nm_rad=max(
                coupling.stiffness_nm_rad + stiffness, LEAST_SHARE * coupling.stiffness_nm_rad
            ),
            damping_nms=max(coupling.damping_nms + damping, LEAST_SHARE * coupling.damping_nms),
        )
    heavier = [m for m in members if m.candidate.inertia is not None]
    if heavier:
        angle, believed = _believed(machine, of)
        inertia = np.maximum(believed + _added(angle, heavier), LEAST_SHARE * believed)
        load = Load(
            viscous_friction_nms=load.viscous_friction_nms,
            inertia_table=InertiaTable(angle, inertia),
            torque_nm=load.torque_nm,
            torque_table=load.torque_table,
        )
    return machine.model_copy(update={"coupling": coupling, "load": load})


def gap_of(known_rad: float, members: Sequence[Member]) -> float:
    """The coupling's gap (rad): what is known, and the members'."""
    added = sum(m.candidate.coupling[2] * float(m.coefficients[0]) for m in members)
    return max(known_rad + added, 0.0)
