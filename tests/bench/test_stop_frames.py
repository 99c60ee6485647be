"""Frames that no sound drive sends, at the worst instant: too short, from a node that has restarted, from who else is
on the bus. What a frame does not say is unknown, and unknown is never off."""

from __future__ import annotations

from collections.abc import Callable

import can
import numpy as np
import pytest
from driver_desk import NODE, bench_and_bus, stroke
from test_stop_found import CSP, RATE_HZ, STAYS, enabled

from schwung.errors import DriveError, NodeLostError, StateError
from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.drive import ParameterValue
from schwung.fieldbus.profile import load_profile
from schwung_sim.drives.dictionary import key
from schwung_sim.drives.power import Power

FIRST_TPDO = 0x180 + NODE


def cut(bytes_left: int, can_id: int = FIRST_TPDO) -> Callable[[can.Message], can.Message]:
    """What an adapter does that loses the end of a frame, or another node that sends as ours does."""

    def alter(message: can.Message) -> can.Message:
        if message.arbitration_id == can_id:
            message.data = bytearray(message.data[:bytes_left])
            message.dlc = bytes_left
        return message

    return alter


@pytest.mark.parametrize("bytes_left", [0, 1, 2, 5])
def test_a_tpdo_that_is_cut_short_stops_the_motion_and_says_nothing_else(bytes_left: int) -> None:
    """The bytes that are missing counted as 0: a place like any other, and a statusword that says off."""
    with enabled(STAYS) as room:
        room.after(0.25, lambda: setattr(room.bus, "alter", cut(bytes_left)))
        with pytest.raises(StateError, match=f"came with {bytes_left} bytes"):
            room.drive.play(stroke(500, RATE_HZ))
        room.drive.disable()
    assert room.states == [Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED]


def test_a_tpdo_without_a_statusword_does_not_say_off() -> None:
    """An empty one read 0, "Not ready to switch on": nothing was sent, and an energised drive was left."""
    with enabled(STAYS) as room:
        room.bus.alter = cut(0)
        room.side.sleep(0.05)
        room.drive.disable()
        assert room.bench.servo.power.state is Power.SWITCH_ON_DISABLED


def test_a_frame_with_a_long_identifier_is_nobodys_answer() -> None:
    """Other protocols have 29 bits, and their numbers may be as ours. One said off, and was believed."""
    said_off = can.Message(arbitration_id=FIRST_TPDO, data=b"\x50\x02" + bytes(6), is_extended_id=True)
    with (
        enabled(STAYS) as room,
        can.Bus(interface="stepped", channel=room.bench.bus.channel) as other,
    ):
        task = room.bench.bus.clock.every(0.0003, lambda: other.send(said_off))
        room.drive.play(stroke(100, RATE_HZ, 0.01))
        room.drive.disable()
        task.close()
        assert room.bench.servo.power.state is Power.SWITCH_ON_DISABLED


@pytest.mark.parametrize("after_s", np.arange(0.0055, 0.013, 0.0007).round(4))
def test_a_drive_that_restarts_while_it_is_started_is_not_energised(after_s: float) -> None:
    """Between the look at what it is set up for and the first frame. It comes back with what it has stored: all but
    that it shall watch us."""
    with bench_and_bus() as (bench, bus):
        drive = CanopenDrive(bus, NODE, load_profile("schwung-bench"), bit_rate=1_000_000)
        drive.write(drive.setup(CSP))
        watching = drive.read(drive.parameter(0x1016, 1))
        drive.write([ParameterValue(watching.parameter, 0)])
        drive.store()
        drive.write([watching])
        drive.clock.later(after_s, bench.servo.reset_node)
        with pytest.raises(DriveError) as raised:
            drive.start(CSP)
        assert isinstance(raised.value, NodeLostError) or "not set up" in str(raised.value)
        assert not bench.servo.power.energised
        drive.close()


def test_a_drive_that_has_restarted_since_its_units_were_read_is_not_started() -> None:
    """It comes back with what it has stored: here with another encoder's counts, by which the first target was 730 rad
    off. Begun anew, its units are those that it has."""
    with bench_and_bus() as (bench, bus):
        drive = CanopenDrive(bus, NODE, load_profile("schwung-bench"), bit_rate=1_000_000)
        bench.servo.dictionary.writer(key(0x608F, 1))(1000)
        assert drive.resolution().position_rad == pytest.approx(2 * np.pi / 1000)
        drive.write(drive.setup(CSP))
        bench.servo.reset_node()
        drive.clock.sleep(0.1)
        drive.write(drive.setup(CSP))
        with pytest.raises(NodeLostError, match="restarted since its units were read"):
            drive.start(CSP)
        assert drive.resolution().position_rad == pytest.approx(2 * np.pi / 2**20)
        drive.start(CSP)
        drive.close()


def test_a_node_whose_drive_is_off_is_not_started_to_hear_a_stop() -> None:
    """It came back set up for nothing: once started, it would take our frames as its default mapping has them."""
    with enabled(STAYS) as room:
        commands: list[bytes] = []
        send = room.bus.stepped.send

        def sending(message: can.Message, timeout: float | None = None) -> None:
            if message.arbitration_id == 0:
                commands.append(bytes(message.data))
            send(message, timeout)

        room.bus.stepped.send = sending

        def restart() -> None:
            room.bench.servo.reset_node()
            room.bench.servo.sdo.aborts[0x6040] = 0x08000022

        room.after(0.25, restart)
        with pytest.raises(NodeLostError, match="restarted"):
            room.drive.play(stroke(500, RATE_HZ))
        room.drive.disable()
        assert bytes([0x01, NODE]) not in commands
