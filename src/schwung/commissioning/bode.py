"""Frequency responses through the drive: hold at each angle, inject, record, move on slowly, come back.

The same set-up, way out, journal and recording as for commissioning (`procedure.record`); only the runs differ.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from schwung.commissioning.bode_excitation import (
    MAX_DEVIATION_RAD,
    BodeWishes,
    excitations_of,
    grid_of,
)
from schwung.commissioning.checks import Check, share_check
from schwung.commissioning.commission import KeptSession, control_of, read_gains, settings_of
from schwung.commissioning.creep import creep_of
from schwung.commissioning.guarding import guard_checks, guard_of, hardest_stop, travel_of
from schwung.commissioning.journal import Change, ParameterJournal
from schwung.commissioning.limits import Limits, limits_of
from schwung.commissioning.plan import AMPLITUDE_SHARE, Plan, PlannedRun, believed_inertia_range
from schwung.commissioning.preflight import Preflight, simulated_run
from schwung.commissioning.procedure import Observer, Recorded, record
from schwung.commissioning.survey import Survey, bus_checks, drive_checks, survey
from schwung.commissioning.ways import MAX_JITTER_SHARE
from schwung.drivetrain import FeedForward, Machine, Simulated, anti_resonance_hz, resonance_hz
from schwung.drivetrain.gains import with_control
from schwung.errors import InputError
from schwung.estimation.bode import fit_bode
from schwung.estimation.bode_values import BodeFit
from schwung.estimation.response import SETTLE_S, measured_responses
from schwung.fieldbus.drive import Acquisition, Drive
from schwung.fieldbus.profile import DeviceProfile
from schwung.motion import Array, Excitation, Motion
from schwung.session import Session, read_session

#: Between angles: shares of the speed limit and of the torque limit, and the rest before and after (s).
_SLOW_SPEED, _SLOW_TORQUE, _REST_S = 0.1, 0.1, 0.1
_SHORTEST_MOVE_S = 0.3
#: Peak speed and acceleration of the fifth-order polynomial over distance/duration and distance/duration².
_POLY5_SPEED, _POLY5_ACCELERATION = 1.875, 5.774
#: An angle nearer than this to where the axis stands needs no move (rad).
_THERE_RAD = 1e-4


@dataclass(frozen=True, eq=False)
class PreparedBode:
    """Everything known before the power stage is switched on."""

    plan: Plan
    runs: tuple[PlannedRun, ...]
    machine: Machine
    survey: Survey
    preflight: Preflight

    @property
    def duration_s(self) -> float:
        """Bus time of all runs."""
        return sum(run.motion.total_s for run in self.runs)


@dataclass(frozen=True, eq=False)
class MeasuredBode:
    """What was recorded and fitted, and where it lies."""

    prepared: PreparedBode
    session_path: Path
    session: Session
    recorded: Recorded
    fit: BodeFit
    changes: tuple[Change, ...]


def prepare_bode(drive: Drive, profile: DeviceProfile, machine: Machine, wishes: BodeWishes) -> PreparedBode:
    """Plan and check; reads the drive, changes nothing, moves nothing.

    Raises InputError where limits or beliefs are missing or a wish cannot be met; what preflight finds is in the
    result.
    """
    gains = read_gains(drive, profile)
    machine = with_control(machine, gains)
    limits = limits_of(wishes.limits, drive.limits(), machine)
    injected = profile.quantities.torque_added
    held = injected is None or injected.between_syncs == "held"
    grid = grid_of(machine, wishes)
    lines = grid.lines_hz
    excitations = excitations_of(machine, limits, wishes, grid, held)
    start = drive.state().position_rad
    runs = tuple(_runs(machine, limits, wishes.angles_rad, excitations, start))
    first = next(run for run in runs if run.excitation is not None)
    travel = travel_of(
        [(start if run.start_position_rad is None else run.start_position_rad, run.motion) for run in runs]
    )
    _, largest = believed_inertia_range(machine)
    guard = guard_of(machine, limits, [run.motion for run in runs], excitations, travel, largest)
    plan = Plan(
        motion=first.motion,
        excitation=excitations[0],
        repeats=wishes.repeats,
        acquisition=Acquisition(mode="csp", sample_rate_hz=wishes.sample_rate_hz, guard=guard),
        limits=limits,
        start_position_rad=start,
        reasons=tuple(_reasons(machine, wishes, excitations, lines)),
    )
    forward = FeedForward(speed_share=gains.get("speed_feed_forward", 0.0))
    seen = survey(drive, plan)
    creep = creep_of(plan, machine, seen.resolution)
    small = [] if creep is None else list(creep.motions(plan))
    simulated = [simulated_run(run, plan, machine, forward) for run in (*runs, *small)]
    checks = (
        *drive_checks(seen),
        *bus_checks(seen.bus_load),
        *guard_checks(guard, seen.limits, machine, hardest_stop(machine, limits, largest)),
        *_motion_checks(plan, simulated),
        *_band(machine, wishes.sample_rate_hz, lines),
        *([Check("creep", "ok", creep.text)] if creep is not None else []),
    )
    by_position = held or wishes.sample_rate_hz * seen.resolution.position_rad < seen.resolution.speed_rad_s
    source: Literal["position", "drive"] = "position" if by_position else "drive"
    ready = Preflight(checks, source, simulated[0], simulated[runs.index(first)], None, creep)
    return PreparedBode(plan, runs, machine, seen, ready)


def measure_bode(
    drive: Drive,
    prepared: PreparedBode,
    out: Path,
    observer: Observer,
    max_jitter_share: float = MAX_JITTER_SHARE,
) -> MeasuredBode:
    """Move, inject, record, fit. The session lies in `out` run by run; parameters are back when this returns.

    Raises RefusedError, DriveError, InterruptedByUser as `record` does, InputError where the recording allows no fit
    (it is kept).
    """
    kept = record_bode(drive, prepared, out, observer, max_jitter_share)
    observer.phase("Fitting the responses")
    session = read_session(kept.session_path)
    fit = fit_bode(measured_responses(session), prepared.machine)
    return MeasuredBode(prepared, kept.session_path, session, kept.recorded, fit, kept.changes)


def record_bode(
    drive: Drive,
    prepared: PreparedBode,
    out: Path,
    observer: Observer,
    max_jitter_share: float = MAX_JITTER_SHARE,
) -> KeptSession:
    """The part of `measure_bode` that needs the drive: move, inject, record; raises as `record` does."""
    path = out / "session.h5"
    journal = ParameterJournal(drive, out / "setup.backup.json", drive.describe())
    recorded = record(
        drive,
        prepared.plan,
        prepared.preflight,
        session_path=path,
        journal=journal,
        observer=observer,
        settings=settings_of(prepared.plan) | control_of(prepared.machine),
        max_jitter_share=max_jitter_share,
        runs=prepared.runs,
        source="schwung bode",
    )
    return KeptSession(path, recorded, journal.changes)


# ── where, and in which order ────────────────────────────────────────────────────────────────────────────────────


def _runs(
    machine: Machine, limits: Limits, angles: tuple[float, ...], excitations: list[Excitation], start: float
) -> Iterator[PlannedRun]:
    """To each angle and back to where it stood; moves are recorded as references, standstills as excited runs."""
    if not angles:
        raise InputError("--angles", "names none", "Give for instance --angles 0,90deg,180deg.")
    here, moves = start, 0
    _, largest = believed_inertia_range(machine)
    for angle in (*angles, None):
        target = start if angle is None else angle
        if abs(target - here) > _THERE_RAD:
            motion = _slow_move(machine, limits, target - here, largest)
            yield PlannedRun("reference", moves, motion, None, here)
            here, moves = target, moves + 1
        if angle is not None:
            for repeat, excitation in enumerate(excitations):
                length = (excitation.end_s or 0.0) + _REST_S
                still = Motion(  # there and back, by nothing
                    distance_rad=0.0, duration_s=length / 2, start_time_s=0.0, returns=True, dwell_s=0.0
                )
                yield PlannedRun("excited", repeat, still, excitation, here)


def _slow_move(machine: Machine, limits: Limits, distance: float, largest_kgm2: float) -> Motion:
    way = abs(distance)
    acceleration = _SLOW_TORQUE * limits.torque_max_nm / (machine.motor.inertia_kgm2 + largest_kgm2)
    duration = max(
        _SHORTEST_MOVE_S,
        _POLY5_SPEED * way / (_SLOW_SPEED * limits.speed_max_rad_s),
        math.sqrt(_POLY5_ACCELERATION * way / acceleration),
    )
    return Motion(
        kind="poly5",
        distance_rad=distance,
        duration_s=duration,
        start_time_s=_REST_S,
        returns=False,
        dwell_s=_REST_S + SETTLE_S,
    )


def _reasons(
    machine: Machine, wishes: BodeWishes, excitations: list[Excitation], lines: Array
) -> Iterable[str]:
    peak = max(e.amplitude_nm for e in excitations)
    what = "multisine" if wishes.waveform == "multisine" else "stepped sine"
    yield f"{what}, {lines.size} frequencies from {lines[0]:.3g} to {lines[-1]:.4g} Hz, up to {peak:.3g} N·m"
    if wishes.amplitude_nm is None:
        yield (
            f"amplitude: {AMPLITUDE_SHARE:.0%} of the torque limit, or less where the axis would leave its angle by "
            f"more than {MAX_DEVIATION_RAD:g} rad"
        )


# ── checks ───────────────────────────────────────────────────────────────────────────────────────────────────────


def _motion_checks(plan: Plan, simulated: list[Simulated]) -> Iterable[Check]:
    limits = plan.limits
    low = min(s.lowest_position_rad for s in simulated)
    high = max(s.highest_position_rad for s in simulated)
    inside = limits.position_min_rad <= low and high <= limits.position_max_rad
    yield Check(
        "room to move",
        "ok" if inside else "stop",
        f"{low:.4g} … {high:.4g} rad of {limits.position_min_rad:.4g} … {limits.position_max_rad:.4g} rad",
        "" if inside else "Choose other --angles, or widen the window if the machine allows it.",
    )
    torque = max(s.peak_torque_nm for s in simulated)
    clipped = any(bool(np.any(s.clipped)) for s in simulated)
    yield share_check(
        "torque",
        torque * (2 if clipped else 1),
        limits.torque_max_nm,
        f"up to {torque:.3g} of {limits.torque_max_nm:.3g} N·m{' and clipped' if clipped else ''}",
        "Inject less (--amplitude).",
    )
    speed = max(s.peak_speed_rad_s for s in simulated)
    yield share_check(
        "speed", speed, limits.speed_max_rad_s, f"up to {speed:.3g} of {limits.speed_max_rad_s:.3g} rad/s",
        "Inject less (--amplitude) or allow more (--max-speed).",
    )  # fmt: skip
    error = max(s.peak_following_error_rad for s in simulated)
    yield share_check(
        "following error", error, limits.following_error_rad,
        f"up to {error:.3g} of {limits.following_error_rad:.3g} rad",
        "Inject less (--amplitude), or widen 0x6065 in the drive.",
    )  # fmt: skip


def _band(machine: Machine, rate: float, lines: Array) -> Iterable[Check]:
    """What the rate lets us see of the believed machine."""
    if machine.coupling is None:
        return
    smallest, _ = believed_inertia_range(machine)
    low, high = float(anti_resonance_hz(machine, smallest)), float(resonance_hz(machine, smallest))
    top = float(lines[-1])
    if top > high:
        yield Check("band", "ok", f"up to {top:.0f} Hz: the believed resonance at {high:.0f} Hz is within it")
        return
    lost = "motor inertia and resonance" if top > low else "stiffness, damping and motor inertia"
    yield Check(
        "band",
        "warning",
        f"at {rate:g} Hz only {top:.0f} Hz can be reached; the believed anti-resonance reaches {low:.0f} Hz, the "
        f"resonance {high:.0f} Hz: {lost} will be uncertain",
        "Raise --rate if the bus allows it.",
    )
