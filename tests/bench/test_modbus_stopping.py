"""A Modbus drive that was told to stop, stops, stays so, and is off when it is said to be off: whatever is lost,
refused, late or unheard of on the way."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from modbus_desk import ModbusDesk, modbus_desk

from schwung.errors import CoastingError, DriveError, DriveFaultError, RegisterError, StateError
from schwung.fieldbus.cia402 import (
    DISABLE_VOLTAGE,
    ENABLE_OPERATION,
    NEW_SET_POINT,
    QUICK_STOP,
    enables_operation,
)
from schwung.fieldbus.drive import ParameterValue
from schwung_sim.drives.modbus.power import PowerStage, State
from schwung_sim.drives.modbus.registers import ILLEGAL_ADDRESS, RefusalError

STATUSWORD, CONTROLWORD, MODE_DISPLAY, CURSOR = 102, 100, 108, 508
STROKE = {"distance_rad": 6.0, "duration_s": 1.0}


def shows(room: ModbusDesk, register: int, value: int) -> None:
    """From now on the drive says so, whatever is the case."""
    room.bench.servo.registers.cells[register].read = lambda: value


def run_away(room: ModbusDesk) -> None:
    """It turns at 5 rad/s, for longer than any test."""
    room.bench.axis.start_move(45.0, 5.0, 100.0, 100.0)
    room.clock.sleep(0.2)
    assert room.bench.axis.speed_rad_s > 4.0


# ── quick stop ───────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize(
    ("transport", "fault"),
    [("rtu", "drop"), ("tcp", "busy=0.4"), ("tcp", "acknowledge=0.1"), ("tcp", "drop")],
)
def test_a_quick_stop_is_repeated_until_the_statusword_agrees(transport: str, fault: str) -> None:
    with modbus_desk(transport) as room, room.enabled():
        run_away(room)
        room.bench.happen(fault)
        room.drive.halt()
        assert room.bench.servo.power.state is State.QUICK_STOP
        assert room.until(lambda: room.bench.axis.standstill)


def test_a_quick_stop_that_is_taken_and_not_followed_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    control = PowerStage.control
    ignored = [QUICK_STOP] * 3

    def hard_of_hearing(power: PowerStage, word: int) -> int:
        if word == QUICK_STOP and ignored:
            ignored.pop()
            return 0
        return control(power, word)

    with modbus_desk() as room, room.enabled():
        run_away(room)
        monkeypatch.setattr(PowerStage, "control", hard_of_hearing)
        room.drive.halt()
        assert room.controlwords[-4:] == [QUICK_STOP] * 4
        assert room.bench.servo.power.state is State.QUICK_STOP


def let_go_at(room: ModbusDesk, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Speeds (rad/s) at which the voltage will have gone."""
    power, speeds = room.bench.servo.power, list[float]()
    off = power._off

    def watched(into: State) -> None:
        if power.energised:
            speeds.append(abs(room.bench.axis.speed_rad_s))
        off(into)

    monkeypatch.setattr(power, "_off", watched)
    return speeds


def test_the_voltage_stays_as_long_as_the_drive_brakes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten seconds here: three were all it got."""
    with modbus_desk() as room, room.enabled():
        room.bench.servo.power.stop_rate_rad_s2 = 0.5
        speeds = let_go_at(room, monkeypatch)
        run_away(room)
        room.drive.disable()
        assert len(speeds) == 1
        assert speeds[0] < 0.05


def test_where_the_speed_no_longer_falls_the_voltage_goes_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with modbus_desk() as room, room.enabled():
        room.bench.servo.power.stop_rate_rad_s2 = 1e-3
        speeds = let_go_at(room, monkeypatch)
        run_away(room)
        began_s = room.clock.now()
        with pytest.raises(CoastingError, match=r"still turned at [45]\.?\d* rad/s.*it coasts"):
            room.drive.disable()
        assert room.clock.now() - began_s < 6.0
        assert len(speeds) == 1
        room.drive.disable()


@pytest.mark.parametrize(
    ("transport", "fault"),
    [("tcp", "deaf"), ("rtu", "mute"), ("tcp", "exception=100:4"), ("tcp", "silent=102")],
)
def test_halting_a_drive_that_is_gone_ends_and_never_raises(transport: str, fault: str) -> None:
    with modbus_desk(transport) as room, room.enabled():
        run_away(room)
        room.bench.happen(fault)
        began_s = room.clock.now()
        room.drive.halt()
        assert room.clock.now() - began_s < 12.0
        assert room.controlwords.count(QUICK_STOP) >= 3


def test_a_generator_that_stays_on_is_switched_off_again() -> None:
    with modbus_desk() as room, room.enabled():
        room.bench.axis.configure(generator_control=2)
        room.bench.happen("exception=406:4")
        room.clock.later(0.3, room.bench.server.faults.now.refused.clear)
        room.drive.halt()
        assert room.bench.axis.settings.generator_control == 0


def enable_and_play(room: ModbusDesk) -> None:
    room.drive.enable()
    room.drive.play(room.stroke(**STROKE))


@pytest.mark.parametrize(
    "after_s", [*np.linspace(0.0002, 0.012, 24).round(5), *np.linspace(0.015, 0.3, 16).round(3)]
)
def test_after_a_halt_at_any_moment_nothing_enables_or_starts(after_s: float) -> None:
    """While it climbs (12 ms), waits, starts and moves; asked for by a callback of the clock, as by another thread."""
    with modbus_desk() as room:
        wanted = room.acquisition(duration_s=1.0)
        room.drive.write(room.drive.setup(wanted))
        room.drive.start(wanted)
        halted: list[int] = []

        def halt() -> None:
            halted.append(len(room.controlwords))
            room.drive.halt()

        room.clock.later(after_s, halt)
        with pytest.raises(StateError, match="halted"):
            enable_and_play(room)
        sent = room.controlwords[halted[0] :]
        assert QUICK_STOP in sent
        after = sent[sent.index(QUICK_STOP) :]
        assert not any(enables_operation(word) or word & NEW_SET_POINT for word in after)
        assert room.bench.servo.power.state is not State.ENABLED
        moves = room.bench.servo.moves
        with pytest.raises(StateError, match=r"halted|stands at"):
            room.drive.play(room.stroke(**STROKE))
        assert room.bench.servo.moves == moves
        room.drive.disable()
        room.drive.enable()  # asked for by name, it may
        assert room.bench.servo.power.state is State.ENABLED


# ── busy, and at it ──────────────────────────────────────────────────────────────────────────────────────────────────


def starts(room: ModbusDesk) -> int:
    return sum(1 for word in room.controlwords if word & NEW_SET_POINT)


def when_it_is_started(room: ModbusDesk, monkeypatch: pytest.MonkeyPatch, fault: str) -> None:
    """A fault that begins right before the start command."""
    machine = type(room.drive._state_machine)
    advance = machine.advance  # type: ignore[union-attr]

    def advance_late(self: object, controlword: int) -> None:
        if controlword & NEW_SET_POINT:
            room.bench.happen(fault)
        advance(self, controlword)  # type: ignore[arg-type]

    monkeypatch.setattr(machine, "advance", advance_late)


def test_a_drive_that_is_busy_is_asked_again_and_started_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exception 6: it was not carried out, so that it may be sent again."""
    with modbus_desk() as room, room.enabled():
        when_it_is_started(room, monkeypatch, "busy=0.3")
        recording = room.drive.play(room.stroke())
        assert recording.lost.size == 0
        assert starts(room) > 1
        assert room.bench.servo.moves == 1


def test_a_start_that_waits_for_a_busy_drive_is_not_sent_after_a_halt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with modbus_desk() as room, room.enabled():
        when_it_is_started(room, monkeypatch, "busy=0.3")
        room.clock.later(0.25, room.drive.halt)
        with pytest.raises(StateError, match="halted"):
            room.drive.play(room.stroke())
        assert room.bench.servo.moves == 0
        sent = room.controlwords
        assert not any(enables_operation(word) for word in sent[sent.index(QUICK_STOP) :])


def test_a_start_that_was_accepted_and_takes_its_time_is_not_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Exception 5: it is being carried out, so that it is waited for."""
    with modbus_desk() as room, room.enabled():
        when_it_is_started(room, monkeypatch, "acknowledge=0.1")
        room.drive.play(room.stroke())
        assert starts(room) == 1
        assert room.bench.servo.moves == 1


def test_a_parameter_that_was_accepted_and_then_not_taken_is_told() -> None:
    """Exception 5 says nothing of the value: whether it holds is seen when the drive is at it no longer."""
    with modbus_desk() as room:
        low, high, target = (room.drive.parameter(register) for register in (300, 302, 210))
        room.drive.write([ParameterValue(low, -1000), ParameterValue(high, 1000)])
        room.bench.happen("acknowledge=0.05")
        room.drive.write([ParameterValue(target, 900)])
        with pytest.raises(RegisterError, match=r"210 target.*then not taken"):
            room.drive.write([ParameterValue(target, 1100)])


def test_what_stays_busy_or_never_ends_is_told() -> None:
    with modbus_desk() as room:
        mode = room.drive.parameter(104)
        value = room.drive.read(mode)
        room.bench.happen("acknowledge=60")
        with pytest.raises(
            RegisterError, match=r"register 104.*was accepted, but whether it was carried out"
        ) as told:
            room.drive.write([value])
        assert told.value.code == 5
        with pytest.raises(RegisterError, match="busy") as told:
            room.drive.read(mode)
        assert told.value.code == 6
        assert room.clock.now() < 10.0


# ── off ──────────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("word", [0x0003, 0x0025])
def test_a_pattern_that_the_standard_does_not_list_is_not_off(word: int) -> None:
    with modbus_desk() as room, room.enabled():
        shows(room, STATUSWORD, word)
        with pytest.raises(StateError, match=rf"may still be energised .*0x{word:04X}"):
            room.drive.disable()
        assert room.controlwords[-1] == DISABLE_VOLTAGE
        assert not room.bench.axis.energised


@pytest.mark.parametrize("fault", ["exception=102:4", "silent=102", "mute"])
def test_a_statusword_that_cannot_be_read_is_not_off(fault: str) -> None:
    with modbus_desk() as room, room.enabled():
        room.bench.happen(fault)
        with pytest.raises(DriveError, match=r"may still be energised|did not answer"):
            room.drive.disable()
        assert DISABLE_VOLTAGE in room.controlwords[-2:]
        assert not room.bench.axis.energised


def test_a_drive_that_we_never_enabled_is_not_off_either_where_it_shows_nonsense() -> None:
    with modbus_desk() as room:
        shows(room, STATUSWORD, 0x0003)
        with pytest.raises(StateError, match="may still be energised"):
            room.drive.disable()
        assert room.controlwords[-1] == DISABLE_VOLTAGE


def test_nonsense_that_passes_is_waited_out() -> None:
    with modbus_desk() as room, room.enabled():
        cell = room.bench.servo.registers.cells[STATUSWORD]
        honest = cell.read
        shows(room, STATUSWORD, 0x0003)
        room.clock.later(0.5, lambda: setattr(cell, "read", honest))
        room.drive.disable()
        assert room.bench.servo.power.state is State.SWITCH_ON_DISABLED


def test_a_fault_reaction_is_waited_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """It ends when the brake has fallen in, half a second after the axis stands."""
    with modbus_desk() as room, room.enabled():
        run_away(room)
        power, clock = room.bench.servo.power, room.clock
        power.stop_rate_rad_s2 = 4.0  # 1.2 s
        poll, held_until_s = power.poll, clock.now() + 1.8
        monkeypatch.setattr(power, "poll", lambda: poll() if clock.now() > held_until_s else None)
        power.fail(0x4310)
        room.drive.disable()
        assert power.state is State.FAULT
        assert not room.bench.axis.energised
        room.drive.reset_fault()
        assert power.state is State.SWITCH_ON_DISABLED


def test_a_fault_is_reset_after_its_reaction() -> None:
    with modbus_desk() as room, room.enabled():
        run_away(room)
        power = room.bench.servo.power
        power.stop_rate_rad_s2 = 4.0
        power.fail(0x4310)
        room.drive.reset_fault()
        assert power.state is State.SWITCH_ON_DISABLED
        assert room.bench.axis.standstill


def coarse_family(folder: Path) -> Path:
    """The bench's own, with 1000 counts per revolution."""
    source = Path(__file__).parents[2] / "device_profiles" / "schwung-bench-modbus" / "profile.toml"
    text = source.read_text(encoding="utf-8").replace("5.992112452678286e-06", repr(2 * math.pi / 1000))
    file = folder / "profile.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_standstill_is_an_angle_and_not_a_number_of_counts(tmp_path: Path) -> None:
    """5 rad/s are 40 coarse counts in 50 ms: no standstill, and no moment to let go of the axis."""
    with modbus_desk(family=str(coarse_family(tmp_path))) as room, room.enabled():
        run_away(room)
        room.bench.servo.power.stop_rate_rad_s2 = 3.0  # 1.7 s
        let_go_at: list[float] = []

        def look() -> None:
            if not room.bench.axis.energised and not let_go_at:
                let_go_at.append(abs(room.bench.axis.speed_rad_s))

        watching = room.clock.every(0.001, look)
        room.drive.disable()
        room.clock.sleep(0.002)
        watching.close()
        assert let_go_at
        assert let_go_at[0] < 0.05  # 1.5 coarse counts in 50 ms would be 0.19 rad/s


# ── before it is energised ───────────────────────────────────────────────────────────────────────────────────────────


def test_a_drive_that_shows_another_mode_is_not_energised() -> None:
    with modbus_desk() as room:
        wanted = room.acquisition()
        room.drive.write(room.drive.setup(wanted))
        room.drive.start(wanted)
        shows(room, MODE_DISPLAY, 3)
        with pytest.raises(StateError, match=r"mode 1 was asked for, the drive shows 3 \(register 108\)"):
            room.drive.enable()
        assert not any(word & ENABLE_OPERATION for word in room.controlwords)
        assert not room.bench.axis.energised


# ── the trace's window ───────────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("transport", ["tcp", "rtu"])
def test_no_row_is_skipped_or_doubled_where_reading_moves_the_window_on(transport: str) -> None:
    """A tenth of the answers is lost: to the window's reading, so that it has moved, and to its placing."""
    with modbus_desk(transport) as room, room.enabled(trace_rate_hz=2000.0):
        room.bench.servo.reading_advances = True
        stroke = room.stroke(1.0)
        status = room.bench.servo.registers.cells[506]
        told, count_rad = status.read, 2 * np.pi / 2**20

        def spoil_when_full() -> float:
            assert told is not None
            if (value := told()) == 3:
                room.bench.happen("garble=0.1")
            return value

        status.read = spoil_when_full
        recording = room.drive.play(stroke)
        traced = room.bench.axis.trace
        room.bench.happen("garble=0")
    assert recording.lost.size == 0
    np.testing.assert_allclose(recording.position_rad, traced.position_counts * count_rad, atol=count_rad / 2)


def test_a_window_that_shows_not_where_it_stands_is_no_reason_not_to_read_it() -> None:
    def refuse() -> float:
        raise RefusalError(ILLEGAL_ADDRESS)

    with modbus_desk() as room, room.enabled():
        cell = room.bench.servo.registers.cells[CURSOR]
        cell.read = refuse
        wanted = room.acquisition()
        room.drive.setup(wanted)
        assert CURSOR not in {parameter.index for parameter in room.drive.passed_through([])}
        recording = room.drive.play(room.stroke())
        assert recording.lost.size == 0
        assert recording.position_rad[-1] == pytest.approx(1.0, abs=0.05)


def test_a_fault_before_it_is_enabled_is_told() -> None:
    with modbus_desk() as room:
        room.bench.servo.power.fail(0x3210)
        with pytest.raises(DriveFaultError, match="0x3210"):
            room.drive.enable()
        assert not any(word & ENABLE_OPERATION for word in room.controlwords)
