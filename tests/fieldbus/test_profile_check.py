"""`check_profile`: what an EDS does not bear out is named by its place in the profile, with a remedy."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from schwung.fieldbus.eds import read_eds
from schwung.fieldbus.profile import load_canopen_profile
from schwung.fieldbus.profile.check import Finding, check_profile

Spoil = Callable[[str, str], tuple[Finding, ...]]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return Path(shutil.copytree(load_canopen_profile("schwung-bench").folder, tmp_path / "drive"))


def findings(folder: Path) -> tuple[Finding, ...]:
    profile = load_canopen_profile(folder)
    return check_profile(profile, read_eds(profile.eds_path, 5))


def spoil_eds(folder: Path, section: str, key: str, value: str | None) -> None:
    """Set (or, with None, drop) a key of a section; key "" drops the section."""
    file = folder / "schwung-bench.eds"
    text = file.read_text(encoding="utf-8")
    pattern = rf"(?ms)^\[{section}\]\n.*?(?=^\[|\Z)"
    found = re.search(pattern, text)
    assert found, section
    body = found.group()
    if not key:
        new = ""
    else:
        assert f"\n{key}=" in body, (section, key)
        new = re.sub(rf"(?m)^{key}=.*$", "" if value is None else f"{key}={value}", body)
    file.write_text(text.replace(body, new), encoding="utf-8")


def spoil_profile(folder: Path, old: str, new: str) -> None:
    file = folder / "profile.toml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def test_a_profile_that_fits_has_nothing_to_mend(folder: Path) -> None:
    assert findings(folder) == ()


@pytest.mark.parametrize(
    ("section", "key", "value", "place", "told"),
    [
        ("6077", "", None, "quantities.torque.object", "6077:00 is not in the EDS"),
        ("2100sub2", "", None, "generator.frequency.object", "2100:02 is not in the EDS"),
        ("6064", "DataType", "0x0008", "quantities.position.object", "counts are wanted"),
        ("6064", "PDOMapping", "0", "pdo[2] (tpdo 1)", "cannot be mapped"),
        ("607A", "AccessType", "ro", "quantities.position.demand", "cannot be written"),
        ("2200sub3", "AccessType", "wo", "trace.status.object", "cannot be read"),
        ("6077", "DataType", "0x0004", "pdo[2] (tpdo 1)", "maps 10 bytes"),
        ("1A01sub0", "AccessType", "ro", "pdo[3] (tpdo 2)", "the mapping is fixed"),
        (
            "1018sub1",
            "DefaultValue",
            "7",
            "",
            "",
        ),  # what the drive says is asked of the drive, not of its EDS
        ("6502", "DefaultValue", "0x00000001", "modes.csp", "6502 of the EDS does not list it"),
    ],
)
def test_each_contradiction_is_found_at_its_place(
    folder: Path, section: str, key: str, value: str | None, place: str, told: str
) -> None:
    spoil_eds(folder, section, key, value)
    found = findings(folder)
    if not place:
        assert found == ()
        return
    matching = [f for f in found if f.place == place and told in f.problem]
    assert matching, [str(f) for f in found]
    assert matching[0].severity == "error"
    assert matching[0].remedy


def test_a_type_that_is_not_the_standards_is_a_warning(folder: Path) -> None:
    spoil_eds(folder, "606C", "DataType", "0x0007")
    (finding,) = findings(folder)
    assert (finding.severity, finding.place) == ("warning", "quantities.speed.object")
    assert "UNSIGNED32 in the EDS, INTEGER32 by the standard" in finding.problem


@pytest.mark.parametrize(
    ("old", "new", "place", "told"),
    [
        ("number = 2", "number = 9", "pdo[3] (tpdo 9)", "the drive has 4 tpdos"),
        ('object = "605A:00", value = 2', 'object = "605A:00", value = 99999', "stop.quick_stop_option", "is outside"),
        ("product_code = 0x00000402", "product_code = 3", "identity.product_code", "the EDS is of 0x00000402"),
        ('[export.host_played]                    # or the host plays the table at SYNC rate\nobject = "60B2:00"',
         '[export.host_played]\nobject = "60B1:00"', "export.host_played.object", "no rpdo carries 60B1:00"),
        ('trace = "sim', '# trace = "sim', "sources", "has no source"),
        ('"disturbance buffer" =', '# "disturbance buffer" =', 'cannot."disturbance buffer"', "is missing"),
        ("number = 1\nentries = [\"6040:00\"", "number = 1\nfixed = true\nentries = [\"6040:00\"",
         "pdo[1] (rpdo 1)", "mapped in 1600"),
    ],
)  # fmt: skip
def test_each_slip_of_the_profile_is_found(folder: Path, old: str, new: str, place: str, told: str) -> None:
    spoil_profile(folder, old, new)
    found = findings(folder)
    assert [f for f in found if f.place == place and told in f.problem], [str(f) for f in found]


def test_units_need_the_objects_that_tell_them(folder: Path) -> None:
    for section in ("608F", "608Fsub0", "608Fsub1", "608Fsub2", "60A9", "6076"):
        spoil_eds(folder, section, "", None)
    places = {f.place for f in findings(folder) if "needs what is not in the EDS" in f.problem}
    assert {"quantities.speed.unit", "quantities.torque.unit", "quantities.torque_added.unit"} <= places


def test_errors_come_before_warnings(folder: Path) -> None:
    spoil_eds(folder, "606C", "DataType", "0x0007")
    spoil_eds(folder, "6077", "", None)
    severities = [f.severity for f in findings(folder)]
    assert severities == sorted(severities)
    assert set(severities) == {"error", "warning"}
