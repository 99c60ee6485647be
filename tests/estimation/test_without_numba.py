"""Without numba an estimate is the same, to rounding: the very estimators in a process that cannot import it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from estimation_plant import thinned

from schwung.drivetrain.machine import Machine, write_machine
from schwung.estimation import estimate
from schwung.session import Session, SessionWriter

#: One whose kernels run as they are, and the one that has others (the filter in whole matrices).
METHODS = ("rls", "trajectory")
ASK = """
import json, sys
sys.modules["numba"] = sys.modules["llvmlite"] = None
import schwung
session, machine = schwung.read_session("session.h5"), schwung.load_machine("machine.toml")
found = {name: schwung.estimate(session, machine, method=name).table for name in sys.argv[1:]}
print(json.dumps({name: [list(table.inertia_kgm2), list(table.std_kgm2)] for name, table in found.items()}))
"""


@pytest.fixture
def folder(tmp_path: Path, fast: Session, machine: Machine) -> Path:
    with SessionWriter(tmp_path / "session.h5", source="test") as writer:
        for run in thinned(fast, 8).runs:
            writer.append(run)
    write_machine(machine, tmp_path / "machine.toml")
    return tmp_path


@pytest.mark.long
def test_estimates_are_the_same(folder: Path, fast: Session, machine: Machine) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ASK, *METHODS], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    plain = json.loads(done.stdout)
    for name in METHODS:
        table = estimate(thinned(fast, 8), machine, method=name).table
        for found, expected in zip(plain[name], (table.inertia_kgm2, table.std_kgm2), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-9, err_msg=name)
