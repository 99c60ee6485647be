"""A stiffness that differs along the way, of a machine whose compliance waves: another formula than the law's."""

import numpy as np
import pytest
from strangers import STIFFNESS, Stranger, belief_of, session_of

from schwung.explain.weighing.weigh import weigh


def test_a_coupling_that_gives_more_here_than_there_has_a_name():
    stranger = Stranger("gives", ("stiffness_over_angle",), gives=(0.15, 3.0))
    found = weigh(session_of(stranger, 5, every=8, times=(0.25,)), belief_of(stranger))
    (name,) = (one for one in found.names if one.probability > 0.5)
    assert name.name == "stiffness_over_angle"
    angle = np.linspace(0.0, 4.3, 200)
    share, order, phase = (name.parameters[key].value for key in ("share", "order", "phase_rad"))
    told = 1 + share * np.sin(order * angle + phase)
    true = 1 / (1 - 0.15 * np.cos(3 * angle))
    assert STIFFNESS * np.max(np.abs(told - true)) < 0.06 * STIFFNESS
    assert share == pytest.approx(0.15, abs=0.03)
    turns = name.parameters["order"]
    assert 0.002 < (turns.high - turns.low) / turns.value < 0.2  # it is known so well, and no better
