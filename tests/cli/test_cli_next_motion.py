"""`commission --plan` and `--until-explained`: what is refused before any bus is opened."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_running import RIGID_MACHINE, invoke


@pytest.fixture
def machine(tmp_path: Path) -> str:
    path = tmp_path / "machine.toml"
    path.write_text(RIGID_MACHINE)
    return str(path)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "--distance: is missing"),
        (("--distance", "1"), "--duration: is missing"),
        (("--plan", "next.json", "--distance", "1"), "--plan: says stroke, time and injection already"),
        (("--plan", "not-there.json"), "not-there.json: cannot be read"),
        (("--distance", "1", "--duration", "1", "--until-explained", "--budget", "1"), "--budget: is 1"),
        (
            ("--distance", "1", "--duration", "1", "--until-explained", "--export", "mean"),
            "--export: belongs",
        ),
    ],
)
def test_what_makes_no_sense_is_one_sentence(
    capsys: pytest.CaptureFixture[str], machine: str, options: tuple[str, ...], said: str
) -> None:
    code, _, err = invoke(capsys, "commission", "-m", machine, *options)
    assert code == 2
    assert said in " ".join(err.split())
    assert "Traceback" not in err


def test_an_fmu_is_no_belief_for_the_next_motion(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, _, err = invoke(
        capsys, "explain", "s.h5", "--belief", "m.fmu", "--map", "m.toml", "--next", "n.json"
    )
    assert code == 2
    assert "--next: simulates the motion" in " ".join(err.split())
