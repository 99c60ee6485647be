"""The procedure on a drive without a bus: what is recorded, and every way out."""

import contextlib
import signal
from pathlib import Path

import h5py
import numpy as np
import pytest
from commissioning_drive import CREEP_PLAYS, DeskDrive, Silence, believed_machine

from schwung.commissioning import ParameterJournal, Plan, read_backup
from schwung.commissioning.limits import LimitWishes, limits_of
from schwung.commissioning.plan import make_plan
from schwung.commissioning.preflight import Preflight, preflight
from schwung.commissioning.procedure import Recorded, record
from schwung.commissioning.runs import following_error_rms
from schwung.commissioning.survey import survey
from schwung.drivetrain import FeedForward
from schwung.errors import (
    CoastingError,
    DriveError,
    EnergisedError,
    InterruptedByUser,
    NodeLostError,
    RefusedError,
    SampleLossError,
    SdoError,
    StateError,
)
from schwung.fieldbus.drive import DriveState, Progress, Recording, Setpoints
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
    """Without what is estimated from the simulated recording: most of its time, and no matter of the procedure."""
    seen = survey(drive, plan)
    return preflight(plan, drive.machine, seen, FeedForward(speed_share=1.0), estimates=False)


def _record(
    drive: DeskDrive, folder: Path, observer: Silence | None = None, plan: Plan | None = None
) -> Recorded:
    plan = plan or _plan(drive)
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


#: What interrupts; Windows has no SIGHUP.
SIGNALS = [signal.Signals[n] for n in ("SIGINT", "SIGTERM", "SIGHUP") if n in signal.Signals.__members__]
CALLS = ["write 6060=8", "write 1016=8323372", "write 1017=100", "start", "enable", *["play"] * (CREEP_PLAYS + 2),
         "disable", "stop", "write 1017=0", "write 1016=0", "write 6060=1"]  # fmt: skip


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("first", range(len(CALLS)))
def test_signals_at_any_time_and_again_and_again_end_with_a_drive_that_is_off_and_as_it_was(
    drive: DeskDrive, tmp_path: Path, first: int, number: signal.Signals
) -> None:
    before = dict(drive.objects)
    handlers = [signal.getsignal(n) for n in SIGNALS]
    drive.on_call = lambda call: signal.raise_signal(number) if call >= first else None
    with pytest.raises(InterruptedByUser):
        _record(drive, tmp_path)
    assert drive.objects == before
    off = [call for call in drive.calls if not call.startswith("write")]
    assert off[-2:] == ["disable", "stop"]
    assert drive.calls[: first + 1] == CALLS[: first + 1]
    assert read_backup(tmp_path / "setup.backup.json").restored is not None
    assert [signal.getsignal(n) for n in SIGNALS] == handlers


def test_a_ctrl_c_that_python_dropped_stops_the_motion(drive: DeskDrive, tmp_path: Path) -> None:
    """What is raised in a finaliser, or when a weak reference goes, is printed, and forgotten."""

    def interrupt(number: int) -> None:
        if number == 0:
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)

    drive.before_play = interrupt
    with pytest.raises(InterruptedByUser):
        _record(drive, tmp_path)
    assert drive.calls.count("play") == CREEP_PLAYS + 1
    assert "halt" in drive.calls


@pytest.mark.posix
def test_a_hang_up_that_is_ignored_stays_ignored(drive: DeskDrive, tmp_path: Path) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # nohup
    try:
        drive.on_call = lambda call: signal.raise_signal(signal.SIGHUP)
        assert len(_record(drive, tmp_path).runs) == 2
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_defect_on_the_way_out_does_not_keep_the_parameters_from_being_put_back(
    drive: DeskDrive, tmp_path: Path
) -> None:
    before = dict(drive.objects)

    def fail() -> None:
        raise RuntimeError("a defect of ours")

    drive.stop = fail  # type: ignore[method-assign]  # a defect
    with pytest.raises(DriveError, match=r"PDO exchange may still be on.*defect"):
        _record(drive, tmp_path)
    assert drive.objects == before


@pytest.mark.parametrize("failures", [1, 9])
def test_parameters_go_back_into_a_drive_that_is_off_alone(
    drive: DeskDrive, tmp_path: Path, failures: int
) -> None:
    """With them it would lose its watch over us, and how it stops when we are gone."""
    before, disable, failed = dict(drive.objects), drive.disable, []

    def fail() -> None:
        if len(failed) < failures:
            failed.append(True)
            raise StateError("node 1", "may still be energised")
        disable()

    drive.disable = fail  # type: ignore[method-assign]  # it is not off
    with pytest.raises(DriveError, match=r"power stage may still be on") as raised:
        _record(drive, tmp_path)
    assert (drive.objects == before) == (failures == 1)
    assert "restore" not in str(raised.value)  # one thing is one sentence
    notes = "; ".join(getattr(raised.value, "__notes__", []))
    assert ("run `schwung restore" in notes) == (failures == 9)


@pytest.mark.parametrize("state", ["Operation enabled", "Quick stop active", "Fault reaction active"])
def test_a_drive_that_another_master_switched_on_since_preflight_is_left_alone(
    drive: DeskDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    plan = _plan(drive)
    ready = _ready(drive, plan)
    journal = ParameterJournal(drive, tmp_path / "setup.backup.json", {})
    monkeypatch.setattr(drive, "state", lambda: DriveState("OPERATIONAL", state, 0.0))
    with pytest.raises(RefusedError, match=rf"energised already \({state}\)"):
        record(drive, plan, ready, session_path=tmp_path / "s.h5", journal=journal, observer=Silence())
    assert drive.calls == []
    assert not journal.path.exists()


def test_nor_is_one_stopped_that_was_switched_on_while_it_was_set_up(
    drive: DeskDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(_: object) -> None:
        raise EnergisedError("node 3", 'is in "Operation enabled": somebody else has switched it on')

    monkeypatch.setattr(drive, "start", start)
    with pytest.raises(EnergisedError) as raised:
        _record(drive, tmp_path)
    assert not {"halt", "disable"} & set(drive.calls)
    assert any("schwung restore" in note for note in raised.value.__notes__)
    assert read_backup(tmp_path / "setup.backup.json").restored is None


def test_an_axis_that_coasts_is_told_as_such_and_the_drive_is_as_before(
    drive: DeskDrive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It did not brake any more: its voltage is off, and not "may still be on"."""
    before = dict(drive.objects)

    def disable() -> None:
        monkeypatch.undo()
        raise CoastingError("node 3", "still turned: it coasts")

    monkeypatch.setattr(drive, "disable", disable)
    with pytest.raises(DriveError, match="it coasts") as raised:
        _record(drive, tmp_path)
    assert "may still be on" not in str(raised.value)
    assert drive.objects == before


def test_an_observer_that_fails_stops_the_drive(drive: DeskDrive, tmp_path: Path) -> None:
    before = dict(drive.objects)

    class Broken(Silence):
        def progress(self, done: int, total: int) -> None:
            raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        _record(drive, tmp_path, Broken())
    assert drive.objects == before
    assert "halt" in drive.calls


def test_a_one_way_motion_is_undone_before_the_next_and_at_the_end(drive: DeskDrive, tmp_path: Path) -> None:
    limits = limits_of(LimitWishes(), drive.limits(), drive.machine)
    plan = make_plan(
        drive.machine, limits, start_position_rad=0.3, distance_rad=1.0, duration_s=0.2, repeats=2,
        returns=False,
    )  # fmt: skip
    drive.lost = {2: [40]}
    stands, play = [0.3], drive.play

    def watch(setpoints: Setpoints, progress: Progress | None = None) -> Recording:
        assert setpoints.position_rad[0] == pytest.approx(stands[-1])
        stands.append(float(setpoints.position_rad[-1]))
        return play(setpoints, progress)

    drive.play = watch  # type: ignore[method-assign]  # a spy
    recorded = _record(drive, tmp_path, plan=plan)
    assert len(recorded.runs) == 4
    assert stands == pytest.approx([0.3, *[0.3] * CREEP_PLAYS, *[1.3, 0.3] * 5])
    assert all(run.position_rad[-1] == pytest.approx(1.3, abs=0.02) for run in recorded.runs)


def test_uneven_samples_are_kept_as_evidence_but_are_no_run(drive: DeskDrive, tmp_path: Path) -> None:
    drive.jitter_s = 0.2e-3
    with pytest.raises(DriveError, match="unevenly"):
        _record(drive, tmp_path)
    session = read_session(tmp_path / "session.h5")
    assert session.runs == ()
    assert "unevenly" in session.partial_reasons[0]


@pytest.mark.parametrize(("slow_by", "said"), [(0.01, True), (1e-4, False)])
def test_a_sync_that_is_slow_on_average_is_told(
    drive: DeskDrive, tmp_path: Path, slow_by: float, said: bool
) -> None:
    drive.sync_is_slow_by = slow_by
    observer = Silence()
    _record(drive, tmp_path, observer)
    assert any("990.1 Hz instead of 1000 Hz" in note and "2.0%" in note for note in observer.notes) is said


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


def test_samples_that_an_uneven_sync_loses_are_not_said_to_be_the_cable(
    drive: DeskDrive, tmp_path: Path
) -> None:
    """Seen under load: 2 of 1050 lost three times, and "check cabling", where SYNC came hundreds of ms late."""
    drive.lost = {number: [5 + number] for number in range(9)}
    drive.jitter_s = 0.2e-3
    with pytest.raises(DriveError, match="SYNC: came unevenly") as caught:
        _record(drive, tmp_path)
    assert not isinstance(caught.value, SampleLossError)
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
