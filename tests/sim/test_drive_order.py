"""The order in which a drive takes what comes, and what it does where something does not (CiA 301 7.2.2, 7.5.2.35)."""

import math
import struct

import pytest
from canopen_rig import (
    COUNTS_PER_RAD,
    ENABLE,
    ENABLED,
    FAULT,
    FAULT_REACTION,
    QUICK,
    QUICK_STOP,
    READY,
    SHUTDOWN,
    SWITCH_ON_DISABLED,
    Rig,
)

SPEED_RAD_S = 6.0
STEP = round(SPEED_RAD_S * 1e-3 * COUNTS_PER_RAD)  # counts in a cycle
START = 0  # where `Rig.run` begins


def moving(faults: str = "") -> tuple[Rig, int]:
    """A drive at constant speed, 0.9 rad from its start; quick stop leads to Quick stop active (605A = 6)."""
    rig = Rig(faults=faults)
    rig.write(0x605A, 0, 6, 2)
    return rig, rig.run(SPEED_RAD_S, 150)


def until(rig: Rig, target: int, time_s: float) -> int:
    """Go on like this until the axis' own time is that; returns the last target."""
    while rig.axis.time_s < time_s - 1e-9:
        target += STEP
        rig.cycle(ENABLE, target)
    return target


# -- Controlword and target of one frame --


def test_state_machine_first_means_no_step() -> None:
    """As it is without a trait: quick stop and an old target in one frame, and the axis only brakes."""
    rig, _ = moving()
    demand = rig.axis.demand_rad
    rig.cycle(QUICK, START)
    assert rig.state == QUICK_STOP
    rig.sync(20)
    assert rig.axis.demand_rad >= demand


def test_setpoint_task_ahead_of_the_state_machine_steps_first() -> None:
    """Nothing in CiA 301 or 402 orders the objects of a PDO: the old target acts four cycles before quick stop does."""
    rig, target = moving("late-controlword=0.004")
    states = []
    for _ in range(5):
        rig.cycle(QUICK, START)
        states.append(rig.state)
    assert states == [ENABLED] * 4 + [QUICK_STOP]
    assert rig.axis.demand_rad == pytest.approx(START, abs=0.05)  # 0.9 rad away from where it was
    assert target / COUNTS_PER_RAD == pytest.approx(0.9, rel=1e-3)


def test_torque_offset_acts_at_once_as_well() -> None:
    """100 ‰ of 70 N·m beside a quick stop that is still to act."""
    rig, target = moving("late-controlword=0.004")
    steady = rig.cycle(ENABLE, target + STEP)
    before = rig.axis.torque_demand_nm
    rig.cycle(QUICK, target + 2 * STEP, 100)
    rig.axis.advance(125e-6)
    assert rig.axis.torque_demand_nm - before == pytest.approx(7.0, abs=1.5)
    assert steady[0] & 0x6F == ENABLED


def test_late_controlwords_all_act_in_their_order() -> None:
    rig = Rig(faults="late-controlword=0.003")
    rig.cyclic()
    rig.write(0x6060, 0, 8, 1)
    seen = []
    for word in (SHUTDOWN, 0x07, ENABLE, ENABLE, ENABLE, ENABLE):
        rig.cycle(word, 0)
        seen.append(rig.state)
    assert seen == [SWITCH_ON_DISABLED] * 3 + [READY, 0x23, ENABLED]


def test_task_sees_only_the_last_controlword() -> None:
    """A quick stop that is taken back within one run of the task never was; one that stays is seen at its next run."""
    rig, target = moving("controlword-task=0.01")
    rig.write(0x605A, 0, 2, 2)  # no way back out of Quick stop active
    target = until(rig, target, 0.4)
    for word in (QUICK, QUICK, ENABLE):
        target += STEP
        rig.cycle(word, target)
    target = until(rig, target, 0.42)
    assert rig.state == ENABLED
    for _ in range(9):
        rig.cycle(QUICK, target)
        assert rig.state == ENABLED
    rig.sync()
    assert rig.state == QUICK_STOP
    assert rig.axis.time_s == pytest.approx(0.43)


def test_late_controlword_by_sdo_needs_no_sync_and_dies_with_a_reset() -> None:
    rig = Rig(faults="late-controlword=0.004")
    assert rig.control(SHUTDOWN) == SWITCH_ON_DISABLED  # accepted, and not yet taken
    rig.wait(0.1)
    assert rig.state == READY
    rig.nmt(0x81)
    rig.control(SHUTDOWN)
    rig.nmt(0x81)
    rig.wait(0.1)
    assert rig.state == SWITCH_ON_DISABLED


def test_late_setpoint_comes_so_much_later_and_the_controlword_does_not() -> None:
    """The path of the same targets, two cycles later; quick stop in between is not delayed."""
    paths = {}
    for faults in ("", "late-setpoint=0.002"):
        rig = Rig(faults=faults)
        rig.run(cycles=0)
        targets = [round(20000 * math.sin(n / 30) ** 2) for n in range(100)]
        paths[faults] = []
        for target in targets:
            rig.cycle(ENABLE, target)
            paths[faults].append(rig.axis.demand_rad)
        rig.cycle(QUICK, START)
        assert rig.state == QUICK_STOP
        held = rig.axis.demand_rad
        rig.sync(5)
        assert (
            abs(rig.axis.demand_rad - held) < 0.01
        )  # neither the old target nor those under way act any more
    assert paths["late-setpoint=0.002"][2:] == pytest.approx(paths[""][:-2], abs=1e-9)


def test_late_torque_offset_is_late_once() -> None:
    """100 ‰ of 70 N·m, two cycles later; also where adding and playing torque are one object, as in this profile."""
    torques: dict[str, list[float]] = {}
    for faults in ("", "late-setpoint=0.002"):
        rig = Rig(faults=faults)
        rig.run(cycles=0)
        rig.cycle(ENABLE, 0, 100)
        torques[faults] = []
        for _ in range(8):
            torques[faults].append(rig.axis.torque_demand_nm)
            rig.sync()
    assert torques[""][1] > 3.0
    assert torques["late-setpoint=0.002"][2:] == pytest.approx(torques[""][:-2], abs=1e-9)


# -- More or fewer RPDOs than SYNCs --


def two_in_a_window(rig: Rig, first: int, second: int) -> float:
    """Two RPDOs before one SYNC; where the demand leads within the next cycle."""
    for target in (first, second):
        rig.give(0x205, struct.pack("<Hih", ENABLE, target, 0))
    rig.sync(2)
    return rig.axis.demand_rad * COUNTS_PER_RAD


def test_of_two_rpdos_in_a_window_the_last_acts() -> None:
    """CiA 301 7.2.2.2: data received with a synchronous RPDO is passed on with the next SYNC: there is one buffer."""
    rig = Rig()
    rig.run(cycles=0)
    assert two_in_a_window(rig, 1000, 2000) == pytest.approx(2000, abs=1)


def test_in_some_drives_the_first_acts() -> None:
    rig = Rig(faults="first-rpdo")
    rig.run(cycles=0)
    assert two_in_a_window(rig, 1000, 2000) == pytest.approx(1000, abs=1)
    assert two_in_a_window(rig, 3000, 4000) == pytest.approx(3000, abs=1)  # the second was dropped, not kept


@pytest.mark.parametrize(("lost", "ahead"), [(1, 1), (2, 0), (5, 0)])
def test_lost_rpdo_is_bridged_once_then_the_last_target_is_held(lost: int, ahead: int) -> None:
    """A SYNC without a new RPDO leaves the old value in the buffer: one step is extrapolated, more are not made up."""
    rig, target = moving(f"lost-rpdo={lost}@0.2")
    target = until(rig, target, 0.2)
    for n in range(1, lost + 1):
        rig.cycle(ENABLE, target + n * STEP)
    rig.sync()  # the demand at the end of the last of these cycles
    assert rig.axis.demand_rad * COUNTS_PER_RAD == pytest.approx(target + ahead * STEP, abs=2)
    for _ in range(300):
        status, position, _, _ = rig.cycle(ENABLE, target + STEP)
    assert status & 0x6F == ENABLED
    assert position == pytest.approx(target + STEP, abs=2000)


def test_late_rpdo_meets_the_next_one_in_its_window() -> None:
    """For its own SYNC it is as if it were lost; in the next window it is the first of two."""
    for faults, acts in (("first-rpdo,late-rpdo=1@0.2", 50), ("late-rpdo=1@0.2", 2)):
        rig, target = moving(faults)
        target = until(rig, target, 0.2)
        rig.cycle(ENABLE, target + 50 * STEP)  # comes behind its SYNC
        rig.cycle(ENABLE, target + 2 * STEP)
        rig.sync()
        assert rig.axis.demand_rad * COUNTS_PER_RAD == pytest.approx(target + acts * STEP, abs=2)


def test_rpdo_deadline_is_reported_once_and_cleared() -> None:
    """CiA 301 7.5.2.35: 14xx:05 monitors from the first reception on; table 26: 8250 is the RPDO time-out."""
    rig = Rig()
    rig.cyclic()
    rig.write(0x1400, 5, 50, 2)
    rig.wait(0.2)
    assert rig.emergencies() == []  # nothing came yet
    rig.give(0x205, struct.pack("<Hih", 0, 0, 0))
    rig.wait(0.04)
    assert rig.emergencies() == []
    rig.wait(0.2)
    assert rig.emergencies() == [0x8250]
    assert rig.read(0x1001) & 0x11 == 0x11
    rig.give(0x205, struct.pack("<Hih", 0, 0, 0))
    rig.wait(0.01)
    assert rig.emergencies() == [0]
    rig.wait(0.2)
    assert rig.emergencies() == [0x8250]


def test_drive_may_fault_where_targets_stay_away() -> None:
    rig, target = moving("rpdo-timeout=0.005")
    rig.sync(4)
    assert rig.state == ENABLED
    rig.cycle(ENABLE, target)
    rig.sync(6)
    assert rig.state in (FAULT_REACTION, FAULT)
    assert rig.read(0x603F) == 0x8250
    assert rig.emergencies() == [0x8250]
