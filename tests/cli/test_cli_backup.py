"""`schwung backup`, `restore` and `diff` against a bench drive."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_running import invoke

from schwung.commissioning.journal import read_backup
from schwung.fieldbus.eds import read_eds
from schwung.fieldbus.profile import load_canopen_profile
from schwung_sim.bench import Bench

EDS = load_canopen_profile("schwung-bench").eds_path
FOLLOWING, VELOCITY, GAIN = 0x6065 << 8, 0x6081 << 8, 0x2400 << 8 | 1


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    with Bench("two-mass", channel=f"backup-{request.node.name}", node_id=3) as running:
        yield running


def _bus(bench: Bench) -> list[str]:
    return ["-i", "stepped", "-c", bench.channel, "-n", "3"]


def _held(bench: Bench, key: int) -> int:
    return int(bench.servo.dictionary.values[key])


def _hold(bench: Bench, key: int, value: int) -> None:
    bench.servo.dictionary.values[key] = value


def test_a_backup_is_written_read_and_named_for_machines(
    capsys: pytest.CaptureFixture[str], bench: Bench
) -> None:
    code, out, err = invoke(capsys, "backup", "axis.dcf", *_bus(bench), "--json")
    assert code == 0
    told = json.loads(out)
    assert (told["file"], told["format"]) == ("axis.dcf", "dcf")
    assert told["parameters"] + len(told["left_out"]) == sum(
        1 for v in read_eds(EDS, 3).description.variables() if v.writable and v.readable
    )
    assert "left out" in err
    file = read_eds(Path("axis.dcf"), 3)
    configured = {
        (v.index, v.subindex): v.configured.raw for v in file.description.variables() if v.configured
    }
    assert configured[0x6065, 0] == _held(bench, FOLLOWING)
    assert file.description.device_info["ProductName"] == "Schwung bench drive"
    assert file.description.node_id == 3


def test_the_name_is_by_drive_and_time_and_no_file_is_overwritten(
    capsys: pytest.CaptureFixture[str], bench: Bench, tmp_path: Path
) -> None:
    assert invoke(capsys, "backup", *_bus(bench))[0] == 0
    (made,) = tmp_path.glob("schwung-bench-node3-*.dcf")
    before = made.read_bytes()
    code, _, err = invoke(capsys, "backup", str(made), *_bus(bench))
    assert (code, made.read_bytes()) == (2, before)
    assert "--force" in err
    assert invoke(capsys, "backup", str(made), "--force", *_bus(bench))[0] == 0
    assert invoke(capsys, "backup", "nowhere/x.dcf", *_bus(bench))[0] == 2


@pytest.mark.parametrize("name", ["axis.dcf", "axis.bin", "axis.backup.json"])
def test_a_changed_drive_differs_and_is_brought_back(
    capsys: pytest.CaptureFixture[str], bench: Bench, name: str
) -> None:
    flags = ["--concise"] if name.endswith(".bin") else []
    assert invoke(capsys, "backup", name, *flags, *_bus(bench))[0] == 0
    before = {key: _held(bench, key) for key in (FOLLOWING, VELOCITY, GAIN)}
    assert invoke(capsys, "diff", name, "drive", *_bus(bench))[0] == 0
    for key, value in before.items():
        _hold(bench, key, value + 1000)
    code, out, _ = invoke(capsys, "diff", name, "drive", *_bus(bench), "--json")
    assert code == 1
    found = {(d["index"], d["subindex"]): d for d in json.loads(out)["different"]}
    assert found.keys() == {("0x6065", 0), ("0x6081", 0), ("0x2400", 1)}
    assert found["0x6065", 0]["b"] == found["0x6065", 0]["a"] + 1000
    assert found["0x6065", 0]["unit"] == "rad"
    assert found["0x2400", 1]["a_si"] == pytest.approx(before[GAIN] / 1000)
    assert invoke(capsys, "restore", name, *_bus(bench), "--yes")[0] == 0
    assert {key: _held(bench, key) for key in before} == before


def test_a_dry_run_shows_and_writes_nothing(
    capsys: pytest.CaptureFixture[str], bench: Bench, tmp_path: Path
) -> None:
    invoke(capsys, "backup", "axis.dcf", *_bus(bench))
    _hold(bench, FOLLOWING, 5)
    code, out, err = invoke(capsys, "restore", "axis.dcf", *_bus(bench), "--dry-run", "--json")
    assert code == 0
    assert json.loads(out)["written"] == 0
    assert [change["new"] for change in json.loads(out)["changes"]] == ["100000"]
    assert "Following error window" in err
    assert _held(bench, FOLLOWING) == 5
    assert [path.name for path in tmp_path.iterdir()] == ["axis.dcf"]


def test_a_dry_run_of_a_backup_file_writes_nothing_either(
    capsys: pytest.CaptureFixture[str], bench: Bench
) -> None:
    invoke(capsys, "backup", "axis.backup.json", *_bus(bench))
    _hold(bench, FOLLOWING, 5)
    code, out, _ = invoke(capsys, "restore", "axis.backup.json", *_bus(bench), "--dry-run", "--json")
    assert code == 0
    assert json.loads(out)["would_restore"] > 100
    assert _held(bench, FOLLOWING) == 5
    assert read_backup(Path("axis.backup.json")).restored is None


def test_a_restore_keeps_the_way_back_and_says_no_without_a_yes(
    capsys: pytest.CaptureFixture[str], bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    invoke(capsys, "backup", "axis.dcf", *_bus(bench))
    _hold(bench, FOLLOWING, 5)
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    assert invoke(capsys, "restore", "axis.dcf", *_bus(bench), "--out", "back")[0] == 3
    assert _held(bench, FOLLOWING) == 5
    assert invoke(capsys, "restore", "axis.dcf", *_bus(bench), "--out", "back", "-y", "--store")[0] == 0
    assert _held(bench, FOLLOWING) == 100000
    backup = read_backup(Path("back/restore.backup.json"))
    assert [(c.old, c.new) for c in backup.changes] == [(5, 100000)]
    assert backup.stored
    assert invoke(capsys, "restore", "back/restore.backup.json", *_bus(bench))[0] == 0
    assert _held(bench, FOLLOWING) == 5


def test_values_that_the_drive_refuses_are_named_and_the_rest_is_written(
    capsys: pytest.CaptureFixture[str], bench: Bench
) -> None:
    invoke(capsys, "backup", "axis.dcf", *_bus(bench))
    text = Path("axis.dcf").read_text("utf-8")
    at = text.index("ParameterValue=", text.index("[6060]"))
    bad = (
        text[:at] + "ParameterValue=99" + text[text.index("\n", at) :]
    )  # a mode that the drive does not have
    Path("bad.dcf").write_text(bad, "utf-8")
    _hold(bench, FOLLOWING, 5)
    code, out, _ = invoke(capsys, "restore", "bad.dcf", *_bus(bench), "-y", "--out", "back", "--json")
    assert code == 4
    told = json.loads(out)
    assert "0x6060:00" in told["error"]
    assert "back/restore.backup.json" in told["error"]
    assert [entry["parameter"] for entry in told["refused"]] == ["0x6060:00 Modes of operation"]
    assert told["written"] == 1
    assert _held(bench, FOLLOWING) == 100000


def test_the_dcf_of_another_node_is_refused(capsys: pytest.CaptureFixture[str], bench: Bench) -> None:
    invoke(capsys, "backup", "axis.dcf", *_bus(bench))
    Path("moved.dcf").write_text(
        Path("axis.dcf").read_text("utf-8").replace("NodeID=3", "NodeID=4"), encoding="utf-8"
    )
    _hold(bench, FOLLOWING, 5)
    code, _, err = invoke(capsys, "restore", "moved.dcf", *_bus(bench), "-y")
    assert code == 3
    assert "node 4" in err
    assert _held(bench, FOLLOWING) == 5


def test_files_are_compared_without_a_drive(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    changed = tmp_path / "other.eds"
    changed.write_text(EDS.read_text().replace("DefaultValue=100000", "DefaultValue=262144", 1))
    assert invoke(capsys, "diff", str(EDS), str(EDS))[0] == 0
    code, out, _ = invoke(capsys, "diff", str(EDS), str(changed), "--all")
    assert code == 1
    assert "262144" in out
    assert "1 differ" in out
    for wrong in (["drive", "drive"], ["none.dcf", str(EDS)], [str(EDS), __file__]):
        assert invoke(capsys, "diff", *wrong)[0] == 2


def test_what_a_dcf_keeps_beyond_the_profiles_eds_is_compared_and_put_back(
    capsys: pytest.CaptureFixture[str], bench: Bench, tmp_path: Path
) -> None:
    family = tmp_path / "family"
    family.mkdir()
    text = EDS.read_text()
    at = text.index("[6085]")
    (family / "small.eds").write_text(text[:at] + text[text.index("[6086]") :])
    (family / "profile.toml").write_text('version = 1\nextends = "schwung-bench"\neds = "small.eds"\n')
    known = [*_bus(bench), "--profile", str(family / "profile.toml")]
    invoke(capsys, "backup", "axis.dcf", "--eds", str(EDS), *known)
    invoke(capsys, "backup", "axis.bin", "--concise", "--eds", str(EDS), *known)
    before = _held(bench, 0x6085 << 8)
    _hold(bench, 0x6085 << 8, before + 1)
    assert invoke(capsys, "diff", "axis.dcf", "drive", *known)[0] == 1
    code, out, _ = invoke(capsys, "restore", "axis.bin", *known, "-y")
    assert code == 0
    assert "not in the EDS (small.eds); give the vendor's with --eds" in " ".join(out.split())
    assert _held(bench, 0x6085 << 8) == before + 1
    assert invoke(capsys, "restore", "axis.dcf", *known, "-y", "--out", "back")[0] == 0
    assert _held(bench, 0x6085 << 8) == before


def test_the_eds_of_another_manufacturer_is_refused(capsys: pytest.CaptureFixture[str], bench: Bench) -> None:
    foreign = load_canopen_profile("elmo-gold").eds_path
    invoke(capsys, "backup", "axis.bin", "--concise", *_bus(bench))
    for command in (
        ["backup", "other.dcf"], ["diff", "axis.bin", "drive"], ["restore", "axis.bin", "-y", "--out", "back"],
    ):  # fmt: skip
        code, _, err = invoke(capsys, *command, "--eds", str(foreign), *_bus(bench))
        assert code == 2
        assert "is of vendor 0x0000009A, and node 3 of 0x53574E47" in err
    assert not Path("other.dcf").exists()


def test_a_drive_that_somebody_else_has_switched_on_is_left_alone(
    capsys: pytest.CaptureFixture[str], bench: Bench
) -> None:
    invoke(capsys, "backup", "axis.dcf", *_bus(bench))
    _hold(bench, FOLLOWING, 5)
    off = bench.servo.dictionary.readers.get(0x6041 << 8)
    bench.servo.dictionary.readers[0x6041 << 8] = lambda: 0x0637
    code, _, err = invoke(capsys, "restore", "axis.dcf", *_bus(bench), "-y", "--out", "back")
    assert (code, _held(bench, FOLLOWING)) == (3, 5)
    assert "the power stage is on (Operation enabled)" in err
    assert not Path("back").exists()
    assert off is not None
    bench.servo.dictionary.readers[0x6041 << 8] = off
    assert invoke(capsys, "restore", "axis.dcf", *_bus(bench), "-y", "--out", "back")[0] == 0
    assert _held(bench, FOLLOWING) == 100000


def test_what_has_nothing_in_common_is_not_equal(
    capsys: pytest.CaptureFixture[str], bench: Bench, tmp_path: Path
) -> None:
    other = tmp_path / "other.dcf"
    other.write_text("[3000]\nParameterName=x\nDataType=7\nAccessType=rw\nParameterValue=1\n")
    for pair in ([str(other), str(EDS)], [str(other), "drive", *_bus(bench)]):
        code, _, err = invoke(capsys, "diff", *pair)
        assert code == 2
        assert "no parameter in common" in err


def test_no_way_back_is_promised_where_nothing_was_written(
    capsys: pytest.CaptureFixture[str], bench: Bench
) -> None:
    """The drive answers the comparison, and not when the old values are kept."""
    invoke(capsys, "backup", "axis.dcf", *_bus(bench))
    _hold(bench, FOLLOWING, 5)

    def once() -> int:
        bench.servo.dictionary.entries.pop(FOLLOWING)
        return 5

    bench.servo.dictionary.readers[FOLLOWING] = once
    code, _, err = invoke(capsys, "restore", "axis.dcf", *_bus(bench), "-y", "--out", "back")
    assert code == 4
    assert "nothing was written" in err
    assert "can be put back" not in err
    assert _held(bench, FOLLOWING) == 5
