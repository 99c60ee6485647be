"""A torque that follows through two filters: another lag than the law's one, beside which nothing else has a name."""

import pytest
from strangers import Stranger, belief_of, session_of

from schwung.explain.weighing.weigh import weigh


def test_two_filters_are_a_lag_and_no_damping():
    """At 47 Hz and 2 ms they differ in the third order by what a third of the coupling's damping does."""
    stranger = Stranger("loop", ("torque_lag",), loop_s=1e-3)
    found = weigh(session_of(stranger, 5, every=8), belief_of(stranger))
    assert [one.name for one in found.names if one.probability > 0.2] == ["torque_lag"]
    assert found.names[0].parameters["time_constant_s"].value == pytest.approx(2e-3, rel=0.1)
    assert not [one for one in found.unnamed if one.probability > 0.2]
