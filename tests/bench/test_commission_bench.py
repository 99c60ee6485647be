"""Commissioning through the whole bus chain: right numbers, and every fault ends with a stopped drive."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from bench_machine import Desk, Silence, desk

from schwung.commissioning import (
    Commissioned,
    ExportChoice,
    LimitWishes,
    export_table,
    following_error_rms,
    read_backup,
    repeat_reference,
)
from schwung.commissioning.procedure import Recorded
from schwung.drivetrain import InertiaTable
from schwung.errors import DriveError, RefusedError, SampleLossError, SchwungError
from schwung.estimation import estimate
from schwung.fieldbus.canopen import sync
from schwung.fieldbus.drive import Acquisition, ParameterValue, Setpoints
from schwung.session import read_session

CHANGED = [
    (0x6060, 0),
    (0x1016, 1),
    (0x1017, 0),
    (0x1400, 2),
    (0x1600, 0),
    (0x1A00, 1),
    (0x1800, 2),
    (0x6007, 0),
]


@dataclass(frozen=True)
class Once:
    """A commissioning with the default wishes, its drive still connected, and the inertia at the table's angles that it
    should have found."""

    room: Desk
    folder: Path
    before: dict[tuple[int, int], object]
    after: dict[tuple[int, int], object]
    done: Commissioned
    truth_kgm2: np.ndarray


@contextmanager
def _commissioned(plant: str, seed: int, folder: Path) -> Iterator[Once]:
    with desk(plant, seed=seed) as room:
        before = _values(room)
        done = room.commission(folder)
        truth = room.bench.plant.true_inertia(done.estimate.table.position_rad)
        yield Once(room, folder, before, _values(room), done, truth)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Once]:
    with _commissioned("two-mass", 7, tmp_path_factory.mktemp("once")) as once:
        yield once


@pytest.fixture
def unpredicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What preflight foretells of the estimate takes as long as a motion; it is looked at with the default wishes."""
    monkeypatch.setattr("schwung.commissioning.preflight._predicted", lambda *_: None)


def _values(room: Desk) -> dict[tuple[int, int], object]:
    return {key: room.drive.read(room.drive.parameter(*key)).raw for key in CHANGED}


def _is_off(room: Desk) -> bool:
    return not room.bench.servo.power.energised


def _comes_to_rest(room: Desk) -> bool:
    """Out of operation and standing: off, in fault, or held in quick stop (605A = 6)."""
    return bool(room.bench.servo.settle(3.0)) and abs(room.bench.axis.speed_rad_s) < 0.5


def test_four_phases_are_several_times_better(tmp_path: Path) -> None:
    """Held at 1 kHz by the bus, through the drive's counts and filters."""
    with desk("two-mass", seed=5) as room:
        done = room.commission(tmp_path / "out", phases=4, duration_s=0.15, amplitude_nm=30.0)
        truth = room.bench.plant.true_inertia

    def rmse(table: InertiaTable) -> float:
        return float(np.sqrt(np.mean((table.inertia_kgm2 - truth(table.position_rad)) ** 2)))

    assert done.estimate.method in ("multiphase", "trajectory")
    assert done.estimate.trust.verdict == "good"
    assert len(done.session.references) == 1
    denoised = estimate(done.session, done.prepared.machine, "denoised")
    assert rmse(done.estimate.table) < 0.0005
    assert rmse(denoised.table) > 3 * rmse(done.estimate.table)


def _is_right_and_as_before(once: Once) -> None:
    assert once.done.contrast is not None
    former = once.done.contrast.table
    worse = former.inertia_kgm2 - once.room.bench.plant.true_inertia(former.position_rad)
    error = once.done.estimate.table.inertia_kgm2 - once.truth_kgm2
    assert np.sqrt(np.mean(error**2)) <= 0.003
    assert np.sqrt(np.mean(worse**2)) > 5 * np.sqrt(np.mean(error**2))
    assert once.after == once.before
    assert _is_off(once.room)
    assert read_backup(once.folder / "setup.backup.json").restored


def test_the_inertia_comes_out_through_the_bus_and_the_drive_is_as_before(once: Once) -> None:
    _is_right_and_as_before(once)


def test_so_it_does_of_a_multi_body_slider_crank(tmp_path: Path) -> None:
    with _commissioned("slider-crank", 5, tmp_path / "out") as crank:
        _is_right_and_as_before(crank)


def test_following_error_falls_five_times_after_the_export(once: Once) -> None:
    room, done, backup = once.room, once.done, once.folder / "e.backup.json"
    export_table(room.drive, room.profile, done.estimate.table, ExportChoice(), backup_path=backup)
    after = repeat_reference(room.drive, done.prepared, once.folder, "verification", Silence())
    before_rms, after_rms = following_error_rms(done.recorded.runs[0]), following_error_rms(after)
    assert before_rms is not None
    assert after_rms is not None
    assert before_rms / after_rms >= 5
    assert len(read_backup(backup).changes) == 68


def test_the_verification_tolerates_the_jitter_that_was_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares: list[object] = []

    def recorded(*_: object, **given: object) -> Recorded:
        shares.append(given["max_jitter_share"])
        return Recorded((None,), (), 0)  # type: ignore[arg-type]  # the run is not looked at

    monkeypatch.setattr("schwung.commissioning.commission.record", recorded)
    with desk(seed=6) as room:
        repeat_reference(room.drive, room.prepare(max_jitter_share=0.7), tmp_path, "verification", Silence())
    assert shares == [0.7]


def _estimated(room: Desk, out: Path, **wishes: object) -> InertiaTable:
    """The table of a recording, at half the usual rate where none is wished for; of more samples than usual by the
    estimate that is quickly made."""
    wishes = {"sample_rate_hz": 500.0, **wishes}
    machine, session = room.prepare(**wishes).machine, room.record(out, **wishes)
    return estimate(session, machine, "auto" if session.runs[0].sample_rate_hz <= 1000 else "denoised").table


def _error_rms(room: Desk, table: InertiaTable) -> float:
    error = table.inertia_kgm2 - room.bench.plant.true_inertia(table.position_rad)
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.usefixtures("unpredicted")
def test_profile_position_gives_the_same_table(once: Once, tmp_path: Path) -> None:
    by_setpoints = once.done.estimate.table
    with desk(seed=7) as room:
        by_moves = _estimated(room, tmp_path / "pp", mode="pp")
    shared = by_moves.position_rad[(by_moves.position_rad > 0.1) & (by_moves.position_rad < 3.0)]
    assert np.max(np.abs(by_moves.at(shared) - by_setpoints.at(shared))) < 0.006


@pytest.mark.parametrize(
    "wishes",
    [
        {"returns": False},
        {"returns": False, "mode": "pp"},
        {"distance_rad": -np.pi},
        {"distance_rad": -np.pi, "returns": False},
        {"sample_rate_hz": 2000.0},
        {"frequency_hz": 47.0},
        {"kind": "poly5"},
    ],
    ids=str,
)
@pytest.mark.usefixtures("unpredicted")
def test_other_motions_rates_and_frequencies_find_the_inertia_and_end_where_they_began(
    wishes: dict[str, object], tmp_path: Path
) -> None:
    with desk(seed=3) as room:
        table = _estimated(room, tmp_path / "out", **wishes)
        assert _error_rms(room, table) <= 0.003
        assert room.bench.axis.position_rad == pytest.approx(0.0, abs=0.01)
        assert _is_off(room)


@pytest.mark.usefixtures("unpredicted")
def test_a_motion_may_start_elsewhere_than_at_zero(tmp_path: Path) -> None:
    """From 1 rad, where the loop rings longest: both motions have to start from rest."""
    with desk(seed=3) as room:
        acquisition = Acquisition("csp", 500.0)
        before = [room.drive.read(value.parameter) for value in room.drive.setup(acquisition)]
        room.drive.write(room.drive.setup(acquisition))
        room.drive.start(acquisition)
        room.drive.enable()
        path = 0.5 * (1 - np.cos(np.linspace(0, np.pi, 500)))
        room.drive.play(Setpoints(500.0, path, np.zeros(500)))
        room.drive.disable()
        room.drive.stop()
        room.drive.write(before)
        assert room.prepare().plan.start_position_rad == pytest.approx(1.0, abs=0.05)
        assert _error_rms(room, _estimated(room, tmp_path / "out")) <= 0.003


@pytest.mark.usefixtures("unpredicted")
def test_a_coarse_speed_or_none_at_all_is_replaced_by_that_of_the_position(tmp_path: Path) -> None:
    with desk(seed=3) as room:
        room.drive.write([ParameterValue(room.drive.parameter(0x60A9), 0x00B44700)])  # 1 rpm a count
        assert _error_rms(room, _estimated(room, tmp_path / "coarse")) <= 0.003
    quantities = room.profile.quantities.model_copy(update={"speed": None})
    silent = room.profile.model_copy(
        update={"quantities": quantities, "pdo": tuple(p for p in room.profile.pdo if p.number == 1)}
    )
    with desk(seed=3, profile=silent) as room:
        assert _error_rms(room, _estimated(room, tmp_path / "none")) <= 0.003
        first = read_session(tmp_path / "none" / "session.h5").runs[0]
        assert np.max(first.speed_rad_s) == pytest.approx(1.5 * np.pi / 0.25, rel=0.2)


@pytest.mark.parametrize(("bit_rate", "rate_hz"), [(250_000, 1000.0), (500_000, 2000.0)])
def test_a_bus_that_is_too_slow_is_refused(bit_rate: int, rate_hz: float, tmp_path: Path) -> None:
    with (
        desk(bit_rate=bit_rate) as room,
        pytest.raises(RefusedError, match=rf"bus load.*{bit_rate // 1000} kbit/s"),
    ):
        room.commission(tmp_path / "out", sample_rate_hz=rate_hz, sampling="sync")


def test_an_injection_held_between_syncs_has_to_be_known_as_such(once: Once) -> None:
    """The bench drive holds 60B2 as most drives do; estimated as if it were continuous the table is biased."""
    done, truth = once.done, once.truth_kgm2
    unsaid = tuple(
        replace(
            run, excitation=run.excitation and run.excitation.model_copy(update={"hold_s": None}), extra={}
        )
        for run in done.session.runs
    )
    machine = done.prepared.machine
    naive = estimate(replace(done.session, runs=unsaid), machine, method="denoised").table
    rms, naive_rms = (np.sqrt(np.mean((t.inertia_kgm2 - truth) ** 2)) for t in (done.estimate.table, naive))
    assert naive_rms > 3 * rms


def test_a_session_read_from_disk_gives_the_very_same_estimate(once: Once) -> None:
    again = estimate(read_session(once.done.session_path), once.done.prepared.machine)
    assert np.array_equal(again.table.inertia_kgm2, once.done.estimate.table.inertia_kgm2)


def test_a_motion_out_of_the_window_is_refused_before_the_drive_is_touched(tmp_path: Path) -> None:
    with desk() as room:
        before = _values(room)
        with pytest.raises(RefusedError, match="room to move"):
            room.commission(tmp_path / "out", limits=LimitWishes(position_max_rad=2.0))
        assert _values(room) == before
        assert not (tmp_path / "out" / "session.h5").exists()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("reset@on+1.2", "restart|boot"),
        ("emcy=0x4310@on+1.2", "0x4310|4310"),
        ("following-error@on+3.5", "0x8611|8611|following"),
        ("heartbeat-stop@on+0.05", "heartbeat"),
        ("bus-off@on+1.2", "heartbeat|answer|bus"),
        ("second-master=0x0006@on+1.2", "master|left"),
        ("drop=0.01@on+0.3", "lost|answer"),
        ("sdo-abort=0x6060", "6060"),
        ("sdo-timeout=0x6060", "6060.*answer|answer"),
    ],
)
@pytest.mark.usefixtures("unpredicted")
def test_a_fault_ends_with_a_sentence_a_stopped_drive_and_what_was_recorded(
    fault: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sync, "LOST_AFTER_S", 0.03)  # what is waited for each answer that never comes
    with desk(seed=9, faults=fault) as room:
        with pytest.raises(SchwungError, match=rf"(?i){words}") as caught:
            # longer than a missing heartbeat takes to be noticed
            room.commission(tmp_path / "out", repeats=6, sample_rate_hz=500.0)
        assert isinstance(caught.value, DriveError | SampleLossError)
        assert len(str(caught.value)) < 400
        room.drive.close()
        assert _comes_to_rest(room)
        if "@on+1.2" in fault or "@on+3.5" in fault:  # in the creep, in a run
            with h5py.File(tmp_path / "out" / "session.h5") as file:
                assert len(file["run"]) >= 1 or len(file["partial"]) >= 1
