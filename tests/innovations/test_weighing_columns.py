"""The evidence of columns, against the density of the samples written out in full."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from schwung.innovations.evidence import Beyond, block_gains, weigh
from schwung.innovations.statistics import Statistics, colour


@pytest.fixture
def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (m, P), target (m,), prior deviations (P,)."""
    chance = np.random.default_rng(3)
    rows = chance.standard_normal((60, 5))
    rows[:, 4] = rows[:, 3] + 0.3 * rows[:, 4]  # nearly alike
    deviations = np.array([1.0, 0.1, 3.0, 0.7, 0.7])
    target = rows @ (deviations * chance.standard_normal(5)) + chance.standard_normal(60)
    return rows, target, deviations


def in_full(rows, target, deviations):
    """log p(target), but for the constant that all sets share."""
    covariance = np.eye(target.size) + (rows * deviations**2) @ rows.T
    constant = -0.5 * target.size * np.log(2 * np.pi)
    return multivariate_normal(np.zeros(target.size), covariance).logpdf(target) - constant


def test_evidence_is_the_density_with_the_coefficients_integrated_out(drawn):
    rows, target, deviations = drawn
    found = weigh(Statistics.of(rows, target), deviations)
    assert found.log_evidence == pytest.approx(in_full(rows, target, deviations), abs=1e-8)
    exact = np.linalg.inv(rows.T @ rows + np.diag(deviations**-2.0))
    np.testing.assert_allclose(found.covariance, exact, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.spread, np.sqrt(np.diag(exact)))
    np.testing.assert_allclose(found.coefficients, exact @ rows.T @ target)


@pytest.mark.parametrize("where", [slice(3, 4), slice(3, 5)])
def test_what_a_block_adds_is_the_difference_of_two_evidences(drawn, where):
    rows, target, deviations = drawn
    members = np.arange(3)
    data = Statistics.of(rows, target)
    scales = (0.2, 1.0, 5.0)
    (gains,) = Beyond.of(data, members, deviations[:3]).gains([where], deviations[where], scales)
    for scale, gain in zip(scales, gains, strict=True):
        both = [*members, *range(where.start, where.stop)]
        prior = np.concatenate([deviations[:3], scale * deviations[where]])
        whole = in_full(rows[:, both], target, prior)
        assert gain == pytest.approx(whole - in_full(rows[:, :3], target, deviations[:3]), abs=1e-8)


def test_runs_add_up_and_what_is_missed_is_a_sum_of_squares(drawn):
    rows, target, deviations = drawn
    both = Statistics.of(rows[:20], target[:20]) + Statistics.of(rows[20:], target[20:])
    whole = Statistics.of(rows, target)
    np.testing.assert_allclose(both.gram, whole.gram)
    assert both.count == whole.count == 60
    assert whole.missed(deviations) == pytest.approx(np.sum((target - rows @ deviations) ** 2))
    which = np.array([4, 0])
    np.testing.assert_allclose(whole.at(which).gram, rows[:, which].T @ rows[:, which])
    assert whole.tempered(4.0).square == pytest.approx(whole.square / 4)


def test_scores_of_coloured_noise_vary_more_than_white_ones():
    chance = np.random.default_rng(8)
    rows = np.ones((20000, 1))
    white = chance.standard_normal(20000)
    slow = np.convolve(white, np.ones(10) / np.sqrt(10), "same")
    assert colour(rows, white, 50)[0] == pytest.approx(1.0, abs=0.2)
    assert colour(rows, slow, 50)[0] == pytest.approx(10.0, rel=0.25)


def test_columns_that_run_away_are_worth_nothing() -> None:
    """Of such no eigenvalues are found: a session ended with a traceback."""
    gram, slope = np.stack([np.eye(2), np.full((2, 2), np.inf)]), np.ones((2, 2))
    gains = block_gains(gram, slope, np.ones(2), (1.0, 0.3))
    assert np.all(np.isfinite(gains[0]))
    assert np.all(gains[1] == -np.inf)
