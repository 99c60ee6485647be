"""A speed that the drive makes of its counted angle, on a plant whose loop answers those counts."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from schwung.estimation import estimate

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from operations import LOAD, Operation, belief, session_of


@pytest.mark.parametrize("bits", [17, 20])
def test_it_has_the_angles_errors_and_is_not_counted_again(bits: int) -> None:
    """As if it was measured by itself, 17 bits put the inertia off by 0.2 %, and 20 bits by 0.02 %."""
    phases = (None, 0.0, np.pi / 2, np.pi, 3 * np.pi / 2)
    session = session_of(Operation("", counts=2**bits, times_s=(0.25, 0.35), phases=phases), 2)
    found = estimate(session, belief(), "trajectory").table
    assert found.std_kgm2 is not None
    off = found.inertia_kgm2 - LOAD
    assert np.sqrt(np.mean(off**2)) < 2e-4 * LOAD
    assert np.all(np.abs(off) < 3 * found.std_kgm2)
