"""The filter without lag, sample by sample, against its gain at each frequency."""

import numpy as np
import pytest

from schwung.innovations.low_pass import low_passed


@pytest.mark.parametrize("count", [3, 10, 61, 1000])
@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("edge", [0.01, 0.16, 0.79, 0.999, 1.0])
def test_each_frequency_is_passed_by_its_gain(count: int, order: int, edge: float) -> None:
    along = np.linspace(0.0, 1.0, count)
    for waves in (1, count // 3 + 1, count - 2):
        sine = np.sin(np.pi * waves * along)
        gain = 1 / (1 + (np.tan(np.pi * waves / (2 * (count - 1))) / np.tan(np.pi * edge / 2)) ** (2 * order))
        passed = low_passed(np.stack([3 + 2 * along + sine, sine], axis=1), edge, order)
        np.testing.assert_allclose(passed[:, 0], 3 + 2 * along + gain * sine, atol=1e-9)
        np.testing.assert_allclose(passed[:, 1], gain * sine, atol=1e-9)


def test_a_signal_may_be_a_line_of_numbers_or_of_whole_numbers() -> None:
    steps = np.arange(200) // 50
    passed = low_passed(steps, 0.1, 4)
    assert passed.shape == (200,)
    np.testing.assert_allclose(passed, low_passed(steps[:, None].astype(float), 0.1, 4)[:, 0])
    assert passed[0] == pytest.approx(0.0)
    assert passed[-1] == pytest.approx(3.0)
