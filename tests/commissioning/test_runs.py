"""A trace as a run: its clock, its injection, its demand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from commissioning_drive import DeskDrive, believed_machine

from schwung.commissioning import LimitWishes, Plan
from schwung.commissioning.limits import limits_of
from schwung.commissioning.plan import PlannedRun, make_plan, setpoints_of
from schwung.commissioning.runs import following_error, run_of
from schwung.errors import InputError
from schwung.fieldbus.drive import Recording, SyncTiming
from schwung.fieldbus.profile import load_profile
from schwung.motion import Array

PROFILE = load_profile("schwung-bench")
RATE = 8000.0


def _plan(**changes: Any) -> Plan:
    drive = DeskDrive(believed_machine())
    arguments: dict[str, Any] = {
        "start_position_rad": 0.5, "distance_rad": np.pi, "duration_s": 0.25, "sampling": "trace",
        "injecting": "generator", "trace": PROFILE.trace, "generator": PROFILE.generator,
    }  # fmt: skip
    return make_plan(
        drive.machine, limits_of(LimitWishes(), drive.limits(), drive.machine), **arguments | changes
    )


def _excited(plan: Plan, number: int = 0) -> PlannedRun:
    return [run for run in plan.runs() if run.role == "excited"][number]


def _recording(
    planned: PlannedRun, plan: Plan, start_s: float, added: Array | None = None, **more: Any
) -> Recording:
    """A drive without any following error; `added` NaN where the drive does not tell."""
    rows = round((planned.motion.total_s - start_s) * RATE) + 1
    time = start_s + np.arange(rows) / RATE
    position = plan.start_position_rad + planned.motion.demand(time).position_rad
    columns: dict[str, Any] = {
        "position_rad": position, "speed_rad_s": np.zeros(rows), "torque_nm": np.zeros(rows),
        "position_demand_rad": np.full(rows, np.nan),
        "torque_added_nm": np.full(rows, np.nan) if added is None else added[:rows],
    }  # fmt: skip
    return Recording(
        sample_rate_hz=RATE, sync_count=np.arange(rows), receive_time_s=np.full(rows, np.nan),
        statusword=np.full(rows, -1), lost=np.array([], dtype=np.int64), timing=SyncTiming("lockstep", 1e-3, 0, 0, 0),
        start_s=start_s, sampling="trace", **columns | more,
    )  # fmt: skip


def test_a_trace_from_the_motions_start_has_its_time_0_there() -> None:
    plan = _plan()
    planned = next(plan.runs())
    run = run_of(_recording(planned, plan, planned.motion.start_time_s), planned, plan, "drive")
    assert run.time_s[0] == 0.0
    assert run.motion is not None
    assert run.motion.start_time_s == 0.0
    assert run.motion.duration_s == planned.motion.duration_s
    assert run.sample_rate_hz == RATE
    error = following_error(run)
    assert error is not None
    assert np.max(np.abs(error)) < 1e-9


@pytest.mark.parametrize("late_s", [-0.02, 0.001])
def test_a_trace_that_begins_earlier_or_later_keeps_the_demand_in_place(late_s: float) -> None:
    """Earlier: time 0 is row 0. Later, as where a smooth start stays below one count: 0 is the motion's start."""
    plan = _plan()
    planned = next(plan.runs())
    run = run_of(_recording(planned, plan, planned.motion.start_time_s + late_s), planned, plan, "drive")
    assert run.motion is not None
    assert run.time_s[0] == pytest.approx(max(late_s, 0.0), abs=1e-12)
    assert run.motion.start_time_s == pytest.approx(max(-late_s, 0.0), abs=1e-12)
    error = following_error(run)
    assert error is not None
    assert np.max(np.abs(error)) < 1e-9


def test_the_demand_of_a_drives_own_profile_is_known_where_it_is_traced() -> None:
    plan = _plan(mode="pp")
    planned = next(plan.runs())
    start = planned.motion.start_time_s
    untold = _recording(planned, plan, start)
    assert run_of(untold, planned, plan, "drive").position_demand_rad is None
    told = _recording(planned, plan, start, position_demand_rad=untold.position_rad + 0.25)
    error = following_error(run_of(told, planned, plan, "drive"))
    assert error == pytest.approx(np.full(untold.position_rad.size, 0.25))


def test_the_phase_of_a_generator_that_was_on_before_is_what_the_trace_shows() -> None:
    plan = _plan(frequency_hz=50.0, amplitude_nm=20.0)
    planned = _excited(plan)
    seen = np.round(20.0 * np.sin(2 * np.pi * 50.0 * np.arange(9999) / RATE + 4.0) / 0.07) * 0.07 + 1.5
    run = run_of(_recording(planned, plan, planned.motion.start_time_s, seen), planned, plan, "drive")
    assert run.excitation is not None
    assert run.excitation.phase_rad == pytest.approx(4.0, abs=1e-3)
    assert run.excitation.ramp_s is run.excitation.end_s is run.excitation.hold_s is None
    assert "notes" not in run.extra
    weak = run_of(_recording(planned, plan, planned.motion.start_time_s, 0.5 * seen), planned, plan, "drive")
    assert "made 10 N·m of the 20 asked for" in weak.extra["notes"][0]


def test_a_phase_that_nobody_knows_is_said_to_be_unknown() -> None:
    plan = _plan()
    planned = _excited(plan)
    run = run_of(_recording(planned, plan, planned.motion.start_time_s), planned, plan, "drive")
    assert run.torque_added_nm is None
    assert run.excitation is not None
    assert run.excitation.model_dump()["phase_known"] is False
    assert "phase" in run.extra["notes"][0]


def test_a_generator_that_starts_with_the_motion_has_the_phase_that_was_set() -> None:
    plan = _plan(phases=4)
    for number in range(4):
        planned = _excited(plan, number)
        run = run_of(_recording(planned, plan, planned.motion.start_time_s), planned, plan, "drive")
        sine = setpoints_of(planned, plan).generator
        assert sine is not None
        assert sine.from_motion
        assert run.excitation is not None
        turn = run.excitation.phase_rad - number * np.pi / 2
        assert np.cos(turn) == pytest.approx(1.0, abs=1e-9)


def test_an_injection_by_setpoints_is_turned_back_and_cut_before_it_fades() -> None:
    plan = _plan(injecting="setpoints", frequency_hz=50.0, mode="csp")
    planned = _excited(plan)
    start = planned.motion.start_time_s
    assert planned.excitation is not None
    assert planned.excitation.end_s is not None
    time = np.arange(9999) / RATE
    run = run_of(
        _recording(planned, plan, start, planned.excitation.torque(start + time)), planned, plan, "drive"
    )
    assert run.excitation is not None
    assert run.torque_added_nm is not None
    assert run.torque_added_nm == pytest.approx(run.excitation.torque(run.time_s), abs=1e-9)
    assert run.time_s[-1] == pytest.approx(planned.excitation.end_s - 2 / 50.0 - start, abs=1.01 / RATE)
    reference = next(plan.runs())
    alike = run_of(_recording(reference, plan, start), reference, plan, "drive")
    assert len(alike) == len(run)


def test_sampled_by_sync_a_running_generator_leaves_the_phase_unknown() -> None:
    plan = _plan(sampling="sync", mode="csp")
    planned = _excited(plan)
    rows = 400
    recording = Recording(
        sample_rate_hz=1000.0, sync_count=np.arange(rows), receive_time_s=np.zeros(rows),
        statusword=np.zeros(rows, int),
        position_rad=np.zeros(rows), speed_rad_s=np.zeros(rows), torque_nm=np.zeros(rows),
        position_demand_rad=np.zeros(rows), torque_added_nm=np.zeros(rows), lost=np.array([], dtype=np.int64),
        timing=SyncTiming("lockstep", 1e-3, 0, 0, 0),
    )  # fmt: skip
    run = run_of(recording, planned, plan, "drive")
    assert run.torque_added_nm is None
    assert run.excitation is not None
    assert run.excitation.model_dump()["phase_known"] is False
    together = _plan(sampling="sync", mode="csp", phases=4)
    run = run_of(recording, _excited(together, 1), together, "drive")
    assert run.torque_added_nm is not None
    assert run.excitation is not None
    before = run.time_s < together.motion.start_time_s - 1e-9
    assert not np.any(run.torque_added_nm[before])
    assert run.torque_added_nm[~before][0] == pytest.approx(
        together.excitation.amplitude_nm
    )  # a cosine from there


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"trace_rate_hz": 250.0}, r"--trace-rate.*5\.0 samples a period"),
        ({"injecting": "setpoints", "trace_rate_hz": 800.0}, r"--trace-rate.*steps at 1000 Hz"),
    ],
)
def test_a_trace_too_slow_for_what_is_injected_is_refused(wishes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        _plan(frequency_hz=50.0, **wishes)


def test_the_generators_frequency_is_one_that_it_can_make() -> None:
    assert PROFILE.generator is not None
    plan = _plan(frequency_hz=47.12345)
    assert plan.excitation.frequency_hz == pytest.approx(47.123)
    assert plan.acquisition.trace_rate_hz == RATE
    assert plan.acquisition.trace_s == pytest.approx(plan.motion.total_s - plan.motion.start_time_s)
