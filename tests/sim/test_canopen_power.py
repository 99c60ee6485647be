"""The CiA 402 state machine, option codes, modes and supervision of the simulated drive."""

import math
import struct

import pytest
from canopen_rig import (
    COUNTS_PER_RAD,
    ENABLE,
    ENABLED,
    FAULT,
    FAULT_REACTION,
    HALT,
    NODE,
    QUICK,
    QUICK_STOP,
    READY,
    RESET,
    SHUTDOWN,
    SWITCH_ON,
    SWITCH_ON_DISABLED,
    SWITCHED_ON,
    VOLTAGE_OFF,
    Aborted,
    Rig,
)

TARGET_REACHED, LIMIT, MODE_BIT, FOLLOWING_ERROR = 1 << 10, 1 << 11, 1 << 12, 1 << 13
REV = 2**20


@pytest.fixture
def rig() -> Rig:
    return Rig()


PATHS = {
    SWITCH_ON_DISABLED: [],
    READY: [SHUTDOWN],
    SWITCHED_ON: [SHUTDOWN, SWITCH_ON],
    ENABLED: [SHUTDOWN, SWITCH_ON, ENABLE],
}


@pytest.mark.parametrize(
    ("state", "word", "then"),
    [
        (SWITCH_ON_DISABLED, SHUTDOWN, READY),  # 2
        (SWITCH_ON_DISABLED, SWITCH_ON, SWITCH_ON_DISABLED),
        (SWITCH_ON_DISABLED, ENABLE, SWITCH_ON_DISABLED),
        (SWITCH_ON_DISABLED, RESET, SWITCH_ON_DISABLED),
        (READY, SWITCH_ON, SWITCHED_ON),  # 3
        (READY, ENABLE, ENABLED),  # 3 and 4
        (READY, QUICK, SWITCH_ON_DISABLED),  # 7
        (READY, VOLTAGE_OFF, SWITCH_ON_DISABLED),  # 7
        (SWITCHED_ON, ENABLE, ENABLED),  # 4
        (SWITCHED_ON, SHUTDOWN, READY),  # 6
        (SWITCHED_ON, QUICK, SWITCH_ON_DISABLED),  # 10
        (SWITCHED_ON, VOLTAGE_OFF, SWITCH_ON_DISABLED),  # 10
        (ENABLED, SHUTDOWN, READY),  # 8, 605B 0: at once
        (ENABLED, VOLTAGE_OFF, SWITCH_ON_DISABLED),  # 9
        (ENABLED, QUICK, QUICK_STOP),  # 11
        (ENABLED, ENABLE | RESET, ENABLED),  # fault reset means nothing without a fault
    ],
)
def test_transitions(rig: Rig, state: int, word: int, then: int) -> None:
    for step in PATHS[state]:
        rig.control(step)
    assert rig.state == state
    assert rig.control(word) == then
    assert rig.axis.energised == (then in (ENABLED, QUICK_STOP))


def test_no_climbing_with_the_reset_bit_set(rig: Rig) -> None:
    assert rig.control(SHUTDOWN | RESET) == SWITCH_ON_DISABLED


def test_statusword_has_voltage_and_remote(rig: Rig) -> None:
    assert rig.status & 0x0210 == 0x0210


@pytest.mark.parametrize("mode", [0, 1, 8])
def test_modes(rig: Rig, mode: int) -> None:
    rig.write(0x6060, 0, mode, 1)
    assert rig.read(0x6061) == mode
    assert rig.read(0x6502) == 0x81


# -- motion --


def test_csp_follows_and_reports(rig: Rig) -> None:
    target = rig.run(speed_rad_s=3.0, cycles=300)
    status, position, torque, speed = rig.cycle(ENABLE, target + 501)
    assert status & MODE_BIT
    assert not status & (LIMIT | FOLLOWING_ERROR)
    assert abs(position - target) < 0.02 * COUNTS_PER_RAD
    assert speed * 1e-3 * 2 * math.pi / 60 == pytest.approx(3.0, abs=0.4)
    assert rig.read(0x6064, signed=True) == position
    assert rig.read(0x6062, signed=True) == rig.read(0x60FC, signed=True)
    assert rig.read(0x60F4, signed=True) == pytest.approx(rig.read(0x6062) - position, abs=1)
    assert abs(torque) < 200


def test_torque_offset_moves_the_axis_and_is_in_per_mille(rig: Rig) -> None:
    """100 ‰ of 70 N·m against the controller: the torque demand changes by it at once."""
    rig.run(cycles=0)
    for _ in range(3):
        rig.cycle(ENABLE, 0, 0)
    before = rig.axis.torque_demand_nm
    rig.cycle(ENABLE, 0, 100)
    rig.axis.advance(125e-6)  # one control tick: the controller has hardly answered
    assert rig.axis.torque_demand_nm - before == pytest.approx(7.0, abs=0.7)
    assert rig.read(0x6074, signed=True) == round(rig.axis.torque_demand_nm / 0.07)


def test_torque_is_clipped_at_6072(rig: Rig) -> None:
    rig.write(0x6072, 0, 50, 2)
    rig.run(speed_rad_s=20.0, cycles=20)
    assert abs(rig.read(0x6074, signed=True)) <= 50
    assert rig.status & LIMIT


# -- stops --


@pytest.mark.parametrize(
    ("option", "then", "seconds"),
    [
        (0, SWITCH_ON_DISABLED, 0.0),
        (1, SWITCH_ON_DISABLED, 0.03),
        (2, SWITCH_ON_DISABLED, 0.006),
        (5, QUICK_STOP, 0.03),
        (6, QUICK_STOP, 0.006),
    ],
)
def test_quick_stop_options(rig: Rig, option: int, then: int, seconds: float) -> None:
    """605A: coast, or the slow-down (6084) or quick-stop (6085) ramp; then power off, or stay."""
    rig.write(0x605A, 0, option, 2)
    rig.write(0x6084, 0, 2_000_000, 4)  # 2000 rpm/s: 209 rad/s²
    target = rig.run()
    speed = rig.axis.demand_speed_rad_s
    assert rig.control(QUICK) == (SWITCH_ON_DISABLED if option == 0 else QUICK_STOP)
    rest = rig.axis.demand_rad
    rig.sync(math.ceil(1000 * seconds) + 2)
    if option:
        assert rig.axis.demand_speed_rad_s == 0
        assert rig.axis.demand_rad - rest == pytest.approx(0.5 * speed * seconds, rel=0.12)
    rig.sync(1000)
    assert rig.state == then
    assert rig.axis.energised == (then == QUICK_STOP)
    if then == QUICK_STOP:
        assert rig.control(ENABLE) == ENABLED  # transition 16
        assert abs(rig.cycle(ENABLE, target)[1] - target) < REV


def test_quick_stop_can_be_left_by_voltage_off(rig: Rig) -> None:
    rig.write(0x605A, 0, 6, 2)
    rig.run()
    rig.control(QUICK)
    assert rig.control(VOLTAGE_OFF) == SWITCH_ON_DISABLED
    assert not rig.axis.energised


@pytest.mark.parametrize("option", [0, 1])
@pytest.mark.parametrize(
    ("index", "word", "then"), [(0x605B, SHUTDOWN, READY), (0x605C, SWITCH_ON, SWITCHED_ON)]
)
def test_leaving_operation(rig: Rig, option: int, index: int, word: int, then: int) -> None:
    rig.write(index, 0, option, 2)
    rig.run()
    assert rig.control(word) == (ENABLED if option else then)
    rig.sync(1000)
    assert rig.state == then
    assert not rig.axis.energised


def test_halt_stops_and_lets_go_on(rig: Rig) -> None:
    target = rig.run()
    for _ in range(200):
        status, held, _, _ = rig.cycle(ENABLE | HALT, target + 200000)
    assert status & 0x6F == ENABLED
    assert not status & MODE_BIT
    assert abs(held - target) < 0.2 * COUNTS_PER_RAD
    for _ in range(300):
        status, position, _, _ = rig.cycle(ENABLE, target)
    assert status & MODE_BIT
    assert position == pytest.approx(target, abs=4000)


# -- faults --


@pytest.mark.parametrize("option", [0, 1, 2])
def test_fault_reaction_options(rig: Rig, option: int) -> None:
    rig.write(0x605E, 0, option, 2)
    rig.run()
    rig.servo.fault(0x4310)
    assert rig.state == (FAULT if option == 0 else FAULT_REACTION)
    assert rig.axis.energised == (option > 0)
    rig.sync(1000)
    assert rig.state == FAULT
    assert not rig.axis.energised
    assert rig.read(0x603F) == 0x4310


def test_fault_reset_needs_a_rising_edge(rig: Rig) -> None:
    rig.control(RESET)
    rig.servo.fault(0x4310)
    assert rig.control(RESET) == FAULT
    assert rig.control(SHUTDOWN) == FAULT
    assert rig.control(RESET) == SWITCH_ON_DISABLED
    assert rig.read(0x603F) == 0


def test_following_error_needs_window_and_time(rig: Rig) -> None:
    rig.write(0x6065, 0, round(0.05 * COUNTS_PER_RAD), 4)
    rig.write(0x6066, 0, 15, 2)
    target = rig.run(cycles=10)
    rig.take(0x80 + NODE)
    rig.servo.vendor.weaken()
    flagged, cycles = 0, 0
    while rig.state == ENABLED and cycles < 200:
        cycles += 1
        target += 1000
        flagged += bool(rig.cycle(ENABLE, target)[0] & FOLLOWING_ERROR)
    assert rig.state in (FAULT_REACTION, FAULT)
    assert flagged in (15, 16)
    assert rig.read(0x603F) == 0x8611
    (emergency,) = rig.take(0x80 + NODE)
    assert struct.unpack_from("<HB", emergency) == (0x8611, 0x21)
    rig.sync(1500)  # without torque no ramp ends at rest: it is given up
    assert rig.state == FAULT


def test_following_error_can_be_switched_off(rig: Rig) -> None:
    rig.write(0x6065, 0, 0xFFFFFFFF, 4)
    target = rig.run(cycles=10)
    rig.servo.vendor.weaken()
    for _ in range(200):
        target += 1000
        assert not rig.cycle(ENABLE, target)[0] & FOLLOWING_ERROR
    assert rig.state == ENABLED


def test_target_beyond_the_limits_is_limited_and_flagged(rig: Rig) -> None:
    rig.write(0x607D, 2, 20000, 4)
    rig.run(cycles=0)
    for n in range(300):
        status, position, _, _ = rig.cycle(ENABLE, 100 * n)
    assert status & LIMIT
    assert position == pytest.approx(20000, abs=500)
    assert not rig.cycle(ENABLE, 19000)[0] & 0x08
    assert not rig.cycle(ENABLE, 19000)[0] & LIMIT


def test_position_beyond_the_limits_is_a_fault(rig: Rig) -> None:
    rig.run(cycles=50)
    rig.write(0x607D, 2, 10000, 4)  # behind the axis
    rig.sync()
    assert rig.state in (FAULT_REACTION, FAULT)
    assert rig.read(0x603F) == 0x8612


def test_jump_is_slowed_to_the_top_speed(rig: Rig) -> None:
    rig.write(0x6080, 0, 60, 4)  # 1 rev/s
    rig.run(cycles=0)
    for _ in range(100):
        status = rig.cycle(ENABLE, REV)[0]
    assert status & LIMIT
    assert rig.axis.demand_rad == pytest.approx(0.1 * 2 * math.pi, rel=0.03)


# -- profile position --


def start_move(rig: Rig, target: int, word: int = 0x10) -> None:
    rig.write(0x607A, 0, target, 4)
    rig.control(ENABLE | word)


def test_profile_move_and_handshake(rig: Rig) -> None:
    rig.write(0x6081, 0, 60_000, 4)  # 60 rpm: 2π rad/s
    rig.write(0x6083, 0, 600_000, 4)  # 20π rad/s²
    rig.write(0x6084, 0, 600_000, 4)
    rig.enable(mode=1)
    assert rig.status & (TARGET_REACHED | MODE_BIT) == TARGET_REACHED
    start_move(rig, REV // 2)
    assert rig.status & (TARGET_REACHED | MODE_BIT) == MODE_BIT  # acknowledged, under way
    rig.control(ENABLE)
    assert not rig.status & MODE_BIT
    fastest = 0.0
    for _ in range(600):  # ½ rev at 1 rev/s and 10 rev/s²: 0.5 + 0.1 s
        rig.sync()
        fastest = max(fastest, rig.axis.demand_speed_rad_s)
    assert fastest == pytest.approx(2 * math.pi, rel=1e-3)
    assert rig.axis.demand_speed_rad_s == pytest.approx(0, abs=0.1)
    rig.sync(400)
    assert rig.status & TARGET_REACHED
    assert rig.read(0x6064, signed=True) == pytest.approx(REV // 2, abs=2000)


def test_no_move_without_a_rising_edge(rig: Rig) -> None:
    rig.enable(mode=1)
    start_move(rig, 50000)
    rig.sync(1500)
    start_move(rig, 0)  # bit 4 has stayed set
    rig.sync(1500)
    assert rig.read(0x6064, signed=True) == pytest.approx(50000, abs=2000)


def test_relative_move(rig: Rig) -> None:
    rig.enable(mode=1)
    for n in (1, 2):
        start_move(rig, 30000, 0x50)
        rig.control(ENABLE)
        rig.sync(1500)
        assert rig.read(0x6064, signed=True) == pytest.approx(30000 * n, abs=2000)


def test_second_setpoint_waits_and_a_third_is_not_taken(rig: Rig) -> None:
    rig.enable(mode=1)
    start_move(rig, 60000)
    rig.control(ENABLE)
    start_move(rig, -60000)
    rig.control(ENABLE)
    assert rig.status & MODE_BIT  # the buffer is full
    start_move(rig, 1000)
    rig.control(ENABLE)
    reached = []
    for _ in range(3000):
        rig.sync()
        reached.append(rig.axis.position_counts)
    assert max(reached) == pytest.approx(60000, abs=12000)  # the cascade overshoots, the demand does not
    assert reached[-1] == pytest.approx(-60000, abs=2000)
    assert not rig.status & MODE_BIT


def test_change_at_once(rig: Rig) -> None:
    rig.enable(mode=1)
    start_move(rig, REV)
    rig.control(ENABLE)
    rig.sync(100)
    start_move(rig, -20000, 0x30)
    rig.control(ENABLE)
    rig.sync(3000)
    assert rig.read(0x6064, signed=True) == pytest.approx(-20000, abs=2000)


def test_halt_interrupts_a_move(rig: Rig) -> None:
    rig.enable(mode=1)
    start_move(rig, REV)
    rig.sync(50)
    rig.control(ENABLE | HALT)
    rig.sync(1000)
    assert rig.status & TARGET_REACHED  # with halt this bit says: at rest
    held = rig.read(0x6064, signed=True)
    assert held < REV // 2
    rig.control(ENABLE)
    rig.sync(3000)
    assert rig.read(0x6064, signed=True) == pytest.approx(REV, abs=2000)


def test_profile_target_is_limited_as_well(rig: Rig) -> None:
    rig.write(0x607D, 2, 40000, 4)
    rig.enable(mode=1)
    start_move(rig, REV)
    assert rig.status & LIMIT
    rig.sync(2000)
    assert rig.read(0x6064, signed=True) == pytest.approx(40000, abs=2000)


# -- units and vendor objects --


@pytest.mark.parametrize(("unit", "factor"), [(0x00B44700, 1000), (0xFEB44700, 10)])
def test_speed_unit_scales_speed_and_profile(rig: Rig, unit: int, factor: int) -> None:
    rig.run(cycles=100)
    fine = rig.read(0x606C, signed=True)
    rig.control(VOLTAGE_OFF)
    rig.write(0x60A9, 0, unit, 4)
    assert rig.read(0x606C, signed=True) == pytest.approx(fine / factor, abs=0.51)


def test_speed_unit_stays_under_power(rig: Rig) -> None:
    rig.enable()
    with pytest.raises(Aborted) as caught:
        rig.write(0x60A9, 0, 0x00B44700, 4)
    assert caught.value.code == 0x08000022


def test_inertia_table_reaches_the_axis(rig: Rig) -> None:
    for point in range(1, 5):
        rig.write(0x2300, point, 500_000 + point, 4)
    rig.write(0x2301, 1, -100_000, 4)
    rig.write(0x2301, 2, 50_000, 4)
    rig.write(0x2301, 3, 3, 1)
    rig.write(0x2302, 1, 2, 1)
    settings = rig.axis.settings
    assert settings.table_inertia_kgm2 == pytest.approx((0.0500001, 0.0500002, 0.0500003))
    assert (settings.table_start_rad, settings.table_step_rad) == pytest.approx((-0.1, 0.05))
    assert settings.feed_forward_mode == 2
    rig.write(0x2300, 2, 700_000, 4)  # a point in use
    assert rig.axis.settings.table_inertia_kgm2[1] == pytest.approx(0.07)


def test_cascade_and_filter_reach_the_axis(rig: Rig) -> None:
    for index, subindex, value in (
        (0x2400, 1, 80_000),
        (0x2400, 2, 5650),
        (0x2400, 3, 4000),
        (0x2000, 0, 250),
    ):
        rig.write(index, subindex, value, 4)
    settings = rig.axis.settings
    assert settings.position_gain_1_s == pytest.approx(80)
    assert settings.speed_gain_nms_rad == pytest.approx(5.65)
    assert settings.speed_integral_time_s == pytest.approx(0.004)
    assert settings.speed_filter_s == pytest.approx(250e-6)


def test_sine_generator_and_trace(rig: Rig) -> None:
    """A trace armed before the motion holds the sine that the generator adds."""
    client = rig.client()
    rig.write(0x2100, 1, 200, 2)
    rig.write(0x2100, 2, 50_000, 4)
    rig.write(0x2100, 4, 1, 1)
    rig.write(0x2200, 1, 8, 2)
    rig.write(0x2200, 2, 300, 4)
    rig.write(0x2200, 3, 1, 1)
    rig.enable(mode=1)
    rig.sync(50)
    assert rig.read(0x2200, 3) == 1
    start_move(rig, 50000)
    rig.sync(150)
    assert rig.read(0x2200, 3) == 2
    rig.sync(200)
    assert rig.read(0x2200, 3) == 3
    rows = list(struct.iter_unpack("<iihhi", client.sdo.upload(0x2200, 4)))
    assert len(rows) == 300
    assert max(row[2] for row in rows) > 150
    with pytest.raises(Aborted):
        rig.write(0x2200, 3, 2, 1)
