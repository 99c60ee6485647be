"""Commissioning over the kernel's CAN, bench and tool as two processes: the same table as on the virtual bus."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from schwung.cli.demo import BELIEF
from schwung.drivetrain import read_inertia_csv

pytestmark = pytest.mark.vcan


def _schwung(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "schwung", *arguments],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )


@pytest.mark.timeout(240)
def test_the_table_over_vcan_is_that_of_the_virtual_bus(
    vcan_channel: str, tmp_path: Path, measured: Callable[[str, str], None]
) -> None:
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
        done = _schwung(
            "commission", "-m", str(tmp_path / "machine.toml"), "--distance", "180deg", "--duration", "250ms",
            "--export", "table", "-y", "--json", "--out", str(tmp_path / "vcan"), *bus,
        )  # fmt: skip
    finally:
        bench.terminate()
        bench.wait(10)
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(done.stdout)
    desk = _schwung(
        "demo", "--plant", "two-mass", "--seed", "3", "--out", str(tmp_path / "virtual"), "--json"
    )
    assert desk.returncode == 0, desk.stderr
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
    assert json.loads(desk.stdout)["rmse_kgm2"] <= 0.003
