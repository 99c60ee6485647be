"""What is missed, in newton metres: the same however often it was sampled."""

import pytest
from strangers import Stranger, belief_of, session_of

from schwung.explain.publishing.publish import publish

DRY = Stranger("dry friction", ("coulomb_friction",), (0.8, 0.0, 0.0, 0.0))


@pytest.mark.long
@pytest.mark.parametrize("every", [2, 8])
def test_the_torque_that_is_missed_is_the_friction(every: int) -> None:
    """Of 4 000 samples a second every other is taken: what each step has of its own was left out of it, 0.22 N·m."""
    found = publish(session_of(DRY, 5, every=every, times=(0.25, 0.4)), belief_of(DRY))
    assert {one.physics for one in found.names if one.in_file} == {"coulomb_friction"}
    assert found.proof is not None
    assert found.proof.before_nm == pytest.approx(0.8, rel=0.03)
    assert found.proof.after_nm is not None
    assert found.proof.after_nm < 0.06
