"""Ways in which a stop was undone, or was a step, that the fault campaign has found; each by itself.

The campaign (benchmarks/campaign.py) draws them; here they are as small as they can be.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count

import can
import numpy as np
import pytest
from driver_desk import NODE, stroke

from schwung.errors import BusError, DriveError, NodeLostError, StateError
from schwung.fieldbus.canopen import CanopenDrive
from schwung.fieldbus.drive import Acquisition, ParameterValue, Setpoints
from schwung.fieldbus.profile import load_profile
from schwung_sim.bench import Bench
from schwung_sim.campaign.side import Side, SideBus
from schwung_sim.drives.dictionary import key
from schwung_sim.drives.power import Power

RATE_HZ = 500.0
CSP = Acquisition("csp", RATE_HZ)
STAYS = 6  # of 605A: quick stop active is kept, and one frame that enables leads back into operation
_channels = count()


@dataclass
class Room:
    """A drive on a stepped bus, our end of it, and all that we sent by RPDO: controlword and target."""

    bench: Bench
    side: Side
    bus: SideBus
    drive: CanopenDrive
    sent: list[tuple[int, int]] = field(default_factory=list)
    states: list[Power] = field(default_factory=list)

    def watch(self) -> None:
        """Note every state of the drive's, and every RPDO as it goes out."""
        send = self.bus.stepped.send

        def sending(message: can.Message, timeout: float | None = None) -> None:
            if message.arbitration_id == 0x200 + NODE:
                self.sent.append(struct.unpack_from("<Hi", message.data))
            send(message, timeout)

        self.bus.stepped.send = sending
        self.bench.bus.clock.every(0.0005, self._note)

    def _note(self) -> None:
        state = self.bench.servo.power.state
        if not self.states or self.states[-1] is not state:
            self.states.append(state)

    def after(self, delay_s: float, call: Callable[[], None]) -> None:
        self.bench.bus.clock.later(delay_s, call)

    def beat(self) -> None:
        """Somebody else's heartbeat, as our node."""
        self.bench.bus.send(can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False))

    @property
    def words(self) -> list[int]:
        return [word for word, _ in self.sent]


@contextmanager
def started(faults: str = "", *, stays: bool = False, acquisition: Acquisition = CSP) -> Iterator[Room]:
    """`stays`: in quick stop, as the drive is set, and by a profile that leaves it so."""
    channel, profile = f"found-{next(_channels)}", load_profile("schwung-bench")
    with Bench("two-mass", channel=channel, node_id=NODE, faults=faults) as bench:
        if stays:
            bench.servo.dictionary.writer(key(0x605A))(STAYS)
            profile = profile.model_copy(
                update={"stop": profile.stop.model_copy(update={"quick_stop_option": None})}
            )
        side = Side(bench.bus.clock)
        with SideBus(can.Bus(interface="stepped", channel=channel), side) as bus:
            drive = CanopenDrive(bus, NODE, profile, bit_rate=1_000_000)
            drive.write(drive.setup(acquisition))
            drive.start(acquisition)
            room = Room(bench, side, bus, drive)
            room.watch()
            yield room
            drive.close()


@contextmanager
def enabled(quick_stop_option: int = 2, faults: str = "") -> Iterator[Room]:
    with started(faults) as room:
        room.drive.enable()
        room.bench.servo.dictionary.writer(key(0x605A))(quick_stop_option)
        room.sent.clear()
        room.states.clear()
        yield room


@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.95])
@pytest.mark.parametrize("faults", ["", "first-rpdo"])
def test_a_frame_that_waits_for_its_sync_does_not_undo_the_quick_stop(share: float, faults: str) -> None:
    """The drive holds an RPDO until SYNC: a quick stop by SDO in between was undone by it, 2 ms later. Of two frames
    within a SYNC some drives take the first."""
    with enabled(STAYS, faults) as room:
        room.after(0.1 + share / RATE_HZ, lambda: room.side.at(0.0, room.drive.halt))
        with pytest.raises(DriveError, match="halt"):
            room.drive.play(stroke(500, RATE_HZ))
        room.drive.disable()
    assert room.states == [Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED]


def test_a_frame_that_waits_for_a_lost_sync_does_not_undo_the_quick_stop() -> None:
    """SYNC alone is lost for 80 ms, and heard again after the quick stop was taken by SDO: of a drive that takes the
    first frame since its last SYNC that is one from before, which enabled it for 2 ms
    (campaign.py --seeds 80302:80303)."""
    with started("first-rpdo", stays=True) as room:
        room.drive.enable()
        room.states.clear()
        send, lost = room.bus.stepped.send, [False]

        def losing(message: can.Message, timeout: float | None = None) -> None:
            if not (lost[0] and message.arbitration_id == 0x080):
                send(message, timeout)

        room.bus.stepped.send = losing
        room.after(0.2, lambda: lost.__setitem__(0, True))
        room.after(0.28, lambda: lost.__setitem__(0, False))
        with pytest.raises(NodeLostError, match="did not answer"):
            room.drive.play(stroke(500, RATE_HZ))
        room.side.sleep(0.05)
        room.drive.disable()
    assert room.states == [Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED]


@pytest.mark.parametrize("off_s", [0.003, 0.0104, 0.04])
def test_a_stop_begins_from_what_was_sent_not_from_what_could_not_be(off_s: float) -> None:
    """The adapter is bus-off for some cycles: what follows has the target of the last frame that went out."""
    with enabled() as room:
        room.after(0.25, lambda: setattr(room.bus, "bus_off", True))
        room.after(0.25 + off_s, lambda: setattr(room.bus, "bus_off", False))
        with pytest.raises(BusError):
            room.drive.play(stroke(500, RATE_HZ))
        room.side.sleep(0.05)
        targets = np.array([target for _, target in room.sent])
        word = np.array([word for word, _ in room.sent])
    # of the stroke's cosine, half a radian there and back in 499 periods, in counts
    largest = np.pi * 0.5 / 499 / (2 * np.pi / 2**20)
    assert np.max(np.abs(np.diff(targets))) <= largest + 1
    stopped = int(np.argmax(word == 0x02))
    assert stopped > 0
    assert not np.any(word[stopped:] == 0x0F)


@pytest.mark.parametrize("full_s", [0.012, 0.02, 0.03, 0.05])
@pytest.mark.parametrize("halted_s", [0.003, 0.01])
def test_a_frame_that_waits_for_the_send_buffer_is_not_sent_after_a_stop(
    full_s: float, halted_s: float
) -> None:
    with enabled() as room:
        before: list[int] = []

        def halt() -> None:
            before.append(len(room.sent))
            room.drive.halt()

        room.after(0.25, lambda: setattr(room.bus, "buffer_full", True))
        room.after(0.25 + halted_s, lambda: room.side.at(0.0, halt))
        room.after(0.25 + full_s, lambda: setattr(room.bus, "buffer_full", False))
        with pytest.raises(StateError, match="halt"):
            room.drive.play(stroke(500, RATE_HZ))
        room.drive.disable()
    assert before[0] > 100
    assert 0x0F not in room.words[before[0] :]


def test_trouble_while_an_axis_comes_to_rest_is_not_waited_with() -> None:
    """Before a motion up to two seconds are given for it; another master that beats as we do was left to go on."""
    with enabled() as room:
        room.bench.plant.state["motor_rad_s"] += 20.0
        room.after(0.001, room.beat)
        began = room.side.now()
        with pytest.raises(StateError, match="127"):
            room.drive.play(stroke(500, RATE_HZ))
        assert room.words.index(0x02) <= 0.03 * RATE_HZ
        assert room.side.now() - began < 2.5


def test_trouble_stops_whatever_is_waited_for_just_then() -> None:
    """A drive that leaves questions open keeps us for seconds; so long it went on enabled, by another's heartbeat."""
    with enabled() as room:
        room.bench.servo.sdo.silent.add(0x6065)
        room.after(0.1, room.beat)
        with pytest.raises(DriveError, match="no answer"):
            room.drive.read(room.drive.parameter(0x6065))
        assert room.words.index(0x02) <= 0.1 * RATE_HZ + 1
        assert set(room.words[room.words.index(0x02) :]) == {0x02}
        with pytest.raises(StateError, match="127"):
            room.drive.play(stroke(500, RATE_HZ))


@pytest.mark.parametrize("beaten_s", [0.001, 0.004, 0.007, 0.01])
def test_trouble_on_the_way_up_ends_it(beaten_s: float) -> None:
    with started() as room:
        came: list[int] = []
        room.after(beaten_s, room.beat)
        room.after(beaten_s + 2 / RATE_HZ, lambda: came.append(len(room.sent)))
        with pytest.raises(StateError, match="127"):
            room.drive.enable()
        room.drive.disable()
        assert set(room.words[came[0] :]) <= {0x00, 0x02}


@pytest.mark.parametrize("held_up_s", [0.1, 0.2, 0.7])
def test_who_was_held_up_hears_what_came_before_anything_that_enables_goes_out(held_up_s: float) -> None:
    """A frame that was due when it began went out when it ended, though another master's heartbeats had come meanwhile
    (campaign seeds 433263 and 434126)."""
    with enabled() as room:
        room.after(0.1, lambda: room.side.stall(held_up_s))
        for number in range(3):
            room.after(0.12 + 0.02 * number, room.beat)
        room.after(0.1 + held_up_s - 0.0001, room.sent.clear)
        with pytest.raises(DriveError, match="127"):
            room.drive.play(stroke(500, RATE_HZ))
        assert set(room.words) == {0x02}


@pytest.mark.parametrize("deaf_s", [0.08, 0.2])
def test_setpoints_do_not_run_away_from_a_drive_that_hears_none(deaf_s: float) -> None:
    """They went on for half a second, and what the drive had missed was one step when it heard again."""
    with enabled() as room:
        deaf = [False]
        room.bus.stepped.wire.weather = lambda sender, end, message: () if deaf[0] else (0.0,)
        room.after(0.3, lambda: deaf.append(deaf.pop() or True))
        room.after(0.3 + deaf_s, lambda: deaf.append(not deaf.pop()))
        with pytest.raises(NodeLostError, match="did not answer SYNC"):
            room.drive.play(stroke(500, RATE_HZ))
        assert 0x02 in room.words[: int((0.3 + 0.07) * RATE_HZ)]
        assert Power.FAULT_REACTION_ACTIVE not in room.states


@pytest.mark.parametrize("full_for_s", [0.02, 0.15])
def test_a_sync_that_waited_for_the_send_buffer_goes_out_after_the_stop(full_for_s: float) -> None:
    """The buffer was full between an RPDO and its SYNC, and a stop came: SYNC had waited longer, went out first, and
    the drive acted upon the RPDO from before, which enables (campaign seed 616968)."""
    with enabled(STAYS) as room:
        full_s = 0.2 + 0.25 / RATE_HZ
        room.after(full_s, lambda: setattr(room.bus, "buffer_full", True))
        room.after(full_s + 0.0011, lambda: room.side.at(0.0, room.drive.halt))
        room.after(full_s + full_for_s, lambda: setattr(room.bus, "buffer_full", False))
        with pytest.raises(DriveError):
            room.drive.play(stroke(500, RATE_HZ))
        room.drive.disable()
    assert room.states == [Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE, Power.SWITCH_ON_DISABLED]


def test_a_node_that_refuses_by_sdo_is_stopped_by_the_rpdo_it_has_to_hear_again() -> None:
    """Another master stopped the node, where RPDOs are not heard, and 6040 was refused by SDO: it stayed in operation
    (campaign seed 2573)."""
    with enabled(STAYS) as room:
        other = can.Bus(interface="stepped", channel=room.bench.bus.channel)
        stop_node = can.Message(arbitration_id=0x000, data=bytes([0x02, NODE]), is_extended_id=False)
        room.bench.servo.sdo.aborts[0x6040] = 0x05030000
        room.after(0.1, lambda: other.send(stop_node))
        with pytest.raises(DriveError, match="NMT"):
            room.drive.play(stroke(500, RATE_HZ))
        assert Power.QUICK_STOP_ACTIVE in room.states
        room.drive.disable()
        assert not room.bench.servo.power.energised
        other.shutdown()


def test_each_motion_and_each_way_to_its_start_is_watched_by_its_own_setpoints() -> None:
    """The one before was: at the approach to the next, a sound axis was not where that had sent it."""
    there = 0.25 * (1 - np.cos(np.pi * np.arange(250) / 249))
    with started() as room:
        room.drive.stop()
        room.drive.write([ParameterValue(room.drive.parameter(0x6065), round(0.1 * 2**20 / (2 * np.pi)))])
        room.drive.start(CSP)
        room.drive.enable()
        for way in (there, np.full(20, 0.505), there[::-1] + 0.005):
            room.drive.play(Setpoints(RATE_HZ, way, np.zeros(way.size)))
        room.drive.disable()
    assert Power.QUICK_STOP_ACTIVE not in room.states


def test_setpoints_that_wait_on_the_wire_are_not_played_to_their_end() -> None:
    """SYNC and its answers came on time, the setpoints did not: the whole stroke was one step when they did, and the
    axis overshot its window (campaign seed 555337)."""
    count_rad, late_s = 2 * np.pi / 2**20, 0.3
    with started() as room:
        room.drive.stop()
        room.drive.write([ParameterValue(room.drive.parameter(0x6065), round(0.1 / count_rad))])
        room.drive.start(CSP)
        room.drive.enable()
        clock, arrives_s = room.bench.bus.clock, list[float]()

        def late(_sender: object, _end: object, message: can.Message) -> tuple[float, ...]:
            if message.arbitration_id != 0x200 + NODE:
                return (0.0,)
            if struct.unpack_from("<Hi", message.data)[1] * count_rad > 0.01 and not arrives_s:
                arrives_s.append(clock.now() + late_s)
            return (max(arrives_s[0] - clock.now(), 0.0) if arrives_s else 0.0,)

        room.bench.bus.stepped.wire.weather = late
        with pytest.raises(StateError, match="not where it was sent"):
            room.drive.play(stroke(500, RATE_HZ))
        assert max(target for _, target in room.sent) * count_rad < 0.3  # of 0.5 rad
        room.drive.disable()
        clock.sleep(late_s)
        assert abs(room.bench.axis.position_rad) < 0.05
        assert not room.bench.servo.power.energised


@pytest.mark.parametrize("kept", [0, 1], ids=["as before", "defaults"])
def test_a_drive_that_restarts_while_it_stores_has_not_stored(kept: int) -> None:
    """Asked again it confirms, but what it stores then are not the values that were meant."""
    channel = f"found-{next(_channels)}"
    with (
        Bench("two-mass", channel=channel, node_id=NODE, faults=f"store-power-cut={kept}") as bench,
        can.Bus(interface="stepped", channel=channel) as bus,
        CanopenDrive(bus, NODE, load_profile("schwung-bench"), bit_rate=1_000_000) as drive,
    ):
        drive.write([ParameterValue(drive.parameter(0x6065), 12_345)])
        with pytest.raises(NodeLostError, match="restarted while it stored"):
            drive.store()
        assert bench.servo.dictionary.number(0x6065) != 12_345


def test_a_drive_whose_restart_is_not_heard_is_not_asked_to_store_again() -> None:
    """The boot-up was lost as well, and the repeat was confirmed: by a drive with the parameters of before (campaign
    seed 102990)."""
    channel = f"found-{next(_channels)}"
    with (
        Bench("two-mass", channel=channel, node_id=NODE, faults="store-power-cut=0") as bench,
        can.Bus(interface="stepped", channel=channel) as bus,
        CanopenDrive(bus, NODE, load_profile("schwung-bench"), bit_rate=1_000_000) as drive,
    ):
        drive.write([ParameterValue(drive.parameter(0x6065), 12_345)])
        clock, from_s = bench.bus.clock, bench.bus.clock.now()

        def lost(_sender: object, _end: object, message: can.Message) -> tuple[float, ...]:
            boots = message.arbitration_id == 0x700 + NODE and message.data == b"\0"
            return () if boots and clock.now() > from_s else (0.0,)

        bench.bus.stepped.wire.weather = lost
        with pytest.raises(NodeLostError, match="did not answer while it stored"):
            drive.store()


def test_a_drive_that_only_seems_to_be_off_gets_no_other_target() -> None:
    """While it stopped, its statusword came as Ready to switch on: Disable voltage went out with the place where it
    was, far from the last target (campaign seed 432697)."""

    def altered(message: can.Message) -> can.Message:
        if message.arbitration_id == 0x180 + NODE:
            message.data[0:2] = b"\x31\x02"
        return message

    with enabled(STAYS) as room:
        room.after(0.25, lambda: setattr(room.bus, "alter", altered))
        room.after(0.9, lambda: setattr(room.bus, "alter", None))
        with pytest.raises(DriveError):
            room.drive.play(stroke(500, RATE_HZ))
        room.drive.disable()
        stopped = next(i for i, (word, _) in enumerate(room.sent) if word != 0x0F)
        targets = {target for word, target in room.sent[stopped:] if word in (0x00, 0x02)}
        assert targets == {room.sent[stopped][1]}
    assert room.states[-1] is not Power.OPERATION_ENABLED


@pytest.mark.parametrize("rate_hz", [200.0, RATE_HZ, 1000.0])
def test_an_axis_that_is_turned_just_before_it_is_enabled_is_held_where_it_is(rate_hz: float) -> None:
    """The place was from before the question for the mode, and a SYNC went by before it went out: 0.083 rad, by two
    turns of the axis (campaign seed 86810)."""
    turned_rad = 0.05
    turned: list[float] = []
    with started(acquisition=Acquisition("csp", rate_hz)) as room:
        pass_on, plant = room.bus.stepped.send, room.bench.plant

        def sending(message: can.Message, timeout: float | None = None) -> None:
            if message.data[1:3] == b"\x61\x60" and message.arbitration_id == 0x600 + NODE and not turned:
                for place in ("motor_rad", "load_rad"):
                    plant.state[place] += turned_rad
                turned.append(plant.state["motor_rad"])
            pass_on(message, timeout)

        room.bus.stepped.send = sending
        room.drive.enable()
        held = next(target for word, target in room.sent if word == 0x0F)
        assert held * room.drive.scales.position_rad == pytest.approx(turned[0], abs=turned_rad / 10)


def test_a_small_motion_does_not_say_how_late_a_drive_is() -> None:
    """Setpoints take 20 ms to a drive, all alike. After a motion of some counts it was taken for one that is never
    behind, and stopped amid the first stroke."""
    count_rad = 2 * np.pi / 2**20
    with started() as room:
        room.drive.stop()
        room.drive.write([ParameterValue(room.drive.parameter(0x6065), round(0.1 / count_rad))])
        room.drive.start(CSP)
        room.bench.bus.stepped.wire.weather = lambda _sender, _end, message: (
            0.02 if message.arbitration_id == 0x200 + NODE else 0.0,
        )
        room.drive.enable()
        room.drive.play(stroke(100, RATE_HZ, 3 * count_rad))
        room.drive.play(stroke(500, RATE_HZ, 3.0))
        room.drive.disable()
    assert Power.QUICK_STOP_ACTIVE not in room.states
