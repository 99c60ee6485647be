"""What a motion is expected to tell, against formulas of its own, and of a session that was weighed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm
from sealed_sessions import fewer
from strangers import Stranger, belief_of, session_of

from schwung.explain.weighing.experiment import Rival, Rivals, _Set, _Weigher
from schwung.explain.weighing.weigh import posterior_of


def rivals_of(monkeypatch, seen, sets, shares):
    """Rivals with these predictions, along a motion of which XᵀX is `seen`."""
    monkeypatch.setattr(Rivals, "_seen", lambda self, runs: seen)
    names = tuple(Rival((f"name {i}",), p) for i, p in enumerate(shares))
    return Rivals(None, names, np.diag(shares), tuple(sets), ())


def of_one(column, mean, deviation=1e-9):
    return _Set(np.array([column]), np.array([mean]), np.array([[deviation]]))


@pytest.mark.parametrize("apart", [0.5, 2.0, 4.0])
def test_two_rivals_that_are_known_well_are_told_apart_as_bayes_says(monkeypatch, apart):
    """Orthogonal columns: the two means are `apart` deviations apart, and half of that decides."""
    size = apart / np.sqrt(2)
    sets = of_one(0, size), of_one(1, size)
    gain = rivals_of(monkeypatch, np.eye(2), sets, (0.5, 0.5)).gain(())
    assert gain.expected == pytest.approx(norm.cdf(apart / 2), abs=0.06)  # 96 recordings drawn


def test_the_most_that_can_be_told_is_which_it_is(monkeypatch):
    sets = of_one(0, 30.0), of_one(1, 30.0)
    gain = rivals_of(monkeypatch, np.eye(2), sets, (0.3, 0.7)).gain(())
    assert gain.information == pytest.approx(-0.3 * np.log(0.3) - 0.7 * np.log(0.7), rel=1e-6)
    assert gain.expected == pytest.approx(1.0)


def test_a_motion_along_which_nothing_shows_tells_nothing(monkeypatch):
    gain = rivals_of(monkeypatch, np.zeros((2, 2)), (of_one(0, 3.0), of_one(1, 3.0)), (0.6, 0.4)).gain(())
    assert gain.information == pytest.approx(0.0, abs=1e-6)
    assert gain.expected == pytest.approx(0.6)


def test_rivals_that_predict_the_same_are_not_told_apart(monkeypatch):
    """However strong they show: their columns are one."""
    seen = 1e4 * np.ones((2, 2))
    gain = rivals_of(monkeypatch, seen, (of_one(0, 2.0), of_one(1, 2.0)), (0.6, 0.4)).gain(())
    assert gain.information < 0.02


def test_sets_that_give_one_answer_need_not_be_told_apart(monkeypatch):
    """Three sets that any motion tells apart, two of them one answer: what counts is which answer it is."""
    monkeypatch.setattr(Rivals, "_seen", lambda self, runs: np.eye(3))
    shares = np.array([[0.3, 0.4, 0.0], [0.0, 0.0, 0.3]])
    answers = Rival(("one",), 0.7), Rival(("other",), 0.3)
    sets = tuple(of_one(i, 30.0) for i in range(3))
    gain = Rivals(None, answers, shares, sets, ()).gain(())
    assert gain.information == pytest.approx(-0.3 * np.log(0.3) - 0.7 * np.log(0.7), rel=1e-6)


def test_the_predictive_likelihood_is_that_of_the_normal_recording():
    """log p(y) − log p(y | nothing) against the density of N(Xm, 1 + XSXᵀ), written out."""
    chance = np.random.default_rng(4)
    columns, mean, root = (
        chance.standard_normal((12, 3)),
        np.array([0.4, -1.0, 2.0]),
        np.tril(np.ones((3, 3))),
    )
    recording = chance.standard_normal(12)
    weigher = _Weigher.of(_Set(np.arange(3), mean, root), columns.T @ columns)
    told = weigher.log((columns.T @ recording)[:, None])[0]
    spread = np.eye(12) + columns @ root @ root.T @ columns.T
    direct = multivariate_normal(columns @ mean, spread).logpdf(recording)
    assert told == pytest.approx(direct - norm.logpdf(recording).sum(), rel=1e-9)


@pytest.mark.long
def test_of_a_weighed_session():
    hidden = Stranger("dry friction", ("coulomb_friction",), (0.8, 0.0, 0.0, 0.0))
    session = fewer(session_of(hidden, 5, every=8, times=(0.25,)), 1)
    posterior = posterior_of(session, belief_of(hidden), heldout=())
    rivals = Rivals.of(posterior)
    assert sum(one.probability for one in rivals.rivals) == pytest.approx(1.0)
    assert rivals.best == rivals.rivals[0].probability
    again = rivals.gain(session.runs[:1])
    assert again.expected >= rivals.best
    assert rivals.gain(session.runs[:1]) == again  # nothing is left to chance
    slower = session_of(hidden, 6, every=8, times=(0.9,)).runs[:1]
    if not rivals.settled:
        assert rivals.gain(slower).information >= 0.0


@pytest.mark.long
def test_a_speed_that_tells_nothing_now_tells_nothing_next_time():
    hidden = Stranger("dry friction", ("coulomb_friction",), (0.8, 0.0, 0.0, 0.0))
    session = fewer(session_of(hidden, 5, every=8, times=(0.25,)), 1)
    derived = replace(
        session,
        runs=tuple(replace(run, extra={**run.extra, "speed_origin": "derived"}) for run in session.runs),
    )
    posterior = posterior_of(derived, belief_of(hidden), heldout=())
    planned = session_of(hidden, 6, every=8, times=(0.9,)).runs[:1]
    (next_time,) = Rivals.of(posterior)._along(planned).view.runs
    assert not next_time.speed_measured
