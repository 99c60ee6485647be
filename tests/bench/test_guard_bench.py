"""Limits that the drive holds, and what keeps a drive from being commissioned, through the whole bus chain."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import can
import pytest
from bench_machine import Desk, desk

from schwung.commissioning import Check, LimitWishes, Prepared
from schwung.errors import RefusedError
from schwung.fieldbus.drive import ParameterValue
from schwung.fieldbus.profile import CanopenProfile, load_profile

RPM = 2 * math.pi / 60
COUNT_RAD = 2 * math.pi / 2**20
WINDOW = LimitWishes(-0.5, 3.7)


@pytest.fixture(autouse=True)
def unpredicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What preflight foretells of the estimate takes seconds; it is tested in tests/commissioning/test_preflight.py."""
    monkeypatch.setattr("schwung.commissioning.preflight._predicted", lambda *_: None)


def _held(room: Desk, index: int, subindex: int = 0) -> int:
    return room.bench.servo.dictionary.number(index, subindex)


def _checks(prepared: Prepared, name: str) -> list[Check]:
    return [check for check in prepared.preflight.checks if check.name == name]


def _objects(folder: Path, *objects: tuple[int, str, int]) -> Path:
    """A folder with profile and EDS of the bench drive, and further objects: index, CiA 306 data type, value."""
    shutil.copytree(load_profile("schwung-bench").folder, folder)
    eds = folder / "schwung-bench.eds"
    text = eds.read_text(encoding="utf-8")
    for index, kind, value in objects:
        text += (
            f"\n[{index:04X}]\nParameterName=Object {index:04X}\nObjectType=0x7\nDataType={kind}\nAccessType=rw\n"
            f"DefaultValue={value}\nPDOMapping=0\n"
        )
    eds.write_text(text, encoding="utf-8")
    return folder


def test_the_drive_is_told_how_fast_it_may_be_and_how_hard_it_has_to_stop(tmp_path: Path) -> None:
    with desk(seed=3) as room:
        room.drive.write([ParameterValue(room.drive.parameter(0x6066), 500)])
        room.drive.write(
            [ParameterValue(room.drive.parameter(0x6085), 100_000)]
        )  # 10 rad/s²: 20 rad to a stop
        before = [_held(room, index) for index in (0x6066, 0x6080, 0x607F, 0x6085)]
        prepared = room.prepare(limits=WINDOW)
        guard = prepared.plan.acquisition.guard
        assert guard is not None
        assert guard.speed_max_rad_s is not None
        assert guard.stop_deceleration_rad_s2 is not None
        needed = prepared.plan.motion.peak_speed_rad_s
        assert needed < guard.speed_max_rad_s < 2 * needed
        values: dict[int, int] = {}

        def look() -> None:
            if room.bench.servo.power.enabled and not values:
                values.update({index: _held(room, index) for index in (0x6066, 0x6080, 0x607F, 0x6085)})

        room.bench.servo.on_advance = look
        room.record(tmp_path / "out", limits=WINDOW)
        assert values[0x6066] == 20
        assert values[0x6080] * RPM == pytest.approx(guard.speed_max_rad_s, abs=RPM)
        assert values[0x607F] * 1e-3 * RPM == pytest.approx(guard.speed_max_rad_s, abs=1e-3 * RPM)
        deceleration = values[0x6085] * 1e-3 * RPM
        room_rad = min(0.5, 3.7 - math.pi)
        assert guard.speed_max_rad_s**2 / (2 * deceleration) <= room_rad * (1 + 1e-6)
        assert [_held(room, index) for index in (0x6066, 0x6080, 0x607F, 0x6085)] == before


def test_a_quick_stop_from_the_highest_speed_ends_within_the_window() -> None:
    """In the drive, with the axis as fast as the drive lets it be, at the end of the stroke."""
    with desk(seed=3) as room:
        acquisition = room.prepare(limits=WINDOW).plan.acquisition
        assert acquisition.guard is not None
        room.drive.write(room.drive.setup(acquisition))
        room.drive.start(acquisition)
        room.drive.enable()
        axis, power = room.bench.axis, room.bench.servo.power
        axis.start_move(
            3.7 + 20, acquisition.guard.speed_max_rad_s, 500.0, 500.0
        )  # a drive that has gone mad
        clock = room.drive.clock
        clock.wait(lambda: axis.position_rad >= math.pi, 5.0)
        power.quick_stop()
        clock.wait(lambda: abs(axis.speed_rad_s) < 0.01 and axis.demand_speed_rad_s == 0, 5.0)
        assert axis.position_rad <= 3.7 + 0.02


def test_stronger_and_narrower_limits_of_the_drive_stay() -> None:
    with desk(seed=3) as room:
        for index, raw in ((0x6066, 5), (0x6085, 100_000_000)):
            room.drive.write([ParameterValue(room.drive.parameter(index), raw)])
        wanted = room.drive.setup(room.prepare(limits=WINDOW).plan.acquisition)
        assert not {0x6066, 0x6085} & {value.parameter.index for value in wanted}


def test_torque_limits_by_direction_are_set_where_the_drive_has_them(tmp_path: Path) -> None:
    folder = _objects(tmp_path / "p", (0x60E0, "0x0006", 3000), (0x60E1, "0x0006", 0))
    profile = load_profile(folder)
    with desk(seed=3, profile=profile, bench_profile=folder) as room:
        wanted = room.drive.setup(room.prepare(limits=LimitWishes(torque_max_nm=140.0)).plan.acquisition)
        told = {value.parameter.index: value.raw for value in wanted}
        assert (told[0x6072], told[0x60E0], told[0x60E1]) == (2000, 2000, 2000)


def test_a_quick_stop_that_coasts_is_made_to_brake_where_the_drive_can_be_told(tmp_path: Path) -> None:
    own = load_profile("schwung-bench")
    assert isinstance(own, CanopenProfile)
    silent = own.model_copy(update={"stop": own.stop.model_copy(update={"quick_stop_option": None})})
    with desk(seed=3, profile=silent) as room:
        room.drive.write([ParameterValue(room.drive.parameter(0x605A), 0)])
        wanted = room.drive.setup(room.prepare(limits=WINDOW).plan.acquisition)
        assert [value.raw for value in wanted if value.parameter.index == 0x605A] == [2]


OFFSET = 100_000  # counts


@pytest.mark.parametrize("reading", ["", ",limits-from-zero"], ids=["by CiA 402", "from zero"])
def test_a_home_offset_is_named_and_the_window_holds_in_both_readings(reading: str, tmp_path: Path) -> None:
    """Drives differ in whether 607D is counted from home or from the zero that 607C shifts."""
    with desk(seed=3, faults=f"set-up=0x607C00:{OFFSET}{reading}") as room:
        start = room.drive.state().position_rad
        assert abs(start) == pytest.approx(OFFSET * COUNT_RAD, abs=1e-4)
        window = LimitWishes(start - 1.5, start + math.pi + 1.5)
        prepared = room.prepare(limits=window)
        assert room.drive.limits().home_offset_rad == pytest.approx(OFFSET * COUNT_RAD)
        assert "607C" in _checks(prepared, "home offset")[0].text
        wanted = room.drive.setup(prepared.plan.acquisition)
        ends = {v.parameter.subindex: int(v.raw) * COUNT_RAD for v in wanted if v.parameter.index == 0x607D}
        for shift in (0.0, OFFSET * COUNT_RAD):
            assert ends[1] - shift >= start - 1.5 - COUNT_RAD
            assert ends[2] - shift <= start + math.pi + 1.5 + COUNT_RAD
        assert len(room.record(tmp_path / "out", limits=window, sample_rate_hz=500.0).runs) == 2


@pytest.mark.parametrize(("polarity", "words"), [(0x80, "opposite sign"), (0xC0, "opposite direction")])
def test_a_polarity_is_named_and_found_by_the_creep(polarity: int, words: str, tmp_path: Path) -> None:
    with desk(seed=3, faults=f"set-up=0x607E00:{polarity:#x}") as room:
        (check,) = _checks(room.prepare(), "polarity")
        assert check.severity == "warning"
        assert f"607E is 0x{polarity:X}" in check.text
        assert "6077" in check.text
        with pytest.raises(RefusedError, match=words):
            room.record(tmp_path / "out")
        assert not room.bench.servo.power.energised


def test_a_polarity_that_turns_the_torques_with_the_position_is_no_obstacle(tmp_path: Path) -> None:
    with desk(seed=3, faults="set-up=0x607E00:0xE0,torque-polarity=5") as room:
        assert len(room.record(tmp_path / "out", sample_rate_hz=500.0).runs) == 2


def test_a_range_at_which_positions_wrap_may_not_be_crossed(tmp_path: Path) -> None:
    turn = 2**20
    with desk(seed=3, faults=f"set-up=0x607B01:{-turn // 4},set-up=0x607B02:{turn // 4}") as room:
        with pytest.raises(RefusedError, match="607B"):
            room.record(tmp_path / "out")
        assert _checks(room.prepare(distance_rad=1.0), "position range")[0].severity == "note"


def test_a_drive_with_a_holding_brake_is_commissioned(tmp_path: Path) -> None:
    with desk(seed=3, faults="brake=0.15", conceal="torque_offset=15") as room:
        assert len(room.record(tmp_path / "out", sample_rate_hz=500.0).runs) == 2


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("negative-limit", "negative limit switch"),
        ("positive-limit", "positive limit switch"),
        ("sto=0x5091", "STO"),
        ("local", "bit 9"),
    ],
)
def test_commission_refuses_for_what_the_doctor_would(fault: str, words: str, tmp_path: Path) -> None:
    with desk(seed=3, faults=fault) as room:
        servo = room.bench.servo
        before = {key: raw for key, raw in servo.dictionary.values.items() if key >> 8 != 0x6040}
        with pytest.raises(RefusedError, match=words):
            room.record(tmp_path / "out")
        assert not servo.power.energised
        assert before.items() <= servo.dictionary.values.items()


def test_commission_refuses_an_interlock(tmp_path: Path) -> None:
    with desk(seed=3) as room:
        room.bench.servo.dictionary.readers[0x60FD << 8] = lambda: 8
        with pytest.raises(RefusedError, match="STO"):
            room.record(tmp_path / "out")
        assert not room.bench.servo.power.energised


@pytest.mark.parametrize("fault", ["not-following", "not-following=1"])
def test_a_drive_that_does_not_follow_its_setpoints_moves_no_stroke(fault: str, tmp_path: Path) -> None:
    with desk(seed=3, faults=fault) as room:
        with pytest.raises(RefusedError, match="bit 12"):
            room.record(tmp_path / "out")
        assert not room.bench.servo.power.energised
        assert room.bench.axis.position_rad == pytest.approx(0.0, abs=0.01)


def test_a_drive_that_turns_demands_and_not_what_it_reports_is_found_by_its_first_stroke(
    tmp_path: Path,
) -> None:
    with desk(seed=3, faults="set-up=0x607E00:0x80,demand-polarity") as room:
        with pytest.raises(RefusedError, match=r"the other way.*607E"):
            room.record(tmp_path / "out")
        assert abs(room.bench.axis.position_rad) < math.radians(4)


@pytest.mark.parametrize(("frame", "words"), [((0x080, b""), "SYNC"), ((0x000, b"\x01\x02"), "NMT commands")])
def test_commission_refuses_a_bus_with_another_master(
    frame: tuple[int, bytes], words: str, tmp_path: Path
) -> None:
    with desk(seed=3) as room:
        clock: Any = room.drive.clock
        other = can.Bus(interface="stepped", channel=room.bench.channel)
        can_id, data = frame
        message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
        beat = clock.every(0.02, lambda: other.send(message))
        try:
            with pytest.raises(RefusedError, match=f"somebody else sends {words}"):
                room.record(tmp_path / "out")
            assert not room.bench.servo.power.energised
        finally:
            beat.close()
            other.shutdown()


def test_what_a_drive_lacks_to_be_guarded_by_is_named() -> None:
    with desk(seed=3) as room:
        assert room.drive.limits().lacking == ()
    poorer = load_profile("maxon-epos2")
    assert isinstance(poorer, CanopenProfile)
    with desk(seed=3, profile=poorer, bench_profile=poorer.folder) as room:
        assert set(room.drive.limits().lacking) == {"6066", "6072"}
