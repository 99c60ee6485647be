"""What keeps a drive from operation, or from following: STO, brake, bit 12, remote, limit switches (CiA 402-2)."""

import math

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
    RESET,
    SHUTDOWN,
    SWITCH_ON,
    SWITCH_ON_DISABLED,
    SWITCHED_ON,
    VOLTAGE_OFF,
    Rig,
)

VOLTAGE, REMOTE, TARGET_REACHED, LIMIT, FOLLOWS = 1 << 4, 1 << 9, 1 << 10, 1 << 11, 1 << 12
SPEED_RAD_S = 6.0
STEP = round(SPEED_RAD_S * 1e-3 * COUNTS_PER_RAD)  # counts in a cycle


def until(rig: Rig, target: int, time_s: float, step: int = STEP) -> int:
    """Go on like this until the axis' own time is that; returns the last target."""
    while rig.axis.time_s < time_s - 1e-9:
        target += step
        rig.cycle(ENABLE, target)
    return target


def climb(rig: Rig) -> int:
    """What an ordinary master does to enable; returns the state it comes to."""
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        rig.control(word)
        rig.sync(2)
    return rig.state


# -- Safe torque off --


@pytest.mark.parametrize(("kind", "into"), [("sto", SWITCH_ON_DISABLED), ("sto-fault", FAULT)])
def test_sto_takes_the_torque_at_once_and_the_axis_coasts(kind: str, into: int) -> None:
    """IEC 61800-5-2 4.2.3.2: no torque, and no braking: the option codes (605E = 2: quick-stop ramp) do not matter."""
    rig = Rig(faults=f"{kind}@0.2")
    target = until(rig, rig.run(SPEED_RAD_S, 50), 0.2)
    assert rig.state == into
    assert not rig.axis.energised
    assert not rig.status & VOLTAGE  # bit 4: high voltage is applied to the drive
    assert rig.status & REMOTE
    assert rig.emergencies() == [0x5091]
    assert rig.read(0x603F) == 0x5091
    rig.sync(20)
    assert rig.axis.torque_demand_nm == 0
    # the ramp of 6085 (1047 rad/s²) would have ended within 6 ms; friction and the crank's inertia alone have not
    assert rig.axis.speed_rad_s > 0.5 * SPEED_RAD_S
    assert rig.cycle(ENABLE, target)[0] & 0x6F != ENABLED


def test_open_sto_keeps_the_drive_in_switch_on_disabled() -> None:
    """Transition 2 needs the high-level power to be available; closing STO energises nothing by itself."""
    rig = Rig(faults="sto=0x8A88@0.1..0.3")
    until(rig, rig.run(SPEED_RAD_S, 50), 0.15)
    assert rig.emergencies() == [0x8A88]
    assert climb(rig) == SWITCH_ON_DISABLED
    until(rig, 0, 0.31, 0)
    assert rig.state == SWITCH_ON_DISABLED
    assert rig.status & VOLTAGE
    assert rig.emergencies() == [0]
    assert climb(rig) == ENABLED


def test_an_enable_input_takes_the_torque_and_tells_nobody_why() -> None:
    rig = Rig(faults="enable-input@0.1..0.3")
    until(rig, rig.run(SPEED_RAD_S, 50), 0.15)
    assert not rig.axis.energised
    assert not rig.status & VOLTAGE
    assert rig.emergencies() == []
    assert rig.read(0x603F) == 0
    assert climb(rig) == SWITCH_ON_DISABLED
    until(rig, 0, 0.31, 0)
    assert rig.state == SWITCH_ON_DISABLED
    assert climb(rig) == ENABLED


def test_torque_is_allowed_by_all_or_not_at_all() -> None:
    rig = Rig(faults="enable-input@0.1..0.2,sto@0.15..0.3")
    until(rig, rig.run(SPEED_RAD_S, 50), 0.25)
    assert not rig.status & VOLTAGE
    assert climb(rig) == SWITCH_ON_DISABLED
    until(rig, 0, 0.31, 0)
    assert rig.status & VOLTAGE


def test_sto_fault_is_not_reset_before_sto_is_closed() -> None:
    rig = Rig(faults="sto-fault@0.1..0.3")
    until(rig, rig.run(SPEED_RAD_S, 50), 0.15)
    assert rig.control(VOLTAGE_OFF) == FAULT
    assert rig.control(RESET) == FAULT
    until(rig, 0, 0.31, 0)
    assert rig.state == FAULT
    assert rig.control(VOLTAGE_OFF) == FAULT
    assert rig.control(RESET) == SWITCH_ON_DISABLED
    assert climb(rig) == ENABLED


@pytest.mark.parametrize(("kind", "into"), [("sto", SWITCH_ON_DISABLED), ("sto-fault", FAULT)])
def test_sto_open_from_the_start_outlives_a_reset(kind: str, into: int) -> None:
    rig = Rig(faults=kind)
    for _ in range(2):
        assert (rig.state, rig.status & VOLTAGE) == (into, 0)
        assert climb(rig) == into
        rig.nmt(0x81)
    rig.sync()
    assert rig.emergencies()[-1] == 0x5091


def test_sto_ends_a_fault_reaction_and_a_quick_stop() -> None:
    for cause, then in ((lambda rig: rig.servo.fault(0x4310), FAULT), (lambda rig: rig.control(QUICK), 0x40)):
        rig = Rig(faults="sto@0.2")
        rig.write(0x6085, 0, 100_000, 4)  # 100 rpm/s: a stop that takes 0.6 s
        until(rig, rig.run(SPEED_RAD_S, 50), 0.19)
        cause(rig)
        assert rig.state in (FAULT_REACTION, QUICK_STOP)
        rig.sync(20)
        assert rig.state == then
        assert not rig.axis.energised


# -- Holding brake --


def test_operation_is_enabled_only_when_the_brake_has_opened() -> None:
    """Power first, then the brake, then the state: transition 4 is complete when set-points can be followed."""
    rig = Rig(faults="brake=0.15")
    rig.cyclic()
    rig.write(0x6060, 0, 8, 1)
    for word in (SHUTDOWN, SWITCH_ON):
        rig.cycle(word, 0)
    began = rig.axis.time_s
    rig.cycle(ENABLE, 0)
    assert rig.axis.energised
    while rig.state != ENABLED:
        assert rig.state == SWITCHED_ON
        assert not rig.status & FOLLOWS
        rig.cycle(ENABLE, 100_000)  # too early: not followed
        assert abs(rig.axis.position_counts) < 200
    assert rig.axis.time_s - began == pytest.approx(0.15, abs=0.003)
    for _ in range(400):
        rig.cycle(ENABLE, 100_000)
    assert rig.axis.position_counts == pytest.approx(100_000, abs=2000)


def test_enabling_is_taken_back_while_the_brake_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Power is switched on once, however often the word comes; with disable operation it goes, and the brake stays."""
    rig = Rig(faults="brake=0.15")
    switched: list[bool] = []
    energise = rig.axis.energise
    monkeypatch.setattr(rig.axis, "energise", lambda on: (switched.append(on), energise(on)))
    for word, then in (
        (SHUTDOWN, READY),
        (SWITCH_ON, SWITCHED_ON),
        (ENABLE, SWITCHED_ON),
        (ENABLE, SWITCHED_ON),
    ):
        assert rig.control(word) == then
        rig.sync()
    assert switched == [True]
    assert rig.control(SWITCH_ON) == SWITCHED_ON
    assert switched == [True, False]
    rig.sync(300)
    assert rig.state == SWITCHED_ON


@pytest.mark.parametrize("option", [2, 3])
def test_a_connection_that_is_lost_while_the_brake_opens_keeps_the_drive_from_operation(option: int) -> None:
    """6007 as Disable voltage or Quick stop: both lead out of Switched on (CiA 402-2, transitions 9 and 10)."""
    rig = Rig(faults="brake=0.15")
    rig.write(0x6007, 0, option, 2)
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        rig.control(word)
    rig.sync()
    assert rig.axis.energised
    rig.give(0x000, bytes((0x82, 0)))
    rig.sync(300)
    assert rig.state == SWITCH_ON_DISABLED
    assert not rig.axis.energised


def test_no_move_is_left_over_when_the_brake_opens_again() -> None:
    rig = Rig(faults="brake=0.05")
    rig.write(0x6060, 0, 1, 1)
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        rig.control(word)
    rig.sync(60)
    rig.write(0x607A, 0, 2**20, 4)
    rig.control(ENABLE | 0x10)
    rig.sync(50)
    assert not rig.status & TARGET_REACHED
    rig.servo.fault(0x4310)
    rig.sync(1000)
    for word in (RESET, SHUTDOWN, SWITCH_ON, ENABLE):
        rig.control(word)
    rig.sync(60)
    assert rig.state == ENABLED
    assert rig.status & TARGET_REACHED
    held = rig.axis.position_rad
    rig.sync(300)
    assert rig.axis.position_rad == pytest.approx(held, abs=0.02)


def test_brake_opens_without_sync() -> None:
    rig = Rig(faults="brake")
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        assert rig.control(word) != ENABLED
    rig.wait(0.3)
    assert rig.state == ENABLED


@pytest.mark.parametrize(("word", "then"), [(SHUTDOWN, READY), (SWITCH_ON, SWITCHED_ON)])
@pytest.mark.parametrize("option", [0, 1])
def test_torque_is_kept_until_the_brake_has_closed(word: int, then: int, option: int) -> None:
    """605B and 605C at standstill, whatever they say: the load would fall through the time that the brake takes."""
    rig = Rig(faults="brake=0.1")
    for index in (0x605B, 0x605C):
        rig.write(index, 0, option, 2)
    target = rig.run(cycles=0)
    for _ in range(50):
        rig.cycle(ENABLE, target)
    began = rig.axis.time_s
    rig.cycle(word, target)
    while rig.state != then:
        assert rig.axis.energised
        rig.cycle(word, target + 5000)  # no longer followed
        assert abs(rig.axis.position_counts) < 200
    assert not rig.axis.energised
    assert rig.axis.time_s - began == pytest.approx(0.1, abs=0.003)


def test_brake_closes_at_the_end_of_a_quick_stop_ramp_and_of_a_fault_reaction() -> None:
    for option, state, then in ((0x605A, QUICK_STOP, SWITCH_ON_DISABLED), (0x605E, FAULT_REACTION, FAULT)):
        rig = Rig(faults="brake=0.1")
        rig.write(option, 0, 2, 2)
        rig.run(SPEED_RAD_S, 100)
        if option == 0x605A:
            rig.control(QUICK)
        else:
            rig.servo.fault(0x4310)
        while not rig.axis.standstill:
            rig.sync()
        rig.sync(90)
        assert rig.state == state
        assert rig.axis.energised
        rig.sync(20)
        assert rig.state == then
        assert not rig.axis.energised


@pytest.mark.parametrize("brake", ["", "brake=0.05"])
def test_quick_stop_option_0_lets_the_axis_coast_and_the_brake_stops_it(brake: str) -> None:
    """605A = 0: disable the drive function. It coasts as long as friction lets it, or until the brake has closed."""
    rig = Rig(faults=brake)
    rig.write(0x605A, 0, 0, 2)
    rig.run(SPEED_RAD_S, 150)
    assert rig.control(QUICK) == SWITCH_ON_DISABLED
    assert not rig.axis.energised
    rig.sync(45)
    assert rig.axis.speed_rad_s > 0.5 * SPEED_RAD_S
    rig.sync(240)  # the load swings against the held shaft for a while
    assert (abs(rig.axis.speed_rad_s) < 0.2) == bool(brake)
    assert rig.axis.torque_demand_nm == 0  # what brakes is not the motor


def test_closed_brake_holds_against_a_hand_and_slips_beyond_its_torque() -> None:
    """Statics: a stiff shaft up to 120 N·m, sliding friction beyond."""
    for push_nm, moves in ((100.0, False), (150.0, True)):
        rig = Rig(faults="brake")
        rig.axis.energise(True)  # behind the drive's back: the motor is the hand
        rig.axis.configure(position_gain_1_s=0.0, speed_gain_nms_rad=0.0, torque_limit_nm=200.0)
        rig.axis.set_torque_offset(push_nm)
        rig.sync(200)
        assert (abs(rig.axis.position_rad) > 0.1) == moves
        if moves:
            rig.axis.set_torque_offset(0.0)
            rig.sync(500)
            assert abs(rig.axis.speed_rad_s) < 0.2


# -- Bit 12 --


@pytest.mark.parametrize(("cause", "limit"), [(0, 0), (1, LIMIT)])
def test_drive_that_does_not_follow_says_so_and_holds(cause: int, limit: int) -> None:
    """CiA 402-2, csp, statusword bit 12 = 0: the drive does not follow the command value, it is ignored."""
    rig = Rig(faults=f"not-following={cause}@0.2..0.5")
    target = until(rig, rig.run(SPEED_RAD_S, 50), 0.2)
    demand = rig.axis.demand_rad
    target = until(rig, target, 0.21)
    rest = rig.axis.demand_rad
    assert rest - demand == pytest.approx(SPEED_RAD_S**2 / (2 * 1047), rel=0.2)  # the ramp of 6085
    target = until(rig, target, 0.4)
    assert rig.axis.demand_rad == rest
    assert rig.state == ENABLED
    assert rig.status & (FOLLOWS | LIMIT) == limit
    assert abs(rig.axis.position_rad - rest) < 0.02
    target = until(rig, round(rest * COUNTS_PER_RAD), 0.51, 0)
    target = until(rig, target, 0.7)
    assert rig.status & (FOLLOWS | LIMIT) == FOLLOWS
    assert rig.axis.demand_rad == pytest.approx(target / COUNTS_PER_RAD, abs=0.02)


def test_drive_that_follows_again_goes_to_a_target_that_ran_away() -> None:
    """What makes bit 12 dangerous: 0.3 s at 6 rad/s further on, the next set-point is a step, and a following error."""
    rig = Rig(faults="not-following@0.2..0.5")
    rig.write(0x6065, 0, round(0.3 * COUNTS_PER_RAD), 4)
    until(rig, rig.run(SPEED_RAD_S, 50), 0.6)
    assert rig.state in (FAULT_REACTION, FAULT)
    assert rig.read(0x603F) == 0x8611


def test_drive_that_never_follows_is_enabled_all_the_same() -> None:
    rig = Rig(faults="not-following")
    rig.cyclic()
    rig.write(0x6060, 0, 8, 1)
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        rig.cycle(word, 0)
    for n in range(100):
        status, position, _, _ = rig.cycle(ENABLE, 500 * n)
    assert (status & 0x6F, status & FOLLOWS) == (ENABLED, 0)
    assert abs(position) < 500
    assert rig.axis.energised


# -- Remote --


def test_local_drive_does_not_process_the_controlword() -> None:
    """CiA 402-2, statusword bit 9 = 0; writing is accepted, and 6040 reads what was written."""
    rig = Rig(faults="local@..0.1")
    assert not rig.status & REMOTE
    assert climb(rig) == SWITCH_ON_DISABLED
    assert rig.read(0x6040) == ENABLE
    rig.sync(200)
    assert rig.state == SWITCH_ON_DISABLED  # what was written meanwhile is not caught up with
    assert rig.status & REMOTE
    assert climb(rig) == ENABLED


def test_drive_that_becomes_local_stops_following_and_cannot_be_stopped_by_controlword() -> None:
    rig = Rig(faults="local@0.2..0.4")
    target = until(rig, rig.run(SPEED_RAD_S, 50), 0.25)
    rest = rig.axis.demand_rad
    for word in (QUICK, VOLTAGE_OFF):
        assert rig.control(word) == ENABLED
    assert not rig.status & (REMOTE | FOLLOWS)
    until(rig, target, 0.35)
    assert rig.axis.demand_rad == rest
    rig.servo.fault(0x4310)  # its own supervision works on
    assert rig.state == FAULT_REACTION


# -- Limit switches --


def test_digital_inputs_have_the_standards_bits() -> None:
    """CiA 402-2, 60FD: bit 0 negative limit switch, bit 1 positive limit switch, bit 2 home switch."""
    rig = Rig(faults="negative-limit@0.01..0.04,positive-limit@0.02..0.05,home-switch@0.03")
    seen = []
    for _ in range(6):
        rig.sync(10)
        seen.append((rig.read(0x60FD), bool(rig.status & LIMIT)))
    assert seen == [(1, True), (3, True), (7, True), (6, True), (4, False), (4, False)]


@pytest.mark.parametrize("sign", [1, -1])
def test_no_further_into_a_limit_switch_but_out_of_it(sign: int) -> None:
    rig = Rig(faults=f"{'positive' if sign > 0 else 'negative'}-limit@0.2")
    target = until(rig, rig.run(sign * SPEED_RAD_S, 50), 0.25, sign * STEP)
    rest = rig.axis.demand_rad
    target = until(rig, target, 0.3, sign * STEP)
    assert rig.axis.demand_rad == rest
    assert rig.status & (FOLLOWS | LIMIT) == LIMIT
    assert rig.state == ENABLED
    stop = sign * SPEED_RAD_S * 0.2 + sign * SPEED_RAD_S**2 / (2 * 1047)
    assert abs(rest) < abs(stop)
    goal = round(0.5 * rest * COUNTS_PER_RAD)
    while sign * (target - goal) > STEP:  # back out of it
        target -= sign * STEP
        rig.cycle(ENABLE, target)
    for _ in range(200):
        status = rig.cycle(ENABLE, goal)[0]
    assert status & (FOLLOWS | LIMIT) == FOLLOWS | LIMIT
    assert rig.axis.position_counts == pytest.approx(goal, abs=2000)


def test_profile_stops_at_a_limit_switch_and_never_arrives() -> None:
    rig = Rig(faults="positive-limit@0.3..0.8")
    rig.enable(mode=1)
    rig.write(0x6081, 0, 60_000, 4)  # 2π rad/s
    rig.write(0x607A, 0, 2**20, 4)
    rig.control(ENABLE | 0x10)
    rig.sync(600)
    held = rig.axis.position_rad
    assert 0.1 < held < math.pi
    assert not rig.status & 1 << 10
    rig.control(ENABLE)
    rig.control(ENABLE | 0x30)  # the same again, at once: it does not start
    rig.sync(100)
    assert rig.axis.position_rad == pytest.approx(held, abs=0.02)
    rig.sync(200)
    rig.control(ENABLE)
    rig.control(ENABLE | 0x30)  # the switch is free again
    rig.sync(2000)
    assert rig.axis.position_counts == pytest.approx(2**20, abs=2000)
