"""Frequency responses through the whole bus chain: the drive train comes out, the drive is left as it was."""

from pathlib import Path

import numpy as np
import pytest
from bench_machine import Desk, Silence, desk, guessed_machine

from schwung.commissioning import LimitWishes, read_backup
from schwung.commissioning.bode import (
    MeasuredBode,
    measure_bode,
    prepare_bode,
)
from schwung.commissioning.bode_excitation import BodeWishes
from schwung.drivetrain import Coupling, Machine
from schwung.errors import DriveError, RefusedError
from schwung.estimation.response import measured_responses
from schwung.session import read_session
from schwung.session.gains import with_recorded_gains

CHANGED = [(0x6060, 0), (0x1016, 1), (0x1017, 0), (0x1400, 2), (0x1600, 0), (0x1A00, 1), (0x6007, 0)]


def _wrong_belief() -> Machine:
    """What a data sheet may be off by: a fifth here, two fifths there."""
    guess = guessed_machine()
    motor = guess.motor.model_copy(update={"inertia_kgm2": 0.010})
    return guess.model_copy(
        update={"motor": motor, "coupling": Coupling(stiffness_nm_rad=20000.0, damping_nms=5.0)}
    )


def _measure(room: Desk, out: Path, **wishes: object) -> MeasuredBode:
    out.mkdir()
    wanted = BodeWishes(**{"periods": 3, "lowest_hz": 24.0, **wishes})  # type: ignore[arg-type]  # by name
    prepared = prepare_bode(room.drive, room.profile, _wrong_belief(), wanted)
    return measure_bode(room.drive, prepared, out, Silence())


@pytest.mark.long
def test_the_two_mass_machine_comes_out_within_its_intervals(tmp_path: Path) -> None:
    with desk("two-mass", seed=5) as room:
        before = [room.drive.read(room.drive.parameter(*key)).raw for key in CHANGED]
        done = _measure(room, tmp_path / "out", angles_rad=(0.2, 1.5))
        after = [room.drive.read(room.drive.parameter(*key)).raw for key in CHANGED]
        truth = room.bench.plant.true_inertia(np.array([0.2, 1.5]))
        assert after == before
        assert not room.bench.servo.power.energised
        assert room.bench.axis.position_rad == pytest.approx(0.0, abs=2e-3)
    assert read_backup(tmp_path / "out" / "setup.backup.json").restored
    fit = done.fit
    for found, true, within in (
        (fit.rotor, 0.012, 0.05),
        (fit.stiffness, 24963.0, 0.005),
        (fit.damping, 8.62, 0.03),
        (fit.angles[0].inertia, truth[0], 0.005),
        (fit.angles[1].inertia, truth[1], 0.005),
    ):
        assert found is not None
        assert found.value == pytest.approx(true, rel=within)
        assert abs(found.value - true) < 3 * found.std
        assert found.determined
    assert [run.role for run in done.session.runs] == ["reference", *["excited"] * 2] * 2 + ["reference"]

    again = read_session(done.session_path)  # what `schwung bode --session` does
    for kept, used in zip(measured_responses(again), fit.responses, strict=True):
        assert np.array_equal(kept.response, used.response)
    with_gains = with_recorded_gains(_wrong_belief(), again)
    assert with_gains.required_control().position_gain_per_s == pytest.approx(60.0)


@pytest.mark.long
def test_the_multi_body_slider_crank_comes_out_within_its_intervals(tmp_path: Path) -> None:
    with desk("slider-crank", seed=6) as room:
        done = _measure(room, tmp_path / "out", angles_rad=(0.4,), lowest_hz=12.0)
        truth = float(room.bench.plant.true_inertia(np.array([0.4]))[0])
    fit = done.fit
    for found, true, within in (
        (fit.rotor, 0.012, 0.05),
        (fit.stiffness, 24963.0, 0.01),
        (fit.damping, 8.62, 0.04),
        (fit.angles[0].inertia, truth, 0.01),
    ):
        assert found is not None
        assert found.value == pytest.approx(true, rel=within)
        assert abs(found.value - true) < 3 * found.std


def test_at_a_low_rate_it_is_said_what_cannot_be_seen(tmp_path: Path) -> None:
    with desk("two-mass", seed=7) as room:
        wishes = BodeWishes(angles_rad=(0.2,), sample_rate_hz=400.0)
        ready = prepare_bode(room.drive, room.profile, _wrong_belief(), wishes).preflight
    band = next(check for check in ready.checks if check.name == "band")
    assert band.severity == "warning"
    assert "motor inertia and resonance" in band.text


def test_an_angle_outside_the_window_is_refused_before_the_drive_is_touched(tmp_path: Path) -> None:
    with desk("two-mass") as room:
        before = [room.drive.read(room.drive.parameter(*key)).raw for key in CHANGED]
        with pytest.raises(RefusedError, match="room to move"):
            _measure(room, tmp_path / "out", angles_rad=(0.2, 3.0), limits=LimitWishes(position_max_rad=2.0))
        assert [room.drive.read(room.drive.parameter(*key)).raw for key in CHANGED] == before
        assert not (tmp_path / "out" / "session.h5").exists()


def test_a_fault_while_it_injects_leaves_a_stopped_drive_and_what_was_recorded(tmp_path: Path) -> None:
    with desk("two-mass", seed=9, faults="emcy=0x4310@on+4.4") as room:
        with pytest.raises(DriveError, match="4310"):
            _measure(room, tmp_path / "out", angles_rad=(0.2,))
        room.drive.close()
        assert not room.bench.servo.power.energised
        assert abs(room.bench.axis.speed_rad_s) < 0.5
    kept = read_session(tmp_path / "out" / "session.h5")
    assert len(kept.references) == 1
    assert kept.partial_reasons
