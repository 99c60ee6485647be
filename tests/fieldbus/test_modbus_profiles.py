"""The Modbus families that come with Schwung: what the manuals say is in them, and what they do not say is not."""

import re
from pathlib import Path

import pytest

from schwung.errors import InputError
from schwung.fieldbus.profile import CAPABILITIES, ModbusProfile, list_profiles, load_profile

FAMILIES = [profile for profile in list_profiles() if isinstance(profile, ModbusProfile)]
VENDORS = [profile for profile in FAMILIES if not profile.family.startswith("schwung-bench")]


def modbus_family(name: str) -> ModbusProfile:
    profile = load_profile(name)
    assert isinstance(profile, ModbusProfile)
    return profile


def test_all_families_are_there() -> None:
    assert {p.family for p in FAMILIES} >= {
        "schwung-bench-modbus", "schneider-lexium-32", "kollmorgen-akd", "delta-asda-a2"
    }  # fmt: skip
    assert all(p.verified == "bench" for p in FAMILIES)


@pytest.mark.parametrize(
    ("family", "order", "registers", "transports", "silence_s"),
    [
        ("schneider-lexium-32", "high_first", 2, ("tcp",), 0.0),
        ("kollmorgen-akd", "high_first", 2, ("tcp",), 0.0),
        ("delta-asda-a2", "low_first", 2, ("rtu",), 0.010),
    ],
)
def test_how_the_families_speak(
    family: str, order: str, registers: int, transports: tuple[str, ...], silence_s: float
) -> None:
    modbus = modbus_family(family).modbus
    assert modbus.word_order == order
    assert modbus.registers_per_parameter == registers
    assert modbus.transports == transports
    assert modbus.silence_s == silence_s
    assert {"modbus.word_order", "modbus.registers_per_parameter"} <= set(modbus_family(family).sources)


@pytest.mark.parametrize("profile", VENDORS, ids=lambda p: p.family)
def test_every_register_has_a_source(profile: ModbusProfile) -> None:
    named = profile.sources
    for place, ref in profile.refs():
        if place.startswith("noted"):
            continue
        steps = place.split(".")
        parents = {".".join(steps[:n]) for n in range(1, len(steps) + 1)}
        twins = {p for p, other in profile.refs() if other.index == ref.index}
        covered = parents | {".".join(t.split(".")[:n]) for t in twins for n in range(1, 4)}
        assert covered & set(named), f"{place} ({ref}) has no source"


@pytest.mark.parametrize("profile", FAMILIES, ids=lambda p: p.family)
def test_what_a_family_does_not_offer_it_says_why(profile: ModbusProfile) -> None:
    for capability in CAPABILITIES:
        if not profile.offers(capability):
            said = profile.reason(capability)
            assert said.startswith("this profile can't do that, because ")
            assert "it says nothing of it" not in said, capability


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("[modes]\npp = 1\n", "pp needs state, strokes"),
        ('[quantities.speed]\nobject = "@200:INTEGER16"\nunit = "literal"\nscale = 1.0\n', "INTEGER16 here"),
        ('[quantities.speed]\nobject = "606C:00"\nunit = "literal"\nscale = 1.0\n', "is an object"),
        ('[quantities.speed]\nobject = "@202"\nunit = "literal"\nscale = 1.0\n', "needs a type"),
        ('[quantities.speed]\nobject = "@202:INTEGER32"\nunit = "si_unit_velocity"\n', "of CANopen"),
    ],
)
def test_a_profile_that_contradicts_itself_is_refused(wrong: str, words: str, tmp_path: Path) -> None:

    file = tmp_path / "profile.toml"
    file.write_text(
        'version = 1\nprotocol = "modbus"\nfamily = "x"\nname = "x"\nverified = "bench"\n'
        '[modbus]\nword_order = "high_first"\n'
        '[quantities.position]\nobject = "@200:INTEGER32"\nunit = "literal"\nscale = 1.0\n' + wrong
    )
    with pytest.raises(InputError, match=re.escape(words)):
        load_profile(file)
