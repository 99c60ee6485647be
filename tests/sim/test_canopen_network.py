"""NMT, heartbeats, emergencies and stored parameters of the simulated drive (CiA 301)."""

import json
import struct
from pathlib import Path

import pytest
from canopen_rig import ENABLED, FAULT, NODE, QUICK_STOP, SWITCH_ON_DISABLED, Aborted, Rig

from schwung_sim.errors import BenchError

SAVE, LOAD = 0x65766173, 0x64616F6C
BOOT_UP = b"\x00"


@pytest.fixture
def rig() -> Rig:
    return Rig()


def emergencies(rig: Rig) -> list[int]:
    return [struct.unpack_from("<H", data)[0] for data in rig.take(0x80 + NODE)]


# -- NMT --


def test_boots_into_pre_operational(rig: Rig) -> None:
    assert rig.take(0x700 + NODE) == [BOOT_UP]
    rig.write(0x1017, 0, 100, 2)
    rig.wait(0.01)
    assert rig.take(0x700 + NODE) == [b"\x7f"]


@pytest.mark.parametrize(("command", "state"), [(1, 5), (2, 4), (0x80, 127)])
def test_commands_show_in_the_heartbeat(rig: Rig, command: int, state: int) -> None:
    rig.write(0x1017, 0, 50, 2)
    rig.take(0x700 + NODE)
    rig.nmt(command)
    rig.wait(0.06)
    assert rig.take(0x700 + NODE)[-1] == bytes((state,))


def test_commands_for_others_are_none_of_its_business(rig: Rig) -> None:
    rig.nmt(1, NODE + 1)
    rig.write(0x1017, 0, 50, 2)
    rig.wait(0.06)
    assert rig.take(0x700 + NODE)[-1] == b"\x7f"


def test_heartbeat_period(rig: Rig) -> None:
    rig.take(0x700 + NODE)
    rig.write(0x1017, 0, 100, 2)
    rig.wait(2.0)
    assert len(rig.take(0x700 + NODE)) in (20, 21)
    rig.write(0x1017, 0, 0, 2)
    rig.wait(1.0)
    assert rig.take(0x700 + NODE) == []


def test_reset_node_forgets_what_was_not_stored_and_powers_off(rig: Rig) -> None:
    rig.write(0x6065, 0, 12345, 4)
    rig.enable()
    rig.take(0x700 + NODE)
    rig.nmt(0x81)
    assert rig.take(0x700 + NODE) == [BOOT_UP]
    assert rig.read(0x6065) == 100000
    assert rig.state == SWITCH_ON_DISABLED
    assert not rig.axis.energised


def test_reset_communication_keeps_the_application(rig: Rig) -> None:
    rig.write(0x6065, 0, 12345, 4)
    rig.write(0x1017, 0, 100, 2)
    rig.take(0x700 + NODE)
    rig.nmt(0x82)
    assert rig.take(0x700 + NODE) == [BOOT_UP]
    assert (rig.read(0x6065), rig.read(0x1017)) == (12345, 0)


# -- heartbeat consumer --


def watched(rig: Rig, option: int) -> None:
    """Energised, moving, and watching node 127 with 100 ms."""
    rig.write(0x6007, 0, option, 2)
    rig.write(0x605A, 0, 6, 2)
    rig.write(0x1016, 1, 0x007F0064, 4)
    rig.cyclic()
    rig.write(0x6060, 0, 8, 1)
    for word in (0x06, 0x07, 0x0F):
        rig.cycle(word, 0)
    rig.give(0x77F, b"\x05")
    for n in range(90):
        rig.cycle(0x0F, 1000 * n)
    assert rig.state == ENABLED
    assert rig.axis.speed_rad_s > 3
    rig.give(0x77F, b"\x05")
    emergencies(rig)


def test_not_watched_before_the_first_heartbeat(rig: Rig) -> None:
    rig.write(0x1016, 1, 0x007F0064, 4)
    rig.wait(1.0)
    assert emergencies(rig) == []


def test_silence_stops_the_drive_by_itself(rig: Rig) -> None:
    """The tool is gone, and SYNC with it: the quick stop runs on the wall clock, then the axis holds."""
    watched(rig, option=3)
    moving = rig.axis.position_rad
    rig.wait(1.0)
    assert emergencies(rig) == [0x8130]
    assert rig.state == QUICK_STOP
    assert abs(rig.axis.demand_rad - moving) < 0.1  # v²/2a and what the axis lagged behind
    assert abs(rig.axis.speed_rad_s) < 0.2
    stands = rig.axis.time_s
    rig.wait(1.0)
    assert rig.axis.time_s == stands  # at rest, SYNC is the clock again
    assert rig.read(0x1001) & 0x11 == 0x11


def test_silence_as_a_fault(rig: Rig) -> None:
    watched(rig, option=1)
    rig.wait(0.5)
    assert rig.state == FAULT
    assert rig.read(0x603F) == 0x8130
    rig.control(0x80)
    assert rig.state == FAULT  # the cause is still there
    rig.give(0x77F, b"\x05")
    rig.control(0x00)
    rig.control(0x80)
    assert rig.state == SWITCH_ON_DISABLED


def test_silence_as_power_off_and_as_nothing() -> None:
    rig = Rig()
    watched(rig, option=2)
    rig.wait(0.12)
    assert rig.state == SWITCH_ON_DISABLED
    assert not rig.axis.energised
    rig = Rig()
    watched(rig, option=0)
    rig.wait(0.5)
    assert rig.state == ENABLED
    assert emergencies(rig) == [0x8130]


def test_heartbeats_that_come_keep_it_going_and_their_return_clears_the_error(rig: Rig) -> None:
    watched(rig, option=3)
    for n in range(5):
        rig.wait(0.08)
        rig.give(0x77F, b"\x05")
        assert rig.state == ENABLED, n
    rig.wait(0.3)
    assert emergencies(rig) == [0x8130]
    rig.give(0x77F, b"\x05")
    assert emergencies(rig) == [0]
    assert rig.read(0x1001) == 0


def test_a_bench_that_was_held_up_does_not_blame_the_master(rig: Rig) -> None:
    """The heartbeats that came meanwhile are still to be read."""
    watched(rig, option=3)
    rig.wait(0.05)
    rig.now += 1.0
    rig.servo.tick()
    assert rig.state == ENABLED
    rig.wait(0.3)
    assert emergencies(rig) == [0x8130]


@pytest.mark.parametrize(("behaviour", "state"), [(0, 127), (1, 5), (2, 4)])
def test_error_behaviour_decides_the_nmt_state(rig: Rig, behaviour: int, state: int) -> None:
    rig.write(0x1029, 1, behaviour, 1)
    rig.write(0x1017, 0, 20, 2)
    rig.write(0x1016, 1, 0x007F0064, 4)
    rig.nmt(1)
    rig.give(0x77F, b"\x05")
    rig.wait(0.3)
    assert rig.take(0x700 + NODE)[-1] == bytes((state,))


# -- emergencies --


def test_history_has_the_newest_first_and_can_be_cleared(rig: Rig) -> None:
    for code in (0x4310, 0x3210):
        rig.servo.fault(code)
        rig.sync(20)
        rig.control(0x00)
        rig.control(0x80)
    assert emergencies(rig) == [0x4310, 0, 0x3210, 0]
    assert [rig.read(0x1003, n) for n in range(3)] == [2, 0x3210, 0x4310]
    rig.write(0x1003, 0, 0, 1)
    assert rig.read(0x1003) == 0
    with pytest.raises(Aborted):
        rig.write(0x1003, 0, 1, 1)


@pytest.mark.parametrize(
    ("code", "register"), [(0x2310, 3), (0x3210, 5), (0x4310, 9), (0x8130, 0x11), (0x8611, 0x21)]
)
def test_error_register_has_the_bit_of_the_class(rig: Rig, code: int, register: int) -> None:
    rig.servo.fault(code)
    assert rig.take(0x80 + NODE)[0][:3] == struct.pack("<HB", code, register)
    assert rig.read(0x1001) == register


def test_emcy_can_be_switched_off(rig: Rig) -> None:
    rig.write(0x1014, 0, 0x80000085, 4)
    rig.servo.fault(0x4310)
    assert emergencies(rig) == []


# -- bus-off --


def test_bus_off_is_a_lost_connection_and_no_setpoint_acts_after_it(rig: Rig) -> None:
    watched(rig, option=3)
    rig.give(0x205, struct.pack("<Hih", 0x0F, 90000, 0))  # waits for SYNC, whose answer fails
    rig.wire.fail = True
    rig.sync(3)
    assert rig.servo.power.state.name == "QUICK_STOP_ACTIVE"
    rig.wire.fail = False
    assert rig.state == QUICK_STOP


# -- store and restore --


def test_stored_parameters_survive_a_reset_and_a_power_cycle(tmp_path: Path) -> None:
    memory = tmp_path / "drive.json"
    rig = Rig(memory=memory)
    rig.write(0x2300, 1, 1234567, 4)
    rig.write(0x607D, 1, -1000, 4)
    rig.write(0x1017, 0, 500, 2)
    rig.write(0x1010, 1, SAVE, 4)
    rig.write(0x607D, 1, -5, 4)
    rig.nmt(0x81)
    assert rig.read(0x607D, 1, signed=True) == -1000
    again = Rig(memory=memory)
    assert (again.read(0x2300, 1), again.read(0x1017)) == (1234567, 500)


def test_restore_takes_effect_at_the_next_reset(rig: Rig) -> None:
    rig.write(0x6065, 0, 777, 4)
    rig.write(0x1010, 1, SAVE, 4)
    rig.write(0x1011, 1, LOAD, 4)
    assert rig.read(0x6065) == 777
    rig.nmt(0x81)
    assert rig.read(0x6065) == 100000


@pytest.mark.parametrize(("group", "kept"), [(2, 0x1017), (3, 0x6066), (4, 0x2302)])
def test_groups_are_stored_apart(rig: Rig, group: int, kept: int) -> None:
    written = {(0x1017, 0): (500, 2), (0x6066, 0): (99, 2), (0x2302, 2): (31, 4)}
    for (index, subindex), (value, size) in written.items():
        rig.write(index, subindex, value, size)
    rig.write(0x1010, group, SAVE, 4)
    rig.nmt(0x81)
    for (index, subindex), (value, _) in written.items():
        assert (rig.read(index, subindex) == value) == (index == kept)


def test_no_storing_under_power(rig: Rig) -> None:
    rig.enable()
    with pytest.raises(Aborted) as caught:
        rig.write(0x1010, 1, SAVE, 4)
    assert caught.value.code == 0x08000022


def test_commands_are_not_parameters(rig: Rig) -> None:
    rig.write(0x607A, 0, 5000, 4)
    rig.write(0x60B2, 0, 100, 2)
    rig.write(0x1010, 1, SAVE, 4)
    rig.nmt(0x81)
    assert (rig.read(0x607A), rig.read(0x60B2)) == (0, 0)


def test_memory_that_is_none_is_refused(tmp_path: Path) -> None:
    memory = tmp_path / "drive.json"
    memory.write_text(json.dumps([1, 2]))
    with pytest.raises(BenchError, match=r"drive\.json: is no drive memory"):
        Rig(memory=memory)


def test_serial_number_is_the_seed() -> None:
    assert Rig(seed=77).read(0x1018, 4) == 77
