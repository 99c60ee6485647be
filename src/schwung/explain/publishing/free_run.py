"""The hardest look at a machine file: driven by the recorded torque alone, how far does it go astray?

No controller pulls it back, so that the smallest error of friction or load adds up over the whole recording. What is
compared is the position; nothing but its start is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from schwung.drivetrain import learned
from schwung.drivetrain.machine import Machine
from schwung.drivetrain.plant import learned_of, plant_of, substeps
from schwung.errors import InputError
from schwung.motion import Array, Demand
from schwung.session.model import Run, Session

#: Shorter recordings say nothing of what adds up (s).
SHORTEST_S = 3.0
#: Dry friction changes sign within this share of the highest speed, and a step of the solver's is this share of the
#: time in which it then brakes the mass.
_SIGN_SHARE, _BRAKING = 0.002, 1.0
_MOST_SUBSTEPS = 200
_TOLD = 2  # recordings, in a session of many


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A recording simulated from its torque alone; arrays (n,)."""

    runs: tuple[int, ...]  # that follow each other without a gap
    duration_s: float
    position_rms_rad: float  # of simulated minus recorded position (m on a linear axis)
    time_s: Array
    position_rad: Array  # as simulated


def free_runs(machine: Machine, session: Session) -> tuple[FreeRun, ...]:
    """Every recording of a session that lasts long enough, its cut runs joined again.

    Torque is held from sample to sample, as drives do. Raises InputError where the machine cannot be simulated.
    """
    result = []
    for numbers in _joined(session.runs):
        runs = [session.runs[n] for n in numbers]
        if sum(len(run) / run.sample_rate_hz for run in runs) >= SHORTEST_S:
            result.append(_free(machine, session, numbers, runs))
    return tuple(result)


def _joined(runs: Sequence[Run]) -> list[list[int]]:
    """Numbers of the runs, those that an import cut out of one recording together."""
    groups = [[0]] if runs else []
    for number, (before, after) in enumerate(pairwise(runs), start=1):
        ends = before.extra.get("source_start_s", np.nan) + len(before) / before.sample_rate_hz
        gap = after.extra.get("source_start_s", np.nan) - ends
        same = before.extra.get("source_file") == after.extra.get("source_file")
        if same and abs(gap) < 0.5 / before.sample_rate_hz:
            groups[-1].append(number)
        else:
            groups.append([number])
    return groups


def _free(machine: Machine, session: Session, numbers: list[int], runs: list[Run]) -> FreeRun:
    torque = np.concatenate([run.torque_nm for run in runs])
    position = np.concatenate([run.position_rad for run in runs])
    speed = np.concatenate([run.speed_rad_s for run in runs])
    rate = runs[0].sample_rate_hz
    time = np.arange(torque.size) / rate
    share = numbers[0] / max(len(session.runs) - 1, 1)
    plant = plant_of(machine, None if machine.load_inertia is not None else 1e-9 * machine.motor.inertia_kgm2)
    moved = learned_of(machine, plant, time, Demand(position, speed, np.zeros_like(speed)), share)
    top = float(np.max(np.abs(speed)))
    moved = moved._replace(smoothing=max(_SIGN_SHARE * top, 1e-12))
    steps = min(
        max(substeps(machine, plant, 1 / rate, top, share), _for_friction(moved, rate)), _MOST_SUBSTEPS
    )
    start, moving = float(position[0]), float(speed[0])
    state = learned.Masses(
        start, moving, start, moving, start, moving, 0.0, 0.0, moved.effects.torque_fade_start
    )  # a coupling finds its twist at once
    simulated = learned.run_driven(moved, torque, state, 0.0, 1 / rate, steps)[:, 0]
    error = float(np.sqrt(np.mean((simulated - position) ** 2)))
    return FreeRun(tuple(numbers), torque.size / rate, error, time, simulated)


def _for_friction(machine: learned.Learned, rate_hz: float) -> int:
    """Steps per sample that dry friction needs at the speed within which it changes sign."""
    e, plant = machine.effects, machine.plant
    level = max(e.coulomb_positive_nm, e.coulomb_negative_nm) + max(
        e.stribeck_rise_nm, e.local_friction_nm, 0.0
    )
    mass = plant.rotor_inertia
    if plant.rigid:
        mass += float(np.min(plant.inertia.coefficients[3]))
    return int(np.ceil(max(level, 0.0) / (machine.smoothing * mass * rate_hz * _BRAKING)))


def told(believed: Machine, learned_machine: Machine, session: Session) -> tuple[str, ...]:
    """One sentence for each recording that is long enough; none where the machines cannot be simulated."""
    if not _lasting(session):
        return ()
    try:
        before, after = free_runs(believed, session), free_runs(learned_machine, session)
    except InputError:
        return ()
    unit, scale = ("mm", 1e3) if session.axis == "linear" else ("rad", 1.0)
    torque = "force" if session.axis == "linear" else "torque"
    return tuple(
        f"driven by its recorded {torque} alone for {now.duration_s:.3g} s ({_runs(now)}), "
        f"the learned machine keeps to the recorded position within {scale * now.position_rms_rad:.3g} {unit} RMS, "
        f"the belief within {scale * then.position_rms_rad:.3g} {unit}"
        for then, now in list(zip(before, after, strict=True))[:_TOLD]
        if np.isfinite(now.position_rms_rad)
    )


def astray(machine: Machine, session: Session) -> float:
    """How far a machine goes astray over all recordings that are long enough (rms, rad or m); not a number: there are
    none, or it cannot be simulated."""
    try:
        driven = free_runs(machine, session)
    except InputError:
        return np.nan
    squares = sum(one.duration_s * one.position_rms_rad**2 for one in driven)
    return float(np.sqrt(squares / sum(one.duration_s for one in driven))) if driven else np.nan


def _lasting(session: Session) -> bool:
    return any(
        sum(len(session.runs[n]) / session.runs[n].sample_rate_hz for n in numbers) >= SHORTEST_S
        for numbers in _joined(session.runs)
    )


def _runs(driven: FreeRun) -> str:
    first, last = driven.runs[0], driven.runs[-1]
    return f"run {first}" if first == last else f"runs {first} to {last}"
