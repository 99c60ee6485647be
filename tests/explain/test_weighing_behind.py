"""Dry friction behind the shaft holds the load at rest: the shaft winds up, and swings when the load is let go."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from strangers import STRANGERS, belief_of, session_of

from schwung.explain.publishing.publish import publish

DRAGS = next(one for one in STRANGERS if one.drags[0] > 0)


@pytest.mark.long
def test_a_guide_behind_the_shaft_that_drags_ever_more_has_its_name() -> None:
    """A load that swings freely at rest misses 18 times the noise, and no law about that takes any of it."""
    found = publish(session_of(DRAGS, 5, every=8, times=(0.25, 0.4)), belief_of(DRAGS))
    assert {one.physics for one in found.names if one.in_file} <= set(DRAGS.right)
    assert "friction_over_angle" in {one.physics for one in found.names if one.probability > 0.9}
    assert found.proof is not None
    assert found.proof.before > 10
    assert found.proof.after < 1.1
