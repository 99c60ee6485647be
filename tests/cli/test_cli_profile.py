"""`schwung profile` as people and scripts use it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_running import invoke

from schwung.fieldbus.profile import CAPABILITIES, load_canopen_profile, load_profile

GENERIC_EDS = load_canopen_profile("generic-cia402").eds_path


def test_list_names_every_family(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "profile", "list")
    assert code == 0
    assert "maxon-epos4" in out
    code, out, _ = invoke(capsys, "profile", "list", "--json")
    listed = {entry["family"]: entry for entry in json.loads(out)["profiles"]}
    assert listed["schwung-bench"]["protocol"] == "canopen"
    assert all(entry["verified"] == "bench" for entry in listed.values())


def test_show_says_what_it_cannot_do_and_where_facts_are_from(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "profile", "show", "trinamic-tmcm1636")
    assert code == 0
    flat = " ".join(out.split())
    assert "this profile can't do that, because" in flat
    assert "PyTrinamic" in flat
    code, out, _ = invoke(capsys, "profile", "show", "trinamic-tmcm1636", "--json")
    document = json.loads(out)
    told = {entry["name"]: entry for entry in document["capabilities"]}
    assert list(told) == list(CAPABILITIES)
    assert not told["torque injection"]["offered"]
    assert "60B2" in told["torque injection"]["reason"]
    assert told["cyclic position"] == {"name": "cyclic position", "offered": True, "reason": ""}


def test_check_is_silent_where_all_fits(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "profile", "check", "schwung-bench")
    assert code == 0
    assert "nothing to mend" in out


def test_check_against_a_foreign_eds_fails_with_places(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("profile", "check", "maxon-epos4", "--eds", str(GENERIC_EDS))
    code, out, err = invoke(capsys, *arguments)
    assert code == 2
    assert "quantities.position.resolution" in out
    assert "do not hold" in err
    code, out, _ = invoke(capsys, *arguments, "--json")
    document = json.loads(out)
    assert code == document["exit_code"] == 2
    assert {"severity", "place", "problem", "remedy"} == set(document["findings"][0])


def test_check_of_a_modbus_family_needs_no_eds(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, _ = invoke(capsys, "profile", "check", "schwung-bench-modbus")
    assert code == 0
    code, _, err = invoke(capsys, "profile", "check", "schwung-bench-modbus", "--eds", str(GENERIC_EDS))
    assert code == 2
    assert "has no EDS" in err


def test_new_writes_a_profile_that_checks(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    target = tmp_path / "my-drive" / "profile.toml"
    code, out, _ = invoke(
        capsys, "profile", "new", "--eds", str(GENERIC_EDS), "-o", str(target), "--family", "my-drive"
    )
    assert code == 0
    assert "trace buffer: its EDS names no recorder" in " ".join(out.split())
    assert "6076 is taken to be in mN·m" in " ".join(out.split())
    assert load_profile(target).family == "my-drive"
    assert invoke(capsys, "profile", "check", str(target))[0] == 0
    code, _, err = invoke(capsys, "profile", "new", "--eds", str(GENERIC_EDS), "-o", str(target))
    assert code == 2
    assert "exists already" in err


def test_new_prints_where_no_file_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "profile", "new", "--eds", str(GENERIC_EDS))
    assert code == 0
    assert "[quantities.position]" in out
    code, out, _ = invoke(capsys, "profile", "new", "--eds", str(GENERIC_EDS), "--json")
    document = json.loads(out)
    assert document["file"] is None
    assert "[quantities.position]" in document["profile"]
    assert document["missing"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("show", "no-such-family"), "neither a known family nor a file"),
        (("new", "--eds", "no-such.eds"), "cannot be read"),
        (("new", "--eds", str(GENERIC_EDS), "--family", "My drive"), 'Write "my-drive"'),
        (("check", "schwung-bench", "--eds", "no-such.eds"), "cannot be read"),
        (("new", "--eds", str(GENERIC_EDS), "-o", f"{GENERIC_EDS}/x/profile.toml"), "cannot be made"),
        ((), "Missing command"),
    ],
)
def test_slips_are_told_in_one_sentence(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], told: str
) -> None:
    code, _, err = invoke(capsys, "profile", *arguments)
    assert code == 2
    assert told in err
    assert "Traceback" not in err


def test_check_shows_what_is_odd_in_the_eds(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    odd = tmp_path / "odd.eds"
    odd.write_text(GENERIC_EDS.read_text().replace("[6065]\n", "[6065]\nLowLimit=rubbish\n"))
    line = odd.read_text().splitlines().index("LowLimit=rubbish") + 1
    arguments = ("profile", "check", "generic-cia402", "--eds", str(odd))
    code, out, _ = invoke(capsys, *arguments)
    assert code == 0
    assert f"line {line} " in out
    assert "rubbish" in out
    code, out, _ = invoke(capsys, *arguments, "--json")
    (warning,) = json.loads(out)["eds_warnings"]
    assert (code, warning["line"], warning["section"]) == (0, line, "6065")
    assert warning["remedy"]
    code, out, _ = invoke(capsys, "profile", "check", "generic-cia402", "--json")
    assert json.loads(out)["eds_warnings"] == []


@pytest.mark.parametrize("name", ["na\udcffme.eds", "two\nlines.eds"])
def test_a_file_name_that_toml_cannot_hold_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str
) -> None:
    odd = tmp_path / name
    odd.write_bytes(GENERIC_EDS.read_bytes())
    code, _, err = invoke(capsys, "profile", "new", "--eds", str(odd), "-o", str(tmp_path / "o" / "p.toml"))
    assert code == 2
    assert "no profile can hold" in err
    assert not (tmp_path / "o").exists()


def test_what_looks_like_markup_is_shown_as_it_is(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    odd = tmp_path / "[x].eds"
    odd.write_text(GENERIC_EDS.read_text().replace("ProductName=", "ProductName=[/x] "))
    target = tmp_path / "[b]" / "profile.toml"
    code, out, _ = invoke(capsys, "profile", "new", "--eds", str(odd), "-o", str(target), "--family", "odd")
    assert code == 0
    assert "[b]" in out
    code, out, _ = invoke(capsys, "profile", "show", str(target))
    assert code == 0
    assert "[/x]" in out
    code, out, _ = invoke(capsys, "profile", "check", str(target))
    assert code == 0
    assert "[x].eds" in "".join(out.split())


def test_check_says_which_units_are_left_to_the_reader(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "profile", "check", "schunk-erb")
    assert code == 0
    assert "quantities.torque" in out
    code, out, _ = invoke(capsys, "profile", "check", "schunk-erb", "--json")
    left = json.loads(out)["left_to_you"]
    assert left.keys() == {"quantities.torque", "quantities.torque_added"}
    assert "N·m" in left["quantities.torque"]
    code, out, _ = invoke(capsys, "profile", "check", "schwung-bench", "--json")
    assert json.loads(out)["left_to_you"] == {}
