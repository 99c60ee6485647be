"""Rates and calibration of weighed sessions."""

from dataclasses import replace

import numpy as np
import pytest
from explain_tally import (
    Told,
    bins_of,
    calibration_error,
    calibration_interval,
    printed,
    read_tally,
    write_tally,
)
from reliability import reliability_figure, write_reliability


def told(kind="single", truth=("cogging",), seed=0, **names):
    return Told(kind, seed, truth, names, 0.9, 3.0)


def test_a_session_is_right_by_its_first_name_and_wrong_by_any():
    assert told(cogging=0.9).right
    assert not told(cogging=0.4).right
    assert told(cogging=0.9, backlash=0.6).wrong
    assert told("none", ()).right
    assert not told("foreign", ("mesh_stiffness",), backlash=0.6).right
    assert not told("two", ("cogging", "backlash"), cogging=0.9).complete


def test_names_that_are_true_as_often_as_they_say_are_calibrated():
    chance = np.random.default_rng(3)
    sessions = []
    for p in chance.uniform(0.02, 1.0, 4000):
        truth = ("cogging",) if chance.uniform() < p else ("backlash",)
        sessions.append(told(truth=truth, cogging=float(p)))
    assert calibration_error(sessions) < 0.03
    sure = [told(truth=("backlash",), cogging=0.95), told(cogging=0.95)]
    assert calibration_error(sure) == pytest.approx(0.45)
    low, high = calibration_interval(sure)
    assert low == pytest.approx(0.05)
    assert high == pytest.approx(0.95)


def test_a_tally_is_read_as_it_was_written(tmp_path):
    file, sessions = tmp_path / "tally.jsonl", [told(cogging=0.995), told("none", (), backlash=0.2)]
    sessions[0] = replace(sessions[0], placed=True, held=(2, 3))
    for one in sessions:
        write_tally(file, one)
    assert read_tally(file) == sessions
    assert [one.count for one in bins_of(sessions)] == [1, 1]
    assert "expected calibration error 0.10" in printed(sessions)


def test_each_kind_has_its_rates():
    lines = printed([told(cogging=0.995), told("weak", backlash=1.0)]).splitlines()
    assert lines[0].startswith("single   right 1/1")
    assert lines[1].startswith("weak     right 0/1")
    assert lines[-1].endswith("2 sessions")


def test_places_and_intervals_are_counted_where_there_are_some():
    one = told(cogging=0.995)
    assert "coordinate" not in printed([one])
    assert "intervals" not in printed([one])
    lines = printed([replace(one, placed=True, held=(2, 3)), replace(one, placed=False, held=(1, 1))])
    assert "right coordinate first 1/2 (9 to 91 %)" in lines
    assert "intervals of 95 % that hold their number: 3/4 (30 to 95 %)" in lines


def test_the_reliability_diagram_shows_every_bin_and_its_count(tmp_path):
    sessions = [told(cogging=0.95), told(cogging=0.97), told(truth=("backlash",), cogging=0.6)]
    (axes,) = reliability_figure(sessions).axes
    assert [label.get_text() for label in axes.get_xticklabels()] == [
        "50 to 70 %\n0 of 1",
        "90 to 99 %\n2 of 2",
    ]
    dots = [line.get_ydata()[0] for line in axes.lines if line.get_marker() == "o"]
    assert dots == [0.0, 100.0]
    write_reliability([], tmp_path / "none.png")  # a tally in which nothing stands yet
    assert (tmp_path / "none.png").read_bytes().startswith(b"\x89PNG")
