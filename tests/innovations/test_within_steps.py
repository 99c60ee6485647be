"""What is worked out within a step: exact where its formulas are, whatever machine it is of."""

import numpy as np
import pytest

from schwung.innovations.steps import WITHIN, height_of, sloping, smoothly, straight

STEP_S = 1e-3


def test_a_cubic_is_the_one_between_its_samples():
    cubic = np.polynomial.Polynomial([0.3, -2.0, 40.0, -900.0])
    time = STEP_S * np.arange(8)
    between = time[:-1] + STEP_S * WITHIN
    assert sloping(cubic(time), cubic.deriv()(time), STEP_S) == pytest.approx(cubic(between))


def test_a_parabola_is_the_one_between_its_samples_but_for_the_ends():
    time = STEP_S * np.arange(8)
    told = smoothly(5.0 - 3e5 * time**2)
    assert told[:, 1:-1] == pytest.approx(5.0 - 3e5 * (time[1:-2] + STEP_S * WITHIN) ** 2)


def test_the_parabola_over_a_step_has_the_momentum_of_what_is_within():
    """Of any polynomial up to the fifth order: a bend between two samples is in none of these."""
    bent = np.polynomial.Polynomial([1.0, 2.0, -7.0, 11.0, 13.0, -5.0])
    start, end = bent(np.zeros(1)), bent(np.ones(1))
    height = height_of(bent(WITHIN) - straight(start, end))
    momentum = (start + end) / 2 + 2 / 3 * height
    assert momentum == pytest.approx(bent.integ()(1.0))
