"""The families that come with Schwung: sourced fact by fact, borne out by their dictionaries, honest about gaps."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from vendors_files import VENDORS_FILE, vendors_file

from schwung.fieldbus.eds import read_eds
from schwung.fieldbus.profile import CAPABILITIES, CanopenProfile, list_profiles, load_canopen_profile
from schwung.fieldbus.profile.check import check_profile, unsourced
from schwung.fieldbus.units import read_scales

CANOPEN = [profile for profile in list_profiles() if isinstance(profile, CanopenProfile)]


def named(profile: CanopenProfile) -> str:
    return profile.family


def test_all_families_are_there() -> None:
    assert {*VENDORS_FILE, "generic-cia402", "schwung-bench"} <= {profile.family for profile in CANOPEN}


@pytest.mark.parametrize("profile", CANOPEN, ids=named)
def test_a_family_is_borne_out_by_its_own_dictionary(profile: CanopenProfile) -> None:
    eds = read_eds(profile.eds_path, 5)
    # a type that is not the standard's is the drive's own: a fact, and told as such
    assert [str(w) for w in eds.warnings if "by the standard" not in w.problem] == []
    assert check_profile(profile, eds) == ()


@pytest.mark.parametrize("family", VENDORS_FILE)
def test_a_family_is_borne_out_by_the_manufacturers_file(family: str) -> None:
    path = vendors_file(family)
    assert check_profile(load_canopen_profile(family), read_eds(path, 5)) == ()


@pytest.mark.parametrize("family", VENDORS_FILE)
def test_our_dictionary_says_what_the_manufacturers_says(family: str) -> None:
    """Every type, access and mapping of ours is a fact of theirs."""
    theirs, ours = read_eds(vendors_file(family), 5), read_eds(load_canopen_profile(family).eds_path, 5)
    for variable in ours.description.variables():
        if variable.subindex == 0 and variable.type == "UNSIGNED8":
            continue  # a count: of ours, which holds fewer
        told = theirs.variable(variable.index, variable.subindex)
        assert told is not None, f"{variable.index:04X}:{variable.subindex:02X}"
        same = ("type", "access", "mappable")
        assert [getattr(variable, key) for key in same] == [getattr(told, key) for key in same], variable


@pytest.mark.parametrize("profile", CANOPEN, ids=named)
def test_every_fact_has_a_source_and_nothing_is_hardware(profile: CanopenProfile) -> None:
    assert unsourced(profile) == []
    assert profile.verified == "bench"


@pytest.mark.parametrize("profile", CANOPEN, ids=named)
def test_what_is_not_offered_has_a_reason_that_reads_on(profile: CanopenProfile) -> None:
    for name in CAPABILITIES:
        if not profile.offers(name):
            reason = profile.reason(name)
            assert reason.startswith("this profile can't do that, because ")
            told = reason.removeprefix("this profile can't do that, because ")
            assert re.match(r"[a-z0-9]", told), told  # the sentence goes on
            assert not told.endswith("."), told
            assert "says nothing" not in told


def test_each_family_has_its_own_words_only() -> None:
    """No name is taken over from a manufacturer's file, unless it is the standard's."""
    standard = {
        variable.name.lower()
        for family in ("generic-cia402", "schwung-bench")
        for variable in read_eds(load_canopen_profile(family).eds_path, 5).description.variables()
    }
    for family in VENDORS_FILE:
        theirs = {
            v.name.lower()
            for v in read_eds(vendors_file(family), 5).description.variables()
            if _vendors(v.index)
        }
        ours = {
            v.name.lower()
            for v in read_eds(load_canopen_profile(family).eds_path, 5).description.variables()
            if _vendors(v.index)
        }
        copied = {name for name in ours & theirs - standard if len(name.split()) > 3}
        assert copied == set(), family


def _vendors(index: int) -> bool:
    return 0x2000 <= index < 0x6000


def test_epos4_tells_its_units_as_its_own_file_has_them() -> None:
    """The numbers of the DCF: 3200 increments a turn, rpm, 512871 µN·m."""
    objects = {(0x3000, 5): 3200, (0x60A9, 0): 0x00B44700, (0x60AA, 0): 0x00C00300, (0x6076, 0): 512871}
    scales = read_scales(load_canopen_profile("maxon-epos4"), lambda i, s: objects.get((i, s)))
    assert scales.position_rad == pytest.approx(2 * math.pi / 3200)
    assert scales.speed_rad_s == pytest.approx(2 * math.pi / 60)
    assert scales.acceleration_rad_s2 == pytest.approx(2 * math.pi / 60)
    assert scales.rated_torque_nm == pytest.approx(0.512871)
    assert scales.torque_nm == pytest.approx(0.512871e-3)
    assert scales.rated_torque_nm == pytest.approx(4.760 * 0.107746, rel=1e-4)  # 3001:01 times 3001:05


def test_drives_that_cannot_tell_a_unit_leave_it_open() -> None:
    """No rated torque, no unit: NaN, and the hint says what is needed."""
    profile = load_canopen_profile("schunk-erb")
    scales = read_scales(profile, lambda i, s: None)
    assert math.isnan(scales.torque_nm)
    assert math.isnan(scales.torque_added_nm)
    assert scales.position_rad == pytest.approx(math.radians(1e-3))
    assert "scale = N·m at the output" in profile.reason("torque")
    assert "scale = N·m at the output" in profile.reason("torque injection")


def test_a_drive_with_fixed_pdos_moves_in_no_mode() -> None:
    profile = load_canopen_profile("faulhaber-cc")
    assert profile.modes == {}
    assert not profile.offers("sampling by SYNC")
    assert all(pdo.fixed for pdo in profile.pdo)


def test_a_site_gives_what_the_family_cannot_know(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    file.write_text(
        'extends = "schunk-erb"\nname = "Arm, joint 3"\n'
        '[quantities.torque]\nunit = "literal"\nscale = 0.0124\n'
        '[quantities.torque_added]\nunit = "literal"\nscale = 0.0124\n',
        encoding="utf-8",
    )
    profile = load_canopen_profile(file)
    assert (profile.name, profile.family) == ("Arm, joint 3", "schunk-erb")
    assert profile.offers("torque injection")
    assert profile.eds_path == load_canopen_profile("schunk-erb").eds_path
    scales = read_scales(profile, lambda i, s: None)
    assert (scales.torque_nm, scales.torque_added_nm) == (0.0124, 0.0124)
    assert str(profile.quantities.torque and profile.quantities.torque.object) == "6077:00"
