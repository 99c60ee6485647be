"""The best motion through the whole bus chain: what was promised is what the drive reports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bench_machine import Desk, Silence, desk, guessed_machine

from schwung.commissioning import LimitWishes
from schwung.commissioning.played import Cost, Played, cost_of_run, cost_of_simulated, interval
from schwung.commissioning.playing import PlayPrepared, play, prepare_play, stand_of
from schwung.drivetrain import InertiaTable, Machine
from schwung.errors import InputError, RefusedError
from schwung.motion import Motion
from schwung.optimise.comparison import there_and_back
from schwung.optimise.formats import cycle_torque
from schwung.optimise.values import MotionLimits, Stroke, Task
from schwung.session import read_session


def true_machine(room: Desk) -> Machine:
    """The machine as a good measurement has it."""
    angle = np.linspace(-0.05, np.pi + 0.05, 80)
    table = InertiaTable(angle, room.bench.plant.true_inertia(angle))
    machine = guessed_machine()
    load = machine.load.model_copy(update={"inertia_kgm2": None, "inertia_table": table})
    return machine.model_copy(update={"load": load})


@pytest.fixture(scope="module")
def best() -> tuple[Stroke, Stroke]:
    """There and back within 0.2 s each."""
    with desk(seed=3) as room:
        task = Task(0.0, np.pi, MotionLimits(233.0), duration_s=0.2)
        return there_and_back(true_machine(room), task)


def prepared(
    room: Desk, machine: Machine, best: tuple[Stroke, Stroke], duration_s: float = 0.2
) -> PlayPrepared:
    stand = stand_of(room.drive, room.profile, machine, LimitWishes())
    there, back = best
    return prepare_play(
        room.drive,
        room.profile,
        stand,
        Motion(kind="third", distance_rad=np.pi, duration_s=duration_s),
        there.motion(back),
        lambda motion, time: cycle_torque(there, back, motion, time) - there.hold_start_nm,
        repeats=2,
    )


def copper(cost: Cost) -> float:
    return cost.copper_n2m2s


def test_the_saving_is_the_promised_one_and_the_drive_is_left_as_it_was(
    best: tuple[Stroke, Stroke], tmp_path: Path
) -> None:
    with desk(seed=3) as room:
        machine = true_machine(room)
        ready = prepared(room, machine, best)
        before = room.bench.servo.dictionary.values.copy()
        recorded = play(room.drive, ready, tmp_path, Silence())
        changed = {
            k for k, v in room.bench.servo.dictionary.values.items() if k >> 8 == 0x6065 and v != before[k]
        }
        assert not room.bench.servo.power.energised
    assert not changed
    plan, predicted = ready.plan, ready.predicted
    assert plan.optimised is not None
    found = Played(
        tuple(cost_of_run(run, machine) for run in recorded.runs[0::2]),
        tuple(cost_of_run(run, machine) for run in recorded.runs[1::2]),
        cost_of_simulated(predicted[0], plan.motion, machine),
        cost_of_simulated(predicted[1], plan.optimised, machine),
    )
    measured, promised = found.saving(copper), found.predicted_saving(copper)
    assert measured is not None
    assert promised is not None
    assert promised > 0.3
    assert measured.mean == pytest.approx(promised, abs=0.03)
    assert found.optimised[0].peak_following_rad < 0.5 * found.reference[0].peak_following_rad
    assert found.optimised[0].settling_s <= found.reference[0].settling_s
    session = read_session(tmp_path / "played.h5")
    kinds = [run.motion.kind for run in session.runs if run.motion is not None]
    assert kinds == ["third", "points", "third", "points"]


def test_a_reference_beyond_the_torque_is_refused_before_anything_moves(
    best: tuple[Stroke, Stroke], tmp_path: Path
) -> None:
    with desk(seed=3) as room:
        ready = prepared(room, true_machine(room), best, duration_s=0.095)
        with pytest.raises(RefusedError, match="torque"):
            play(room.drive, ready, tmp_path, Silence())
        assert room.bench.plant.motor_rad == 0.0


def test_a_drive_that_adds_its_own_torque_is_not_given_more() -> None:
    with desk(seed=3) as room:
        enable = room.profile.export.table
        assert enable is not None
        assert enable.enable is not None
        parameter = room.drive.parameter(enable.enable.object.index, enable.enable.object.subindex)
        held = room.drive.read(parameter)
        room.drive.write([type(held)(parameter, enable.enable.value)])
        with pytest.raises(InputError, match="ours would come on top"):
            stand_of(room.drive, room.profile, true_machine(room), LimitWishes())


def test_an_interval_is_students() -> None:
    found = interval([1.0, 2.0, 3.0])
    assert found.mean == 2.0
    assert found.half == pytest.approx(4.303 / np.sqrt(3), rel=1e-3)  # t(0.975, 2) = 4.303
    assert interval([1.0]).half is None
