"""A recording as a run of a session: its clock, what was commanded, what was injected."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from schwung.commissioning.plan import Plan, PlannedRun
from schwung.fieldbus.drive import Recording
from schwung.motion import Array, Excitation, Motion
from schwung.session import Run

#: A generator whose amplitude is off by more than this share is worth a note.
SAME_AMPLITUDE = 0.05


@dataclass(frozen=True)
class TraceClock:
    """The time of a run whose row 0 is a trace's: the motion's start, or row 0 where that was earlier."""

    first_s: float  # of row 0
    back_s: float  # the run's time 0, on the clock of the setpoints
    motion: Motion


def trace_clock(motion: Motion, start_s: float) -> TraceClock:
    """See TraceClock; `start_s`: when row 0 was sampled, on the clock of the setpoints."""
    back = min(start_s, motion.start_time_s)
    moved = motion.model_copy(update={"start_time_s": motion.start_time_s - back})
    return TraceClock(start_s - back, back, moved)


def turned_back(excitation: Excitation, back_s: float) -> Excitation:
    """The injection on a clock whose 0 is `back_s` later, where it has settled: no ramp, no end."""
    phase = excitation.phase_rad + 2 * math.pi * excitation.frequency_hz * back_s
    return excitation.model_copy(update={"phase_rad": phase % (2 * math.pi), "ramp_s": None, "end_s": None})


def injected_fully_until(planned: PlannedRun, plan: Plan) -> float:
    """When the plan's injection begins to fade, on the clock of the setpoints (s); reference runs end there, too."""
    excitation = planned.excitation or plan.excitation_of(planned.motion)
    return math.inf if excitation.end_s is None else excitation.end_s - (excitation.ramp_s or 0.0)


def run_of(recording: Recording, planned: PlannedRun, plan: Plan, speed_source: str) -> Run:
    """The recording as a run. Raises InputError where it holds what no run may (a session's own checks)."""
    if recording.sampling == "trace":
        return _traced(recording, planned, plan, speed_source)
    return _by_sync(recording, planned, plan, speed_source)


def _by_sync(recording: Recording, planned: PlannedRun, plan: Plan, speed_source: str) -> Run:
    """Time 0 is the SYNC after the one that took the first setpoint.

    A drive that takes setpoint k at SYNC k has reached it one period later, when SYNC k+1 samples it; so the run
    holds what SYNC k+1 sampled beside what was commanded with SYNC k, and its injected sine is that of `excitation`.
    """
    actual, commanded = slice(1, None), slice(None, -1)
    position = recording.position_rad[actual]
    demand = recording.position_demand_rad[commanded] if plan.acquisition.mode == "csp" else None
    speed, extra = _speed(recording.speed_rad_s[actual], position, recording.sample_rate_hz)
    time = np.arange(position.size) / recording.sample_rate_hz
    added: Array | None = recording.torque_added_nm[commanded]
    excitation, said = planned.excitation, list[str]()
    if excitation is not None and plan.acquisition.injecting == "generator":
        clock = trace_clock(planned.motion, 0.0)
        excitation, said = injection_of(planned, plan, clock, time, np.full(time.size, np.nan))
        started = time >= planned.motion.start_time_s
        added = None
        if excitation is not None and plan.generator_starts_with_motion:
            added = np.where(started, excitation.torque(time), 0.0)
    return Run(
        role=planned.role,
        repeat=planned.repeat,
        sample_rate_hz=recording.sample_rate_hz,
        time_s=time,
        position_rad=position,
        speed_rad_s=speed,
        torque_nm=recording.torque_nm[actual],
        position_demand_rad=demand,
        torque_added_nm=added,
        motion=planned.motion,
        excitation=excitation,
        extra=_extra(recording, speed_source, said) | extra,
    )


def _traced(recording: Recording, planned: PlannedRun, plan: Plan, speed_source: str) -> Run:
    """Time 0 is the motion's start, or the trace's first sample where that was earlier; what was planned for earlier
    is turned back as far. The end is where the injection begins to fade."""
    rate, clock = recording.sample_rate_hz, trace_clock(planned.motion, recording.start_s)
    end = (injected_fully_until(planned, plan) - recording.start_s) * rate + 1e-6
    kept = slice(None, int(end) + 1 if math.isfinite(end) else None)
    position, added = recording.position_rad[kept], recording.torque_added_nm[kept]
    time = clock.first_s + np.arange(position.size) / rate
    demand: Array | None = recording.position_demand_rad[kept]
    if not np.all(
        np.isfinite(recording.position_demand_rad[kept])
    ):  # a drive's own profile is not known to the sample
        planned_rad = plan.start_of(planned) + clock.motion.demand(time).position_rad
        demand = planned_rad if plan.acquisition.mode == "csp" else None
    speed, extra = _speed(recording.speed_rad_s[kept], position, rate)
    excitation, said = injection_of(planned, plan, clock, time, added)
    return Run(
        role=planned.role,
        repeat=planned.repeat,
        sample_rate_hz=rate,
        time_s=time,
        position_rad=position,
        speed_rad_s=speed,
        torque_nm=recording.torque_nm[kept],
        position_demand_rad=demand,
        torque_added_nm=added if np.all(np.isfinite(added)) else None,
        motion=clock.motion,
        excitation=excitation,
        extra=_extra(recording, speed_source, said)
        | extra
        | {"sampling": "trace", "trace_start_s": recording.start_s},
    )


def injection_of(
    planned: PlannedRun, plan: Plan, clock: TraceClock, time: Array, added: Array
) -> tuple[Excitation | None, list[str]]:
    """What was injected, on the run's clock; and what has to be said about it.

    A generator that was on before has a phase that only the trace can tell. Where it does not, `phase_known` is false.
    """
    wanted = planned.excitation
    if wanted is None:
        return None, []
    if plan.acquisition.injecting == "setpoints":
        return turned_back(wanted, clock.back_s), []
    if plan.generator_starts_with_motion:
        turn = 2 * math.pi * wanted.frequency_hz * clock.motion.start_time_s
        return wanted.model_copy(update={"phase_rad": (wanted.phase_rad - turn) % (2 * math.pi)}), []
    if not np.all(np.isfinite(added)):
        unknown = {"phase_rad": 0.0, "phase_known": False}
        return wanted.model_copy(update=unknown), ["the generator's phase at the motion's start is not known"]
    turning = np.exp(-2j * math.pi * wanted.frequency_hz * time)
    columns = np.column_stack([turning.real, -turning.imag, np.ones(time.size)])  # cos, sin, 1
    cosine, sine, _ = np.linalg.lstsq(columns, added, rcond=None)[0]
    amplitude, phase = float(np.hypot(cosine, sine)), float(np.arctan2(cosine, sine))
    notes = []
    if abs(amplitude / wanted.amplitude_nm - 1) > SAME_AMPLITUDE:
        notes.append(f"the generator made {amplitude:.3g} N·m of the {wanted.amplitude_nm:.3g} asked for")
    return wanted.model_copy(update={"phase_rad": phase % (2 * math.pi)}), notes


def _speed(reported: Array, position: Array, rate: float) -> tuple[Array, dict[str, Any]]:
    """The speed as reported, or that of the position where the drive has none: nothing was lost."""
    if not np.all(np.isnan(reported)):
        return reported, {}
    return np.gradient(position, 1 / rate), {"speed_origin": "derived from position"}


def _extra(recording: Recording, speed_source: str, said: Sequence[str] = ()) -> dict[str, Any]:
    notes = [*recording.notes, *said]
    return {
        "sync_timing": asdict(recording.timing),
        "speed_source": speed_source,
        **({"notes": notes} if notes else {}),
    }


def following_error(run: Run) -> Array | None:
    """Demand minus position at the same instants (rad), (n,), see `run_of`; None where no demand was recorded."""
    return None if run.position_demand_rad is None else run.position_demand_rad - run.position_rad


def following_error_rms(run: Run) -> float | None:
    """RMS of the following error over the run (rad); None where no demand was recorded."""
    error = following_error(run)
    return None if error is None else float(np.sqrt(np.mean(error**2)))


def on_trace_clock(run: Run, planned: PlannedRun, plan: Plan) -> Run:
    """A run as simulated over the whole motion, as a trace would have recorded it: from the motion's start on."""
    start = planned.motion.start_time_s
    clock = trace_clock(planned.motion, start)
    kept = (run.time_s >= start - 1e-9) & (run.time_s <= injected_fully_until(planned, plan) + 1e-9)
    excitation = planned.excitation and turned_back(planned.excitation, start)
    return replace(
        run,
        time_s=run.time_s[kept] - start,
        position_rad=run.position_rad[kept],
        speed_rad_s=run.speed_rad_s[kept],
        torque_nm=run.torque_nm[kept],
        torque_added_nm=None if run.torque_added_nm is None else run.torque_added_nm[kept],
        motion=clock.motion,
        excitation=excitation,
    )
