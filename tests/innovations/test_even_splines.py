"""Splines through evenly spaced values, against scipy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from schwung.innovations.splines import interpolated, slopes


@pytest.mark.parametrize("count", [4, 5, 40])
def test_slopes_and_values_are_those_of_the_not_a_knot_spline(count):
    values = np.random.default_rng(count).standard_normal((count, 2, 3))
    knots, places = 1.0 + 0.3 * np.arange(count), np.linspace(1.0, 1.0 + 0.3 * (count - 1), 101)
    spline = CubicSpline(knots, values)
    np.testing.assert_allclose(slopes(values, 0.3), spline(knots, 1), atol=1e-11)
    np.testing.assert_allclose(interpolated(values, 1.0, 0.3, places), spline(places), atol=1e-11)
