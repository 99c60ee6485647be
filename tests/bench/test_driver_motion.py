"""The driver against the simulated drive: parameters, state transitions, motion and samples."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import numpy as np
import pytest
from driver_desk import NODE, bench_and_bus, connected, enabled, stroke

from schwung.commissioning import ParameterJournal, restore_backup
from schwung.errors import DriveFaultError, InputError, SdoError, StateError
from schwung.fieldbus.canopen import CanopenDrive, match_profile, scan_bus
from schwung.fieldbus.canopen.block import BlockError, BlockUpload
from schwung.fieldbus.drive import Acquisition, Guard, Move, Parameter, ParameterValue, Setpoints
from schwung.fieldbus.profile import load_profile

CSP = Acquisition("csp", 1000.0)


def test_scan_finds_the_drive_and_its_profile_and_changes_nothing() -> None:
    with bench_and_bus(seed=77, clock="sync") as (bench, bus):
        before = dict(bench.servo.dictionary.values)
        (found,) = scan_bus(bus, range(1, 20))
        assert (found.node_id, found.vendor_id, found.serial) == (NODE, 0x53574E47, 77)
        assert found.profiles == ("schwung-bench",)
        assert found.cia402 == "Switch on disabled"
        missing = {capability.name for capability in found.capabilities if not capability.available}
        assert missing == {"disturbance buffer", "harmonic feed-forward"}
        assert dict(bench.servo.dictionary.values) == before
        assert match_profile(bus, NODE).family == "schwung-bench"


def test_units_and_limits_are_the_drives_own() -> None:
    with connected() as (_, drive):
        resolution, limits = drive.resolution(), drive.limits()
        assert resolution.position_rad == pytest.approx(2 * np.pi / 2**20)
        assert resolution.speed_rad_s == pytest.approx(1e-3 * 2 * np.pi / 60)
        assert resolution.torque_nm == pytest.approx(0.07)
        assert limits.rated_torque_nm == pytest.approx(70.0)
        assert limits.torque_max_nm == pytest.approx(233.0, abs=0.1)
        assert limits.speed_max_rad_s == pytest.approx(6000 * 2 * np.pi / 60)


def test_the_same_drive_serves_by_standard_objects_alone() -> None:
    with enabled(family="generic-cia402", sync="thread", rate_hz=200.0) as (_, drive):
        recording = drive.play(stroke(100, 200.0))
        assert np.nanmax(recording.position_rad) == pytest.approx(0.5, abs=0.01)


def test_set_up_is_complete_and_writing_back_restores_everything() -> None:
    with connected() as (bench, drive):
        before = dict(bench.servo.dictionary.values)
        wanted = drive.setup(CSP)
        old = [drive.read(value.parameter) for value in wanted]
        drive.write(wanted)
        assert drive.setup(CSP) == []
        drive.write(old)
        assert dict(bench.servo.dictionary.values) == before


def test_a_part_of_the_pdo_objects_is_written_by_the_whole_dance() -> None:
    """What a backup holds of a PDO may be one entry: the others stay."""
    with connected() as (_, drive):
        drive.write(drive.setup(CSP))
        entry = drive.parameter(0x1A00, 3)
        drive.write([ParameterValue(entry, 0x60740010)])
        assert drive.read(entry).raw == 0x60740010
        assert drive.read(drive.parameter(0x1A00, 0)).raw == 3
        assert drive.read(drive.parameter(0x1A00, 1)).raw == 0x60410010
        assert drive.read(drive.parameter(0x1800, 1)).raw == 0x40000180 + NODE  # enabled again


@pytest.mark.parametrize("writes", [3, 6, 9, 12])
def test_a_set_up_that_is_cut_short_anywhere_is_put_back_by_its_backup(
    writes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the drive has the wanted COB-ID and count already, and only an entry between is another."""
    with connected() as (bench, drive):
        drive.write([ParameterValue(drive.parameter(0x1A00, 3), 0x60740010)])
        before = dict(bench.servo.dictionary.values)
        done, parameters = [], drive._parameters
        write_one = parameters._write_one

        def killed(value: ParameterValue) -> None:
            done.append(value)
            if len(done) > writes:
                raise KeyboardInterrupt
            write_one(value)

        monkeypatch.setattr(parameters, "_write_one", killed)
        path = tmp_path / "setup.backup.json"
        with pytest.raises(KeyboardInterrupt):
            ParameterJournal(drive, path, drive.describe()).change(drive.setup(CSP))
        monkeypatch.undo()
        restore_backup(drive, path)
        assert dict(bench.servo.dictionary.values) == before


def test_the_drive_keeps_the_limits_of_an_acquisition_by_itself() -> None:
    limits = Guard(-0.5, 0.25, 70.0, 0.05)
    with connected() as (bench, drive):
        acquisition = Acquisition("csp", 1000.0, guard=limits)
        drive.write(drive.setup(acquisition))
        told = drive.limits()
        assert (told.position_min_rad, told.position_max_rad) == pytest.approx((-0.5, 0.25), abs=1e-5)
        assert (told.torque_max_nm, told.following_error_rad) == pytest.approx((70.0, 0.05), abs=1e-5)
        drive.start(acquisition)
        drive.enable()
        recording = drive.play(stroke(2000, distance_rad=0.26))
        assert np.max(recording.position_rad) == pytest.approx(0.25, abs=2e-3)  # 607D holds the target back
        with pytest.raises(DriveFaultError, match="8611"):
            drive.play(Setpoints(1000.0, np.full(500, recording.position_rad[-1]), np.full(500, 69.0)))
        assert bench.servo.settle(2.0)


def test_a_motion_starts_from_rest_even_where_the_last_one_still_swings() -> None:
    """At 1 rad of the two-mass machine the loop rings for a tenth of a second: two motions shall be alike."""
    with enabled() as (_, drive):
        drive.play(Setpoints(1000.0, np.linspace(0, 0.01, 10), np.zeros(10)))
        recordings = []
        for _ in range(2):
            time_s = np.arange(300) / 1000
            path = 0.01 + np.where(time_s < 0.2, 0.0, 0.2 * (time_s - 0.2))
            recordings.append(drive.play(Setpoints(1000.0, path, np.zeros(300))))
            drive.play(Setpoints(1000.0, path[::-1].copy(), np.zeros(300)))
        assert np.max(np.abs(recordings[0].speed_rad_s[:50])) < 0.2
        assert np.max(np.abs(recordings[1].speed_rad_s[:50])) < 0.2


def test_pdos_cannot_be_changed_while_they_run() -> None:
    with enabled() as (_, drive), pytest.raises(StateError, match="exchanges PDOs"):
        drive.write([ParameterValue(drive.parameter(0x1A00, 3), 0x60740010)])


def test_a_drive_that_is_not_set_up_does_not_start() -> None:
    with connected() as (bench, drive):
        with pytest.raises(StateError, match="not set up"):
            drive.start(CSP)
        assert not bench.servo.power.energised


def test_motion_follows_and_every_sync_is_a_row() -> None:
    with enabled() as (_, drive):
        setpoints = stroke(1500)
        recording = drive.play(setpoints)
        assert recording.position_rad.size == 1500
        assert recording.lost.size == 0
        assert np.array_equal(np.diff(recording.sync_count), np.ones(1499))
        assert np.all(np.diff(recording.receive_time_s) >= 0)
        assert np.all(recording.statusword & 0x6F == 0x27)
        assert recording.position_demand_rad == pytest.approx(setpoints.position_rad, abs=1e-5)
        assert np.max(np.abs(recording.position_rad - setpoints.position_rad)) < 0.02
        assert recording.timing.max_s < 1e-6  # but for the rounding of a date
        speed = np.gradient(setpoints.position_rad) * 1000
        assert np.max(np.abs(recording.speed_rad_s - speed)) < 0.3


def test_sample_k_answers_sync_k_and_setpoint_k_takes_effect_at_sync_k() -> None:
    """By the standard a sample shows the instant of SYNC: the injected torque of setpoint k shows in sample k + 1."""
    with enabled() as (_, drive):
        added = np.zeros(200)
        added[100:] = 7.0
        recording = drive.play(Setpoints(1000.0, np.zeros(200), added))
        assert np.max(np.abs(recording.torque_nm[:101])) < 1.0
        assert np.max(recording.torque_nm[101:103]) > 3.0
        assert recording.torque_added_nm == pytest.approx(added, abs=0.04)


def test_lockstep_is_faster_than_real_time() -> None:
    """In processor time, which other load hardly changes; benchmarks/bus.py has the figures on the wall clock."""
    with enabled() as (_, drive):
        drive.play(stroke(500))
        began = time.process_time()
        drive.play(stroke(3000))
        assert time.process_time() - began < 1.5


def test_motions_follow_each_other_and_progress_is_told() -> None:
    told: list[tuple[int, int]] = []
    with enabled() as (_, drive):
        for _ in range(3):
            recording = drive.play(stroke(400), lambda done, total: told.append((done, total)))
            assert recording.lost.size == 0
        assert told[-1] == (400, 400)
        drive.disable()
        assert drive.state().cia402 == "Switch on disabled"
        drive.stop()
        drive.start(CSP)
        drive.enable()
        assert drive.play(stroke(100)).lost.size == 0


def test_profile_position_makes_its_own_trapezoid_and_leaves_its_dynamics_as_they_were() -> None:
    moves = (Move(50, 1.0, 6.0, 60.0), Move(500, 0.0, 6.0, 60.0))
    with enabled(mode="pp") as (_, drive):
        speed = drive.read(drive.parameter(0x6081)).raw
        recording = drive.play(Setpoints(1000.0, np.zeros(900), np.zeros(900), moves))
        assert np.max(np.abs(recording.position_rad[:50])) < 1e-3
        assert recording.position_rad[450] == pytest.approx(1.0, abs=0.01)
        assert recording.position_rad[-1] == pytest.approx(0.0, abs=0.01)
        assert np.max(recording.speed_rad_s) == pytest.approx(6.0, rel=0.1)
        assert drive.read(drive.parameter(0x6081)).raw == speed


@pytest.mark.parametrize(
    ("setpoints", "kind", "words"),
    [
        (stroke(100, begin_rad=0.5), StateError, "first setpoint"),
        (stroke(100, rate_hz=500.0), StateError, "1000 Hz"),
        (Setpoints(1000.0, np.array([0.0, np.nan]), np.zeros(2)), InputError, "finite"),
        (Setpoints(1000.0, np.array([0.0, 1e9]), np.zeros(2)), InputError, "607A"),
        (Setpoints(1000.0, np.zeros(2), np.array([0.0, 1e5])), InputError, "60B2"),
        (Setpoints(1000.0, np.zeros(0), np.zeros(0)), InputError, "empty"),
    ],
)
def test_setpoints_that_cannot_be_played_are_refused_before_anything_moves(
    setpoints: Setpoints, kind: type[Exception], words: str
) -> None:
    with enabled() as (bench, drive):
        with pytest.raises(kind, match=words):
            drive.play(setpoints)
        assert abs(bench.axis.position_rad) < 1e-3


def test_playing_needs_an_enabled_drive() -> None:
    with connected() as (_, drive):
        with pytest.raises(StateError, match="start first"):
            drive.play(stroke(100))
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        with pytest.raises(StateError, match="Switch on disabled"):
            drive.play(stroke(100))


def test_a_wrong_node_or_profile_is_refused_with_a_remedy(tmp_path_factory: pytest.TempPathFactory) -> None:
    with bench_and_bus() as (bench, bus):
        profile = load_profile("schwung-bench")
        with pytest.raises(InputError, match=r"node 9.*does not answer") as raised:
            CanopenDrive(bus, 9, profile, sdo_timeout_s=0.05)
        assert "scan" in raised.value.remedy
        assert profile.identity is not None
        other = profile.model_copy(
            update={"identity": profile.identity.model_copy(update={"product_code": 1})}
        )
        with pytest.raises(InputError, match="product code is 0x00000402"):
            CanopenDrive(bus, NODE, other)
        assert not bench.servo.power.energised


def test_an_eds_of_another_drive_is_refused(tmp_path: Path) -> None:
    profile = load_profile("schwung-bench")
    text = profile.eds_path.read_text()
    assert "ProductNumber=0x00000402" in text
    (tmp_path / profile.eds).write_text(text.replace("ProductNumber=0x00000402", "ProductNumber=7"))
    with bench_and_bus() as (_, bus), pytest.raises(InputError, match=r"product code \(EDS\)"):
        CanopenDrive(bus, NODE, profile.model_copy(update={"folder": tmp_path}))


def test_a_domain_is_read_by_block_transfer_or_else_by_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: BlockUpload) -> bytes:
        raise BlockError("the CRC is wrong")

    with enabled() as (_, drive):
        trace = drive.parameter(0x2200, 4)
        drive.write(
            [ParameterValue(drive.parameter(0x2200, 2), 100), ParameterValue(drive.parameter(0x2200, 3), 1)]
        )
        drive.play(stroke(400))
        by_block = drive.read(trace).raw
        assert isinstance(by_block, bytes)
        assert len(by_block) == 1600
        monkeypatch.setattr(BlockUpload, "run", broken)
        assert drive.read(trace).raw == by_block


def test_an_sdo_abort_is_told_in_words() -> None:
    with connected() as (_, drive):
        with pytest.raises(SdoError, match=r"0x6064:00 .*read-only"):
            drive.write([ParameterValue(drive.parameter(0x6064), 0)])
        with pytest.raises(SdoError, match="does not exist"):
            drive.read(Parameter(0x5FFF, 0, "UNSIGNED32", "nothing"))
        with pytest.raises(InputError, match=r"schwung-bench\.eds"):
            drive.parameter(0x5FFF)


def test_several_threads_may_read_at_once() -> None:
    with connected(interface="virtual") as (_, drive):
        wrong: list[object] = []

        def reader(index: int, expected: object) -> None:
            for _ in range(40):
                raw = drive.read(drive.parameter(index, 1)).raw
                if raw != expected:
                    wrong.append(raw)

        pairs = [(0x1018, 0x53574E47), (0x608F, 2**20), (0x6091, 1)]
        threads = [threading.Thread(target=reader, args=pair) for pair in pairs]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10)
        assert wrong == []


@pytest.mark.parametrize("clock", ["wall", "sync"])
@pytest.mark.parametrize("sync", ["thread", "auto"])
def test_the_rate_is_kept(clock: str, sync: str) -> None:
    with enabled(rate_hz=200.0, sync=sync, clock=clock) as (_, drive):
        began = drive.clock.now()
        recording = drive.play(stroke(200, 200.0))
        assert drive.clock.now() - began == pytest.approx(1.0, abs=0.1)
        assert recording.timing.producer == "thread"
        assert recording.timing.period_s == pytest.approx(0.005, rel=1e-6)
        assert recording.lost.size == 0
        assert np.max(np.abs(recording.position_rad - recording.position_demand_rad)) < 0.05


def test_a_drive_that_stalls_answers_late_and_no_sample_is_taken_for_another() -> None:
    with enabled(sync="lockstep", clock="sync") as (bench, drive):
        undisturbed = drive.play(stroke(400))
        begin = bench.servo.syncs

        def stall_once() -> None:
            if bench.servo.syncs == begin + 200:
                drive.clock.sleep(0.15)  # longer than the driver waits for an answer

        bench.servo.on_advance = stall_once
        recording = drive.play(stroke(400))
        assert any("after the following SYNC" in note for note in recording.notes)
        assert recording.lost.size == 0
        after = slice(210, 390)
        speed = np.gradient(undisturbed.position_rad)[after]
        off = (recording.position_rad - undisturbed.position_rad)[after]
        assert abs(np.dot(speed, off) / np.dot(speed, speed)) < 0.2  # samples by which the two are shifted
