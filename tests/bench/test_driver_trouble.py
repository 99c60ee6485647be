"""What goes wrong while the driver moves the drive: a clear error, the recording so far, a drive that has stopped."""

from __future__ import annotations

import can
import numpy as np
import pytest
from bench_peer import Master
from driver_desk import NODE, bench_and_bus, connected, enabled, stroke

from schwung.errors import (
    BusError,
    DriveError,
    DriveFaultError,
    NodeLostError,
    SdoError,
    StateError,
)
from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.canopen.link import Frame
from schwung.fieldbus.drive import Acquisition, partial_recording
from schwung.fieldbus.profile import load_profile
from schwung_sim.drives.power import Power

CSP = Acquisition("csp", 1000.0)
LONG = stroke(20_000, distance_rad=3.0)


@pytest.mark.parametrize(
    ("fault", "kind", "words"),
    [
        ("emcy=0x4310@on+0.3", DriveFaultError, "0x4310 excess temperature, drive"),
        ("following-error@on+0.3", DriveFaultError, "0x8611 following error"),
        ("reset@on+0.3", NodeLostError, "restarted on its own"),
        ("heartbeat-stop@on+0.3", NodeLostError, "no heartbeat"),
        ("bus-off@on+0.3", NodeLostError, "did not answer|no heartbeat"),
        ("second-master=0x0006@on+0.3", StateError, "another master"),
        ("not-following@on+0.3", StateError, "no longer follows its setpoints"),
    ],
)
def test_trouble_in_motion_is_named_and_the_drive_stops(
    fault: str, kind: type[DriveError], words: str
) -> None:
    with enabled(faults=fault) as (bench, drive):
        with pytest.raises(kind, match=words) as raised:
            drive.play(LONG)
        recording = partial_recording(raised.value)
        assert recording is not None
        assert 250 <= recording.position_rad.size < 20_000
        assert np.all(np.isfinite(recording.position_rad[:250]))
        assert bench.servo.settle(2.0)
        assert bench.servo.power.state is not Power.OPERATION_ENABLED


def test_lost_frames_become_nan_and_shift_nothing() -> None:
    with enabled(faults="drop=0.01@on+0.05") as (_, drive):
        recording = drive.play(stroke(400))
        lost = recording.lost
        assert 2 <= lost.size <= 40
        for values in (recording.position_rad, recording.speed_rad_s, recording.torque_nm):
            assert np.array_equal(np.flatnonzero(np.isnan(values)), lost)
        assert np.all(recording.statusword[lost] == -1)
        assert recording.position_rad.size == 400
        good = np.isfinite(recording.position_rad)
        assert np.max(np.abs((recording.position_rad - recording.position_demand_rad)[good])) < 0.02


def test_halt_from_elsewhere_ends_the_motion() -> None:
    with enabled() as (bench, drive):
        drive.clock.later(0.2, drive.halt)
        with pytest.raises(StateError, match="halt") as raised:
            drive.play(LONG)
        assert partial_recording(raised.value) is not None
        assert bench.servo.power.state is Power.SWITCH_ON_DISABLED  # by itself, when it stands (605A = 2)
        assert abs(bench.axis.speed_rad_s) < 0.05


def test_halt_while_it_is_being_enabled_is_not_forgotten() -> None:
    """Somebody says halt between two steps of the state machine: the next step may not come."""
    with connected() as (bench, drive):
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        done = []

        def halt_when_switched_on() -> None:
            if bench.servo.power.state is Power.SWITCHED_ON and not done:
                done.append(True)
                drive.halt()

        drive.clock.every(0.001, halt_when_switched_on)
        with pytest.raises(StateError, match="halt"):
            drive.enable()
        assert bench.servo.power.state is not Power.OPERATION_ENABLED
        with pytest.raises(StateError):
            drive.play(stroke(100))


def test_a_drive_that_somebody_else_has_switched_on_is_left_alone() -> None:
    with connected() as (bench, drive):
        drive.write(drive.setup(CSP))
        other = Master(interface="stepped", channel=bench.channel)
        for word in (0x06, 0x07, 0x0F):
            other.write(0x6040, 0, word, 2)
        with pytest.raises(StateError, match="somebody else"):
            drive.start(CSP)
        assert bench.servo.power.state is Power.OPERATION_ENABLED
        other.write(0x6040, 0, 0, 2)
        other.close()


def test_a_node_that_is_lost_while_it_is_enabled_is_given_up_soon() -> None:
    with connected(faults="bus-off@on+0.0") as (bench, drive):
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        began = drive.clock.now()
        with pytest.raises((NodeLostError, SdoError)):
            drive.enable()
        drive.close()
        assert drive.clock.now() - began < 4.0
        assert bench.servo.settle(2.0)


def test_an_observer_that_fails_stops_the_drive_and_keeps_the_recording() -> None:
    def fail(done: int, total: int) -> None:
        if done > 300:
            raise BrokenPipeError

    with enabled() as (bench, drive):
        with pytest.raises(BrokenPipeError) as raised:
            drive.play(LONG, fail)
        recording = partial_recording(raised.value)
        assert recording is not None
        assert recording.position_rad.size > 300
        assert bench.servo.power.state is Power.SWITCH_ON_DISABLED  # by itself, when it stands (605A = 2)


def test_an_interrupt_stops_the_drive_and_keeps_the_recording() -> None:
    def interrupt(done: int, total: int) -> None:
        if done > 300:
            raise KeyboardInterrupt

    with enabled() as (bench, drive):
        with pytest.raises(KeyboardInterrupt) as raised:
            drive.play(LONG, interrupt)
        recording = partial_recording(raised.value)
        assert recording is not None
        assert recording.position_rad.size > 300
        assert bench.servo.power.state is Power.SWITCH_ON_DISABLED  # by itself, when it stands (605A = 2)
        drive.disable()
        assert not bench.servo.power.energised


def test_our_own_adapter_going_bus_off_is_a_bus_error_and_the_drive_stops_by_itself() -> None:
    with bench_and_bus(tool_faults={"drop": 0.0}) as (bench, bus):
        drive = CanopenDrive(bus, NODE, load_profile("schwung-bench"))
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        drive.enable()
        drive.clock.later(0.2, bus.go_bus_off)  # type: ignore[attr-defined]
        with pytest.raises(BusError):
            drive.play(LONG)
        began = drive.clock.now()
        drive.close()
        assert drive.clock.now() - began < 8.0
        assert bench.servo.settle(2.0)


def test_when_we_die_the_drive_stops_by_its_own_heartbeat_consumer() -> None:
    with enabled() as (bench, drive):
        assert drive._parameters._heartbeat is not None
        drive._parameters._heartbeat.close()  # what kill -9 does: our heartbeat ends, nothing else is said
        assert bench.servo.settle(2.0)
        assert bench.servo.power.state is not Power.OPERATION_ENABLED


def test_a_fault_is_only_reset_on_request_and_energises_nothing() -> None:
    with enabled(faults="emcy=0x4310@on+0.2") as (bench, drive):
        with pytest.raises(DriveFaultError):
            drive.play(LONG)
        assert bench.servo.settle(2.0)
        drive.disable()
        with pytest.raises(DriveFaultError, match="0x4310"):
            drive.enable()
        assert bench.servo.power.state is Power.FAULT
        drive.reset_fault()
        assert bench.servo.power.state is Power.SWITCH_ON_DISABLED
        drive.enable()
        assert drive.play(stroke(200, begin_rad=drive.state().position_rad)).lost.size == 0


def test_foreign_setpoints_on_our_identifier_are_noticed() -> None:
    with enabled() as (bench, drive):
        other = can.Bus(interface="stepped", channel=bench.channel)
        foreign = Frame(0x200 + NODE, bytes([0x06, 0, 0, 0, 0, 0, 0, 0]))
        drive.clock.later(0.2, lambda: other.send(foreign))
        with pytest.raises(StateError, match="another master sends setpoints"):
            drive.play(LONG)
        other.shutdown()
        assert bench.servo.settle(2.0)


@pytest.mark.parametrize(
    ("fault", "words"),
    [("sdo-abort=0x6060:0x06090030", "value out of range"), ("sdo-timeout=0x6060", "no answer")],
)
def test_an_object_that_cannot_be_written_is_named(fault: str, words: str) -> None:
    with connected(faults=fault) as (bench, drive):
        mode = drive.parameter(0x6060)
        with pytest.raises(SdoError, match=f"0x6060:00.*{words}"):
            drive.read(mode)
        assert drive.read(drive.parameter(0x6061)).raw == 0  # the channel goes on working
        assert not bench.servo.power.energised


def test_closing_in_mid_motion_stops_the_drive_and_does_not_hang() -> None:
    with enabled(rate_hz=200.0, sync="thread") as (bench, drive):
        drive.clock.later(0.3, drive.close)
        with pytest.raises(DriveError):
            drive.play(stroke(2000, 200.0))
        assert drive.clock.now() < 8.0
        assert not bench.servo.power.energised


def test_a_drive_under_local_control_is_told_to_be_energised_still() -> None:
    """It ignores controlwords: nothing of ours stops it, which has to be said."""
    with enabled(faults="local@on+0.3") as (bench, drive):
        with pytest.raises(StateError, match="no longer takes commands"):
            drive.play(LONG)
        with pytest.raises(StateError, match="may still be energised"):
            drive.disable()
        assert bench.axis.energised
