"""A believed inertia that is told over fewer angles than the motion visits."""

from pathlib import Path

import numpy as np
import pytest
from sealed_sessions import drawn

from schwung.explain.weighing.weigh import weigh


@pytest.mark.long
def test_a_motion_that_passes_the_ends_of_its_table_hides_nothing(tmp_path: Path) -> None:
    """It overshoots both ends of the table by a tenth of a radian, where the inertia was held: no less than an inertia
    of another profile and a further mass were unnamed beside it."""
    session, machine, label = drawn(tmp_path, 210004, each=2, kind="none")
    assert not label["effects"]
    table, visited = machine.load.inertia_table, [run.position_rad for run in session.runs]
    assert table is not None
    assert min(map(np.min, visited)) < table.position_rad[0] - 0.1
    assert max(map(np.max, visited)) > table.position_rad[-1] + 0.1
    found = weigh(session, machine)
    assert not found.names
    assert not found.unnamed
