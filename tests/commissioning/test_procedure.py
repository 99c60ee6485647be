"""The procedure on a drive without a bus: what is recorded, and every way out."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from commissioning_drive import DeskDrive, Silence, believed_machine

from schwung.commissioning import ParameterJournal, Plan, read_backup
from schwung.commissioning.plan import LimitWishes, limits_of, make_plan
from schwung.commissioning.preflight import Preflight, preflight, survey
from schwung.commissioning.procedure import Recorded, following_error_rms, record
from schwung.drivetrain import FeedForward
from schwung.errors import (
    DriveError,
    InterruptedByUser,
    NodeLostError,
    RefusedError,
    SampleLossError,
    SdoError,
)
from schwung.session import read_session


@pytest.fixture
def drive() -> DeskDrive:
    return DeskDrive(believed_machine())


def _plan(drive: DeskDrive, duration_s: float = 0.25) -> Plan:
    limits = limits_of(LimitWishes(), drive.limits(), drive.machine)
    return make_plan(
        drive.machine, limits, start_position_rad=0.0, distance_rad=np.pi, duration_s=duration_s, repeats=1
    )


def _ready(drive: DeskDrive, plan: Plan) -> Preflight:
    return preflight(plan, drive.machine, survey(drive, plan), FeedForward(speed_share=1.0))


def _record(drive: DeskDrive, folder: Path, observer: Silence | None = None) -> Recorded:
    plan = _plan(drive)
    return record(
        drive, plan, _ready(drive, plan), session_path=folder / "session.h5",
        journal=ParameterJournal(drive, folder / "setup.backup.json", drive.describe()),
        observer=observer or Silence(),
    )  # fmt: skip


def test_a_good_run_leaves_the_drive_as_it_was(drive: DeskDrive, tmp_path: Path) -> None:
    before = dict(drive.objects)
    recorded = _record(drive, tmp_path)
    assert [run.role for run in recorded.runs] == ["reference", "excited"]
    assert drive.objects == before
    assert drive.calls[-5:-3] == ["disable", "stop"]
    assert "halt" not in drive.calls
    session = read_session(tmp_path / "session.h5")
    assert [run.role for run in session.runs] == ["reference", "excited"]
    assert session.runs[0].excitation is None
    assert session.runs[1].excitation is not None


def test_nothing_is_written_where_preflight_says_stop(drive: DeskDrive, tmp_path: Path) -> None:
    plan = _plan(drive, duration_s=0.08)  # takes more torque than there is
    ready = _ready(drive, plan)
    journal = ParameterJournal(drive, tmp_path / "setup.backup.json", {})
    with pytest.raises(RefusedError, match="preflight"):
        record(drive, plan, ready, session_path=tmp_path / "s.h5", journal=journal, observer=Silence())
    assert drive.calls == []
    assert not (tmp_path / "s.h5").exists()


@pytest.mark.parametrize("error", [NodeLostError("node 3", "is gone"), RuntimeError("a defect of ours")])
def test_any_failure_in_mid_motion_halts_restores_and_keeps_what_was_recorded(
    drive: DeskDrive, tmp_path: Path, error: Exception
) -> None:
    before = dict(drive.objects)

    def fail_in_the_second(number: int) -> None:
        if number == 1:
            raise error

    drive.before_play = fail_in_the_second
    with pytest.raises(type(error)):
        _record(drive, tmp_path)
    assert drive.calls.index("halt") < drive.calls.index("disable")
    assert drive.objects == before
    assert len(read_session(tmp_path / "session.h5").runs) == 1


def test_ctrl_c_halts_and_says_what_is_on_disk(drive: DeskDrive, tmp_path: Path) -> None:
    def interrupt(number: int) -> None:
        if number == 1:
            raise KeyboardInterrupt

    drive.before_play = interrupt
    with pytest.raises(InterruptedByUser, match=r"1 of 2 motions are in .*session\.h5"):
        _record(drive, tmp_path)
    assert "halt" in drive.calls
    assert read_backup(tmp_path / "setup.backup.json").restored is not None


def test_where_parameters_cannot_be_put_back_the_remedy_is_named(drive: DeskDrive, tmp_path: Path) -> None:
    def cut_the_cable(number: int) -> None:
        drive.unwritable.add((0x6060, 0))
        raise NodeLostError("node 3", "is gone")

    drive.before_play = cut_the_cable
    with pytest.raises(NodeLostError) as caught:
        _record(drive, tmp_path)
    assert any("schwung restore" in note for note in caught.value.__notes__)
    assert read_backup(tmp_path / "setup.backup.json").restored is None


def test_a_good_run_whose_parameters_cannot_be_put_back_is_an_error(drive: DeskDrive, tmp_path: Path) -> None:
    def forget(number: int) -> None:
        drive.unwritable.add((0x1017, 0))

    drive.before_play = forget
    with pytest.raises(DriveError, match="schwung restore") as caught:
        _record(drive, tmp_path)
    assert not isinstance(caught.value, SdoError)


def test_a_motion_with_lost_samples_is_made_again_and_the_gap_is_never_bridged(
    drive: DeskDrive, tmp_path: Path
) -> None:
    drive.lost = {0: [300, 301]}
    observer = Silence()
    recorded = _record(drive, tmp_path, observer)
    assert recorded.retries == 1
    assert any("2 of" in note and "SYNC 300" in note for note in observer.notes)
    assert np.all(np.isfinite(recorded.runs[0].position_rad))
    with h5py.File(tmp_path / "session.h5") as file:
        assert file["partial/0000/position"].shape == (299,)  # time 0 is the second sample
        assert len(file["run"]) == 2


def test_a_bus_that_keeps_losing_samples_is_given_up(drive: DeskDrive, tmp_path: Path) -> None:
    drive.lost = {number: [5 + number] for number in range(9)}
    with pytest.raises(SampleLossError, match="3 motions in a row"):
        _record(drive, tmp_path)
    assert drive.plays == 3
    assert "halt" in drive.calls


def test_uneven_sync_is_refused_in_words(drive: DeskDrive, tmp_path: Path) -> None:
    drive.jitter_s = 0.2e-3
    with pytest.raises(DriveError, match=r"0\.20 ms.*of a 1 ms period"):
        _record(drive, tmp_path)
    assert "halt" in drive.calls


def test_following_error_compares_demand_and_position_of_one_instant(
    drive: DeskDrive, tmp_path: Path
) -> None:
    run = _record(drive, tmp_path).runs[0]
    assert run.position_demand_rad is not None
    assert run.motion is not None
    assert run.position_demand_rad == pytest.approx(run.motion.demand(run.time_s).position_rad)
    error = run.position_demand_rad - run.position_rad
    assert following_error_rms(run) == pytest.approx(np.sqrt(np.mean(error**2)))
