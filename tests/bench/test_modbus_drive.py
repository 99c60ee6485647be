"""A drive on Modbus through the real driver: it moves, injects and records by itself, and every trouble stops it."""

from dataclasses import replace

import numpy as np
import pytest
from modbus_desk import ModbusDesk, line_options, modbus_bench, modbus_desk, profile_of

from schwung.clock import SteppedClock
from schwung.errors import DriveFaultError, InputError, NodeLostError, RegisterError, StateError
from schwung.fieldbus.cia402 import NEW_SET_POINT
from schwung.fieldbus.drive import Guard, Sine, partial_recording
from schwung.fieldbus.modbus import ModbusDrive, ModbusLink, match_profile, scan_units
from schwung.fieldbus.modbus.state_machine import StateMachine
from schwung_sim.drives.modbus.power import State

BOTH = pytest.mark.parametrize("transport", ["tcp", "rtu"])
SINE = Sine(frequency_hz=50.0, amplitude_nm=20.0)


def registers(room: ModbusDesk) -> dict[int, object]:
    """Everything that can be set, as the drive holds it now."""
    live = {100, 102, 106, 112, 200, 202, 204, 506}
    return {p.index: room.drive.read(p).raw for p in room.drive.parameters() if p.index not in live}


@BOTH
def test_it_tells_who_it_is_what_it_keeps_and_what_it_can(transport: str) -> None:
    with modbus_desk(transport) as room:
        drive = room.drive
        assert (drive.identity.vendor_id, drive.identity.serial) == (0x53574E47, 7)
        assert drive.state().cia402 == "Switch on disabled"
        limits = drive.limits()
        assert limits.torque_max_nm == pytest.approx(233.0)
        assert limits.position_max_rad == pytest.approx(50.0, abs=1e-4)
        assert limits.following_error_time_s == pytest.approx(0.01)
        told = {c.name: c for c in drive.capabilities()}
        assert told["trace buffer"].available
        assert told["generator"].available
        assert told["stop by heartbeat"].available
        assert "has no SYNC" in told["sampling by SYNC"].reason
        assert room.bench.servo.moves == 0


def test_it_is_found_by_its_identity_and_by_asking_around() -> None:
    clock = SteppedClock()
    with modbus_bench("tcp", clock, unit=3) as bench:
        options, line = line_options(bench), bench.line
        assert match_profile(options, 3, clock=clock, line=line).family == "schwung-bench-modbus"
        found = scan_units(options, range(2, 5), clock=clock, line=line)
        assert [(node.node_id, node.profiles, node.serial) for node in found] == [
            (3, ("schwung-bench-modbus",), 7)
        ]
        with pytest.raises(InputError, match=r"unit 2 .* fits no profile"):
            match_profile(options, 2, clock=clock, line=line)


def test_a_wrong_word_order_is_seen_before_anything_else() -> None:
    with (
        pytest.raises(InputError, match=r"reads 0x4e475357, not 0x53574e47.* word order"),
        modbus_desk(faults="swap"),
    ):
        pass


@BOTH
def test_a_stroke_is_recorded_as_the_drive_traced_it(transport: str) -> None:
    with modbus_desk(transport) as room, room.enabled(trace_rate_hz=2000.0):
        recording = room.drive.play(room.stroke(1.0, sine=SINE))
        traced = room.bench.axis.trace
    count_rad = 2 * np.pi / 2**20
    assert recording.sample_rate_hz == 2000.0
    assert recording.start_s == pytest.approx(0.1)
    assert recording.lost.size == 0
    np.testing.assert_allclose(recording.position_rad, traced.position_counts * count_rad, atol=count_rad / 2)
    np.testing.assert_allclose(recording.torque_nm, traced.torque_nm, atol=0.0051)
    np.testing.assert_allclose(recording.torque_added_nm, traced.torque_added_nm, atol=0.0051)
    np.testing.assert_allclose(recording.position_demand_rad, traced.demand_rad, atol=count_rad)
    assert np.max(recording.torque_added_nm) == pytest.approx(20.0, rel=0.01)
    assert recording.position_demand_rad[-1] == pytest.approx(1.0, abs=1e-5)
    assert np.std(recording.torque_added_nm[:40]) > 10.0  # the sine was on before the motion


@BOTH
def test_the_same_calls_give_the_same_bytes(transport: str) -> None:
    """Noise, lost answers and time are all the seed's; nothing is the computer's."""
    runs = []
    for _ in range(2):
        with modbus_desk(transport, faults="garble=0.02") as room, room.enabled():
            recording = room.drive.play(room.stroke(1.0, sine=SINE))
            runs.append((room.sent, room.clock.now(), recording.position_rad.tobytes()))
    assert runs[0] == runs[1]


def test_a_sine_from_the_motion_on_starts_at_its_phase() -> None:
    sine = replace(SINE, phase_rad=np.pi / 2, from_motion=True)
    with modbus_desk() as room, room.enabled(trace_rate_hz=2000.0):
        recording = room.drive.play(room.stroke(1.0, sine=sine))
        traced = room.bench.axis.trace.torque_added_nm
    np.testing.assert_allclose(recording.torque_added_nm, traced, atol=0.02)
    assert recording.torque_added_nm[0] == pytest.approx(20.0, abs=0.02)


def test_what_playing_changes_is_as_before_and_was_announced() -> None:
    with modbus_desk() as room:
        wanted = room.acquisition()
        room.drive.write(room.drive.setup(wanted))
        before = registers(room)
        announced = {p.index for p in room.drive.passed_through([])}
        room.drive.start(wanted)
        room.drive.enable()
        room.drive.play(room.stroke(0.5, sine=SINE))
        room.drive.disable()
        room.drive.stop()
        after = registers(room)
    assert {index for index in before if before[index] != after[index]} <= {
        502
    }  # the trace is as long as it was
    assert {210, 212, 214, 216, 400, 402, 404, 406, 504, 508} <= announced


def test_setup_tightens_what_the_drive_keeps() -> None:
    guard = Guard(
        -1.0, 2.0, torque_max_nm=50.0, following_error_rad=0.2, following_error_time_s=0.004, speed_max_rad_s=12.0
    )  # fmt: skip
    with modbus_desk() as room:
        wanted = replace(room.acquisition(), guard=guard)
        room.drive.write(room.drive.setup(wanted))
        limits = room.drive.limits()
        assert limits.position_min_rad == pytest.approx(-1.0, abs=1e-5)
        assert limits.position_max_rad == pytest.approx(2.0, abs=1e-5)
        assert limits.torque_max_nm == pytest.approx(50.0)
        assert limits.following_error_rad == pytest.approx(0.2, abs=1e-5)
        assert limits.following_error_time_s == pytest.approx(0.004)
        assert limits.speed_max_rad_s == pytest.approx(12.0, abs=1e-3)
        assert room.drive.setup(wanted) == []
        room.drive.start(wanted)
        room.drive.enable()
        with pytest.raises(RegisterError, match=r"register 210 target.*does not take this value"):
            room.drive.play(room.stroke(3.0))
        assert room.bench.servo.moves == 0


def test_two_strokes_and_other_ways_are_refused_before_anything_moves() -> None:
    with modbus_desk() as room, room.enabled():
        stroke = room.stroke()
        with pytest.raises(InputError, match="--one-way"):
            room.drive.play(replace(stroke, moves=(*stroke.moves, *stroke.moves)))
        with pytest.raises(StateError, match="the motion starts at"):
            room.drive.play(replace(stroke, position_rad=stroke.position_rad + 1.0))
        assert room.bench.servo.moves == 0
        for changes, words in (
            ({"mode": "csp"}, "too slow for setpoints"),
            ({"sampling": "sync"}, "has no SYNC"),
        ):
            with pytest.raises(InputError, match=words):
                room.drive.setup(replace(room.acquisition(), **changes))  # type: ignore[arg-type]  # by name


@pytest.mark.parametrize(("transport", "again"), [("tcp", True), ("tcp", False), ("rtu", False)])
def test_after_a_lost_connection_nothing_moves_by_surprise(transport: str, again: bool) -> None:
    """In the middle of a stroke. The drive is halted when the line is back, and by its watchdog where it is not."""
    fault = "drop@moving+0.2" if again else "deaf@moving+0.2"
    with (
        modbus_desk(transport, faults=fault) as room,
        room.enabled(duration_s=3.0, trace_rate_hz=500.0),
    ):
        with pytest.raises((NodeLostError, RegisterError, StateError, DriveFaultError)) as caught:
            room.drive.play(room.stroke(6.0, duration_s=3.0, sine=SINE))
        if again:
            assert isinstance(caught.value, NodeLostError)
        power, axis = room.bench.servo.power, room.bench.axis
        assert room.until(lambda: power.state in (State.QUICK_STOP, State.FAULT))
        assert room.until(lambda: axis.standstill and axis.demand_speed_rad_s == 0.0)
        stands = axis.position_rad
        assert stands < 5.0
        assert power.error == (0 if again else 0x7500)
        assert not room.until(lambda: abs(axis.position_rad - stands) > 0.05, 0.3)
        assert room.bench.servo.moves == 1


def test_a_short_silence_on_a_serial_line_is_outlived() -> None:
    """Nothing was sent but questions, and those may be asked again; the drive has gone on by itself."""
    with (
        modbus_desk("rtu", faults="drop@moving+0.3") as room,
        room.enabled(duration_s=1.0, trace_rate_hz=500.0),
    ):
        recording = room.drive.play(room.stroke(3.0, duration_s=1.0))
        assert recording.lost.size == 0
        assert recording.position_demand_rad[-1] == pytest.approx(3.0, abs=1e-5)
        assert room.bench.servo.moves == 1


@pytest.mark.parametrize("back", [True, False])
def test_a_start_command_does_not_go_over_a_connection_that_came_back(
    back: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lost between the last look and the start; found out by whoever asks next, or by the start command itself."""
    advance = StateMachine.advance
    with modbus_desk() as room, room.enabled(duration_s=0.2):

        def advance_late(machine: StateMachine, controlword: int) -> None:
            if controlword & NEW_SET_POINT:
                room.bench.server.drop()
                if back:
                    machine.statusword()
            advance(machine, controlword)

        monkeypatch.setattr(StateMachine, "advance", advance_late)
        with pytest.raises(NodeLostError, match="the connection was lost"):
            room.drive.play(room.stroke(1.0))
        starts = [word for word in room.controlwords if word & NEW_SET_POINT]
        assert len(starts) == (0 if back else 1)
        assert room.bench.servo.moves == 0
        assert room.until(lambda: room.bench.servo.power.state is State.QUICK_STOP)


def test_a_halt_from_elsewhere_is_not_overtaken_by_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked for between the last look and the start."""
    advance = StateMachine.advance
    with modbus_desk() as room, room.enabled(duration_s=0.2):

        def advance_late(machine: StateMachine, controlword: int) -> None:
            if controlword & NEW_SET_POINT:
                room.drive.halt()
            advance(machine, controlword)

        monkeypatch.setattr(StateMachine, "advance", advance_late)
        with pytest.raises(StateError, match="was halted"):
            room.drive.play(room.stroke(1.0))
        assert room.bench.servo.moves == 0


def test_a_start_command_that_was_not_answered_is_not_sent_again() -> None:
    """It was carried out all the same: the drive is halted instead."""
    with (
        modbus_desk(faults="silent=100@moving+0") as room,
        room.enabled(duration_s=1.0),
    ):
        with pytest.raises(RegisterError, match=r"register 100 controlword.*did not answer"):
            room.drive.play(room.stroke(6.0, duration_s=1.0))
        assert room.bench.servo.moves == 1
        assert room.until(lambda: room.bench.servo.power.state is State.QUICK_STOP)
        assert room.bench.axis.position_rad < 5.0


def test_halt_from_elsewhere_ends_a_motion() -> None:
    with modbus_desk() as room, room.enabled(duration_s=1.0):
        room.clock.later(0.4, room.drive.halt)
        with pytest.raises(StateError, match="halted by us"):
            room.drive.play(room.stroke(6.0, duration_s=1.0, sine=SINE))
        assert room.bench.servo.power.state is State.QUICK_STOP
        assert room.bench.axis.settings.generator_control == 0
        assert room.until(lambda: room.bench.axis.standstill)


@pytest.mark.parametrize(
    ("fault", "words"), [("fault=0x4310@moving+0.25", "0x4310"), ("following-error@moving+0.15", "0x8611")]
)
def test_a_fault_is_told_and_what_was_traced_until_then_is_kept(fault: str, words: str) -> None:
    with modbus_desk(faults=fault) as room, room.enabled(duration_s=0.8):
        with pytest.raises(DriveFaultError, match=words) as caught:
            room.drive.play(room.stroke(6.0, duration_s=0.8))
        partial = partial_recording(caught.value)
        assert partial is not None
        assert 0 < partial.lost.size < partial.position_rad.size
        before = partial.position_rad[: partial.lost[0]]
        assert np.all(np.diff(before) >= -1e-4)
        room.drive.disable()
        assert room.drive.state().cia402.startswith("Fault")
        assert room.until(lambda: room.bench.servo.power.state is State.FAULT)
        with pytest.raises(DriveFaultError, match="fault is present"):
            room.drive.enable()
        room.drive.reset_fault()
        assert room.drive.state().cia402 == "Switch on disabled"
        assert not room.bench.axis.energised


def test_a_drive_that_is_closed_while_it_moves_is_stopped_and_off() -> None:
    with modbus_desk() as room:
        wanted = room.acquisition(duration_s=1.0)
        room.drive.write(room.drive.setup(wanted))
        room.drive.start(wanted)
        room.drive.enable()
        room.bench.axis.start_move(3.0, 2.0, 20.0, 20.0)
        room.drive.close()
        assert not room.bench.axis.energised
        assert room.bench.axis.standstill


def test_the_drive_hears_us_while_we_do_nothing_and_stops_when_we_do_not() -> None:
    with modbus_desk() as room:
        with room.enabled():
            assert not room.until(
                lambda: room.bench.servo.power.state is not State.ENABLED, 1.4
            )  # the watchdog is 1 s
        assert room.until(lambda: room.bench.servo.power.state is State.FAULT, 2.5)
        assert room.bench.servo.power.error == 0x7500


def test_start_wants_what_setup_asks_for() -> None:
    with modbus_desk() as room, pytest.raises(StateError, match="register 104 mode"):
        room.drive.start(room.acquisition())


def test_another_family_is_not_taken_for_this_one() -> None:
    clock = SteppedClock()
    with modbus_bench("tcp", clock, profile="schneider-lexium-32") as bench:
        profile = profile_of()
        link = ModbusLink(line_options(bench), 1, profile.modbus, clock=clock, line=bench.line)
        with pytest.raises(InputError, match="does not answer as Schwung bench drive"):
            ModbusDrive(link, profile)
        link.close()
