"""The command line: quick to answer, one sentence for every mistake, JSON beside the words."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from cli_running import RIGID_MACHINE, invoke


@pytest.fixture
def machine(tmp_path: Path) -> str:
    path = tmp_path / "machine.toml"
    path.write_text(RIGID_MACHINE)
    return str(path)


def test_help_loads_nothing_heavy() -> None:
    code = "import sys, schwung.cli; print(sorted({m.split('.')[0] for m in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    for heavy in ("numpy", "scipy", "numba", "h5py", "pydantic", "can", "canopen", "matplotlib", "mujoco"):
        assert f"'{heavy}'" not in loaded


def test_commissioning_loads_only_what_it_needs() -> None:
    """Its first second is imports: what explains, Modbus, optional libraries and window systems stay away."""
    code = (
        "import sys, schwung, schwung.cli.flow; from schwung_sim.plants import slider_crank;"
        "schwung.connect, schwung.load_machine, schwung.write_inertia; print(*sys.modules)"
    )
    loaded = set(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.split()
    )
    assert {"can", "mujoco", "matplotlib.figure", "schwung.commissioning.commission"} <= loaded
    unneeded = {
        "asammdf",
        "pandas",
        "pyarrow",
        "pymodbus",
        "canopen",
        "glfw",
        "matplotlib.pyplot",
        "schwung.optimise",
    }
    unneeded |= {
        "scipy.stats",
        "scipy.signal",
        "schwung.explain.weighing.weigh",
        "schwung.report.explanation",
    }
    assert not unneeded & loaded


@pytest.mark.parametrize(
    "command", ["", "demo", "scan", "commission", "estimate", "export", "restore", "report", "bench"]
)
def test_every_command_has_help_with_examples(capsys: pytest.CaptureFixture[str], command: str) -> None:
    code, out, _ = invoke(capsys, *filter(None, [command]), "--help")
    assert code == 0
    assert "schwung" in out
    assert command == "" or "Examples" in out


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "--version")
    assert code == 0
    assert out.startswith("schwung 0.")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["estimate", "none.h5", "-m", "MACHINE"], "none.h5"),
        (["estimate", "none.h5", "-m", "none.toml"], "none.toml"),
        (["report", "MACHINE", "-m", "MACHINE"], "machine.toml"),
        (["restore", "MACHINE"], "JSON"),
        (["restore", "none.json"], "does not exist"),
        (["export", "MACHINE"], "machine.toml"),
        (["scan", "-i", "nonsense", "-c", "x"], "nonsense"),
        (["scan", "-i", "stepped", "-c", "x", "--nodes", "0-5"], "--nodes"),
        (["scan", "-i", "stepped", "-c", "x", "--bus", "host"], "key=value"),
        (
            [
                "commission",
                "-m",
                "MACHINE",
                "--distance",
                "1",
                "--duration",
                "1",
                "-i",
                "stepped",
                "--mode",
                "x",
            ],
            "--mode",
        ),
        (
            ["commission", "-m", "MACHINE", "--distance", "1", "--duration", "1", "-i", "stepped", "-c", "q"],
            "node 1",
        ),
        (["bench"], "one bus"),
        (["bench", "--tcp", "here"], "--tcp"),
        (["bench", "--tcp", "127.0.0.1:0", "--conceal", "magic=1"], "magic"),
        (["bench", "--tcp", "127.0.0.1:0", "--fault", "magic"], "magic"),
        (["bench", "--tcp", "127.0.0.1:0", "--plant", "magic"], "magic"),
    ],
)
def test_a_mistake_is_one_sentence_with_its_place(
    capsys: pytest.CaptureFixture[str], machine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    arguments: list[str], words: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    given = [machine if argument == "MACHINE" else argument for argument in arguments]
    code, _, err = invoke(capsys, *given)
    assert code == 2, err
    assert words in err
    assert "Traceback" not in err


@pytest.mark.parametrize("text", ["abc", "1e", "3 furlongs", "--"])
def test_nonsense_quantities_are_refused_by_name(
    capsys: pytest.CaptureFixture[str], machine: str, text: str
) -> None:
    code, _, err = invoke(capsys, "commission", "-m", machine, f"--distance={text}", "--duration", "1")
    assert code == 2
    assert "--distance" in err


def test_errors_come_as_json_too(capsys: pytest.CaptureFixture[str], machine: str) -> None:
    code, out, _ = invoke(capsys, "estimate", "none.h5", "-m", machine, "--json")
    assert code == 2
    assert json.loads(out)["exit_code"] == 2


@pytest.mark.long
def test_the_demo_commissions_and_says_where_the_report_lies(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, _ = invoke(capsys, "demo", "--out", str(tmp_path / "d"), "--json")
    assert code == 0
    result = json.loads(out)
    assert result["rmse_kgm2"] <= 0.003
    assert result["former_rmse_kgm2"] > 5 * result["rmse_kgm2"]
    assert result["export"]["improvement"] >= 5
    assert Path(result["files"]["report"]).stat().st_size > 10_000
    code, out, _ = invoke(
        capsys, "report", str(tmp_path / "d/session.h5"), "-m", str(tmp_path / "d/machine.toml"),
        "--out", str(tmp_path / "again.html"), "--figures", str(tmp_path / "pictures"), "--json",
    )  # fmt: skip
    assert code == 0
    assert all(Path(name).stat().st_size > 1000 for name in json.loads(out)["figures"])
    again = (tmp_path / "again.html").read_text()
    for heading in ("What the export brought", "Preflight", "Parameters changed in the drive", "SYNC timing"):
        assert heading in again  # as it was told when the machine moved
    code, out, _ = invoke(
        capsys, "explain", str(tmp_path / "d/session.h5"), "-m", str(tmp_path / "d/measured.toml"),
        "--out", str(tmp_path / "e"), "--json",
    )  # fmt: skip
    assert code == 0
    told = json.loads(out)  # nothing was hidden in it: names are listed from 2 % on, told from one half
    assert told["verdict"] == "consistent"
    assert [
        one for one in told["names"] + told["unnamed"] if one["in_file"] or one["probability"] > 0.25
    ] == []
    assert told["runners_up"][0]["names"] == []
    code, _, err = invoke(capsys, "demo", "--out", str(tmp_path / "d"))
    assert code == 2
    assert "holds a session already" in err


def test_listing_shows_every_effect_and_fault(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = invoke(capsys, "bench", "--list")
    assert code == 0
    for word in ("coulomb_friction", "inertia_profile_shift", "torque_nm", "heartbeat-stop"):
        assert word in out
