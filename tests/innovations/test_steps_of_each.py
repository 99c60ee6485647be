"""Steps of a coupling that is another in each."""

import numpy as np
import pytest

from schwung.innovations.steps import Steps
from schwung.innovations.values import Shaft

SHAFT = Shaft(0.004, 0.01, 0.02, 9000.0, 1.9, False)
INERTIA = np.linspace(0.02, 0.03, 40)


def test_where_it_is_the_same_everywhere_they_are_the_steps_of_that_coupling():
    each = np.tile([9000.0, 1.9], (INERTIA.size, 1))
    one = Steps.of_each(SHAFT, each, INERTIA, 5e-4)
    other = Steps.of(SHAFT, INERTIA, 5e-4, slopes=False)
    np.testing.assert_allclose(one.transition, other.transition, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(one.inputs, other.inputs, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("stiffness", [9.0, 30000.0])
def test_each_has_its_own(stiffness):
    each = np.tile([9000.0, 1.9], (INERTIA.size, 1))
    each[7] = stiffness, 0.3
    steps = Steps.of_each(SHAFT, each, INERTIA, 5e-4)
    alone = Steps.of(SHAFT._replace(stiffness=stiffness, damping=0.3), INERTIA[7:8], 5e-4, slopes=False)
    np.testing.assert_allclose(steps.transition[7], alone.transition[0], rtol=1e-6, atol=1e-9)
    assert not np.allclose(steps.transition[7], steps.transition[6], rtol=1e-3)
