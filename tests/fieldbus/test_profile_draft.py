"""`draft_profile`: any EDS makes a profile that loads, fits that EDS, and says what it could not find."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from vendors_files import VENDORS_FILE, vendors_file

from schwung.fieldbus.eds import read_eds
from schwung.fieldbus.profile import CanopenProfile, list_profiles, load_canopen_profile
from schwung.fieldbus.profile.check import check_profile
from schwung.fieldbus.profile.draft import Draft, draft_profile

OWN = [profile.eds_path for profile in list_profiles() if isinstance(profile, CanopenProfile)]


def drafted(path: Path, folder: Path) -> tuple[Draft, CanopenProfile]:
    draft = draft_profile(read_eds(path, 5), folder)
    (folder / "profile.toml").write_text(draft.text, encoding="utf-8")
    return draft, load_canopen_profile(folder / "profile.toml")


@pytest.mark.parametrize("path", OWN, ids=lambda path: path.stem)
def test_a_draft_loads_and_fits_its_own_eds(path: Path, tmp_path: Path) -> None:
    draft, profile = drafted(path, tmp_path)
    assert profile.eds_path.resolve() == path.resolve()
    assert check_profile(profile, read_eds(path, 5)) == ()
    assert draft.missing  # no EDS tells all


@pytest.mark.parametrize("family", VENDORS_FILE)
def test_a_manufacturers_file_makes_a_draft_that_fits(family: str, tmp_path: Path) -> None:
    path = vendors_file(family)
    _, profile = drafted(path, tmp_path)
    assert check_profile(profile, read_eds(path, 5)) == ()


def test_the_draft_finds_what_the_standard_has(tmp_path: Path) -> None:
    draft, profile = drafted(load_canopen_profile("generic-cia402").eds_path, tmp_path)
    hand = load_canopen_profile("generic-cia402")
    assert profile.quantities.model_dump() == hand.quantities.model_dump()
    assert [pdo.entries for pdo in profile.pdo] == [pdo.entries for pdo in hand.pdo]
    assert profile.modes == {"csp": 8, "pp": 1}
    assert any(sentence.startswith("identity: the EDS tells no vendor") for sentence in draft.missing)


def test_the_draft_says_what_cannot_be_mapped(tmp_path: Path) -> None:
    draft, profile = drafted(load_canopen_profile("trinamic-tmcm1636").eds_path, tmp_path)
    assert profile.quantities.torque_added is None
    assert "torque injection: its torque offset (60B2) cannot be mapped into a PDO" in draft.missing
    assert "60B2" in profile.reason("torque injection")


def test_fixed_pdos_are_written_down_as_they_are(tmp_path: Path) -> None:
    _, profile = drafted(load_canopen_profile("faulhaber-cc").eds_path, tmp_path)
    assert profile.modes == {}
    assert [(pdo.direction, pdo.fixed, list(map(str, pdo.entries))) for pdo in profile.pdo] == [
        ("rpdo", True, ["6040:00"]),
        ("tpdo", True, ["6041:00"]),
    ]


def test_names_that_promise_something_are_noted_and_not_used(tmp_path: Path) -> None:
    _, profile = drafted(load_canopen_profile("maxon-epos4").eds_path, tmp_path)
    assert profile.trace is None
    noted = list(map(str, profile.noted["trace buffer"]))
    assert {"31E0:01", "31E4:01"} <= set(noted)
    assert profile.export.scalar is None
    assert "30A1:05" in map(str, profile.noted["scalar feed-forward"])


_BLOCKS = load_canopen_profile("generic-cia402").eds_path.read_text(encoding="utf-8").split("\n[")
#: Objects without which there is no CiA 402 drive, and nothing to draft around.
_LEAST = re.compile(r"6040|6041|6060|6061|6064|607A|1[468A]00")


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_an_eds_lacks_its_draft_loads_and_promises_nothing_more(
    data: st.DataObject, tmp_path: Path
) -> None:
    """Objects dropped, mappings and accesses changed at random: what is drafted is borne out, or it is the standard's
    least (a position, a statusword, a controlword) that is missing."""
    blocks = list(_BLOCKS)
    for number in data.draw(st.lists(st.integers(1, len(blocks) - 1), max_size=40)):
        if re.match(r"[0-9A-F]{4}", blocks[number]):
            old, new = data.draw(st.sampled_from(_CHANGES))
            blocks[number] = re.sub(old, new, blocks[number])
    path = tmp_path / "changed.eds"
    path.write_text("\n[".join(block for block in blocks if block), encoding="utf-8")
    _, profile = drafted(path, tmp_path)
    errors = [f for f in check_profile(profile, read_eds(path, 5)) if f.severity == "error"]
    assert all(_LEAST.search(f.problem) or f.place.startswith("quantities.position") for f in errors), [
        str(f) for f in errors
    ]


_CHANGES = [
    (r"(?s)^.*$", ""),
    ("PDOMapping=1", "PDOMapping=0"),
    ("AccessType=rw+", "AccessType=ro"),
    ("AccessType=ro", "AccessType=wo"),
    ("DataType=0x000[0-9]", "DataType=0x0008"),
]
