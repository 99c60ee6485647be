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
def test_many_states_are_whitened_as_few_are(kind: int) -> None:
    """Four states by both ways, and by one with two more that nothing moves; an effect on one of four things."""
    chance, count = np.random.default_rng(kind), 75
    transition = 0.3 * chance.standard_normal((count - 1, 5, 5))
    transition[:, 4] = 0.0
    inputs, gain = chance.standard_normal((count - 1, 4, 6)), 0.3 * chance.standard_normal((count, 2, 5))
    variance, none = chance.uniform(0.5, 2, (count, 2)), np.zeros((count, 5))
    result = Filtered(np.zeros((count, 2)), variance, gain, none, np.zeros((count, 5, 5)))
    parts = [np.empty((count, 0))] * 4
    parts[kind] = chance.standard_normal((count, 5))
    expected, found, wide = (np.zeros((7, 160)) for _ in range(3))
    kernel.responses(kernel.closed_loop(transition, result, inputs), tuple(parts), expected, 1, 4)
    kernel.responses_of_many(transition, result, inputs, tuple(parts), found, 1, 4)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)

    at = np.array([0, 1, 2, 3, 6])
    larger = np.zeros((count - 1, 7, 7))
    larger[:, at[:, None], at] = transition
    gains, pushed = np.zeros((count, 2, 7)), np.zeros((count - 1, 6, 6))
    gains[:, :, at], pushed[:, :4] = gain, inputs
    result = Filtered(np.zeros((count, 2)), variance, gains, np.zeros((count, 7)), np.zeros((count, 7, 7)))
    kernel.responses_of_many(larger, result, pushed, tuple(parts), wide, 1, 4)
    np.testing.assert_allclose(wide, expected, rtol=1e-9, atol=1e-12)
    assert np.count_nonzero(expected) > 5 * 140
