"""Objects 607B, 607C and 607E of the simulated drive, and what they do to everything else (CiA 402-2, factor group)."""

import math
import struct
from pathlib import Path

import pytest
from canopen_rig import COUNTS_PER_RAD, ENABLE, SHUTDOWN, SWITCH_ON, VOLTAGE_OFF, Aborted, Rig
from hypothesis import given
from hypothesis import strategies as st

from schwung_sim.drives.frame import Frame, read_frame
from schwung_sim.drives.roles import Roles
from schwung_sim.drives.units import read_units, turned

LIMIT, TARGET_REACHED = 1 << 11, 1 << 10
QUARTER = 2**18  # counts of a quarter turn
STEP = 1000  # counts in a cycle
SETTLED = 2000  # counts: the loop with the machine's inertia creeps into place


def enabled(*objects: tuple[int, int, int, int], faults: str = "") -> Rig:
    """A drive in cyclic position whose objects (index, sub-index, value, size) were written first."""
    rig = Rig(faults=faults)
    for index, subindex, value, size in objects:
        rig.write(index, subindex, value, size)
    rig.cyclic()
    rig.write(0x6060, 0, 8, 1)
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        rig.cycle(word, rig.read(0x6064, signed=True))
    return rig


def go(rig: Rig, start: int, goal: int) -> tuple[int, int, int, int]:
    """Targets from here to there, STEP counts a cycle, and time to settle; the last answer."""
    step = STEP if goal > start else -STEP
    for target in (*range(start, goal, step), *[goal] * 800):
        answer = rig.cycle(ENABLE, target)
    return answer


def while_moving(rig: Rig, sign: int = 1, cycles: int = 60) -> tuple[int, int, int, int]:
    """At constant speed from 0; the last answer."""
    for n in range(cycles):
        answer = rig.cycle(ENABLE, sign * n * STEP)
    return answer


# -- 607E --


@pytest.mark.parametrize("polarity", [0x00, 0x80, 0x40, 0xC0])
def test_polarity_turns_position_by_bit_7_and_velocity_by_bit_6(polarity: int) -> None:
    """CiA 402-2, polarity: demand and actual values are multiplied by −1; each bit turns its own quantity only."""
    rig = enabled((0x607E, 0, polarity, 1))
    turned = -1 if polarity & 0x80 else 1
    _, position, _, speed = while_moving(rig)
    motor_speed = rig.axis.demand_speed_rad_s
    assert math.copysign(1, motor_speed) == turned  # a positive way on the bus
    assert position == pytest.approx(turned * rig.axis.position_counts, abs=1)
    assert position > 0
    assert (speed > 0) == (motor_speed * (-1 if polarity & 0x40 else 1) > 0)
    demand = rig.read(0x6062, signed=True)
    assert demand == pytest.approx(turned * rig.axis.demand_rad * COUNTS_PER_RAD, abs=1)
    assert demand == rig.read(0x60FC, signed=True)
    assert rig.read(0x60F4, signed=True) == pytest.approx(demand - rig.read(0x6064, signed=True), abs=1)


@pytest.mark.parametrize(
    ("faults", "polarity", "sign"),
    [
        ("", 0xC0, 1),  # CiA 402-2 has no bit for the torque: it stays the motor's
        ("", 0xE0, 1),
        ("torque-polarity=5", 0xC0, 1),
        ("torque-polarity=5", 0x20, -1),  # bit 5, as Mitsubishi's MR-J5-G has it
        ("torque-polarity=5", 0xE0, -1),
        ("torque-polarity=7", 0x80, -1),  # the whole motor is turned
    ],
)
def test_torque_offset_and_torque_keep_the_motors_sign_unless_the_drive_has_a_bit(
    faults: str, polarity: int, sign: int
) -> None:
    rig = enabled((0x607E, 0, polarity, 1), faults=faults)
    for _ in range(5):
        rig.cycle(ENABLE, 0)
    before = rig.axis.torque_demand_nm
    rig.cycle(ENABLE, 0, 100)
    rig.axis.advance(125e-6)
    assert rig.axis.torque_demand_nm - before == pytest.approx(sign * 7.0, abs=0.7)
    assert rig.read(0x6074, signed=True) == round(sign * rig.axis.torque_demand_nm / 0.07)
    rig.sync(3)
    assert abs(rig.axis.torque_nm) > 0.1
    assert rig.read(0x6077, signed=True) == pytest.approx(sign * rig.axis.torque_nm / 0.07, abs=0.6)


@pytest.mark.parametrize(("polarity", "sign"), [(0xC0, 1), (0x20, -1)])
def test_every_torque_on_the_bus_has_the_same_sign(polarity: int, sign: int) -> None:
    """Also where a drive adds torque at an object of its own, and reports it at another."""
    plain = read_units(Roles(), lambda k: 0)
    units = turned(plain, polarity, torque_bit=1 << 5)
    assert units.torque_nm == sign * plain.torque_nm
    assert units.torque_added_nm == sign * plain.torque_added_nm
    assert units.rated_torque_nm == plain.rated_torque_nm


def test_in_some_drives_polarity_turns_demands_only() -> None:
    """As Novanta's manual says of 607E: the way back is reported in the motor's own direction."""
    rig = enabled((0x607E, 0, 0xC0, 1), faults="demand-polarity")
    _, position, _, speed = while_moving(rig)
    assert rig.axis.demand_speed_rad_s < 0
    assert position < 0
    assert speed < 0
    assert rig.read(0x6062, signed=True) > 0


def test_profile_goes_the_turned_way() -> None:
    rig = Rig(faults="set-up=0x607E00:0x80")
    rig.enable(mode=1)
    for relative in (0, 0x40):
        rig.write(0x607A, 0, 40_000, 4)
        rig.control(ENABLE | 0x10 | relative)
        rig.control(ENABLE)
        rig.sync(1500)
        assert rig.status & TARGET_REACHED
    assert rig.axis.position_counts == pytest.approx(-80_000, abs=2000)
    assert rig.read(0x6064, signed=True) == pytest.approx(80_000, abs=2000)


@pytest.mark.parametrize(("faults", "high"), [("negative-limit@0.05", False), ("positive-limit@0.05", True)])
def test_limit_switches_are_those_of_the_users_direction(faults: str, high: bool) -> None:
    rig = enabled((0x607E, 0, 0x80, 1), faults=faults)
    while_moving(rig, cycles=100)
    assert bool(rig.status & 1 << 12) != high  # on the bus it goes up


# -- 607C and 607D --


def test_zero_is_the_home_position_plus_the_home_offset() -> None:
    """CiA 402-2, home offset: zero position = home position + home offset; all positions are relative to that."""
    rig = enabled((0x607C, 0, 5000, 4))
    assert rig.read(0x6064, signed=True) == -5000  # it stands at home
    _, position, _, _ = go(rig, -5000, 20_000)
    assert position == pytest.approx(20_000, abs=SETTLED)
    assert rig.axis.position_counts == pytest.approx(25_000, abs=SETTLED)
    assert rig.read(0x6062, signed=True) == 20_000


@pytest.mark.parametrize(
    ("faults", "motor", "shown"),
    [
        ("", 20_000, 15_000),  # corrected max position limit = max position limit − home offset
        ("limits-from-zero", 25_000, 20_000),  # as in Nanotec's: "the home offset is not taken into account"
    ],
)
def test_software_limits_are_relative_to_the_machines_home(faults: str, motor: int, shown: int) -> None:
    rig = enabled((0x607C, 0, 5000, 4), (0x607D, 2, 20_000, 4), faults=faults)
    status, position, _, _ = go(rig, -5000, 40_000)
    assert status & LIMIT
    assert status & 0x6F == 0x27  # limited, and not left behind
    assert position == pytest.approx(shown, abs=SETTLED)
    assert rig.axis.position_counts == pytest.approx(motor, abs=SETTLED)
    rig.write(0x607D, 2, 20_000 - 2**18, 4)  # now far behind the axis
    rig.sync()
    assert rig.read(0x603F) == 0x8612


# -- 607B --


def test_position_wraps_at_the_end_of_its_range() -> None:
    """CiA 402-2, position range limit: reaching or exceeding an end, the value wraps to the other end."""
    rig = enabled((0x607B, 1, 0, 4), (0x607B, 2, QUARTER, 4))
    seen = []
    for n in range(400):
        seen.append(rig.cycle(ENABLE, n * STEP % QUARTER)[1])  # wrapped targets, as its own master sends them
    assert rig.axis.demand_rad * COUNTS_PER_RAD == pytest.approx(
        399 * STEP, abs=STEP
    )  # straight on over the end
    assert max(seen) < QUARTER
    assert min(seen[20:]) < STEP
    assert rig.read(0x6064, signed=True) == rig.axis.position_counts - QUARTER
    assert rig.read(0x6062, signed=True) == pytest.approx(
        rig.axis.demand_rad * COUNTS_PER_RAD - QUARTER, abs=1
    )


def test_target_outside_the_range_is_folded_into_it() -> None:
    """A master that knows nothing of the range counts on: the axis goes there, and is reported a range away."""
    rig = enabled((0x607B, 1, -QUARTER // 2, 4), (0x607B, 2, QUARTER // 2, 4))
    _, position, _, _ = go(rig, 0, 150_000)
    assert rig.axis.position_counts == pytest.approx(150_000, abs=SETTLED)
    assert position == pytest.approx(150_000 - QUARTER, abs=SETTLED)


@pytest.mark.parametrize(
    ("relative", "motor"),
    [
        (0, 50_000),  # back within the range, though across the end it were nearer
        (0x40, 250_000 + 50_000),  # a relative move goes straight on
    ],
)
def test_profile_crosses_the_end_of_the_range_only_where_it_is_relative(relative: int, motor: int) -> None:
    """CiA 402-2, positioning option code 60F2 bits 7 and 6 = 0: as on a linear axis."""
    rig = Rig(faults=f"set-up=0x607B02:{QUARTER}")
    rig.enable(mode=1)
    for target, word in ((250_000, 0), (50_000, relative)):
        rig.write(0x607A, 0, target, 4)
        rig.control(ENABLE | 0x10 | word)
        rig.control(ENABLE)
        rig.sync(2500)
        assert rig.status & TARGET_REACHED
    assert rig.axis.position_counts == pytest.approx(motor, abs=2000)
    assert rig.read(0x6064, signed=True) == rig.axis.position_counts % QUARTER


def test_software_limits_within_the_range_prevent_the_wrap() -> None:
    rig = enabled((0x607B, 2, QUARTER, 4), (0x607D, 1, 0, 4), (0x607D, 2, QUARTER - 20_000, 4))
    status, position, _, _ = go(rig, 0, QUARTER - 5000)
    assert status & LIMIT
    assert position == rig.axis.position_counts == pytest.approx(QUARTER - 20_000, abs=SETTLED)


def test_all_three_together() -> None:
    """Turned, moved, folded: motor −300 000 is 300 000 the user's way, 290 000 from zero, and one range back."""
    rig = enabled((0x607E, 0, 0xC0, 1), (0x607C, 0, 10_000, 4), (0x607B, 1, 0, 4), (0x607B, 2, QUARTER, 4))
    assert rig.read(0x6064, signed=True) == QUARTER - 10_000
    _, position, _, _ = go(rig, -10_000, 290_000)
    assert rig.axis.position_counts == pytest.approx(-300_000, abs=SETTLED)
    assert position == pytest.approx(290_000 - QUARTER, abs=SETTLED)


# -- What else is over the angle --


@pytest.mark.parametrize(
    ("polarity", "offset", "start_rad", "values"),
    [
        (0x00, 0, -0.1, (0.5, 0.6, 0.7)),
        (0x00, 100_000, -0.1 + 100_000 / COUNTS_PER_RAD, (0.5, 0.6, 0.7)),
        (
            0x80,
            0,
            -0.2,
            (0.7, 0.6, 0.5),
        ),  # −0.1, 0.05, 0.2 rad of the user's are 0.1, −0.05, −0.2 rad of the motor
        (0x80, 100_000, -0.2 - 100_000 / COUNTS_PER_RAD, (0.7, 0.6, 0.5)),
    ],
)
@pytest.mark.parametrize("frame_first", [True, False])
def test_inertia_table_is_over_the_users_angle(
    polarity: int, offset: int, start_rad: float, values: tuple[float, ...], frame_first: bool
) -> None:
    rig = Rig()
    frame = [(0x607E, 0, polarity, 1), (0x607C, 0, offset, 4)]
    table = [(0x2300, n, 4_000_000 + 1_000_000 * n, 4) for n in (1, 2, 3)]
    table += [(0x2301, 1, -100_000, 4), (0x2301, 2, 150_000, 4), (0x2301, 3, 3, 1), (0x2302, 1, 2, 1)]
    for one in frame + table if frame_first else table + frame:
        rig.write(*one)
    settings = rig.axis.settings
    assert settings.table_inertia_kgm2 == pytest.approx(values)
    assert (settings.table_start_rad, settings.table_step_rad) == pytest.approx((start_rad, 0.15))


def test_recorder_has_the_users_positions() -> None:
    client_rows = []
    for objects in ((), ((0x607E, 0, 0xC0, 1), (0x607C, 0, 10_000, 4))):
        rig = enabled(*objects)
        client = rig.client()
        rig.write(0x2200, 1, 8, 2)
        rig.write(0x2200, 2, 50, 4)
        rig.write(0x2200, 3, 1, 1)
        start = rig.read(0x6064, signed=True)
        go(rig, start, start + 60 * STEP)
        client_rows.append(
            [row[0] - start for row in struct.iter_unpack("<iihhi", client.sdo.upload(0x2200, 4))]
        )
        assert start == (-10_000 if objects else 0)
    assert client_rows[1] == pytest.approx(client_rows[0], abs=200)  # the same way, measured the same way
    assert max(client_rows[1]) > 5000


# -- The objects themselves --


@pytest.mark.parametrize(
    ("index", "subindex", "size"), [(0x607B, 1, 4), (0x607B, 2, 4), (0x607C, 0, 4), (0x607E, 0, 1)]
)
def test_not_under_power(index: int, subindex: int, size: int) -> None:
    """0x08000022: an axis under power would be elsewhere at once."""
    rig = Rig()
    rig.enable()
    with pytest.raises(Aborted) as caught:
        rig.write(index, subindex, 64, size)
    assert caught.value.code == 0x08000022
    rig.control(VOLTAGE_OFF)
    rig.write(index, subindex, 64, size)


def test_stored_frame_holds_after_power_on(tmp_path: Path) -> None:
    rig = Rig(memory=tmp_path / "memory.json")
    rig.write(0x607C, 0, 1234, 4)
    rig.write(0x1010, 1, 0x65766173, 4)
    rig.write(0x607C, 0, 99, 4)
    rig.nmt(0x81)
    assert rig.read(0x6064, signed=True) == -1234
    assert Rig(memory=tmp_path / "memory.json").read(0x6064, signed=True) == -1234


def test_set_up_works_behind_an_eds_without_the_object(tmp_path: Path) -> None:
    """A drive whose home offset nobody can see."""
    rig = Rig(profile="generic-cia402", faults="set-up=0x607C00:-777")
    with pytest.raises(Aborted):
        rig.read(0x607C)
    shown = rig.read(0x6064, signed=True)
    rig.nmt(0x81)
    assert rig.read(0x6064, signed=True) == shown == 777


def test_whole_range_of_the_type_is_no_range() -> None:
    def held(index: int, subindex: int) -> int:
        return {(0x607B, 1): -(2**31), (0x607B, 2): 2**31 - 1}.get((index, subindex), 0)

    assert read_frame(held) is None


@given(
    zero=st.integers(-(10**6), 10**6),
    low=st.integers(-(10**6), 10**6),
    modulus=st.integers(2, 10**6),
    target=st.integers(-(10**7), 10**7),
    near=st.integers(-(10**7), 10**7),
)
def test_a_target_is_reached_where_it_is_reported(
    zero: int, low: int, modulus: int, target: int, near: int
) -> None:
    frame = Frame(zero, low, modulus)
    nearest, within = frame.nearest(target, near), frame.within(target, near)
    assert frame.reported(nearest) == frame.reported(within) == frame.fold(target)
    assert abs(nearest - near) <= modulus / 2
    assert low <= frame.reported(near) < low + modulus
    assert (near - zero - low) // modulus == (within - zero - low) // modulus  # no end is between them
