"""Capabilities: what a profile offers is looked for in the drive, what it does not comes with the profile's reason."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from schwung.fieldbus import eds
from schwung.fieldbus.canopen.capabilities import assess
from schwung.fieldbus.drive import Capability
from schwung.fieldbus.profile import CAPABILITIES, CanopenProfile, ObjectRef, load_canopen_profile

BENCH = load_canopen_profile("schwung-bench")


def assessed(profile: CanopenProfile, **lacking: bool) -> dict[str, Capability]:
    """Capabilities of a drive that has all its EDS has, except objects named like o1016; reads give 1."""
    dictionary = eds.load_dictionary(profile.eds_path, 5)
    gone = {int(name[1:], 16) for name, is_gone in lacking.items() if is_gone}

    def lookup(index: int, subindex: int):
        return None if index in gone else eds.find_parameter(dictionary, index, subindex)

    def read(index: int, subindex: int) -> int | None:
        if lookup(index, subindex) is None:
            return None
        return 0x81 if index == 0x6502 else 1  # profile position and cyclic synchronous position

    return {capability.name: capability for capability in assess(profile, lookup, read)}


def test_every_capability_is_assessed_once_and_in_order() -> None:
    assert tuple(assessed(BENCH)) == CAPABILITIES


def test_the_bench_has_all_that_its_profile_offers() -> None:
    found = assessed(BENCH)
    assert {name for name, capability in found.items() if not capability.available} == {
        "disturbance buffer",
        "harmonic feed-forward",
    }
    assert found["torque injection"].reason == "60B2:00 by PDO"


@pytest.mark.parametrize(
    ("lacking", "name", "told"),
    [
        ("o60B2", "torque injection", "the drive does not have 60B2:00"),
        ("o2200", "trace buffer", "the drive does not have 2200:03"),
        ("o2100", "generator", "the drive does not have 2100:01, 2100:04"),
        ("o1016", "stop by heartbeat", "it will not notice our death"),
        ("o1010", "store", "lost at power-off"),
        ("o1800", "sampling by SYNC", "no TPDO 1"),
        ("o2400", "control gains", "2400:01"),
        ("o2301", "table feed-forward", "2301:01"),
    ],
)
def test_what_the_drive_lacks_is_named(lacking: str, name: str, told: str) -> None:
    found = assessed(BENCH, **{lacking: True})[name]
    assert not found.available
    for part in told.split(", "):
        assert part in found.reason


@pytest.mark.parametrize(
    ("family", "name", "told"),
    [
        ("maxon-epos4", "trace buffer", "what its control and status words mean is published nowhere"),
        ("maxon-epos2", "torque", "torque constant in N·m/A divided by 1000"),
        ("faulhaber-cc", "profile position", "all mappings are fixed"),
        ("wittenstein-simco", "scalar feed-forward", "3905"),
        ("elmo-gold", "trace buffer", "RC, RG, RL, RR"),
        ("schunk-erb", "cyclic position", "60C1"),
        ("trinamic-tmcm1636", "torque injection", "60B2"),
        ("zeroerr-erob", "torque injection", "motor's or the joint's"),
        ("generic-cia402", "table feed-forward", "the standard has no feed-forward"),
    ],
)
def test_what_the_profile_lacks_comes_with_its_reason(family: str, name: str, told: str) -> None:
    found = assessed(load_canopen_profile(family))[name]
    assert not found.available
    assert found.reason.startswith("this profile can't do that, because ")
    assert told in found.reason


def test_a_mode_that_the_drive_does_not_list_is_not_available() -> None:
    profile = BENCH

    def read(index: int, subindex: int) -> int | None:
        return 1  # of 6502: profile position only

    found = {c.name: c for c in assess(profile, lambda i, s: None, read)}
    assert found["profile position"].available
    assert not found["cyclic position"].available
    assert "0x00000001" in found["cyclic position"].reason


def test_a_profile_cannot_deny_what_it_offers() -> None:
    with pytest.raises(ValidationError, match="trace buffer"):
        CanopenProfile.model_validate({**BENCH.model_dump(), "cannot": {"trace buffer": "it is said not to"}})


def test_the_places_of_all_objects_are_told() -> None:
    places = dict(BENCH.refs())
    assert places["quantities.position.demand"] == ObjectRef(index=0x607A, subindex=0)
    assert places["trace.status.object"] == ObjectRef(index=0x2200, subindex=3)
    assert places["pdo[1].entries[3]"] == ObjectRef(index=0x60B2, subindex=0)
