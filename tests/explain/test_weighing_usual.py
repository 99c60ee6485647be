"""What is believed is usually off by as much: that is no finding, unless it is plain to see."""

from pathlib import Path

import pytest
from sealed_sessions import drawn

from schwung.explain.publishing.publish import publish


@pytest.mark.long
def test_a_crank_that_is_half_a_degree_off_is_one_where_a_quiet_recording_shows_little_else(
    tmp_path: Path,
) -> None:
    """10 mrad change the inertia by less than 0.3 %; 1.5 σ were missed, and nothing was said to take it."""
    session, belief, label = drawn(tmp_path, 307212)
    (effect,) = label["effects"]
    found = publish(session, belief)
    assert [one.physics for one in found.names if one.probability > 0.5] == ["inertia_profile_shift"]
    (named,) = found.names
    told = named.parameters["shift_rad"]
    assert told.ci95 is not None
    assert told.ci95[0] < effect["parameters"]["shift_rad"] < told.ci95[1]
    assert found.proof is not None
    assert found.proof.before > 1.4
    assert found.proof.after < 1.02
