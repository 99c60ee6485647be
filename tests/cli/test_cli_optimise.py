"""`schwung optimise` as typed: files, JSON, and one sentence for what cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_running import RIGID_MACHINE, invoke

from schwung.drivetrain import load_machine, paper_machine, write_machine


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    write_machine(paper_machine(), tmp_path / "machine.toml")
    return tmp_path / "machine.toml"


def test_it_writes_what_can_be_taken_away_and_says_what_is_saved(
    machine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "best"
    code, text, _ = invoke(
        capsys, "optimise", "-m", str(machine), "--distance", "180deg", "--duration", "120ms", "--no-rivals",
        "--out", str(out), "--json",
    )  # fmt: skip
    document = json.loads(text)
    assert code == 0
    assert document["copper_saving"] > 0.4
    assert document["motions"][0]["breaks"] == []
    for name in ("motion.json", "setpoints.csv", "twincat_cam.st", "codesys_cam.st", "pvt.csv", "motion.png"):
        assert (out / name).stat().st_size > 100
    assert json.loads((out / "optimised.json").read_text()) == document


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--distance", "180deg"), "--duration: is given beside --fastest, or neither is"),
        (("--distance", "270deg", "--duration", "1s"), "covers 0 … 3.142 rad"),
        (
            ("--distance", "180deg", "--duration", "0.2", "--objective", "energy"),
            "motor.electrical: is missing",
        ),
        (("--distance", "180deg", "--duration", "0.2", "--objective", "speed"), "Use copper, energy"),
        (("--distance", "180deg", "--duration", "0.2", "--max-position", "1"), "out of the window"),
        (("--distance", "180deg", "--duration", "0.2", "--robust"), "has no std_kgm2"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    machine: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], sentence: str
) -> None:
    code, out, err = invoke(capsys, "optimise", "-m", str(machine), *arguments)
    assert code == 2
    assert out == ""
    assert err.startswith("Error: ")
    assert sentence in err.replace("\n", " ")
    assert "Traceback" not in err


def test_an_unusable_table_is_refused(machine: Path, capsys: pytest.CaptureFixture[str]) -> None:
    believed = load_machine(machine)
    load = believed.load.model_copy(update={"trust": "unusable"})
    write_machine(believed.model_copy(update={"load": load}), machine)
    code, _, err = invoke(capsys, "optimise", "-m", str(machine), "--distance", "3", "--duration", "0.2")
    assert code == 2
    assert "found unusable" in err


ELECTRICAL = "\n[motor.electrical]\nresistance = 0.4\ntorque_constant = 1.6\niron_loss = 0.01\n"


def test_electrical_data_are_read_and_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(RIGID_MACHINE + ELECTRICAL, encoding="utf-8")
    assert load_machine(path).motor.electrical is not None
    arguments = (
        "-m",
        str(path),
        "--distance",
        "1",
        "--duration",
        "0.2",
        "--no-rivals",
        "--objective",
        "energy",
    )
    code, text, _ = invoke(capsys, "optimise", *arguments, "--json", "--out", str(tmp_path / "out"))
    assert code == 0
    assert json.loads(text)["motions"][0]["drawn_j"] > 0
    path.write_text(RIGID_MACHINE + ELECTRICAL.replace("0.4", "-1.0"), encoding="utf-8")
    code, _, err = invoke(capsys, "optimise", *arguments)
    assert code == 2
    assert "motor.electrical.resistance: is -1.0" in err
    assert "Ω" in err


@pytest.mark.parametrize(
    "curve", ["[[0, 1]]", "[[0, 10], [0, 5]]", "[[0, 10], [5, 11]]", "[[0, 9], [1, 3], [2, 2]]"]
)
def test_a_torque_speed_curve_has_to_fall_ever_more_steeply(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], curve: str
) -> None:
    path = tmp_path / "machine.toml"
    path.write_text(RIGID_MACHINE.replace("[load]", f"torque_over_speed = {curve}\n[load]"), encoding="utf-8")
    code, _, err = invoke(capsys, "optimise", "-m", str(path), "--distance", "1", "--duration", "0.2")
    assert code == 2
    assert "torque_over_speed" in err


@pytest.mark.long
def test_the_demo_measures_optimises_plays_and_keeps_its_promise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "demo"
    code, text, _ = invoke(
        capsys,
        "demo",
        "--optimise",
        "--plant",
        "two-mass",
        "--duration",
        "200ms",
        "--out",
        str(out),
        "--json",
    )
    assert code == 0
    copper = json.loads(text)["optimised"]["played"]["copper_n2m2s"]
    assert copper["saving"]["mean"] == pytest.approx(copper["predicted_saving"], abs=0.03)
    assert copper["saving"]["mean"] > 0.35
    assert 'trust = "good"' in (out / "measured.toml").read_text(encoding="utf-8")
    for name in ("played.h5", "played.png", "played-angle.png", "motion.json"):
        assert (out / "optimised" / name).exists()
    code, _, err = invoke(
        capsys, "optimise", "-m", str(out / "measured.toml"), "--distance", "1", "--duration", "1", "--play",
        "--out", str(out / "optimised"), "-i", "stepped", "-c", "nobody",
    )  # fmt: skip
    assert code == 2
    assert "holds played motions already" in err
