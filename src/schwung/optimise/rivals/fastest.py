"""TOPP-RA: the fastest way along a path within torque limits, of a machine taken as stiff.

Pham and Pham, "A new approach to time-optimal path parameterization based on reachability analysis", IEEE Trans.
Robotics 34 (2018), as the library `toppra` has it. Its torque is a(s) s̈ + b(s) ṡ² + c(s): friction in proportion to
speed has no place in it, and is left out.
"""

from __future__ import annotations

import logging

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array, Demand
from schwung.optimise.model import Model
from schwung.optimise.values import Task

_GRID = 1001


class ToppraStroke:
    """The fastest stroke; `duration_s` long."""

    def __init__(
        self, times_s: Array, shares: Array, speeds: Array, accelerations: Array, distance_rad: float
    ) -> None:
        self.times_s, self.duration_s, self._distance_rad = times_s, float(times_s[-1]), distance_rad
        self._shares, self._speeds, self._accelerations = shares, speeds, accelerations

    def demand(self, time_s: Array) -> Demand:
        """At instants (s), (n,), from 0; acceleration is constant between grid points."""
        last = self.times_s.size - 2
        i = np.clip(np.searchsorted(self.times_s, time_s, side="right") - 1, 0, last)
        t = np.clip(time_s - self.times_s[i], 0.0, self.times_s[i + 1] - self.times_s[i])
        moving = time_s < self.duration_s
        acceleration = self._accelerations[i]
        position = np.where(moving, self._shares[i] + t * (self._speeds[i] + t * acceleration / 2), 1.0)
        return Demand(
            self._distance_rad * position,
            self._distance_rad * np.where(moving, self._speeds[i] + t * acceleration, 0.0),
            self._distance_rad * np.where(moving, acceleration, 0.0),
        )


def toppra_stroke(model: Model, task: Task) -> ToppraStroke:
    """The fastest stroke by TOPP-RA. Raises InputError where it finds none."""
    import toppra  # noqa: PLC0415  # late: only --fastest asks for it
    from toppra.algorithm import TOPPRA  # noqa: PLC0415  # likewise
    from toppra.constraint import (  # noqa: PLC0415  # likewise
        JointTorqueConstraint,
        JointVelocityConstraint,
    )

    logging.getLogger("toppra").setLevel(logging.CRITICAL)

    def needed(position: Array, speed: Array, acceleration: Array) -> Array:
        inertia = model.rotor_inertia_kgm2 + model.load_inertia(position)
        torque = inertia * acceleration + model.inertia_slope.at(position) / 2 * speed**2
        return np.asarray(model.reported(torque - model.load_torque.at(position)))

    friction = float(
        model.motor_needs(task.start_rad, 1e-9 + 10 * model.smooth_rad_s * np.sign(task.distance_rad))
    )
    path = toppra.SplineInterpolator([0.0, 1.0], np.array(task.ends_rad)[:, None])
    constraints = [
        JointTorqueConstraint(
            needed, np.array([[-model.torque_max_nm, model.torque_max_nm]]), np.array([abs(friction)])
        )
    ]
    if task.limits.speed_max_rad_s is not None:
        fastest = task.limits.speed_max_rad_s
        constraints.append(JointVelocityConstraint(np.array([[-fastest, fastest]])))
    grid = np.linspace(0.0, 1.0, _GRID)
    algorithm = TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
    accelerations, speeds, _ = algorithm.compute_parameterization(0.0, 0.0)
    if accelerations is None or speeds is None:
        raise InputError("TOPP-RA", "finds no motion within the limits", "Allow more torque (--max-torque).")
    steps = 2 * np.diff(grid) / (speeds[1:] + speeds[:-1])
    times = np.concatenate([[0.0], np.cumsum(steps)])
    return ToppraStroke(times, grid, speeds, accelerations, task.distance_rad)
