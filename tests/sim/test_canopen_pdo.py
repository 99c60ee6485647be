"""PDO rules and exchange of the simulated drive (CiA 301)."""

import struct

import pytest
from canopen_rig import NODE, Aborted, Rig

OFF = 1 << 31
STATUS, POSITION, TORQUE, SPEED = 0x60410010, 0x60640020, 0x60770010, 0x606C0020


@pytest.fixture
def rig() -> Rig:
    return Rig()


def refused(rig: Rig, index: int, subindex: int, value: int, size: int = 4) -> int:
    with pytest.raises(Aborted) as caught:
        rig.write(index, subindex, value, size)
    return caught.value.code


# -- mapping rules --


def test_mapping_changes_only_while_the_pdo_is_off(rig: Rig) -> None:
    assert refused(rig, 0x1A00, 0, 0, 1) == 0x08000022
    rig.write(0x1800, 1, 0x40000185 | OFF, 4)
    assert refused(rig, 0x1A00, 1, STATUS) == 0x08000022  # and only while the count is 0
    rig.write(0x1A00, 0, 0, 1)
    rig.write(0x1A00, 1, POSITION, 4)
    rig.write(0x1A00, 0, 1, 1)
    rig.write(0x1800, 1, 0x40000185, 4)


@pytest.mark.parametrize(
    ("communication", "entry", "code"),
    [
        (0x1800, 0x5FFF0010, 0x06020000),  # no such object
        (0x1800, 0x60410110, 0x06090011),  # no such sub-index
        (0x1800, 0x60410020, 0x06040041),  # wrong length
        (0x1800, 0x10180220, 0x06040041),  # not mappable
        (0x1400, STATUS, 0x06040041),  # read only, into an RPDO
        (0x1800, 0x00050008, 0x06020000),  # a dummy is for RPDOs
    ],
)
def test_what_cannot_be_mapped(rig: Rig, communication: int, entry: int, code: int) -> None:
    rig.write(communication, 1, rig.read(communication, 1) | OFF, 4)
    rig.write(communication + 0x200, 0, 0, 1)
    assert refused(rig, communication + 0x200, 1, entry) == code


def test_no_more_than_64_bits(rig: Rig) -> None:
    rig.write(0x1801, 1, rig.read(0x1801, 1) | OFF, 4)
    rig.write(0x1A01, 0, 0, 1)
    for subindex, entry in enumerate((POSITION, SPEED, STATUS), start=1):
        rig.write(0x1A01, subindex, entry, 4)
    assert refused(rig, 0x1A01, 0, 3, 1) == 0x06040042
    rig.write(0x1A01, 0, 2, 1)
    assert refused(rig, 0x1A01, 0, 9, 1) == 0x06090031


def test_count_checks_entries_that_were_never_written(rig: Rig) -> None:
    rig.write(0x1A03, 0, 0, 1)
    assert refused(rig, 0x1A03, 0, 3, 1) == 0x06020000  # entries 2 and 3 are zero


@pytest.mark.parametrize("cob_id", [0x000, 0x080 - 1, 0x601, 0x701, 0x585, 0x20000185, 0x101])
def test_restricted_identifiers(rig: Rig, cob_id: int) -> None:
    assert refused(rig, 0x1801, 1, cob_id) == 0x06090030


def test_identifier_changes_only_while_the_pdo_is_off(rig: Rig) -> None:
    assert refused(rig, 0x1800, 1, 0x40000190) == 0x08000022
    rig.write(0x1800, 1, 0x40000185 | OFF, 4)
    rig.write(0x1800, 1, 0x40000190, 4)


@pytest.mark.parametrize("kind", [241, 252, 253])
def test_reserved_transmission_types(rig: Rig, kind: int) -> None:
    assert refused(rig, 0x1800, 2, kind, 1) == 0x06090030


def test_inhibit_time_and_start_value_only_while_off(rig: Rig) -> None:
    assert refused(rig, 0x1800, 3, 100, 2) == 0x08000022
    assert refused(rig, 0x1800, 6, 3, 1) == 0x08000022


# -- exchange --


def test_nothing_before_operational(rig: Rig) -> None:
    rig.map_pdo(0x1800, 0x40000185, 1, [STATUS])
    rig.sync(3)
    assert rig.take(0x185) == []
    rig.nmt(1)
    rig.sync(3)
    assert len(rig.take(0x185)) == 3
    rig.nmt(0x80)
    rig.sync(3)
    assert rig.take(0x185) == []


@pytest.mark.parametrize(("kind", "count"), [(1, 12), (2, 6), (3, 4), (240, 0)])
def test_cyclic_types_send_at_every_nth_sync(rig: Rig, kind: int, count: int) -> None:
    rig.map_pdo(0x1800, 0x40000185, kind, [STATUS])
    rig.nmt(1)
    rig.sync(12)
    assert len(rig.take(0x185)) == count


def test_acyclic_type_sends_at_sync_only_what_is_new(rig: Rig) -> None:
    rig.map_pdo(0x1800, 0x40000185, 0, [STATUS])
    rig.nmt(1)
    rig.sync(5)
    assert len(rig.take(0x185)) == 1
    rig.control(0x06)
    assert rig.take(0x185) == []
    rig.sync(5)
    assert [struct.unpack("<H", data)[0] & 0x6F for data in rig.take(0x185)] == [0x21]


def test_event_type_sends_changes_and_respects_inhibit_and_timer(rig: Rig) -> None:
    rig.map_pdo(0x1800, 0x40000185, 255, [STATUS])
    rig.nmt(1)
    rig.wait(0.1)
    assert len(rig.take(0x185)) == 1  # on entering operational
    rig.control(0x06)
    rig.wait(0.01)
    assert len(rig.take(0x185)) == 1
    rig.nmt(0x80)
    rig.write(0x1800, 1, 0x40000185 | OFF, 4)
    rig.write(0x1800, 3, 500, 2)  # 50 ms
    rig.write(0x1800, 5, 100, 2)  # 100 ms
    rig.write(0x1800, 1, 0x40000185, 4)
    rig.nmt(1)
    rig.wait(1.0)
    assert 9 <= len(rig.take(0x185)) <= 11
    for word in (0x07, 0x06, 0x07, 0x06):  # four changes within 8 ms
        rig.control(word)
        rig.wait(0.002)
    assert len(rig.take(0x185)) <= 1


def test_synchronous_rpdo_acts_at_the_next_sync(rig: Rig) -> None:
    rig.map_pdo(0x1400, 0x205, 1, [0x60400010])
    rig.nmt(1)
    rig.give(0x205, struct.pack("<H", 0x06))
    assert rig.state == 0x40
    rig.sync()
    assert rig.state == 0x21


def test_event_driven_rpdo_acts_at_once(rig: Rig) -> None:
    rig.nmt(1)  # the default: RPDO 1 is 6040, type 255
    rig.give(0x205, struct.pack("<H", 0x06))
    assert rig.state == 0x21


def test_reported_values_belong_to_sync_and_setpoints_to_the_time_after_it(rig: Rig) -> None:
    """A demand that comes with SYNC n cannot show in the sample of SYNC n."""
    rig.cyclic()
    rig.write(0x6060, 0, 8, 1)
    for word in (0x06, 0x07, 0x0F):
        rig.cycle(word, 0)
    before = rig.cycle(0x0F, 0)
    with_step = rig.cycle(0x0F, 20000)
    after = rig.cycle(0x0F, 20000)
    assert with_step[1] == pytest.approx(before[1], abs=1)
    assert after[1] > before[1] + 50


def test_short_frame_is_reported_and_ignored(rig: Rig) -> None:
    rig.nmt(1)
    rig.give(0x205, b"\x06")
    assert rig.state == 0x40
    (emergency,) = rig.take(0x80 + NODE)
    assert struct.unpack_from("<H", emergency)[0] == 0x8210


def test_value_out_of_range_in_a_pdo_leaves_the_old_one(rig: Rig) -> None:
    rig.map_pdo(0x1401, 0x305, 255, [0x60720010, 0x60600008])
    rig.nmt(1)
    rig.give(0x305, struct.pack("<Hb", 5000, 8))
    assert (rig.read(0x6072), rig.read(0x6061)) == (3329, 8)


def test_dummy_entry_skips_bytes(rig: Rig) -> None:
    rig.map_pdo(0x1401, 0x305, 255, [0x00070020, 0x60600008])
    rig.nmt(1)
    rig.give(0x305, struct.pack("<Ib", 0xFFFFFFFF, 1))
    assert rig.read(0x6061) == 1


def test_sync_counter_and_start_value(rig: Rig) -> None:
    rig.write(0x1019, 0, 10, 1)
    rig.write(0x1800, 1, 0x40000185 | OFF, 4)
    rig.write(0x1800, 6, 4, 1)
    rig.map_pdo(0x1800, 0x40000185, 3, [STATUS])
    rig.nmt(1)
    sent = []
    for counter in range(1, 11):
        rig.give(0x80, bytes((counter,)))
        sent.append(len(rig.take(0x185)))
    assert sent == [0, 0, 0, 1, 0, 0, 1, 0, 0, 1]
    rig.give(0x80)  # without its counter
    (emergency,) = rig.take(0x80 + NODE)
    assert struct.unpack_from("<H", emergency)[0] == 0x8240


def test_other_sync_identifier(rig: Rig) -> None:
    rig.map_pdo(0x1800, 0x40000185, 1, [STATUS])
    rig.write(0x1005, 0, 0x90, 4)
    rig.nmt(1)
    rig.give(0x80)
    assert rig.take(0x185) == []
    rig.give(0x90)
    assert len(rig.take(0x185)) == 1


# -- the clock --


@pytest.mark.parametrize(("period_us", "ticks"), [(1000, 8), (500, 4), (2000, 16), (0, 8)])
def test_each_sync_is_exactly_one_period(rig: Rig, period_us: int, ticks: int) -> None:
    rig.write(0x1006, 0, period_us, 4)  # 0: the interpolation period 60C2, 1 ms, counts
    start = rig.axis.time_s
    rig.sync(100, period_s=0.0137)  # however slowly they come
    rig.wait(1.0)
    assert rig.axis.time_s - start == pytest.approx(100 * ticks * 125e-6)


def test_wall_clock_follows_time_whatever_sync_does() -> None:
    rig = Rig(clock="wall")
    start = rig.axis.time_s
    rig.sync(100, period_s=0.0012)
    rig.wait(0.5)
    assert rig.axis.time_s - start == pytest.approx(0.62, abs=2e-4)
    assert rig.read(0x2F00) == 0
    assert Rig().read(0x2F00) == 1


def test_counters_of_a_long_exchange_add_up(rig: Rig) -> None:
    rig.cyclic()
    rig.write(0x6060, 0, 8, 1)
    for n in range(2000):
        rig.cycle(0x0F, n)
    assert rig.servo.syncs == 2000
