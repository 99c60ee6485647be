"""How a load torque changes with the angle, from the mean motion: to a ripple it is a spring.

A torque T_l(θ) on the load adds T_l'(θ) θ~ to the balance of the ripple (`balance.py`). At one frequency that is an
inertia of −T_l'/ω²: a weight of a third of the injection is worth 0.02 % of the inertia, more than noise often leaves.
The ripple cannot tell the two apart, the motion can: what it takes beyond the inertia that the ripple found, friction
aside, is T_l.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial import legendre

from schwung.drivetrain.machine import Machine
from schwung.estimation.balance import LoadSide
from schwung.estimation.ripple import Ripple
from schwung.innovations.low_pass import low_passed
from schwung.innovations.splines import slopes
from schwung.motion import Array

#: T_l is a polynomial of the angle of this degree.
DEGREE = 7
#: The motion is looked at below this share of the injected frequency, and above this share of its top speed.
BELOW, MOVING = 0.5, 0.05
#: T_l counts where it explains so many times what chance would, per coefficient: three standard deviations.
CLEAR = 9.0


def pulls(
    loads: Sequence[LoadSide],
    ripples: Sequence[Ripple],
    inertia_at: Callable[[Array, int], Array],
    machine: Machine,
) -> list[Array]:
    """dT_l/dθ (N·m/rad) along each load's motion, (n,); the machine file's where the motion shows no other.

    `inertia_at`: J_l and its derivatives over the load angle.
    """
    low = min(float(load.angle_rad.min()) for load in loads)
    span = max(max(float(load.angle_rad.max()) for load in loads) - low, 1e-9)
    rows, wanted, independent = [], [], 0.0
    for load, ripple in zip(loads, ripples, strict=True):
        columns, rest = _motion(load, ripple, inertia_at, machine, low, span)
        edge = 2 * BELOW * ripple.frequency_hz / ripple.sample_rate_hz
        moving = np.abs(load.speed_rad_s) > MOVING * float(np.max(np.abs(load.speed_rad_s)))
        rows.append(low_passed(columns, edge, 2)[moving])
        wanted.append(low_passed(rest, edge, 2)[moving])
        independent += edge * np.count_nonzero(moving)
    design, y = np.vstack(rows), np.concatenate(wanted)
    believed = [_believed(machine, load.angle_rad) for load in loads]
    free = independent - design.shape[1]
    if free < 1:
        return believed
    size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    found = np.linalg.lstsq(design / size, y, rcond=1e-9)[0] / size
    frictions = design[:, : -DEGREE - 1]
    alone = y - frictions @ np.linalg.lstsq(frictions, y, rcond=1e-9)[0]
    left = y - design @ found
    if float(alone @ alone - left @ left) / (DEGREE + 1) < CLEAR * float(left @ left) / free:
        return believed
    slope = legendre.legder(found[-DEGREE - 1 :]) * 2 / span
    return [
        known + legendre.legval(2 * (load.angle_rad - low) / span - 1, slope)
        for known, load in zip(believed, loads, strict=True)
    ]


def _motion(
    load: LoadSide,
    ripple: Ripple,
    inertia_at: Callable[[Array, int], Array],
    machine: Machine,
    low: float,
    span: float,
) -> tuple[Array, Array]:
    """What friction and a load torque add to the motor's torque, (n, 3 + DEGREE), and what is to explain, (n,)."""
    motor, angle, speed = machine.motor, load.angle_rad, load.speed_rad_s

    def rate_of(values: Array) -> Array:
        return slopes(values, 1 / ripple.sample_rate_hz)

    inertia, slope = inertia_at(angle, 0), inertia_at(angle, 1)
    known = motor.inertia_kgm2 * rate_of(ripple.speed_rad_s) + motor.viscous_friction_nms * ripple.speed_rad_s
    known = known + rate_of(inertia * speed) - slope * speed**2 / 2
    known = known + machine.load.viscous_friction_nms * speed - machine.load_torque_at(angle)
    shapes = legendre.legvander(2 * (angle - low) / span - 1, DEGREE)
    return np.column_stack([speed, np.sign(speed), -shapes]), ripple.torque_nm - known


def _believed(machine: Machine, angle_rad: Array) -> Array:
    """The slope of the machine file's load torque."""
    step = 1e-4
    rise = machine.load_torque_at(angle_rad + step) - machine.load_torque_at(angle_rad - step)
    return np.asarray(np.broadcast_to(rise / (2 * step), angle_rad.shape))
