"""Columns that are torques alone go a shorter way, which says the same."""

import numpy as np
import pytest

from schwung.innovations import kernel


@pytest.mark.parametrize("side", [0, 1])
def test_torques_alone_are_whitened_as_beside_an_error_of_nothing(side: int) -> None:
    chance = np.random.default_rng(side)
    packed, torque = 0.1 * chance.standard_normal((75, 44)), chance.standard_normal((75, 5))
    nothing, none = np.empty((75, 0)), np.zeros((75, 5))
    both = (torque, nothing) if side == 0 else (nothing, torque)
    expected, found = np.zeros((7, 160)), np.zeros((7, 160))
    kernel.responses(packed, (*both, none, none), expected, 1, 4)
    kernel.responses_to_torque(packed, torque, side, found, 1, 4)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.count_nonzero(found) == 5 * 148  # nothing shows at the first sample
