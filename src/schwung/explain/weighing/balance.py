"""An inertia over the angle from a plain balance of torque, to begin from.

Far from the truth the filter's likelihood has more than one maximum over a curve: about a number, that of a crank whose
ends are seldom visited came to rest at a third of what it is there. A balance is linear in the curve wherever it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from schwung.explain.causes.along import Along
from schwung.explain.causes.candidate import Candidate, Shape
from schwung.explain.causes.equations import Acting
from schwung.explain.causes.inertia_at import DIFFERENCE_RAD
from schwung.explain.causes.present import Member
from schwung.explain.weighing.round import Linearised, acting
from schwung.innovations.splines import slopes
from schwung.motion import Array

#: Samples at either end of a run where a filter without lag has no other side yet; of a short run a quarter at most.
_EDGE = 30


def balanced(about: Linearised, present: Sequence[Member], curve: Member, runs: Sequence[int]) -> Array:
    """Coefficients (p,) of a curve of inertia beside what is present, by least squares within the band of motion and
    injection, about their prior; what friction, weight and offset may do is fitted beside it. Zeros where what is
    present makes the numbers run away."""
    rows, torques = [], []
    for run in runs:
        along = about.alongs[run]
        row, torque = _balance(along, acting(about.view, along, present), curve.candidate, curve.shape)
        edge = min(_EDGE, torque.size // 4)
        inside = slice(edge, torque.size - edge)
        rows.append(row[inside])
        torques.append(torque[inside])
    matrix, torque = np.concatenate(rows), np.concatenate(torques)
    size = curve.candidate.size
    if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(torque))):
        return np.zeros(size)
    missed = torque - matrix @ np.linalg.lstsq(matrix, torque, rcond=1e-6)[0]
    prior = np.zeros((size, matrix.shape[1]))
    prior[:, :size] = np.diag(np.std(missed) / np.asarray(curve.candidate.deviations))
    whole = np.vstack([matrix, prior]), np.concatenate([torque, np.zeros(size)])
    return np.asarray(np.linalg.lstsq(*whole, rcond=None)[0][:size])


def _balance(along: Along, acts: Acting, candidate: Candidate, shape: Shape) -> tuple[Array, Array]:
    """Of one run, what a unit of each coefficient and of everything beside takes, and what is missed, (n, …), (n,)."""
    run, machine = along.run, along.present
    angle, speed = run.position_rad, run.quiet(run.speed_rad_s)
    accelerated = slopes(speed, run.step_s)
    given = run.quiet(run.drive.whole_nm + acts.on_motor)
    given = given - machine.motor.inertia_kgm2 * accelerated - machine.motor.viscous_friction_nms * speed
    if machine.coupling is not None:  # the load is behind by what it winds up
        wound = run.quiet(given) / machine.coupling.stiffness_nm_rad
        angle, speed = angle - wound, speed - run.quiet(slopes(wound, run.step_s))
        accelerated = slopes(speed, run.step_s)
    given = given + acts.on_load + machine.load_torque_at(angle) - machine.load.viscous_friction_nms * speed
    believed, changes = (
        _taken(inertia, angle, speed, accelerated)
        for inertia in (
            lambda at: machine.load_inertia_at(at)[:, None],
            lambda at: (
                candidate.inertia(at, shape) if candidate.inertia is not None else np.zeros((at.size, 0))
            ),
        )
    )
    beside = [speed, along.direction, np.ones_like(speed), np.sin(angle), np.cos(angle)]
    return run.quiet(np.column_stack([changes, *beside])), run.quiet(given - believed[:, 0])


def _taken(inertia: Callable[[Array], Array], angle: Array, speed: Array, accelerated: Array) -> Array:
    """J α + ½ J' ω² of inertias at angles, (n,) -> (n, p)."""
    higher, lower = inertia(angle + DIFFERENCE_RAD), inertia(angle - DIFFERENCE_RAD)
    slope = (higher - lower) / (2 * DIFFERENCE_RAD)
    return np.asarray(inertia(angle) * accelerated[:, None] + slope * (speed**2 / 2)[:, None])
