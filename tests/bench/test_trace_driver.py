"""The bench drive's own trace and generator through the driver: aligned, put back, and off on every way out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from driver_desk import connected, stroke

from schwung.errors import DriveError, DriveFaultError, InputError, SdoError, StateError
from schwung.fieldbus import tracing
from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.canopen.block import BlockUpload
from schwung.fieldbus.drive import Acquisition, Move, Setpoints, Sine, partial_recording
from schwung_sim.bench import Bench
from schwung_sim.drives.axis import GENERATOR_OFF

TRACED = Acquisition(
    "csp", 1000.0, sampling="trace", injecting="generator", trace_rate_hz=2000.0, trace_s=0.5
)
OWN = [(0x2100, 1), (0x2100, 2), (0x2100, 3), (0x2100, 4), (0x2200, 1), (0x2200, 2), (0x2200, 3)]


@contextmanager
def tracing_drive(acquisition: Acquisition = TRACED, **options: Any) -> Iterator[tuple[Bench, CanopenDrive]]:
    """Bench and driver, enabled for a trace."""
    with connected(**options) as (bench, drive):
        drive.write(drive.setup(acquisition))
        drive.start(acquisition)
        drive.enable()
        yield bench, drive


def there(sine: Sine | None = None, rest: int = 100, **changes: Any) -> Setpoints:
    """A rest, then half a radian there and back within 0.4 s."""
    path = np.concatenate([np.zeros(rest), stroke(400).position_rad])
    return Setpoints(1000.0, path, np.zeros(path.size), generator=sine, **changes)


def own_values(drive: CanopenDrive) -> list[object]:
    return [drive.read(drive.parameter(*key)).raw for key in OWN]


def generating(bench: Bench) -> bool:
    """By what the axis does, not by what the object says."""
    return bool(bench.axis._c["generator_control"] != GENERATOR_OFF)


def test_the_trace_is_aligned_to_the_motions_start_to_its_sample() -> None:
    with tracing_drive() as (bench, drive):
        setpoints = there()
        recording = drive.play(setpoints)
        assert recording.sampling == "trace"
        assert recording.sample_rate_hz == 2000.0
        assert recording.lost.size == 0
        assert recording.start_s == pytest.approx(0.1)
        due = np.arange(setpoints.position_rad.size) / 1000.0
        time = recording.start_s + np.arange(recording.position_rad.size) / 2000.0
        assert time[-1] == pytest.approx(due[-1])
        demand = np.interp(time, due, setpoints.position_rad)
        count = bench.axis.settings.encoder_counts
        assert recording.position_demand_rad == pytest.approx(demand, abs=2e-5 + 2 * np.pi / count)
        later = np.interp(time - 0.5e-3, due, setpoints.position_rad)
        assert np.max(np.abs(recording.position_demand_rad - later)) > 1e-3  # a sample off would be seen


def test_a_trace_and_sync_see_one_and_the_same_motion() -> None:
    """Twice from the same seed, once sampled by SYNC and once by the trace, at the rate of SYNC."""
    setpoints = there()
    by_sync = Acquisition("csp", 1000.0)
    with tracing_drive(by_sync, seed=3) as (_, drive):
        sampled = drive.play(setpoints)
    by_trace = Acquisition("csp", 1000.0, sampling="trace", trace_rate_hz=1000.0, trace_s=0.5)
    with tracing_drive(by_trace, seed=3) as (_, drive):
        traced = drive.play(setpoints)
    begin = 1 + round(traced.start_s * 1000)  # what setpoint k commands, SYNC k + 1 samples
    rows = sampled.position_rad.size - begin
    assert np.max(np.abs(traced.position_rad[:rows] - sampled.position_rad[begin:])) < 1e-4
    assert np.max(np.abs(traced.torque_nm[:rows] - sampled.torque_nm[begin:])) < 1.0
    assert np.array_equal(traced.torque_added_nm, np.zeros(traced.torque_added_nm.size))


def test_setpoints_of_torque_are_told_beside_a_trace_as_the_drive_held_them() -> None:
    acquisition = Acquisition("csp", 1000.0, sampling="trace", trace_rate_hz=8000.0, trace_s=0.5)
    with tracing_drive(acquisition) as (bench, drive):
        path = there().position_rad
        added = 20.0 * np.sin(2 * np.pi * 50.0 * np.arange(path.size) / 1000.0)
        recording = drive.play(Setpoints(1000.0, path, added))
        seen = bench.axis.trace.torque_added_nm  # from each instant on; ours is up to it
        assert recording.torque_added_nm[1:400] == pytest.approx(seen[:399], abs=1e-6)
        assert np.ptp(recording.torque_added_nm) > 35.0


def test_a_move_of_the_drives_own_starts_the_trace_too() -> None:
    acquisition = Acquisition(
        "pp", 1000.0, sampling="trace", injecting="generator", trace_rate_hz=8000.0, trace_s=0.4
    )
    with tracing_drive(acquisition) as (_, drive):
        still = np.zeros(500)
        setpoints = Setpoints(1000.0, still, still, (Move(100, 0.5, 5.0, 50.0),), Sine(50.0, 20.0))
        recording = drive.play(setpoints)
        assert recording.start_s == pytest.approx(0.1)
        assert recording.position_demand_rad[0] == pytest.approx(0.0, abs=1e-4)
        early = np.arange(0, 320) / 8000.0  # 0.04 s of acceleration
        assert recording.position_demand_rad[:320] == pytest.approx(25.0 * early**2, abs=2e-5)
        assert recording.position_demand_rad[-1] == pytest.approx(0.5, abs=1e-4)


def test_a_generator_that_was_on_before_has_settled_and_one_from_the_motion_has_its_phase() -> None:
    with tracing_drive() as (_, drive):
        before = drive.play(there(Sine(50.0, 20.0)))
        still = before.torque_added_nm  # the trace's own column: the phase is the drive's
        assert np.ptp(still) == pytest.approx(40.0, rel=0.02)
        fitted = drive.play(there(Sine(50.0, 20.0, 1.0, from_motion=True)))
        time = np.arange(fitted.torque_added_nm.size) / 2000.0
        assert fitted.torque_added_nm == pytest.approx(20.0 * np.sin(2 * np.pi * 50.0 * time + 1.0), abs=1e-6)
        # and that is what the drive did: the torque at the very start jumps by as much
        plain = drive.play(there())
        jump = fitted.torque_nm[1:5] - plain.torque_nm[1:5]
        assert np.all(jump > 0.5 * 20.0 * np.sin(1.0))


def test_parameters_are_as_before_and_the_journal_is_told_of_them() -> None:
    with connected() as (bench, drive):
        before = own_values(drive)
        changed = drive.setup(TRACED)
        told = {(p.index, p.subindex) for p in drive.passed_through(changed)}
        old = {v.parameter: drive.read(v.parameter) for v in changed}
        assert {(0x2100, 1), (0x2100, 2), (0x2100, 3), (0x2100, 4)} <= told
        drive.write(changed)
        drive.start(TRACED)
        drive.enable()
        armed = own_values(drive)
        drive.play(there(Sine(47.0, 10.0, 0.5)))
        assert own_values(drive) == armed
        assert not generating(bench)
        drive.disable()
        drive.stop()
        drive.write(list(old.values()))
        assert own_values(drive) == before
        drive.setup(Acquisition("csp", 1000.0))
        assert not any(p.index == 0x2100 for p in drive.passed_through([]))


def test_what_nobody_looks_at_is_not_read_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def not_read(self: BlockUpload) -> bytes:
        raise AssertionError("read all the same")

    with tracing_drive() as (bench, drive):
        monkeypatch.setattr(BlockUpload, "run", not_read)
        assert drive.play(there(recorded=False)).sampling == "sync"
        assert bench.axis.trace_status == 0


def _interrupt(done: int, total: int) -> None:
    if 400 < done < total:
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("fault", "progress", "expected"),
    [
        ("emcy=0x4310@on+0.4", None, DriveFaultError),
        ("following-error@on+0.3", None, DriveFaultError),
        ("turn-around=0.0005", _interrupt, KeyboardInterrupt),  # slow enough to be interrupted
    ],
)
def test_trouble_in_the_motion_stops_the_generator_and_keeps_the_trace_so_far(
    fault: str, progress: Callable[[int, int], None] | None, expected: type[BaseException]
) -> None:
    acquisition = Acquisition(
        "csp", 1000.0, sampling="trace", injecting="generator", trace_rate_hz=2000.0, trace_s=2.0
    )
    path = 0.5 * (1 - np.cos(2 * np.pi * np.arange(2000) / 2000.0))
    with tracing_drive(acquisition, faults=fault) as (bench, drive):
        setpoints = Setpoints(
            1000.0, np.concatenate([np.zeros(100), path]), np.zeros(2100), generator=Sine(50.0, 20.0)
        )
        with pytest.raises(expected) as raised:
            drive.play(setpoints, progress)
        assert not generating(bench)
        assert bench.axis.trace_status == 0
        partial = partial_recording(raised.value)
        assert partial is not None
        assert partial.sampling == "trace"
        came = partial.position_rad.size - partial.lost.size
        assert 20 < came < partial.position_rad.size
        assert np.all(np.isfinite(partial.torque_nm[:came]))
        assert partial.lost[0] == came


def test_an_interrupt_while_the_trace_is_read_leaves_what_sync_sampled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(self: BlockUpload) -> bytes:
        raise KeyboardInterrupt

    with tracing_drive() as (bench, drive):
        monkeypatch.setattr(BlockUpload, "run", interrupted)
        with pytest.raises(KeyboardInterrupt) as raised:
            drive.play(there(Sine(50.0, 20.0)))
        partial = partial_recording(raised.value)
        assert partial is not None
        assert partial.sampling == "sync"
        assert partial.lost.size == 0
        assert not generating(bench)


def test_halt_from_another_thread_silences_the_generator() -> None:
    acquisition = Acquisition(
        "csp", 1000.0, sampling="trace", injecting="generator", trace_rate_hz=1000.0, trace_s=20.0
    )
    path = 0.5 * (1 - np.cos(2 * np.pi * np.arange(20_000) / 20_000))
    with tracing_drive(acquisition) as (bench, drive):
        drive.clock.later(0.2, drive.halt)
        with pytest.raises(StateError, match="halt"):
            drive.play(Setpoints(1000.0, path, np.zeros(path.size), generator=Sine(50.0, 20.0)))
        assert not generating(bench)
        assert abs(bench.axis.speed_rad_s) < 0.1


def test_a_drive_that_loses_the_bus_is_left_with_what_sync_sampled() -> None:
    with tracing_drive(faults="bus-off@on+0.3") as (_, drive):
        drive._sdo.timeout_s = 0.05
        with pytest.raises(DriveError) as raised:
            drive.play(there(Sine(50.0, 20.0), rest=2000))
        partial = partial_recording(raised.value)
        assert partial is not None
        assert partial.sampling == "sync"


def test_a_trace_that_is_not_full_in_time_says_so_and_counts_as_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    with tracing_drive() as (bench, drive):
        rows_of = tracing.rows_of
        monkeypatch.setattr(tracing, "rows_of", lambda seconds, rate: 3 * rows_of(seconds, rate))
        recording = drive.play(there(Sine(50.0, 20.0)))
        assert bench.axis.trace_status == 0
        total, lost = recording.position_rad.size, recording.lost.size
        assert total / 3 <= total - lost < 0.6 * total
        assert recording.notes[-1] == f"the trace holds {total - lost} of {total} samples"
        assert np.all(np.isnan(recording.position_rad[recording.lost]))


def test_a_trace_that_the_motion_does_not_start_is_no_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    with tracing_drive() as (bench, drive):
        monkeypatch.setattr(bench.axis, "arm_trace", lambda *_: None)
        with pytest.raises(
            StateError, match=r'trace did not start with the motion \(it is "idle"\)'
        ) as raised:
            drive.play(there(Sine(50.0, 20.0)))
        assert not generating(bench)
        partial = partial_recording(raised.value)
        assert partial is not None
        assert partial.sampling == "sync"


def test_a_generator_that_cannot_be_set_is_refused_before_anything_moves() -> None:
    with tracing_drive() as (bench, drive):
        for sine, words in (
            (Sine(50.0, 1e-4), "too small"),
            (Sine(50.0, 1e6), "2100:01"),
            (Sine(5e4, 10.0), "2100:02"),
        ):
            with pytest.raises((InputError, SdoError), match=words):
                drive.play(there(sine))
            assert abs(bench.axis.position_rad) < 1e-3
            assert not generating(bench)
        assert drive.play(there()).lost.size == 0
