"""Commissioning over the kernel's CAN, the bench a process of its own: the same table as on the virtual bus."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from schwung.cli import main
from schwung.cli.demo import BELIEF
from schwung.drivetrain import read_inertia_csv

pytestmark = pytest.mark.vcan


def _schwung(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    """The tool in this process, which has loaded and compiled everything already; what it says as JSON."""
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--json"])
    out, err = capsys.readouterr()
    assert not ended.value.code, out + err
    return json.loads(out)


@pytest.mark.timeout(240)
def test_the_table_over_vcan_is_that_of_the_virtual_bus(
    vcan_channel: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    measured: Callable[[str, str], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # denoised does: what the bus delivers is asked here, and a fit of the whole motion takes long in user-mode-linux
    estimating = importlib.import_module("schwung.estimation.estimate")
    monkeypatch.setattr(estimating, "leaves_much", lambda _task, *, windowed: False)
    (tmp_path / "machine.toml").write_text(BELIEF)
    bus = ["-i", "socketcan", "-c", vcan_channel]
    bench = subprocess.Popen(
        [sys.executable, "-m", "schwung", "bench", *bus, "--seed", "3", "--seconds", "200"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        assert bench.stdout is not None
        line = bench.stdout.readline()
        assert re.search("bench ready", line), line + bench.stdout.read()
        result = _schwung(
            capsys, "commission", "-m", str(tmp_path / "machine.toml"), "--distance", "180deg",
            "--duration", "250ms", "--export", "table", "-y", "--out", str(tmp_path / "vcan"), *bus,
        )  # fmt: skip
    finally:
        bench.terminate()
        bench.wait(10)
    desk = _schwung(capsys, "demo", "--plant", "two-mass", "--seed", "3", "--out", str(tmp_path / "virtual"))
    ours, theirs = (read_inertia_csv(tmp_path / name / "inertia.csv") for name in ("vcan", "virtual"))
    difference = ours.inertia_kgm2 - theirs.at(ours.position_rad)
    rms = float(np.sqrt(np.mean(difference**2)))
    band = float(np.median(ours.std_kgm2)) if ours.std_kgm2 is not None else 0.0
    measured(
        "inertia over vcan against the virtual bus", f"rms difference {rms:.2e} kg·m², band {band:.2e} kg·m²"
    )
    measured("following error after the export", f"{result['export']['improvement']:.1f} times smaller")
    assert rms < 0.0005
    assert rms < band
    assert desk["rmse_kgm2"] <= 0.003
