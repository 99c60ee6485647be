"""Scopes: nothing is lost that a picture can show, whoever is slow."""

from __future__ import annotations

import numpy as np

from schwung.fieldbus.drive import LiveSamples
from schwung.service.live import KEPT_ROWS, SIGNALS, Scope, thinned


def samples(motion: int, start: int, torque_nm: np.ndarray) -> LiveSamples:
    n = torque_nm.size
    rest = {name: np.zeros(n) for name in SIGNALS if name != "torque_nm"}
    return LiveSamples(motion=motion, time_s=(start + np.arange(n)) / 1000, torque_nm=torque_nm, **rest)


def test_thinning_keeps_every_peak_and_the_ends() -> None:
    rng = np.random.default_rng(1)
    time_s, signal = np.arange(10_000) / 1000, rng.normal(size=(2, 10_000))
    signal[0, 4321], signal[1, 17] = 50.0, -60.0
    signal[1, 100:200] = np.nan
    few_s, few = thinned(time_s, signal, 200)
    assert few.shape == (2, 200)
    assert few_s.size == 200
    assert np.all(np.diff(few_s) >= 0)
    assert (few_s[0], few_s[-1]) == (time_s[0], time_s[-1])
    for all_of_it, thin in zip(signal, few, strict=True):
        assert np.nanmax(thin) == np.nanmax(all_of_it)
        assert np.nanmin(thin) == np.nanmin(all_of_it)


def test_few_samples_are_left_as_they_are() -> None:
    time_s, signal = np.arange(7.0), np.arange(14.0).reshape(2, 7)
    few_s, few = thinned(time_s, signal, 200)
    np.testing.assert_array_equal(few_s, time_s)
    np.testing.assert_array_equal(few, signal)


def test_time_goes_on_from_motion_to_motion_and_each_watcher_has_a_cursor() -> None:
    scope = Scope()
    scope.append(samples(1, 0, np.ones(10)))
    first = scope.since(0, 100)
    scope.append(samples(2, 0, 2 * np.ones(5)))
    second = scope.since(first.cursor, 100)
    assert second.columns["torque_nm"].tolist() == [2.0] * 5
    assert second.columns["time_s"][0] > first.columns["time_s"][-1]
    assert scope.since(second.cursor, 100).columns["time_s"].size == 0


def test_who_was_away_for_too_long_is_told_what_is_lost() -> None:
    scope = Scope()
    for piece in range(3):
        scope.append(samples(1, piece * 40_000, np.full(40_000, float(piece))))
    view = scope.since(0, 1000)
    assert view.lost == 120_000 - KEPT_ROWS
    assert set(np.unique(view.columns["torque_nm"])) == {1.0, 2.0}


def test_a_piece_that_is_longer_than_what_is_kept_leaves_its_end() -> None:
    scope = Scope()
    scope.append(samples(1, 0, np.arange(KEPT_ROWS + 100.0)))
    view = scope.since(0, 2 * KEPT_ROWS)
    assert (view.columns["torque_nm"][0], view.columns["torque_nm"][-1]) == (100.0, KEPT_ROWS + 99.0)
