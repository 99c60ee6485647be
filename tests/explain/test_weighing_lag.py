"""A torque that follows through two filters: another lag than the law's one, beside which nothing else has a name."""

from math import atan, pi, tan

import pytest
from strangers import Stranger, belief_of, session_of

from schwung.explain.weighing.published import publish


def test_two_filters_are_a_lag_and_no_damping():
    """At 47 Hz and 2 ms they differ in the third order by what a third of the coupling's damping does. One filter that
    is as late there as both has tan(2 atan(ωτ))/ω, 2.2 ms, and leaves something of them.

    What the belief misses on the runs kept aside is missed with the timing that the drive has beside the lag: with one
    that was fitted to the lag itself it missed nothing, and the page said so above the name.
    """
    stranger = Stranger("loop", ("torque_lag",), loop_s=1e-3)
    found = publish(session_of(stranger, 5, every=8), belief_of(stranger))
    assert [one.physics for one in found.names if one.probability > 0.2] == ["torque_lag"]
    rate = 2 * pi * 47
    assert found.names[0].parameters["time_constant_s"].value == pytest.approx(
        tan(2 * atan(rate * 1e-3)) / rate, rel=0.1
    )
    assert not [one for one in found.curves if one.probability > 0.2]
    assert found.left is not None
    assert found.left < 0.1  # one filter for two leaves a twentieth
    assert found.in_file == ("torque_lag",)
    assert found.mismatch[0].coordinate in ("torque", "acceleration")
