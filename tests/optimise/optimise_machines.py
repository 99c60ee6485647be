"""Machines for tests of the optimiser: the paper's, and rigid ones whose best motion is known in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np

from schwung.drivetrain import InertiaTable, Load, Machine, Motor, paper_machine
from schwung.drivetrain.inertia import slider_crank_inertia
from schwung.drivetrain.physics_term import PhysicsTerm
from schwung.optimise.values import MotionLimits, Task

#: Half as many intervals as there are at the least: for a test that looks at more than a hundredth of its numbers, and
#: not at the shortest time of a machine that swings.
COARSE = 80

MEASURED = paper_machine()


def _beyond(machine: Machine) -> Machine:
    """The paper's machine with a table that goes on beyond the stroke.

    Where a table ends, the inertia stands still; a series of smooth functions wants 33 terms for such a corner. Without
    it 13 do, and a solution takes half the time.
    """
    angle = np.linspace(-0.3, np.pi + 0.3, 401)
    table = InertiaTable(angle, slider_crank_inertia(angle))
    return machine.model_copy(update={"load": machine.load.model_copy(update={"inertia_table": table})})


PAPER = _beyond(MEASURED)


def rigid(inertia_kgm2: float = 0.1, peak_torque_nm: float = 1000.0) -> Machine:
    """One mass without friction."""
    return Machine(
        name="rigid",
        motor=Motor(inertia_kgm2=0.01, viscous_friction_nms=0.0, peak_torque_nm=peak_torque_nm),
        load=Load(inertia_kgm2=inertia_kgm2 - 0.01),
    )


def with_physics(machine: Machine, **terms: dict[str, Any]) -> Machine:
    """The machine with [[physics]]."""
    physics = tuple(PhysicsTerm(name=name, **parameters) for name, parameters in terms.items())
    return machine.model_copy(update={"physics": physics})


def task(duration_s: float | None = 0.1, **changes: Any) -> Task:
    """Half a turn of the paper's machine within its torque."""
    limits = changes.pop("limits", {})
    arguments: dict[str, Any] = {"start_rad": 0.0, "distance_rad": np.pi, "duration_s": duration_s}
    return Task(limits=MotionLimits(**({"torque_max_nm": 233.0} | limits)), **(arguments | changes))
