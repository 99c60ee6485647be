"""Columns that are torques alone, and states that are many, go ways of their own, which say the same."""

import numpy as np
import pytest

from schwung.innovations import kernel
from schwung.innovations.values import Filtered


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


@pytest.mark.parametrize("kind", range(4))
def test_six_states_are_whitened_as_the_filter_says(kind: int) -> None:
    """Angle, then speed, is taken off all states in turn, and the step goes on from there; an effect on one of four."""
    chance, count = np.random.default_rng(kind), 75
    transition = 0.2 * chance.standard_normal((count - 1, 7, 7))
    transition[:, 6] = 0.0
    inputs, gain = chance.standard_normal((count - 1, 6, 4)), 0.3 * chance.standard_normal((count, 2, 7))
    variance = chance.uniform(0.5, 2, (count, 2))
    parts = [np.empty((count, 0))] * 4
    parts[kind] = chance.standard_normal((count, 5))
    motor, load, angle, speed = (part if part.shape[1] else np.zeros((count, 5)) for part in parts)

    expected, x = np.zeros((7, 160)), np.zeros((7, 5))
    for k in range(count):
        for m, error in enumerate((angle[k], speed[k])):
            seen = x[m] + error
            expected[1:6, 4 + 2 * k + m] = seen / np.sqrt(variance[k, m])
            x = x - np.outer(gain[k, m], seen)
        if k < count - 1:
            x = transition[k] @ x
            x[:6] += inputs[k] @ np.stack([motor[k], load[k], motor[k + 1], load[k + 1]])

    found, still = np.zeros((7, 160)), np.zeros((count, 7))
    result = Filtered(np.zeros((count, 2)), variance, gain, still, np.zeros((count, 7, 7)))
    kernel.responses_of_six(transition, result, inputs, tuple(parts), found, 1, 4)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert np.count_nonzero(expected) > 5 * 140
