"""Runs that move a machine, and the proposals that come before them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.api.computing import load_machine
from schwung.api.responses import with_bode
from schwung.api.stages import (
    MAX_JITTER_SHARE,
    BodeWishes,
    LimitWishes,
    Prepared,
    PreparedBode,
    Simulated,
    Wishes,
    prepare,
    prepare_bode,
    rechecked,
    record_bode,
    record_prepared,
    require_there,
    settings_of,
)
from schwung.errors import InputError
from schwung.service.jobs import Task
from schwung.service.work.computing import estimate_session, fit_bode_session, session_summary

#: Points of a predicted curve that is sent to a page.
_CURVE_POINTS = 600


@dataclass(frozen=True, eq=False)
class Planned:
    """What a commissioning will play."""

    prepared: Prepared
    machine_id: str


def plan(task: Task) -> Mapping[str, Any]:
    """See PlanRequest."""
    asked = task.request
    machine_id = _machine_of(task)
    machine = load_machine(task.store.machine_path(machine_id))
    wishes = Wishes(
        distance_rad=asked.distance_rad,
        duration_s=asked.duration_s,
        limits=LimitWishes(**asked.limits.model_dump()),
        kind=asked.profile_kind,
        returns=asked.returns,
        mode=asked.mode,
        sampling=asked.sampling,
        injecting=asked.injecting,
        sample_rate_hz=asked.sample_rate_hz,
        trace_rate_hz=asked.trace_rate_hz,
        frequency_hz=asked.frequency_hz,
        amplitude_nm=asked.amplitude_nm,
        repeats=asked.repeats,
        phases=asked.phases,
        also_s=tuple(asked.also_s),
        max_jitter_share=(
            MAX_JITTER_SHARE if asked.max_jitter_s is None else asked.max_jitter_s * asked.sample_rate_hz
        ),
        misses_allowed=asked.misses_allowed,
    )
    if asked.bode_run_id is not None:
        bode_run = task.store.run(asked.bode_run_id)
        use = with_bode(task.store.run_folder(bode_run.id), wishes, machine)
        wishes, machine = use.wishes, use.machine
    task.phase("Reading the drive, simulating the motion")
    found = task.connect()
    prepared = prepare(found.drive, found.profile, machine, wishes)
    document = plan_document(prepared)
    made = task.proposals.add(
        "commission", task.drive_record.id, document, Planned(prepared, machine_id), machine_id
    )
    return made.to_json()


def commission(task: Task) -> Mapping[str, Any]:
    """See CommissionRequest."""
    made = task.proposals.take(task.request.proposal_id, "commission", task.request.digest)
    planned: Planned = made.content
    task.phase("Looking at the drive again")
    drive = task.connect().drive
    prepared = rechecked(drive, planned.prepared)
    prepared.preflight.require()
    task.warm()
    kept = record_prepared(drive, prepared, task.folder, task, prepared.max_jitter_share)
    summary = task.compute(session_summary, session=kept.session_path)
    session = task.store.add_session(task.run, summary)
    found = task.compute(
        estimate_session,
        session=kept.session_path,
        machine=task.store.machine_path(planned.machine_id),
        folder=task.folder,
        beside=_beside(prepared),
    )
    estimate = task.store.add_estimate(task.run, session.id, found["verdict"], found["document"])
    return {
        "session_id": session.id, "estimate_id": estimate.id, "verdict": found["verdict"],
        "digest": made.digest, "retries": kept.recorded.retries,
    }  # fmt: skip


def _beside(prepared: Prepared) -> dict[str, Any]:
    checks = [vars(check) for check in prepared.preflight.checks]
    return {"plan": settings_of(prepared.plan), "preflight": checks}


@dataclass(frozen=True, eq=False)
class BodePlanned:
    """What a measurement of the frequency response will play, and the stroke that its proposal shall be for."""

    prepared: PreparedBode
    machine_id: str
    distance_rad: float | None
    duration_s: float


def propose_bode(task: Task) -> Mapping[str, Any]:
    """See ProposeBodeRequest."""
    asked, machine_id = task.request, _machine_of(task)
    wishes = BodeWishes(
        angles_rad=tuple(asked.angles_rad),
        limits=LimitWishes(**asked.limits.model_dump()),
        waveform=asked.waveform,
        amplitude_nm=asked.amplitude_nm,
        lowest_hz=asked.lowest_hz,
        highest_hz=asked.highest_hz,
        periods=asked.periods,
        repeats=asked.repeats,
        sample_rate_hz=asked.sample_rate_hz,
    )
    task.phase("Reading the drive, simulating the motions")
    found = task.connect()
    prepared = prepare_bode(
        found.drive, found.profile, load_machine(task.store.machine_path(machine_id)), wishes
    )
    checked = prepared.preflight
    document = {
        "machine": prepared.machine.name,
        "angles_rad": list(asked.angles_rad),
        "waveform": asked.waveform,
        "motions": len(prepared.runs),
        "duration_s": prepared.duration_s,
        **settings_of(prepared.plan),
        "checks": [vars(check) for check in checked.checks],
        "can_start": not checked.stops,
        "predicted": {"reference": _predicted(checked.reference), "excited": _predicted(checked.excited)},
    }
    content = BodePlanned(prepared, machine_id, asked.distance_rad, asked.duration_s)
    return task.proposals.add("bode", task.drive_record.id, document, content, machine_id).to_json()


def bode(task: Task) -> Mapping[str, Any]:
    """See BodeRequest."""
    made = task.proposals.take(task.request.proposal_id, "bode", task.request.digest)
    planned: BodePlanned = made.content
    prepared = planned.prepared
    prepared.preflight.require()
    drive = task.connect().drive
    require_there(drive, prepared.plan, prepared.survey)
    task.warm()
    kept = record_bode(drive, prepared, task.folder, task)
    session = task.store.add_session(task.run, task.compute(session_summary, session=kept.session_path))
    found = task.compute(
        fit_bode_session, session=kept.session_path, machine=task.store.machine_path(planned.machine_id),
        folder=task.folder, torque_max_nm=prepared.plan.limits.torque_max_nm, distance_rad=planned.distance_rad,
        duration_s=planned.duration_s,
    )  # fmt: skip
    return {"session_id": session.id, "digest": made.digest, "bode": found}


def _machine_of(task: Task) -> str:
    machine_id: str | None = task.request.machine_id or task.drive_record.machine_id
    if machine_id is None:
        raise InputError("machine_id", "is missing, and the drive has none", "Name the machine.")
    return machine_id


def plan_document(prepared: Prepared) -> dict[str, Any]:
    """A plan as people confirm it: what is played, within which limits, what is expected of it, and the checks."""
    plan, checked = prepared.plan, prepared.preflight
    return {
        "machine": prepared.machine.name,
        "motion": plan.motion.model_dump(mode="json"),
        "excitation": plan.excitation.model_dump(mode="json"),
        "repeats": plan.repeats,
        "phases": plan.phases,
        "also_s": [motion.duration_s for motion in plan.slower],
        "motions": len(tuple(plan.runs())),
        "duration_s": plan.duration_s,
        **settings_of(plan),
        "checks": [vars(check) for check in checked.checks],
        "can_start": not checked.stops,
        "creep": checked.creep.text if checked.creep is not None else None,
        "predicted": {"reference": _predicted(checked.reference), "excited": _predicted(checked.excited)},
    }


def _predicted(simulated: Simulated) -> dict[str, Any]:
    """Travel, speed and torque, thinned for a picture; the peaks are those of all samples."""
    step = max(1, simulated.time_s.size // _CURVE_POINTS)
    return {
        "travel_rad": [float(np.min(simulated.position_rad)), float(np.max(simulated.position_rad))],
        "peak_speed_rad_s": simulated.peak_speed_rad_s,
        "peak_torque_nm": simulated.peak_torque_nm,
        "peak_following_error_rad": simulated.peak_following_error_rad,
        "time_s": simulated.time_s[::step].tolist(),
        "position_rad": simulated.position_rad[::step].tolist(),
        "speed_rad_s": simulated.speed_rad_s[::step].tolist(),
        "torque_nm": simulated.torque_nm[::step].tolist(),
    }
