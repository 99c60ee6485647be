"""From a task to its best stroke: scales, a first guess, IPOPT, and what to say where there is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from schwung.drivetrain import Machine
from schwung.drivetrain.effects import Effects
from schwung.errors import InputError
from schwung.motion import Array
from schwung.optimise.collocation import (
    MOST_OF_ALL,
    SHOWN_BY,
    Programme,
    nodes_for,
    radau,
    swings_at_hz,
)
from schwung.optimise.dynamics import follow, merits_of
from schwung.optimise.inverse import Scales, resting_twist
from schwung.optimise.model import Model, models_of
from schwung.optimise.values import Objective, Stroke, Task

_IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 200,
    "tol": 1e-7,
    "linear_solver": "mumps",
    "max_wall_time": 30.0,  # s: far beyond what a motion takes that there is
}
#: How often a stroke that passes the torque limit between the grid's points is solved anew with less, and how far
#: within it is then to end, in shares.
TIGHTENED, INSIDE = 3, 1e-4
#: Where dry friction is too sharp to begin with: how much rounder it is at first, down to as it shall be.
ROUNDER = (30.0, 10.0, 3.0, 1.0)


@dataclass(frozen=True, eq=False)
class Guess:
    """A motion to begin with, and what 1 stands for: motor (3, n+1), loads at nodes and inner points."""

    duration_s: float
    motor: Array
    nodes: Array
    inner: Array
    scales: Scales


class NoMotionError(InputError):
    """No motion keeps within the limits in the time that it has."""


def best_stroke(
    machine: Machine, task: Task, intervals: int | None = None, start: Stroke | None = None
) -> Stroke:
    """The best motion of a task; `intervals`: of the grid, None: enough for what swings fastest.

    `start`: another stroke to begin with, of one load; None: the fifth-order polynomial. Raises NoMotionError that
    names the limit and the shortest duration that would do, and InputError for what the machine file lacks.
    """
    _require(machine, task)
    duration = task.duration_s
    if duration is None:
        duration = _shortest_guess(machine, task)
    models = _shown(_models(machine, task, duration), duration)
    return _solve(machine, task, models, duration, intervals, start)


def _shown(models: Sequence[Model], duration_s: float) -> tuple[Model, ...]:
    """The models, rigid where they swing so fast that no grid of reasonable size would show it."""
    most = MOST_OF_ALL / SHOWN_BY
    if duration_s * max(map(swings_at_hz, models)) <= most:
        return tuple(models)
    return tuple(replace(model, stiffness_nm_rad=None) for model in models)


def _solve(
    machine: Machine,
    task: Task,
    models: Sequence[Model],
    duration_s: float,
    intervals: int | None,
    start: Stroke | None,
) -> Stroke:
    """The best stroke; where dry friction is too sharp for the solver, from rounder ones towards it."""
    n = intervals or nodes_for(models, duration_s, task.distance_rad)
    found = _attempt(machine, task, models, duration_s, n, start)
    if isinstance(found, str) and any(_rubs(model.effects) for model in models):
        found = _from_rounder(machine, task, models, duration_s, n) or found
    if isinstance(found, str):
        raise _why_not(machine, task, found)
    return _kept(machine, task, models, duration_s, n, found)


def _kept(
    machine: Machine, task: Task, models: Sequence[Model], duration_s: float, intervals: int, found: Stroke
) -> Stroke:
    """The stroke, solved anew with less torque as long as an independent integrator sees it pass the limit.

    The programme keeps its limits at the points of the grid; what lies between them may pass by a few tenths of a per
    cent. Where less torque leaves no motion the stroke stays as it is, and its peak is reported.
    """
    limit = models[0].torque_max_nm
    allowed = limit
    for _ in range(TIGHTENED):
        peak = merits_of(machine, follow(machine, found.motion(), task.start_rad)).peak_torque_nm
        if peak <= limit:
            break
        allowed *= (1 - INSIDE) * limit / peak
        tighter = [replace(m, torque_max_nm=m.torque_max_nm * allowed / limit) for m in models]
        again = _attempt(machine, task, tighter, duration_s, intervals, found)
        if isinstance(again, str):
            break
        found = again
    return found


def _from_rounder(
    machine: Machine, task: Task, models: Sequence[Model], duration_s: float, intervals: int
) -> Stroke | None:
    """The best stroke by way of those with rounder friction; None where one of them is not found."""
    last: Stroke | None = None
    for rounder in ROUNDER:
        rounded = [replace(model, smooth_rad_s=rounder * model.smooth_rad_s) for model in models]
        found = _attempt(machine, task, rounded, duration_s, intervals, last)
        if isinstance(found, str):
            return None
        last = found
    return last


def _rubs(e: Effects) -> bool:
    """Whether there is dry friction."""
    return any((e.coulomb_positive_nm, e.coulomb_negative_nm, e.stribeck_rise_nm, e.local_friction_nm))


def _attempt(
    machine: Machine,
    task: Task,
    models: Sequence[Model],
    duration_s: float,
    intervals: int,
    start: Stroke | None,
) -> Stroke | str:
    """The stroke that IPOPT finds, or else what it says."""
    guess = _guess(machine, task, models, duration_s, intervals, start)
    electrical = machine.motor.electrical
    losses = (electrical.copper_w_nm2, electrical.iron_loss_nms) if electrical else None
    curve = machine.motor.torque_over_speed
    pairs = None if curve is None else np.array(curve)
    programme = Programme(task, models, intervals, guess.scales, duration_s, losses, pairs)
    problem: Any = {"x": programme.unknowns, "f": programme.objective, "g": programme.constraints}
    options: Any = {"print_time": False, "ipopt": _IPOPT}
    solver = ca.nlpsol("best", "ipopt", problem, options)
    low, high = programme.bounds()
    found = solver(
        x0=programme.unknowns_of(guess.motor, guess.nodes, guess.inner),
        lbx=low,
        ubx=high,
        lbg=np.concatenate([np.zeros(programme.equalities), np.full(programme.inequalities, -np.inf)]),
        ubg=np.zeros(programme.equalities + programme.inequalities),
    )
    stats = solver.stats()
    if not stats["success"]:
        return str(stats["return_status"])
    unknowns = np.asarray(found["x"]).ravel()
    return _stroke(programme, unknowns, float(found["f"]), int(stats["iter_count"]))


def _stroke(programme: Programme, unknowns: Array, objective: float, iterations: int) -> Stroke:
    motor, nodes, duration = programme.split(unknowns)
    task, now = programme.task, programme.instants(motor, nodes, duration)
    return Stroke(
        start_rad=task.start_rad,
        distance_rad=task.distance_rad,
        duration_s=duration,
        share=motor[0],
        speed_share=motor[1],
        acceleration_share=motor[2],
        torque_nm=np.asarray(now.torque_nm[0]),
        load_position_rad=np.asarray(now.load_rad[0]),
        load_speed_rad_s=np.asarray(now.load_rad_s[0]),
        hold_start_nm=_holding(programme.models[0], task.ends_rad[0]),
        hold_end_nm=_holding(programme.models[0], task.ends_rad[1]),
        objective=objective,
        iterations=iterations,
        active=programme.active(unknowns),
    )


def _holding(model: Model, motor_rad: float) -> float:
    """The torque (N·m) that holds the axis at an angle, friction left out, which may hold it as well."""
    twist = 0.0 if model.stiffness_nm_rad is None else resting_twist(model, motor_rad)
    needed = model.load_needs(motor_rad - twist, 0.0) + model.motor_needs(motor_rad, 0.0)
    return float(model.reported(needed))


def _require(machine: Machine, task: Task) -> None:
    if task.duration_s is not None and task.weights.get("energy", 0) > 0 and machine.motor.electrical is None:
        raise InputError(
            f'machine "{machine.name}", motor.electrical',
            "is missing, and the drawn energy cannot be told without",
            "Add [motor.electrical] with resistance and torque_constant, or take --objective copper.",
        )


def _models(machine: Machine, task: Task, duration_s: float) -> tuple[Model, ...]:
    limit = min(task.limits.torque_max_nm, machine.motor.peak_torque_nm)
    mean = abs(task.distance_rad) / duration_s
    return models_of(machine, task.ends_rad, mean, limit, task.payloads_kgm2, task.band_sigmas)


# -- Where to begin -----------------------------------------------------------------------------------


def _poly5(u: Array) -> Array:
    """Share of the stroke and its two derivatives, (3, n), of the fifth-order polynomial."""
    return np.array(
        [
            u**3 * (10 - 15 * u + 6 * u**2),
            30 * u**2 * (1 - u) ** 2,
            60 * u * (1 - u) * (1 - 2 * u),
        ]
    )


def _guess(
    machine: Machine, task: Task, models: Sequence[Model], duration_s: float, n: int, start: Stroke | None
) -> Guess:
    u, points = np.linspace(0.0, 1.0, n + 1), radau()[0]
    fine = (u[:-1, None] + points[None, :-1] / n).ravel()
    flexible = [m for m in models if m.stiffness_nm_rad is not None]
    limit = max(m.torque_max_nm for m in models)
    twist = max((limit / float(m.stiffness_nm_rad or 1) for m in flexible), default=1.0)
    swing = max((math.sqrt(float(m.stiffness_nm_rad or 1) / m.lightest_kgm2) for m in flexible), default=1.0)
    scales = Scales(limit, twist, twist * swing, {})
    if start is None:
        motor = _poly5(u)
        nodes, inner = (_quasi_static(task, flexible, _poly5(at), at, duration_s, scales) for at in (u, fine))
    else:
        motor = _read(start, u)[:3]
        nodes, inner = (_hanging(start, at, duration_s, len(flexible), scales) for at in (u, fine))
    merits = _merits(machine, task, models, duration_s, scales)
    return Guess(duration_s, motor, nodes, inner, replace(scales, merits=merits))


def _read(start: Stroke, u: Array) -> Array:
    """Motor (3 rows), wind-up (rad) and its rate (rad/s) of a stroke at shares of its duration, (5, n)."""
    own = np.linspace(0.0, 1.0, start.share.size)
    speed = start.distance_rad / start.duration_s * start.speed_share
    rows = (
        start.share,
        start.speed_share,
        start.acceleration_share,
        start.start_rad + start.distance_rad * start.share - start.load_position_rad,
        speed - start.load_speed_rad_s,
    )
    return np.array([np.interp(u, own, row) for row in rows])


def _hanging(start: Stroke, u: Array, duration_s: float, loads: int, scales: Scales) -> Array:
    """Loads (2·m, n) that hang on the motor as in another stroke, its time stretched to this one's."""
    twist, rate = _read(start, u)[3:]
    rate = rate * start.duration_s / duration_s
    return np.tile(np.array([twist / scales.twist_rad, rate / scales.twist_speed_rad_s]), (loads, 1))


def _quasi_static(
    task: Task, models: Sequence[Model], motor: Array, u: Array, duration_s: float, scales: Scales
) -> Array:
    """Loads (2·m, n) that follow a motor motion (3, n) as if the coupling were stiff: wind-up by what they take."""
    rows = []
    angle = task.start_rad + task.distance_rad * motor[0]
    speed = task.distance_rad * motor[1] / duration_s
    acceleration = task.distance_rad * motor[2] / duration_s**2
    for model in models:
        torque = model.load_inertia(angle) * acceleration + model.load_needs(angle, speed)
        twist = torque / float(model.stiffness_nm_rad or 1)
        rows += [twist / scales.twist_rad, np.gradient(twist, u * duration_s) / scales.twist_speed_rad_s]
    return np.array(rows).reshape(2 * len(models), u.size)


def _merits(
    machine: Machine, task: Task, models: Sequence[Model], duration_s: float, scales: Scales
) -> dict[Objective, float]:
    """What the fifth-order polynomial has of each objective on the stiff machine; never 0."""
    u = np.linspace(0.0, 1.0, 1001)
    motor, model = _poly5(u), models[0]
    angle = task.start_rad + task.distance_rad * motor[0]
    speed = task.distance_rad * motor[1] / duration_s
    acceleration = task.distance_rad * motor[2] / duration_s**2
    on_load = model.load_inertia(angle) * acceleration + model.load_needs(angle, speed)
    torque = model.reported(
        on_load + model.rotor_inertia_kgm2 * acceleration + model.motor_needs(angle, speed)
    )
    electrical = machine.motor.electrical
    copper, iron = (electrical.copper_w_nm2, electrical.iron_loss_nms) if electrical else (0.0, 0.0)
    power = torque * speed + copper * torque**2 + iron * speed**2
    if model.stiffness_nm_rad is None:
        swing = np.gradient(acceleration, u * duration_s)
    else:
        swing = np.gradient(on_load / model.stiffness_nm_rad, u * duration_s)
    return {
        "copper": float(np.mean(torque**2)) * duration_s + 1e-12,
        "energy": float(np.mean(np.maximum(power, 0.0))) * duration_s + 1e-12,
        "vibration": float(np.mean(swing**2)) * duration_s + 1e-30,
        "peak": float(np.max(np.abs(torque))) + 1e-12,
    }


def _shortest_guess(machine: Machine, task: Task) -> float:
    """About how long the fifth-order polynomial takes within the limits of torque and speed (s)."""
    models = _models(machine, task, 1.0)
    scales = Scales(1.0, 1.0, 1.0, {})
    limit = models[0].torque_max_nm
    low, high = 1e-4, 1e4
    for _ in range(60):
        middle = math.sqrt(low * high)
        peak = _merits(machine, task, models, middle, scales)["peak"]
        low, high = (low, middle) if peak <= limit else (middle, high)
    speed = task.limits.speed_max_rad_s
    if speed is not None:
        high = max(high, 1.875 * abs(task.distance_rad) / speed)
    jerk = task.limits.jerk_max_rad_s3
    if jerk is not None:
        high = max(high, (60.0 * abs(task.distance_rad) / jerk) ** (1 / 3))
    return high


# -- Where there is none ------------------------------------------------------------------------------

_OPTIONS = {
    "torque": "--max-torque",
    "torque over speed": "motor.torque_over_speed",
    "speed": "--max-speed",
    "jerk": "--max-jerk",
    "window": "--min-position and --max-position",
}


def _why_not(machine: Machine, task: Task, status: str) -> InputError:
    """What to tell: the fastest motion's time, and the limit that holds it back the longest."""
    if task.duration_s is None:
        return NoMotionError(
            "limits",
            f"no motion of {task.distance_rad:.4g} rad was found within them (IPOPT: {status})",
            "Allow more torque (--max-torque), or a wider window; a load torque may hold the axis back.",
        )
    try:
        fastest = best_stroke(machine, replace(task, duration_s=None))
    except NoMotionError as error:
        return error
    if fastest.duration_s < task.duration_s:
        return NoMotionError(
            "--duration",
            f"IPOPT found no motion in {task.duration_s * 1e3:.4g} ms ({status}), though one of "
            f"{fastest.duration_s * 1e3:.4g} ms keeps the limits",
            "Give another duration, or other weights.",
        )
    name = max(fastest.active, key=lambda key: fastest.active[key], default="torque")
    shortest = math.ceil(fastest.duration_s * 1e4) / 10
    return NoMotionError(
        "--duration",
        f"no motion of {task.distance_rad:.4g} rad in {task.duration_s * 1e3:.4g} ms keeps the limit of {name} "
        f"({_OPTIONS[name]})",
        f"The shortest that does takes {shortest:g} ms: give that or more, or allow more.",
    )
