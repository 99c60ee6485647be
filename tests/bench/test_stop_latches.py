"""A drive that was told to stop does not move again, and what is not known to be off is not taken for it.

Each of these was once so: the frame that was held overwrote the quick stop, the quick stop carried the target of the
motion's start, an answer that was refused counted as "off" or as position 0, the mode was looked at too late.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import can
import numpy as np
import pytest
from bench_peer import Master
from driver_desk import NODE, connected
from driver_desk import enabled as enabled_at
from driver_desk import stroke as stroke_at

from schwung.clock import clock_of
from schwung.errors import DriveError, DriveFaultError, StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.drive import Acquisition, ParameterValue
from schwung_sim.bench import Bench
from schwung_sim.drives.dictionary import key
from schwung_sim.drives.power import Power

RATE_HZ = 250.0  # motions are many seconds long
CSP = Acquisition("csp", RATE_HZ)
enabled, stroke = partial(enabled_at, RATE_HZ), partial(stroke_at, rate_hz=RATE_HZ)
LONG = stroke(5_000, distance_rad=3.0)
RPDO = 0x200 + NODE
WAYS = pytest.mark.parametrize(("sync", "clock"), [("lockstep", "sync"), ("thread", "wall")])


@dataclass(frozen=True)
class Said:
    """An RPDO as the bench's own drive has it: controlword, target in counts, torque offset in per mille."""

    time_s: float
    controlword: int
    target: int
    torque: int

    @property
    def enables(self) -> bool:
        return self.controlword & 0x0F == 0x0F


@contextmanager
def overheard(bench: Bench) -> Iterator[list[Said]]:
    """What is said to the drive by RPDO, by a third end of the wire."""
    said: list[Said] = []

    def hear(message: can.Message) -> None:
        if message.arbitration_id == RPDO:
            said.append(Said(message.timestamp, *struct.unpack("<Hih", message.data)))

    with can.Bus(interface="stepped", channel=bench.channel) as ear:
        clock_of(ear).read(ear, hear, lambda error: pytest.fail(str(error)))
        yield said


def after_stop(said: list[Said]) -> list[Said]:
    first = next(i for i, frame in enumerate(said) if frame.controlword == cia402.QUICK_STOP)
    return said[first:]


@WAYS
def test_nothing_enables_after_a_halt(sync: str, clock: str) -> None:
    """With 605A = 6 the drive waits in Quick stop active, where one frame with 0x000F brings it back into operation."""
    with enabled_at(sync=sync, clock=clock) as (bench, drive), overheard(bench) as said:
        drive.write([ParameterValue(drive.parameter(0x605A), 6)])
        drive.clock.later(0.4, drive.halt)
        with pytest.raises(StateError, match="halt"):
            drive.play(stroke_at(20_000, distance_rad=3.0))
        stood = bench.axis.position_rad
        drive._operation._dialogue.cyclic.pump(1.0)  # type: ignore[union-attr]  # it is running
        assert bench.servo.power.state is Power.QUICK_STOP_ACTIVE
        assert bench.axis.position_rad == pytest.approx(stood, abs=1e-3)
        assert not any(frame.enables for frame in after_stop(said))
        for again in (drive.enable, lambda: drive.play(stroke_at(100))):
            with pytest.raises(StateError, match="halt"):
                again()
        assert not any(frame.enables for frame in after_stop(said))
        drive.disable()
        assert bench.servo.power.state is Power.SWITCH_ON_DISABLED


@WAYS
def test_the_stop_keeps_the_target_that_went_out_last(sync: str, clock: str) -> None:
    """A drive may take the target before it looks at the controlword."""
    with enabled(sync=sync, clock=clock) as (bench, drive), overheard(bench) as said:
        drive.clock.later(1.0, drive.halt)  # on a way of 3 rad
        with pytest.raises(StateError, match="halt"):
            drive.play(LONG)
        first = said.index(after_stop(said)[0])
        assert said[first].target == said[first - 1].target != said[0].target
        assert said[first].torque == 0
        counts = np.diff([frame.target for frame in said])
        plan = np.diff(np.rint(LONG.position_rad / drive.resolution().position_rad))
        assert np.max(np.abs(counts)) <= np.max(np.abs(plan))


def test_the_first_setpoint_is_approached() -> None:
    with enabled_at() as (bench, drive), overheard(bench) as said:
        off = 0.015  # within the window in which a motion may start
        drive.play(stroke_at(400, distance_rad=0.02, begin_rad=off))
        counts = np.diff([frame.target for frame in said]) * drive.resolution().position_rad
        assert np.max(np.abs(counts)) < off / 50
        assert bench.axis.position_rad == pytest.approx(off, abs=2e-3)


@pytest.mark.parametrize("fault", ["sdo-abort=0x6041", "sdo-timeout=0x6041"])
def test_a_statusword_that_is_refused_is_not_off(fault: str) -> None:
    with connected(faults=f"{fault}@0.05", clock="wall") as (bench, drive):
        with Master(interface="stepped", channel=bench.channel) as other:
            for word in (0x06, 0x07, 0x0F):
                other.write(0x6040, 0, word, 2)
        assert bench.servo.power.energised
        drive.clock.sleep(0.1)
        with pytest.raises(DriveError, match=r"may still be energised|no answer"):
            drive.disable()
        assert not bench.servo.power.energised  # it was told all the same


@pytest.mark.parametrize("word", [0x0001, 0x0003, 0x0013])
def test_a_statusword_that_the_standard_does_not_know_is_not_off(word: int) -> None:
    with connected() as (bench, drive):
        drive.write(drive.setup(CSP))
        with Master(interface="stepped", channel=bench.channel) as other:
            for command in (0x06, 0x07, 0x0F):
                other.write(0x6040, 0, command, 2)
        bench.servo.dictionary.readers[key(0x6041)] = lambda: word
        with pytest.raises(StateError, match=f"may still be energised .*0x{word:04X}"):
            drive.disable()
        assert not bench.servo.power.energised
        with pytest.raises(StateError, match="no state that CiA 402 knows"):
            drive.start(CSP)
        with pytest.raises(StateError, match="Disable it before changing PDOs"):
            drive.write([ParameterValue(drive.parameter(0x1400, 1), 0x80000000 | RPDO)])


def test_a_position_that_is_refused_is_no_place_to_hold() -> None:
    with connected(faults="sdo-abort=0x6064") as (bench, drive):
        drive.write(drive.setup(CSP))
        with pytest.raises(StateError, match="does not show its position"):
            drive.start(CSP)
        assert not bench.servo.power.energised


def test_a_fault_reaction_is_waited_out() -> None:
    with enabled() as (bench, drive):
        drive.write([ParameterValue(drive.parameter(0x6085), 20_000)])  # a long way to stand still
        drive.clock.later(3.0, lambda: bench.servo.fault(0x4310))
        with pytest.raises(DriveFaultError):
            drive.play(LONG)
        drive.disable()
        assert bench.servo.power.state is Power.FAULT
        assert not bench.axis.energised


def test_a_mode_that_the_drive_does_not_take_is_seen_before_it_is_energised() -> None:
    with connected() as (bench, drive):
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        bench.servo.dictionary.readers[key(0x6061)] = lambda: 1
        energised: list[bool] = []
        drive.clock.every(0.001, lambda: energised.append(bench.axis.energised))
        with pytest.raises(StateError, match=r"drive shows 1 \(6061\)"):
            drive.enable()
        drive.disable()
        assert not any(energised)


def test_a_mode_that_the_drive_refuses_to_show_is_no_mode_to_energise_in() -> None:
    with connected() as (bench, drive):
        drive.write(drive.setup(CSP))
        drive.start(CSP)
        bench.servo.sdo.aborts[0x6061] = 0x06020000  # though its EDS has the object
        energised: list[bool] = []
        drive.clock.every(0.001, lambda: energised.append(bench.axis.energised))
        with pytest.raises(StateError, match=r"drive shows none \(6061\)"):
            drive.enable()
        drive.disable()
        assert not any(energised)


def test_another_master_that_beats_as_we_do_keeps_us_from_moving() -> None:
    with connected() as (bench, drive), can.Bus(interface="stepped", channel=bench.channel) as other:
        beat = can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False)
        clock_of(other).every(0.5, lambda: other.send(beat))
        with pytest.raises(StateError, match="another master sends heartbeats as node 127"):
            drive.write(drive.setup(CSP))
        assert not bench.servo.heartbeats.silent
        assert not bench.servo.power.energised


def test_another_master_that_was_heard_before_the_start_keeps_us_from_moving() -> None:
    with connected() as (bench, drive), can.Bus(interface="stepped", channel=bench.channel) as other:
        drive.write(drive.setup(CSP))  # we beat already
        other.send(can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False))
        drive.clock.sleep(0.01)
        drive.start(CSP)
        with pytest.raises(StateError, match="another master sends heartbeats as node 127"):
            drive.enable()
        assert not bench.servo.power.energised


def test_another_master_that_begins_to_beat_as_we_do_stops_the_motion() -> None:
    with enabled() as (bench, drive), can.Bus(interface="stepped", channel=bench.channel) as other:
        beat = can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False)
        drive.clock.later(0.4, lambda: other.send(beat))
        with pytest.raises(StateError, match="another master sends heartbeats as node 127"):
            drive.play(LONG)
        assert bench.servo.settle(2.0)


def test_close_stops_a_drive_whose_state_cannot_be_told() -> None:
    with enabled() as (bench, drive):
        assert isinstance(drive, CanopenDrive)
        bench.servo.dictionary.readers[key(0x6041)] = lambda: 0x0003
        drive.close()
        assert not bench.servo.power.energised
