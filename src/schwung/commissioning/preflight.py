"""Preflight: everything that can be known before the power stage is switched on, checked and put in words.

Pure: it looks at values that were read from the drive (`Survey`), never at the drive itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from schwung.commissioning.checks import COMFORT, Check, share_check
from schwung.commissioning.creep import Creep, creep_of
from schwung.commissioning.guarding import guard_checks, hardest_stop
from schwung.commissioning.plan import Plan, PlannedRun, believed_inertia_range
from schwung.commissioning.runs import on_trace_clock
from schwung.commissioning.survey import Survey, bus_checks, drive_checks
from schwung.drivetrain import FeedForward, Machine, Simulated, simulate
from schwung.errors import RefusedError, SchwungError
from schwung.estimation import Estimate, estimate
from schwung.fieldbus.drive import Resolution
from schwung.session import Run, Session

SpeedSource = Literal["drive", "position"]

#: The belief may be off: the motion is also simulated with this much more load inertia.
HEAVIER = 1.5
#: Counts per ripple amplitude below which a reported quantity is too coarse for the estimate.
MIN_RIPPLE_COUNTS = 20.0
#: An axis that the injection moves by more than this share of the stroke is no longer locally linear.
MAX_DEVIATION_SHARE = 0.05
#: Simulated instants per sample: torque clips and positions overshoot between samples, too.
FINER = 8


@dataclass(frozen=True, eq=False)
class Preflight:
    """The checks, and the simulated motions that they rest upon."""

    checks: tuple[Check, ...]
    speed_source: SpeedSource
    reference: Simulated
    excited: Simulated
    predicted: Estimate | None
    creep: Creep | None = None  # the small motions before the first stroke

    @property
    def stops(self) -> tuple[Check, ...]:
        """Checks that forbid the motion."""
        return tuple(check for check in self.checks if check.severity == "stop")

    def require(self) -> None:
        """Raise RefusedError naming the first stop (and how many more there are)."""
        if self.stops:
            first, more = self.stops[0], len(self.stops) - 1
            also = f" (and {more} more)" if more else ""
            raise RefusedError(f"preflight, {first.name}", first.text + also, first.remedy)


def preflight(
    plan: Plan,
    machine: Machine,
    seen: Survey,
    feed_forward: FeedForward | None = None,
    *,
    estimates: bool = True,
) -> Preflight:
    """Check a plan against the drive and against the simulated motion. Never raises for what it finds.

    `estimates`: the recording is going to be estimated from, so that it is tried on the simulated one.
    """
    every = [run for run in plan.runs() if run.repeat == 0]
    first = [run for run in every if run.motion == plan.motion]
    reference, *phases = (simulated_run(run, plan, machine, feed_forward) for run in first)
    excited = max(phases, key=lambda simulated: simulated.peak_torque_nm)
    back = plan.way_back(next(plan.runs()))
    others = [*(run for run in every if run.motion != plan.motion), *([back] if back else [])]
    creep = creep_of(plan, machine, seen.resolution)
    others += creep.motions(plan) if creep is not None else ()
    motions = (reference, *phases, *(simulated_run(run, plan, machine, feed_forward) for run in others))
    made = zip(first, (reference, *phases), strict=True)
    predicted = _predicted(plan, made, machine) if estimates else None
    source, resolution_checks = _resolution(plan, seen.resolution, reference, excited)
    checks = [
        *standing_checks(plan, machine, seen),
        *resolution_checks,
        *motion_checks(plan, motions),
        *_margin(plan, machine, motions, feed_forward),
        *(_trust(plan, reference, excited, predicted) if estimates else ()),
        *([Check("creep", "ok", creep.text)] if creep is not None else []),
    ]
    return Preflight(tuple(checks), source, reference, excited, predicted, creep)


def standing_checks(plan: Plan, machine: Machine, seen: Survey) -> Iterable[Check]:
    """What drive and bus have to be before any motion."""
    yield from drive_checks(seen, plan.acquisition)
    yield from bus_checks(seen.bus_load)
    yield from _guarded(plan, machine, seen)


def motion_checks(plan: Plan, motions: Sequence[Simulated]) -> Iterable[Check]:
    """Whether simulated motions keep the plan's limits."""
    yield from _room(plan, motions)
    yield from _torque_and_speed(plan, motions)
    yield from _following(plan, motions)


def simulated_run(
    run: PlannedRun, plan: Plan, machine: Machine, feed_forward: FeedForward | None, heavier: float = 1.0
) -> Simulated:
    """One run as the believed machine would make it, on a grid `FINER` times as fine as the samples."""
    time = run.motion.time(FINER * plan.grid_rate_hz)
    demand = run.motion.demand(time)
    inertia, added = None, None
    if heavier != 1.0:
        inertia = heavier * float(np.max(machine.load_inertia_at(plan.start_of(run) + demand.position_rad)))
    if run.excitation is not None:
        held, step = run.excitation.hold_s, FINER
        if held is not None:
            step = max(1, round(held * FINER * plan.grid_rate_hz))
        commanded_at = time[np.arange(time.size) // step * step] if held else time
        added = run.excitation.torque(commanded_at)
    if run.torque is not None:
        cycles = run.motion.time(plan.grid_rate_hz)
        cycle = np.minimum(
            np.arange(time.size) // FINER + 1, cycles.size - 1
        )  # held before the setpoint it is for
        added = (0.0 if added is None else added) + run.torque(run.motion, cycles)[cycle]
    return simulate(
        _limited(machine, plan),
        demand,
        time,
        torque_added_nm=added,
        feed_forward=feed_forward,
        inertia=inertia,
        start_rad=plan.start_of(run),
        hold_torque_added=True,
    )


def _limited(machine: Machine, plan: Plan) -> Machine:
    """The machine whose drive clips at the plan's torque limit, which may be below the motor's peak."""
    motor = machine.motor.model_copy(update={"peak_torque_nm": plan.limits.torque_max_nm})
    return machine.model_copy(update={"motor": motor})


def _predicted(
    plan: Plan, simulated: Iterable[tuple[PlannedRun, Simulated]], machine: Machine
) -> Estimate | None:
    """What the estimator would make of the simulated recording; None where it would refuse.

    By the method of the injection alone: it judges ripple and motion, and it answers at once.
    """
    runs = [sampled_run(planned, plan, made) for planned, made in simulated]
    method = "multiphase" if plan.phases > 1 else "denoised"
    try:
        return estimate(Session(tuple(runs), created="", source="simulated"), machine, method=method)
    except SchwungError:
        return None


def sampled_run(planned: PlannedRun, plan: Plan, simulated: Simulated) -> Run:
    """The simulated run as a drive reports it: angle and speed at SYNC, torque of the tick before it."""
    at_sync = slice(FINER, None, FINER)
    before_sync = slice(FINER - 1, -1, FINER)
    position, rate = simulated.position_rad[at_sync], plan.grid_rate_hz
    time = np.arange(position.size) / rate
    added = planned.excitation.torque(time) if planned.excitation else np.zeros(time.size)
    run = Run(
        role=planned.role,
        repeat=planned.repeat,
        sample_rate_hz=rate,
        time_s=time,
        position_rad=position,
        speed_rad_s=simulated.speed_rad_s[at_sync],
        torque_nm=simulated.torque_nm[before_sync],
        torque_added_nm=added,
        motion=planned.motion,
        excitation=planned.excitation,
    )
    return on_trace_clock(run, planned, plan) if plan.acquisition.sampling == "trace" else run


def _resolution(
    plan: Plan, resolution: Resolution, reference: Simulated, excited: Simulated
) -> tuple[SpeedSource, list[Check]]:
    """Is the ripple many counts high, and which speed shall be used: the reported one, or that of the position?"""
    ripple = float(np.max(np.abs(excited.speed_rad_s - reference.speed_rad_s)))
    reported = ripple / resolution.speed_rad_s if resolution.speed_rad_s > 0 else 0.0
    derived = ripple / (plan.recorded_rate_hz * resolution.position_rad)
    # held from sample to sample, averages over a period are wanted, which positions give
    held = plan.excitation.hold_s is not None and plan.acquisition.sampling == "sync"
    use_position = derived > reported or (held and derived >= MIN_RIPPLE_COUNTS)
    counts = derived if use_position else reported
    text = f"the ripple of {ripple:.3g} rad/s is {counts:.0f} counts high"
    if use_position:
        why = (
            "the injection is held between SYNCs"
            if held and derived <= reported
            else "the reported one is coarser"
        )
        text += f" in the speed derived from position ({why})"
    if counts >= MIN_RIPPLE_COUNTS:
        speed = Check("speed resolution", "note" if use_position and not held else "ok", text)
    else:
        remedy = "Inject more torque, or raise the drive's speed resolution (60A9)."
        speed = Check("speed resolution", "warning", text, remedy)
    return "position" if use_position else "drive", [speed, _torque_resolution(plan, resolution)]


def _torque_resolution(plan: Plan, resolution: Resolution) -> Check:
    """Is the injected amplitude many counts of the reported torque high?"""
    if not resolution.torque_nm > 0:  # NaN where nothing tells it
        remedy = "Give its scale in a profile that extends this one."
        return Check("torque resolution", "stop", "nobody tells what a count of torque is worth", remedy)
    counts = plan.excitation.amplitude_nm / resolution.torque_nm
    if counts < MIN_RIPPLE_COUNTS:
        text = f"the injected amplitude is {counts:.1f} counts high"
        return Check("torque resolution", "warning", text, "Inject more torque.")
    return Check("torque resolution", "ok", f"the injected amplitude is {counts:.0f} counts high")


def _guarded(plan: Plan, machine: Machine, seen: Survey) -> Iterable[Check]:
    if plan.acquisition.guard is None:
        return ()
    hardest = hardest_stop(machine, plan.limits, believed_inertia_range(machine)[1])
    return guard_checks(plan.acquisition.guard, seen.limits, machine, hardest)


def _room(plan: Plan, motions: Sequence[Simulated]) -> Iterable[Check]:
    limits = plan.limits
    low = min(float(s.position_rad.min()) for s in motions)
    high = max(float(s.position_rad.max()) for s in motions)
    text = (
        f"the simulated motion covers {low:.4g} … {high:.4g} rad, "
        f"the window is {limits.position_min_rad:.4g} … {limits.position_max_rad:.4g} rad"
    )
    inside = low >= limits.position_min_rad and high <= limits.position_max_rad
    remedy = "" if inside else "Move the axis, shorten or turn the stroke (--distance), or widen the window."
    yield Check("room to move", "ok" if inside else "stop", text, remedy)


def _torque_and_speed(plan: Plan, motions: Sequence[Simulated]) -> Iterable[Check]:
    limit = plan.limits.torque_max_nm
    peak = max(float(np.max(np.abs(s.torque_nm))) for s in motions)
    clipped = any(bool(np.any(s.clipped)) for s in motions)
    slower = "Take longer (--duration), inject less (--amplitude) or allow more (--max-torque)."
    yield Check(
        "torque",
        "stop" if clipped else "warning" if peak > COMFORT * limit else "ok",
        f"the simulated motion takes up to {peak:.3g} of {limit:.3g} N·m"
        + (" and is clipped" if clipped else ""),
        slower if peak > COMFORT * limit else "",
    )
    speed = max(float(np.max(np.abs(s.speed_rad_s))) for s in motions)
    speed_limit = plan.limits.speed_max_rad_s
    yield share_check(
        "speed",
        speed,
        speed_limit,
        f"up to {speed:.3g} of {speed_limit:.3g} rad/s",
        "Take longer (--duration) or allow more (--max-speed).",
    )


def _margin(
    plan: Plan, machine: Machine, motions: Sequence[Simulated], feed_forward: FeedForward | None
) -> Iterable[Check]:
    """Whether the torque would do for a load that is heavier than believed, too."""
    if any(bool(np.any(s.clipped)) for s in motions):
        return
    heavy = simulated_run(list(plan.runs())[1], plan, machine, feed_forward, HEAVIER)
    if np.any(heavy.clipped):
        yield Check(
            "torque margin",
            "warning",
            f"with {HEAVIER:g} times the believed load inertia the torque would be clipped",
            "Start with a longer motion if the belief is a guess.",
        )


def _following(plan: Plan, motions: Sequence[Simulated]) -> Iterable[Check]:
    limit = plan.limits.following_error_rad
    worst = max(float(np.max(np.abs(s.following_error_rad))) for s in motions)
    yield share_check(
        "following error",
        worst,
        limit,
        f"up to {worst:.3g} of {limit:.3g} rad",
        "Take longer (--duration), inject less (--amplitude), or widen 0x6065 in the drive.",
    )


def _trust(
    plan: Plan, reference: Simulated, excited: Simulated, predicted: Estimate | None
) -> Iterable[Check]:
    stroke = abs(plan.motion.distance_rad)
    deviation = float(np.max(np.abs(excited.position_rad - reference.position_rad)))
    if deviation > MAX_DEVIATION_SHARE * stroke:
        yield Check(
            "linearity",
            "warning",
            f"the injection moves the axis by {deviation:.3g} rad, {deviation / stroke:.1%} of the stroke",
            "Inject less or at a higher frequency.",
        )
    if predicted is None:
        yield Check(
            "predicted trust",
            "warning",
            "the estimator cannot use the simulated recording",
            "Check frequency and amplitude against the believed machine.",
        )
        return
    trust = predicted.trust
    dpr = f", DPR {trust.dpr:.3f}" if trust.dpr is not None else ""
    yield Check(
        "predicted trust",
        "ok" if trust.verdict == "good" else "warning",
        f"{trust.verdict}: MIV {trust.miv_kgm2:.3g} kg·m²{dpr}, deviation {deviation:.2g} rad",
        "" if trust.verdict == "good" else "; ".join(trust.reasons),
    )
