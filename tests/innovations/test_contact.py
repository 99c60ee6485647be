"""What a coupling with a gap carries on average over a time, as far as its wind-up is known, against a drawn one."""

import numpy as np
import pytest

from schwung.innovations.contact import touching

HALF, SPREAD = 5e-4, 2e-4


@pytest.mark.parametrize("moved", [0.0, 1e-8, 1e-4, -3e-4, 2e-3])
@pytest.mark.parametrize("twist", [-4e-4, 3e-4, 5e-4, 6e-4, 1.2e-3])
def test_moments_of_what_is_carried(twist: float, moved: float) -> None:
    off = SPREAD * np.random.default_rng(3).normal(size=20_000)[:, None]
    along = twist + moved * ((np.arange(100) + 0.5) / 100 - 0.5)
    carried = np.mean(np.maximum(along + off - HALF, 0.0), axis=1)  # of each draw, over the time
    share, lacks, remains = touching(twist - moved / 2, twist + moved / 2, HALF, SPREAD)
    assert share == pytest.approx(np.mean(along + off > HALF), abs=0.01)
    assert share * twist - lacks == pytest.approx(np.mean(carried), abs=0.02 * SPREAD)
    line = np.mean(carried) + share * off[:, 0]  # what a unit of the wind-up adds, on average
    beyond = float(np.std(carried - line))
    # each instant's is told exactly; that of their mean is at most the mean of theirs
    assert 0.98 * beyond - 0.01 * SPREAD <= remains <= 1.35 * beyond + 0.01 * SPREAD


@pytest.mark.parametrize("spread", [1e-12, 1e-5, 2e-4])
def test_a_contact_that_closes_in_a_known_while_touches_for_the_rest_of_it(spread: float) -> None:
    """By halves, by a third: nothing jumps where an instant goes by."""
    share, lacks, remains = touching(0.0, 2e-2, 5e-3, spread)
    assert share == pytest.approx(0.75, rel=1e-6)
    assert 1e-2 * share - lacks == pytest.approx(
        0.75 * 7.5e-3, rel=1e-2
    )  # of the mean wind-up beyond the gap's end
    assert remains <= 0.05 * spread


def test_nothing_is_open_far_from_the_end_of_the_gap() -> None:
    for twist in (-0.1, 0.0, 0.1):
        assert touching(twist, twist + 1e-4, HALF, 1e-5)[2] == 0.0


def test_a_wind_up_that_stands_still_is_no_other_than_one_that_moves_a_little() -> None:
    for twist in np.linspace(-1e-3, 2e-3, 31):
        still, moving = (touching(twist - by, twist + by, HALF, SPREAD) for by in (0.9e-7, 1.1e-7))
        np.testing.assert_allclose(still, moving, rtol=1e-5, atol=1e-9 * SPREAD)
