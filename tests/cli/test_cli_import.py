"""`schwung import`: the session file, what is said about it, and nothing half-written after a mistake."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from cli_running import invoke

from schwung.motion import Motion
from schwung.session import read_session


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Three times there and back, in degrees, with decimal commas."""
    motion = Motion(distance_rad=90.0, duration_s=0.4, start_time_s=0.2, dwell_s=0.2)
    once = motion.demand(motion.time(1000.0)).position_rad
    angle = np.tile(once, 3)
    time = np.arange(angle.size) / 1000
    torque = np.gradient(np.gradient(angle))
    rows = (f"{t:.3f};{q:.6f};{u:.6g}".replace(".", ",") for t, q, u in zip(time, angle, torque, strict=True))
    path = tmp_path / "drive.csv"
    path.write_text("t;q [deg];u\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_a_recording_becomes_a_session_with_its_repeats(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, recording: Path
) -> None:
    out = tmp_path / "s.h5"
    code, text, _ = invoke(
        capsys, "import", str(recording), "-o", str(out), "--position", "q", "--torque", "u", "--time", "t"
    )
    assert code == 0
    assert "position is taken in deg, as the file says" in text
    assert "runs 0, 1, 2 repeat one motion" in text
    session = read_session(out)
    assert [run.repeat for run in session.runs] == [0, 1, 2]
    assert session.runs[0].position_rad.max() == pytest.approx(np.pi / 2, abs=1e-6)
    assert "drive.csv" in session.source


def test_json_holds_the_runs_and_the_notes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, recording: Path
) -> None:
    out = tmp_path / "s.h5"
    code, text, _ = invoke(
        capsys, "import", str(recording), "-o", str(out), "--position", "1", "--torque", "2", "--json",
        "--split", "none",
    )  # fmt: skip
    document = json.loads(text)
    assert code == 0
    assert document["axis"] == "rotary"
    assert [run["samples"] for run in document["runs"]] == [len(read_session(out).runs[0])]
    assert any("not measured" in note for note in document["notes"])


def test_a_recipe_is_completed_and_overruled_by_options(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, recording: Path
) -> None:
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(
        'files = ["drive.csv"]\nposition = "q"\ntorque = "u"\ntorque_scale = 2.0\nsplit = "none"\n'
    )
    out = tmp_path / "s.h5"
    code, _, _ = invoke(capsys, "import", "--recipe", str(recipe), "-o", str(out), "--torque-scale", "-3")
    assert code == 0
    run = read_session(out).runs[0]
    assert run.torque_nm.max() == pytest.approx(3 * 90 * 4.5 / 400**2, rel=0.01)  # a third profile: 4.5 Δ/t²
    code, _, error = invoke(capsys, "import", "--recipe", str(recipe), "-o", str(out))
    assert (code, "exists already" in error) == (2, True)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--position", "q"], "torque: is missing. Say which column it is: --torque NAME"),
        (["--position", "q", "--torque", "w"], "--torque w: there is no such column"),
        (["--position", "q", "--torque", "u", "--excitation", "50"], "Write FREQUENCY,AMPLITUDE"),
        (["--position", "q", "--torque", "u", "--rate", "500", "--time", "t"], "add --resample"),
        (["--position", "q", "--torque", "u", "--axis", "round"], "axis: is 'round'"),
        (["--recipe", "none.toml"], "none.toml: cannot be read"),
    ],
)
def test_mistakes_are_one_sentence_and_leave_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, recording: Path, arguments: list[str], words: str
) -> None:
    out = tmp_path / "s.h5"
    code, _, error = invoke(capsys, "import", str(recording), "-o", str(out), *arguments)
    assert code == 2
    assert words in error
    assert len(error.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["drive.csv"]


def test_help_has_examples(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "import", "--help")
    assert code == 0
    assert "Examples" in out
    assert "data[:,2]" in out


def test_a_guess_writes_nothing_but_the_picture_until_it_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, recording: Path
) -> None:
    out = tmp_path / "s.h5"
    code, text, _ = invoke(capsys, "import", str(recording), "-o", str(out), "--guess", "--json")
    assert code == 0
    assert not out.exists()
    assert (tmp_path / "s-guess.png").read_bytes().startswith(b"\x89PNG")
    told = json.loads(text)
    command = shlex.split(told["proposals"][0]["command"])
    assert command[:2] == ["schwung", "import"]
    assert invoke(capsys, *command[1:])[0] == 0
    first = read_session(out)
    assert (
        invoke(capsys, "import", str(recording), "-o", str(tmp_path / "again.h5"), "--guess", "--yes")[0] == 0
    )
    again = read_session(tmp_path / "again.h5")
    assert len(first.runs) == len(again.runs) == 3
    np.testing.assert_array_equal(first.runs[0].position_rad, again.runs[0].position_rad)


def test_each_joint_becomes_a_session(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    motion = Motion(distance_rad=1.0, duration_s=0.4, start_time_s=0.2, dwell_s=0.2)
    angle = np.tile(motion.demand(motion.time(1000.0)).position_rad, 2)
    rows = [f"{k / 1000},{q},{2 * q},{3 * q},{4 * q}" for k, q in enumerate(angle)]
    path = tmp_path / "robot.csv"
    path.write_text("t,q1,tau1,q2,tau2\n" + "\n".join(rows) + "\n")
    columns = ("--position", "q{joint}", "--torque", "tau{joint}")
    out = str(tmp_path / "s.h5")
    assert invoke(capsys, "import", str(path), *columns, "--joint", "1,2", "-o", out)[0] == 0
    assert read_session(tmp_path / "s-2.h5").runs[0].position_rad.max() == pytest.approx(3.0, rel=1e-6)
    code, _, error = invoke(
        capsys, "import", str(path), "--position", "q1", "--torque", "tau1", "--joint", "1"
    )
    assert (code, "stands for nothing" in error) == (2, True)
    code, _, error = invoke(
        capsys, "import", str(path), *columns, "--joint", "7", "-o", str(tmp_path / "x.h5")
    )
    assert (code, "no such column" in error) == (2, True)
