"""Stops that come at the worst instant, and drives that are but half heard: what once moved again, coasted, or was
switched on again and again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial

import can
import numpy as np
import pytest
from bench_peer import Master
from driver_desk import NODE, connected
from driver_desk import enabled as enabled_at
from driver_desk import stroke as stroke_at
from modbus_desk import modbus_desk

from schwung.clock import SteppedBus
from schwung.errors import CoastingError, DriveError, EnergisedError, SdoError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.canopen.generator import SineGenerator
from schwung.fieldbus.canopen.operation import Operation
from schwung.fieldbus.drive import Acquisition, ParameterValue, Setpoints, Sine
from schwung_sim.bench import Bench
from schwung_sim.drives.dictionary import key
from schwung_sim.drives.modbus.power import State as ModbusState
from schwung_sim.drives.power import Power

#: Slow enough that many seconds of braking are soon over, and that there is much time between an RPDO and its SYNC.
RATE_HZ = 250.0
CSP = Acquisition("csp", RATE_HZ)
enabled, stroke = partial(enabled_at, RATE_HZ), partial(stroke_at, rate_hz=RATE_HZ)
FAST = stroke(250, distance_rad=3.0)  # 9 rad/s after a quarter of a second
SLOWLY_RAD_S2 = 7.0  # it takes 1.3 s from there
TPDOS = (0x180 + NODE, 0x280 + NODE)


@dataclass(frozen=True)
class Seen:
    """The power stage was first seen in a state, at this speed."""

    time_s: float
    state: Power
    speed_rad_s: float


@contextmanager
def watched(bench: Bench) -> Iterator[list[Seen]]:
    """Every change of the power stage, from within: it calls for each controlword and each control tick."""
    power, seen = bench.servo.power, []

    def look() -> None:
        if not seen or seen[-1].state is not power.state:
            seen.append(Seen(bench.servo._monotonic(), power.state, bench.axis.speed_rad_s))

    control, poll = power.control, power.poll

    def controlled(word: int) -> None:
        control(word)
        look()

    def polled() -> None:
        poll()
        look()

    power.control, power.poll = controlled, polled  # type: ignore[method-assign]  # somebody watches
    look()
    try:
        yield seen
    finally:
        power.control, power.poll = control, poll  # type: ignore[method-assign]


def states(seen: list[Seen]) -> list[Power]:
    return [entry.state for entry in seen]


def brakes_slowly(bench: Bench, ramp_rad_s2: float = SLOWLY_RAD_S2) -> None:
    """However far that leads: there is no limit (607D) in the way."""
    bench.servo.power._ramp = lambda index: ramp_rad_s2
    for subindex in (1, 2):
        bench.servo.dictionary.values[key(0x607D, subindex)] = 0
    bench.servo.operation.load()


def stays_in_quick_stop(drive: CanopenDrive) -> None:
    """605A = 6, from where "enable operation" leads back into motion."""
    drive.write([ParameterValue(drive.parameter(0x605A), 6)])


def halt_when_fast(bench: Bench, drive: CanopenDrive) -> None:
    """By the axis: in lockstep the drive's time is ahead of the clock's."""
    halted: list[bool] = []

    def look() -> None:
        if bench.axis.speed_rad_s > 8.0 and not halted:
            halted.append(True)
            drive.halt()

    drive.clock.every(0.001, look)


def lost(drive: CanopenDrive, *can_ids: int, before: Callable[[], object] = lambda: None) -> None:
    """From now on frames with these identifiers are lost; none given: all that the tool should hear."""
    bus = drive._link.bus
    assert isinstance(bus, SteppedBus)
    bus.wire.weather = lambda sender, end, message: (
        () if (end is bus if not can_ids else message.arbitration_id in can_ids) else (0.0,)
    )
    before()


# ── a stop amid the exchange ─────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("after_s", 0.2 + np.arange(0.05, 1.0, 0.1).round(2) / RATE_HZ)
def test_a_frame_that_waits_for_its_sync_does_not_undo_a_stop(after_s: float) -> None:
    """An RPDO is sent half a period ahead of its SYNC: with 605A = 6, one that came before the quick stop by SDO and
    acts after it would bring the drive back into operation."""
    with enabled(sync="thread", clock="wall") as (bench, drive), watched(bench) as seen:
        stays_in_quick_stop(drive)
        drive.clock.later(after_s, drive.halt)
        with pytest.raises(StateError, match="halt"):
            drive.play(FAST)
        drive.disable()
        assert states(seen) == [
            Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED,
        ]  # fmt: skip


def test_a_frame_that_a_full_buffer_held_up_does_not_undo_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stop comes while the frame before it is being sent again."""
    with enabled(sync="thread", clock="wall") as (bench, drive), watched(bench) as seen:
        stays_in_quick_stop(drive)
        bus, send, full = drive._link.bus, drive._link.bus.send, []

        def send_when_there_is_room(message: can.Message, timeout: float | None = None) -> None:
            if message.arbitration_id == 0x200 + NODE and len(full) == 1:
                full.append(True)
                drive.clock.later(0.0002, drive.halt)
                raise can.CanOperationError("full", error_code=105)
            send(message, timeout)

        monkeypatch.setattr(bus, "send", send_when_there_is_room)
        drive.clock.later(0.25, lambda: full.append(True))
        with pytest.raises(StateError, match="halt"):
            drive.play(FAST)
        assert len(full) == 2
        assert states(seen) == [Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE]


# ── a stop amid what is no motion ────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("after_s", np.arange(0.0, 0.24, 0.012).round(4))
def test_a_stop_while_it_is_being_set_up_or_started_is_not_forgotten(after_s: float) -> None:
    def go(drive: CanopenDrive) -> None:
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        drive.enable()
        drive.clock.sleep(0.2)
        drive.play(stroke(25))

    with connected(clock="wall") as (bench, drive), watched(bench) as seen:
        drive.clock.sleep(1.0)  # in which other masters are listened for
        drive.clock.later(after_s, drive.halt)
        with pytest.raises(StateError, match="halt"):
            go(drive)
        assert Power.OPERATION_ENABLED not in states(seen) or after_s > 0.1
        assert bench.servo.power.state is not Power.OPERATION_ENABLED
        drive.disable()
        drive.stop()
        go(drive)  # asked for anew
        assert bench.servo.power.state is Power.OPERATION_ENABLED


@pytest.mark.parametrize("after_s", np.arange(0.0005, 0.03, 0.002).round(4))
def test_a_stop_while_a_fault_is_being_reset_is_not_forgotten(after_s: float) -> None:
    with enabled(clock="wall") as (bench, drive):
        bench.servo.fault(0x4310)
        drive.clock.sleep(0.2)
        drive.clock.later(after_s, drive.halt)

        def reset_and_enable() -> None:
            drive.reset_fault()
            drive.clock.sleep(0.05)
            drive.enable()

        with watched(bench) as seen, pytest.raises(StateError, match="halt"):
            reset_and_enable()
        assert Power.OPERATION_ENABLED not in states(seen)


def test_resetting_a_fault_that_is_not_there_lets_no_axis_coast() -> None:
    with enabled(clock="wall") as (bench, drive), watched(bench) as seen:
        drive.clock.later(0.25, drive.reset_fault)
        with pytest.raises(StateError):
            drive.play(FAST)
        assert seen[-1].state is Power.SWITCH_ON_DISABLED
        assert abs(seen[-1].speed_rad_s) < 0.1


def test_a_generator_is_not_switched_on_after_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    with enabled(clock="wall") as (bench, drive):
        settings, on = SineGenerator.settings, []

        def settings_and_stop(generator: SineGenerator, sine: Sine) -> list[ParameterValue]:
            drive.clock.later(0.001, drive.halt)  # while they are written
            return settings(generator, sine)

        monkeypatch.setattr(SineGenerator, "settings", settings_and_stop)
        monkeypatch.setattr(Operation, "_approach", lambda *_, **__: None)
        drive.clock.every(0.0001, lambda: on.append(bench.axis.settings.generator_control != 0))
        motion = stroke(250)
        with pytest.raises(StateError, match="halt"):
            drive.play(Setpoints(RATE_HZ, motion.position_rad, motion.torque_added_nm, (), Sine(80.0, 2.0)))
        assert not any(on)


def test_what_breaks_off_after_the_motion_stops_the_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    """The generator cannot be switched off: its sine goes on."""
    with enabled(clock="wall") as (bench, drive):
        generator, write = drive._operation.own_means._sine_generator(), drive._sdo.write

        def refuse(value: ParameterValue, timeout_s: float | None = None) -> None:
            if value == generator.silent():
                raise SdoError("node 5, 0x2100:04", "the drive refused to write it")
            write(value, timeout_s)

        monkeypatch.setattr(drive._sdo, "write", refuse)
        motion = stroke(100, distance_rad=0.05)
        with pytest.raises(SdoError):
            drive.play(Setpoints(RATE_HZ, motion.position_rad, motion.torque_added_nm, (), Sine(80.0, 2.0)))
        assert bench.servo.power.state is not Power.OPERATION_ENABLED
        assert bench.axis.settings.generator_control == 0


# ── a drive that is but half heard ───────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("silent", [TPDOS, TPDOS[:1], TPDOS[1:], (0x580 + NODE,), (*TPDOS, 0x580 + NODE), ()])
def test_voltage_goes_when_the_axis_has_come_to_rest(silent: tuple[int, ...]) -> None:
    """Whatever of it is still heard: one that cannot be seen to stand is given the time for it."""
    with enabled(sync="thread", clock="wall") as (bench, drive), watched(bench) as seen:
        stays_in_quick_stop(drive)
        brakes_slowly(bench)
        drive.clock.later(0.25, lambda: lost(drive, *silent, before=drive.halt))
        with pytest.raises(DriveError):
            drive.play(FAST)
        began_s = drive.clock.now()
        unheard = silent in ((), (*TPDOS, 0x580 + NODE))
        with pytest.raises(DriveError, match="no answer") if unheard else nullcontext():
            drive.disable()
        assert drive.clock.now() - began_s < 4.0
        assert states(seen) == [
            Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED,
        ]  # fmt: skip
        assert seen[1].speed_rad_s > 7.0
        assert abs(seen[2].speed_rad_s) < 0.2


@pytest.mark.parametrize("sync", ["thread", "lockstep"])
@pytest.mark.parametrize("option", [2, 6])
def test_the_voltage_stays_as_long_as_the_drive_brakes(option: int, sync: str) -> None:
    """Seventeen seconds, at a ramp that it has: not for any number of ours."""
    with (
        enabled(sync=sync, clock="sync" if sync == "lockstep" else "wall") as (bench, drive),
        watched(bench) as seen,
    ):
        drive.write([ParameterValue(drive.parameter(0x605A), option)])
        brakes_slowly(bench, 0.5)
        halt_when_fast(bench, drive)
        with pytest.raises(DriveError):
            drive.play(FAST)
        drive.disable()
        assert states(seen) == [
            Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED,
        ]  # fmt: skip
        assert abs(seen[1].speed_rad_s) > 7.0
        assert abs(seen[2].speed_rad_s) < 0.2


def test_a_fault_reaction_that_takes_its_time_is_given_it() -> None:
    with enabled(sync="thread", clock="wall") as (bench, drive), watched(bench) as seen:
        brakes_slowly(bench, 0.5)
        drive.clock.later(0.25, lambda: bench.servo.fault(0x4310))
        with pytest.raises(DriveError):
            drive.play(FAST)
        drive.disable()
        assert states(seen) == [Power.OPERATION_ENABLED, Power.FAULT_REACTION_ACTIVE, Power.FAULT]
        assert abs(seen[2].speed_rad_s) < 0.2


def test_where_the_speed_no_longer_falls_the_voltage_goes_and_that_is_said() -> None:
    with enabled_at(sync="thread", clock="wall") as (bench, drive), watched(bench) as seen:
        stays_in_quick_stop(drive)
        brakes_slowly(bench, 1e-3)
        drive.clock.later(0.25, drive.halt)
        with pytest.raises(DriveError):
            drive.play(stroke_at(1000, distance_rad=3.0))
        began_s = drive.clock.now()
        with pytest.raises(CoastingError, match=r"still turned at [789]\.\d* rad/s.*it coasts"):
            drive.disable()
        assert drive.clock.now() - began_s < 12.0
        assert seen[-1].state is Power.SWITCH_ON_DISABLED
        drive.disable()  # it is off: there is nothing more to say


@pytest.mark.parametrize("leave", ["close", "disable"])
def test_a_drive_that_falls_silent_is_told_to_stop_before_it_is_told_to_let_go(leave: str) -> None:
    """Nobody had said halt before."""
    with enabled(sync="thread", clock="wall") as (bench, drive), watched(bench) as seen:
        stays_in_quick_stop(drive)
        brakes_slowly(bench)
        drive.clock.later(0.25, lambda: lost(drive, before=getattr(drive, leave)))
        with pytest.raises(DriveError):
            drive.play(FAST)
        assert states(seen) == [
            Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED,
        ]  # fmt: skip
        assert abs(seen[2].speed_rad_s) < 0.2


@pytest.mark.parametrize("option", [0, 1])
def test_a_drive_that_somebody_left_moving_is_stopped_before_it_is_switched_off(option: int) -> None:
    """As `restore` finds it: there are no PDOs, and with 605C = 0 "disable operation" lets it coast."""
    with connected(clock="wall") as (bench, drive):
        drive.write([ParameterValue(drive.parameter(0x605C), option)])
        with Master(interface="stepped", channel=bench.channel) as other:
            for word in (0x06, 0x07, 0x0F):
                other.write(0x6040, 0, word, 2)
        bench.axis.start_move(45.0, 10.0, 100.0, 100.0)
        drive.clock.sleep(0.3)
        with watched(bench) as seen:
            drive.disable()
        assert states(seen)[:2] == [Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE]
        assert seen[-1].state is Power.SWITCH_ON_DISABLED
        assert abs(seen[-1].speed_rad_s) < 0.5


def test_a_node_that_another_master_has_stopped_is_switched_off_all_the_same() -> None:
    """In the NMT state "stopped" it takes neither PDO nor SDO."""
    with enabled(sync="thread", clock="wall") as (bench, drive):
        with Master(interface="stepped", channel=bench.channel) as other:
            drive.clock.later(0.25, lambda: other.send(0, bytes([2, NODE])))
            with pytest.raises(StateError, match="another master sends NMT commands"):
                drive.play(FAST)
        drive.disable()
        assert bench.servo.power.state is Power.SWITCH_ON_DISABLED


@pytest.mark.parametrize("silent", TPDOS)
def test_a_motion_of_which_one_tpdo_is_missing_is_given_up(silent: int) -> None:
    """It may be the one that would show a fault, or that the axis has left its way."""
    with enabled(sync="thread", clock="wall") as (bench, drive):
        drive.clock.later(0.2, lambda: lost(drive, silent))
        began_s = drive.clock.now()
        with pytest.raises(DriveError, match="did not answer SYNC"):
            drive.play(stroke(1250))
        assert drive.clock.now() - began_s < 3.0
        assert bench.servo.power.state is not Power.OPERATION_ENABLED


def test_an_old_frame_that_says_off_is_not_believed() -> None:
    """A TPDO from before it was switched on, that comes late, and last."""
    with enabled(sync="thread", clock="wall") as (bench, drive):
        old = can.Message(
            arbitration_id=TPDOS[0], data=b"\x50\x02" + bytes(6), is_extended_id=False
        )  # fmt: skip
        with can.Bus(interface="stepped", channel=bench.channel) as other:
            statusword, shown = drive._operation._dialogue.walker._access.statusword, []

            def look() -> int | None:
                if not shown:
                    shown.append(True)
                    other.send(old)
                    drive.clock.sleep(0.0002)
                return statusword()

            access = drive._operation._dialogue.walker._access
            object.__setattr__(access, "statusword", look)
            drive._operation._dialogue.walker.off()
        assert shown
        assert not bench.servo.power.energised


# ── others who have a say ────────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("number", [2, 3, 4])
def test_another_masters_setpoints_are_noticed_in_every_rpdo(number: int) -> None:
    with enabled(clock="wall") as (bench, drive):
        with Master(interface="stepped", channel=bench.channel) as other:
            drive.clock.later(0.2, lambda: other.send(0x100 + 0x100 * number + NODE, bytes(2)))
            with pytest.raises(StateError, match="another master sends setpoints"):
                drive.play(stroke(500))
        assert bench.servo.power.state is not Power.OPERATION_ENABLED


#: What another master sends that is for our node, told apart by what follows.
FOREIGN = {
    "NMT commands": (0x000, bytes([0x01, NODE])),
    "NMT commands, to all": (0x000, bytes([0x01, 0])),
    "setpoints": (0x200 + NODE, bytes(8)),
    "setpoints, in PDO 2": (0x300 + NODE, bytes(2)),
    "SDO requests": (0x600 + NODE, b"\x40\x41\x60\x00" + bytes(4)),
    "heartbeats": (0x77F, b"\x05"),
}


@pytest.mark.parametrize("what", FOREIGN)
def test_another_master_is_noticed_while_the_axis_only_stands(what: str) -> None:
    """Enabled, between two motions: nobody plays, and nobody asks."""
    with (
        enabled(sync="thread", clock="wall") as (bench, drive),
        Master(interface="stepped", channel=bench.channel) as other,
    ):
        drive.clock.sleep(0.1)
        other.send(*FOREIGN[what])
        drive.clock.sleep(0.05)
        assert bench.servo.power.state is not Power.OPERATION_ENABLED
        with pytest.raises(StateError, match=f"another master sends {what.partition(',')[0]}"):
            drive.play(stroke(25))


@pytest.mark.parametrize("what", FOREIGN)
def test_another_master_that_was_heard_before_the_start_keeps_the_drive_off(what: str) -> None:
    """Also before anything was set up: who spoke to it then will speak to it again."""
    with connected(clock="wall") as (bench, drive), watched(bench) as seen:
        with Master(interface="stepped", channel=bench.channel) as other:
            other.send(*FOREIGN[what])
        drive.clock.sleep(1.0)
        if what == "heartbeats":
            with pytest.raises(StateError, match="another master sends heartbeats"):
                drive.write(drive.setup(CSP))
        else:
            assert what.partition(",")[0] in drive.state().others
        assert states(seen) == [Power.SWITCH_ON_DISABLED]


def test_a_command_to_another_node_is_nobodys_business_of_ours() -> None:
    with enabled(sync="thread", clock="wall") as (bench, drive):
        with Master(interface="stepped", channel=bench.channel) as other:
            for can_id, data in (
                (0x000, bytes([0x02, NODE + 1])),
                (0x200 + NODE + 1, bytes(8)),
                (0x601, bytes(8)),
            ):
                other.send(can_id, data)
            drive.clock.sleep(0.05)
        drive.play(stroke(25, distance_rad=0.01))
        assert bench.servo.power.state is Power.OPERATION_ENABLED


@pytest.mark.parametrize("energised_s", [0.0, 0.01, 0.03])
def test_a_drive_that_another_master_has_switched_on_is_left_alone(
    energised_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between set-up and our first command, or while its node is being started: it goes on, also when we are gone."""
    with connected(clock="wall") as (bench, drive), watched(bench) as seen:
        drive.write(drive.setup(CSP))

        def switch_on() -> None:
            for word in (0x06, 0x07, 0x0F):
                bench.servo.operation.control(word)

        send = drive._link.send

        def sent(can_id: int, data: bytes) -> None:
            if can_id == 0:
                drive.clock.later(energised_s, switch_on)
            send(can_id, data)

        if energised_s:
            monkeypatch.setattr(drive._link, "send", sent)
        else:
            switch_on()
        with pytest.raises(EnergisedError, match="left alone"):
            drive.start(CSP)
        drive.clock.sleep(0.1)
        drive.close()
        bench.servo._sleep(3.0)
        assert states(seen) == [
            Power.SWITCH_ON_DISABLED, Power.READY_TO_SWITCH_ON, Power.SWITCHED_ON, Power.OPERATION_ENABLED,
        ]  # fmt: skip


def test_a_modbus_drive_that_another_master_has_switched_on_is_left_alone() -> None:
    with modbus_desk() as room:
        wanted = room.acquisition()
        room.drive.write(room.drive.setup(wanted))
        room.drive.start(wanted)
        for word in (0x06, 0x07, 0x0F):
            room.bench.servo.power.control(word)
        with pytest.raises(EnergisedError, match="left alone"):
            room.drive.enable()
        room.drive.close()
        room.clock.sleep(1.0)
        assert room.controlwords == []
        assert room.bench.servo.power.state is ModbusState.ENABLED


def test_a_drive_that_drops_out_is_not_switched_on_again_and_again() -> None:
    """Its enable input, or its supply, goes whenever it is on."""
    with connected(clock="wall") as (bench, drive):
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        power, times = bench.servo.power, []

        def drop_out() -> None:
            if power.state is Power.OPERATION_ENABLED:
                times.append(drive.clock.now())
                power._off(Power.SWITCH_ON_DISABLED)
            if len(times) > 5:
                raise AssertionError("it goes on and on")

        task = drive.clock.every(0.0013, drop_out)
        with pytest.raises(StateError, match="does not reach"):
            drive.enable()
        task.close()
        assert len(times) == 1


def test_switching_off_ends_where_somebody_keeps_switching_on() -> None:
    with connected(clock="wall") as (_, drive):
        words = [cia402.State.OPERATION_ENABLED, cia402.State.SWITCHED_ON]
        patterns, looks = {words[0]: 0x0237, words[1]: 0x0233}, []

        def statusword() -> int:
            looks.append(True)
            return patterns[words[len(looks) % 2]]

        walker = drive._operation._dialogue.walker
        object.__setattr__(walker._access, "statusword", statusword)
        began_s = drive.clock.now()
        with pytest.raises(StateError, match="may still be energised"):
            walker.off()
        assert drive.clock.now() - began_s < 15.0


# ── Modbus ───────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("after_s", [0.0005, 0.005, 0.02])
def test_a_modbus_drive_is_not_enabled_after_a_stop_while_it_was_set_up(after_s: float) -> None:
    with modbus_desk() as room:
        wanted = room.acquisition(duration_s=1.0)
        room.clock.later(after_s, room.drive.halt)
        room.drive.write(room.drive.setup(wanted))
        room.drive.start(wanted)
        room.clock.sleep(0.1)
        with pytest.raises(StateError, match="halted"):
            room.drive.enable()
        assert room.bench.servo.power.state is not ModbusState.ENABLED


def test_resetting_a_modbus_fault_that_is_not_there_lets_no_axis_coast() -> None:
    with modbus_desk() as room, room.enabled():
        room.bench.axis.start_move(45.0, 5.0, 100.0, 100.0)
        room.clock.sleep(0.2)
        room.drive.reset_fault()
        words = room.controlwords
        assert cia402.QUICK_STOP in words
        assert cia402.DISABLE_VOLTAGE not in words[: words.index(cia402.QUICK_STOP)]
        assert not room.bench.axis.energised
