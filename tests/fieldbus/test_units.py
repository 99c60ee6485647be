"""Units from the drive's objects, with numbers that the standards print."""

from __future__ import annotations

import math

import pytest

from schwung.errors import InputError
from schwung.fieldbus.profile import DeviceProfile, ObjectRef, load_profile
from schwung.fieldbus.units import decode_si_unit, read_scales

BENCH = {
    (0x608F, 1): 2**20, (0x608F, 2): 1, (0x6091, 1): 1, (0x6091, 2): 1, (0x60A9, 0): 0xFDB44700,
    (0x60AA, 0): 0xFDC00300, (0x6076, 0): 70000,
}  # fmt: skip


def scales_of(objects: dict[tuple[int, int], int], profile: DeviceProfile | None = None):
    return read_scales(profile or load_profile("schwung-bench"), lambda i, s: objects.get((i, s)))


@pytest.mark.parametrize(
    ("raw", "si"),
    [
        (0xFDB44700, 1e-3 * 2 * math.pi / 60),  # 10⁻³ rpm
        (0x00B44700, 2 * math.pi / 60),  # rpm
        (0x00100300, 1.0),  # rad/s
        (0xFD100300, 1e-3),
        (0x00410300, math.pi / 180),  # degrees per second
        (0x00B50300, 0.25),  # increments per second
        (0x00C00300, 2 * math.pi / 60),  # rpm per second
        (0x00000000, None),
        (0x00FF0300, None),
    ],
)
def test_si_unit_notation(raw: int, si: float | None) -> None:
    assert decode_si_unit(raw, increment_rad=0.25) == (None if si is None else pytest.approx(si))


def test_position_is_one_turn_over_the_encoders_increments() -> None:
    assert scales_of(BENCH).position_rad == pytest.approx(2 * math.pi / 2**20)
    assert scales_of(BENCH | {(0x608F, 2): 2}).position_rad == pytest.approx(4 * math.pi / 2**20)


def test_gear_and_feed_are_taken_into_account() -> None:
    """CiA 402: position = increments · feed / (resolution · gear); 3600 units a shaft turn, 10 motor turns for it."""
    scales = scales_of(BENCH | {(0x6091, 1): 10, (0x6092, 1): 3600, (0x6092, 2): 1})
    assert scales.position_rad == pytest.approx(10 * 2 * math.pi / 3600)  # motor side


def test_torque_is_per_mille_of_rated() -> None:
    scales = scales_of(BENCH)
    assert scales.rated_torque_nm == pytest.approx(70.0)
    assert scales.torque_nm == pytest.approx(0.07)


def test_rated_torque_in_micronewton_metres_is_the_profiles_to_say() -> None:
    profile = load_profile("schwung-bench")
    torque = profile.quantities.torque.model_copy(update={"rated_torque_scale": 1e-6})
    quantities = profile.quantities.model_copy(update={"torque": torque})
    scales = scales_of(BENCH, profile.model_copy(update={"quantities": quantities}))
    assert scales.rated_torque_nm == pytest.approx(0.07)


def test_a_literal_of_the_profile_overrides_the_drive() -> None:
    profile = load_profile("schwung-bench")
    assert profile.quantities.speed is not None
    speed = profile.quantities.speed.model_copy(update={"unit": "literal", "scale": 0.5})
    quantities = profile.quantities.model_copy(update={"speed": speed})
    assert (
        scales_of(
            {**BENCH, (0x60A9, 0): 0}, profile.model_copy(update={"quantities": quantities})
        ).speed_rad_s
        == 0.5
    )


def test_acceleration_without_60aa_is_in_speed_units_per_second() -> None:
    told = scales_of(BENCH)
    untold = scales_of(BENCH | {(0x60AA, 0): 0})
    assert told.acceleration_rad_s2 == pytest.approx(1e-3 * 2 * math.pi / 60)
    assert untold.acceleration_rad_s2 == untold.speed_rad_s


@pytest.mark.parametrize("missing", [(0x608F, 1), (0x60A9, 0), (0x6076, 0)])
def test_a_unit_that_nobody_tells_is_asked_for_in_the_profile(missing: tuple[int, int]) -> None:
    objects = {key: value for key, value in BENCH.items() if key != missing}
    with pytest.raises(InputError, match=f"{missing[0]:04X}") as raised:
        scales_of(objects)
    assert "literal" in raised.value.remedy


def with_quantity(name: str, **update: object) -> DeviceProfile:
    """The bench profile with one quantity told otherwise."""
    profile = load_profile("schwung-bench")
    quantity = getattr(profile.quantities, name).model_copy(update=update)
    quantities = profile.quantities.model_copy(update={name: quantity})
    return profile.model_copy(update={"quantities": quantities})


def test_increments_per_turn_may_be_in_an_object_of_the_manufacturers() -> None:
    """EPOS4: 3200 in 3000:05, EPOS2: 800 pulses in 2210:01, four counts each: the same encoder."""
    counts = with_quantity("position", unit="increments", resolution=ObjectRef(index=0x3000, subindex=5))
    pulses = with_quantity(
        "position", unit="increments", resolution=ObjectRef(index=0x2210, subindex=1), resolution_factor=4.0
    )
    objects = {**BENCH, (0x3000, 5): 3200, (0x2210, 1): 800}
    assert scales_of(objects, counts).position_rad == pytest.approx(2 * math.pi / 3200)
    assert scales_of(objects, pulses).position_rad == pytest.approx(2 * math.pi / 3200)
    with pytest.raises(InputError, match="3000:05"):
        scales_of(BENCH, counts)


def test_speed_may_be_position_counts_per_second() -> None:
    scales = scales_of(BENCH, with_quantity("speed", unit="position_per_second"))
    assert scales.speed_rad_s == scales.position_rad == pytest.approx(2 * math.pi / 2**20)


def test_rated_torque_may_be_in_another_object() -> None:
    torque = with_quantity("torque", rated=ObjectRef(index=0x2F10, subindex=2))
    assert scales_of({**BENCH, (0x2F10, 2): 5000}, torque).rated_torque_nm == pytest.approx(5.0)


@pytest.mark.parametrize("name", ["position", "speed", "torque", "torque_added"])
def test_what_is_left_to_the_user_is_no_number(name: str) -> None:
    scales = scales_of(BENCH, with_quantity(name, unit="user", hint="ask"))
    assert math.isnan(getattr(scales, f"{name}_{SI[name]}"))


SI = {"position": "rad", "speed": "rad_s", "torque": "nm", "torque_added": "nm"}


def test_factory_ones_are_no_resolution() -> None:
    """Elmo leaves 608F, 6091 and 6092 at 1 to 1: that would make every count a turn."""
    ones = BENCH | {(0x608F, 1): 1, (0x6091, 1): 1, (0x6091, 2): 1, (0x6092, 1): 1, (0x6092, 2): 1}
    with pytest.raises(InputError, match="1 count a turn"):
        scales_of(ones)
