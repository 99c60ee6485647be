"""What a coupling with a gap carries, as far as its wind-up is known, against a drawn wind-up."""

import numpy as np
import pytest

from schwung.innovations.contact import touching


@pytest.mark.parametrize("twist", [-4e-4, 3e-4, 5e-4, 6e-4, 1.2e-3])
def test_moments_of_what_is_carried(twist: float) -> None:
    half, spread = 5e-4, 2e-4
    drawn = twist + spread * np.random.default_rng(3).normal(size=2_000_000)
    carried = np.maximum(drawn - half, 0.0)
    sure, lacks, beyond = touching(twist, twist, half, spread)
    assert sure == pytest.approx(np.mean(drawn > half), abs=2e-3)
    assert sure * twist - lacks == pytest.approx(np.mean(carried), abs=1e-6)
    line = np.mean(carried) + sure * (drawn - twist)  # what a unit of the wind-up adds, on average
    assert np.sqrt(beyond) == pytest.approx(np.sqrt(np.mean((carried - line) ** 2)), abs=1e-6)
    assert beyond >= 0.0


def test_nothing_is_open_far_from_the_end_of_the_gap() -> None:
    for twist in (-0.1, 0.0, 0.1):
        assert touching(twist, twist, 5e-4, 1e-5)[2] == pytest.approx(0.0, abs=1e-30)
