"""Commissioning end to end over Modbus, TCP and RTU: the table is right, and the drive is as before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from bench_machine import Silence, desk, guessed_machine
from modbus_desk import FAMILY, connected_bench, profile_of

from schwung.commissioning import (
    Commissioned,
    ExportChoice,
    LimitWishes,
    Wishes,
    carry_out,
    export_table,
    following_error_rms,
    prepare,
    read_backup,
    repeat_reference,
    restore_backup,
)
from schwung.drivetrain import Control, InertiaTable
from schwung.errors import InputError, NodeLostError, RefusedError

#: Errors of neighbouring angles are alike and strokes over Modbus begin when they begin, so that a whole stretch of a
#: curve lies outside a band of 95 % now and then: so many deviations are allowed, and this share of angles beyond them.
BEYOND, MISSES = 3.0, 0.15


@pytest.fixture(autouse=True)
def unpredicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What preflight foretells of the estimate takes seconds; it is tested in tests/commissioning/test_preflight.py."""
    monkeypatch.setattr("schwung.commissioning.preflight._predicted", lambda *_: None)


def wishes(**changes: object) -> Wishes:
    return Wishes(**{"distance_rad": np.pi, "duration_s": 0.25, "repeats": 1, **changes})  # type: ignore[arg-type]


@dataclass(frozen=True)
class Measured:
    """A commissioning over Modbus, and how it left the drive."""

    done: Commissioned
    truth: Callable[[np.ndarray], np.ndarray]
    moves: int
    position_rad: float
    energised: bool
    restored: bool
    changed: set[str]  # parameters, by name


def _measured(transport: str, trace_rate_hz: float | None, folder: Path) -> Measured:
    with connected_bench(transport, "two-mass", seed=5) as (bench, opened):
        drive, profile = opened.drive, opened.profile
        held = {p: drive.read(p).raw for p in drive.parameters()}  # type: ignore[attr-defined]  # of Modbus drives
        prepared = prepare(drive, profile, guessed_machine(), wishes(trace_rate_hz=trace_rate_hz))
        done = carry_out(drive, prepared, folder, Silence())
        live = {p for p in held if p.name in ("position", "speed", "torque", "statusword", "controlword")}
        return Measured(
            done,
            bench.plant.true_inertia,
            bench.servo.moves,
            bench.axis.position_rad,
            bench.axis.energised,
            bool(read_backup(folder / "setup.backup.json").restored),
            {p.name for p in held if p not in live and drive.read(p).raw != held[p]},
        )


@pytest.fixture(scope="module")
def over_modbus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Measured]:
    """At 8 kHz by TCP, as fast as the drive's trace is; at 2 kHz by a serial line."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("schwung.commissioning.preflight._predicted", lambda *_: None)
        return {
            transport: _measured(transport, rate_hz, tmp_path_factory.mktemp(transport))
            for transport, rate_hz in (("tcp", None), ("rtu", 2000.0))
        }


@pytest.mark.parametrize(("transport", "rate_hz"), [("tcp", 8000.0), ("rtu", 2000.0)])
def test_the_inertia_comes_out_and_the_drive_is_as_before(
    over_modbus: dict[str, Measured], transport: str, rate_hz: float
) -> None:
    measured = over_modbus[transport]
    done = measured.done
    acquisition = done.prepared.plan.acquisition
    assert (acquisition.mode, acquisition.sampling, acquisition.injecting) == ("pp", "trace", "generator")
    assert any("one way is measured" in reason for reason in done.prepared.plan.reasons)
    table = done.estimate.table
    error = table.inertia_kgm2 - measured.truth(table.position_rad)
    assert np.sqrt(np.mean(error**2)) <= 0.0005
    assert table.std_kgm2 is not None
    assert np.mean(np.abs(error) <= 3 * table.std_kgm2) > 0.95
    assert done.estimate.trust.verdict == "good"
    assert done.session.runs[0].sample_rate_hz == rate_hz
    excited = next(run for run in done.session.runs if run.excitation is not None)
    assert excited.excitation is not None
    assert excited.excitation.hold_s is None  # the drive's own sine is no staircase
    assert (
        measured.moves == 8
    )  # there and back, without and with the sine; and before, two steps of the creep
    assert measured.position_rad == pytest.approx(0.0, abs=0.01)
    assert not measured.energised
    assert measured.restored
    assert measured.changed <= {"trace.status", "trace-status"}


def test_every_bus_gives_the_same_table_and_the_true_one_within_its_band(
    over_modbus: dict[str, Measured], tmp_path: Path
) -> None:
    """One machine: 1 kHz by SYNC on CANopen, its trace by Modbus TCP, and by a serial line."""
    with desk("two-mass", seed=5) as room:
        tables = [room.commission(tmp_path / "sync").estimate.table]
        truth = room.bench.plant.true_inertia
    tables += [measured.done.estimate.table for measured in over_modbus.values()]
    angle = np.linspace(0.05, np.pi - 0.05, 60)
    found, std = zip(*(_at(table, angle) for table in tables), strict=True)
    for one in range(len(tables)):
        assert np.mean(np.abs(found[one] - truth(angle)) > BEYOND * std[one]) <= MISSES
        for other in range(one):
            apart = np.abs(found[one] - found[other])
            assert np.mean(apart > BEYOND * np.hypot(std[one], std[other])) <= MISSES


def _at(table: InertiaTable, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    assert table.std_kgm2 is not None
    return table.at(angle), np.interp(angle, table.position_rad, table.std_kgm2)


def test_the_table_goes_into_the_drive_helps_and_comes_out_again(tmp_path: Path) -> None:
    with connected_bench("tcp", family=FAMILY, seed=6) as (bench, opened):
        drive, profile = opened.drive, opened.profile
        prepared = prepare(drive, profile, guessed_machine(), wishes(trace_rate_hz=1000.0))
        before = repeat_reference(drive, prepared, tmp_path, "before", Silence())
        truth = bench.plant.true_inertia
        angles = np.linspace(-0.05, np.pi + 0.05, 200)
        backup = tmp_path / "export.backup.json"
        exported = export_table(
            drive, profile, InertiaTable(angles, truth(angles)), ExportChoice(), backup_path=backup
        )
        assert len(exported.changes) == 68
        after = repeat_reference(drive, prepared, tmp_path, "after", Silence())
        improvement = (following_error_rms(before) or 0.0) / (following_error_rms(after) or 1.0)
        assert improvement >= 5
        restore_backup(drive, backup)
        assert bench.axis.settings.feed_forward_mode == 0
        assert bench.axis.settings.table_inertia_kgm2 == ()


@pytest.mark.parametrize("family", ["schneider-lexium-32", "kollmorgen-akd", "delta-asda-a2"])
def test_a_family_that_cannot_be_commissioned_says_why(family: str, tmp_path: Path) -> None:
    """First that units are missing; and with everything given that a user can give, what the profile cannot."""
    transport = "rtu" if family == "delta-asda-a2" else "tcp"
    control = Control(
        position_gain_per_s=60, speed_gain_nms=7, speed_integral_time_s=0.02, sample_rate_hz=8000
    )
    machine = guessed_machine().model_copy(update={"control": control})
    given = wishes(limits=LimitWishes(-10.0, 10.0, 100.0, 233.0, 1.0))
    profile = profile_of(family)
    file = tmp_path / "profile.toml"
    lines = [f'extends = "{family}"']
    for name in ("position", "speed"):
        quantity = getattr(profile.quantities, name)
        if quantity is not None and quantity.unit == "user":
            lines += [f"[quantities.{name}]", 'unit = "literal"', "scale = 1e-5"]
    file.write_text("\n".join(lines))
    if profile.quantities.position.unit == "user":
        with (
            connected_bench(transport, profile=family, family=family) as (_, opened),
            pytest.raises(InputError, match=r"left to you: rad of one count"),
        ):
            prepare(opened.drive, opened.profile, machine, given)
    with connected_bench(transport, profile=family, family=str(file)) as (bench, opened):
        prepared = prepare(opened.drive, opened.profile, machine, given)
        with pytest.raises(RefusedError, match=r"this profile can't do that, because"):
            carry_out(opened.drive, prepared, tmp_path, Silence())
        assert bench.servo.moves == 0
        assert not bench.axis.energised


def test_a_lost_connection_ends_commissioning_with_a_sentence_and_a_stopped_drive(tmp_path: Path) -> None:
    with connected_bench("tcp", family=FAMILY, seed=6, faults="drop@moving+0.1") as (bench, opened):
        prepared = prepare(opened.drive, opened.profile, guessed_machine(), wishes(trace_rate_hz=1000.0))
        with pytest.raises(NodeLostError, match="connection was lost"):
            carry_out(opened.drive, prepared, tmp_path, Silence())
        assert bench.servo.moves == 1
        assert not bench.axis.energised
        assert bench.servo.value("state.mode") == 0  # put back over the new connection
        assert read_backup(tmp_path / "setup.backup.json").restored
