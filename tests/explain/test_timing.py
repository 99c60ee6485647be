"""Time shifts between angle, speed and torque: what filters and sampling do, and what is worth a name."""

from __future__ import annotations

from dataclasses import replace

import pytest

from schwung.drivetrain import paper_machine
from schwung.explain.channels import Noise
from schwung.explain.signals import Prepared
from schwung.explain.timing import Times, shift

NOISE = Noise(1e-6, 1e-2, 1e-1)


def prepared(
    speed_delay_s: float, std_s: float = 1e-6, bend_s2: float = 0.0, bend_std_s2: float = float("inf")
) -> Prepared:
    """A 4 kHz session whose speed is so late behind the angle, by a filter that is seen to bend so much."""
    plain = Prepared((), 300.0, 4000.0, 4000.0, 5, NOISE, NOISE, speed_delay_s, std_s, 0.01, 20.0)
    return replace(plain, seen_bend_s2=bend_s2, seen_bend_std_s2=bend_std_s2)


def times(torque_late_s: float, lag_s: float = 0.0) -> Times:
    """The torque is so late behind the angle, and lags by so much more by its shape."""
    return Times(-torque_late_s, 1e-6, lag_s, 1e-6)


@pytest.mark.parametrize(
    ("speed_late", "torque_late"),
    [(0.0, 0.0), (112e-6, 112e-6), (200e-6, 195e-6), (62.5e-6, 0.0), (125e-6, 0.0), (0.0, -62.5e-6)],
)
def test_filters_and_sampling_are_not_given_a_name(speed_late: float, torque_late: float) -> None:
    assert shift(prepared(speed_late), paper_machine(), times(torque_late)).name is None


def test_a_late_speed_is_a_measurement_delay() -> None:
    found = shift(prepared(500e-6), paper_machine(), times(0.0))
    assert found.name == "measurement_delay"
    assert found.seconds == pytest.approx(500e-6)
    assert not found.doubtful


def test_a_torque_ahead_of_the_motion_that_it_makes_is_a_lag() -> None:
    found = shift(prepared(0.0), paper_machine(), times(-390e-6))
    assert found.name == "torque_lag"
    assert found.seconds == pytest.approx(390e-6)


def test_the_shape_of_a_lag_decides_where_it_shows() -> None:
    assert shift(prepared(112e-6), paper_machine(), times(112e-6, 300e-6)).name == "torque_lag"


def test_between_the_two_both_are_left_open() -> None:
    assert shift(prepared(150e-6), paper_machine(), times(100e-6)).doubtful


@pytest.mark.parametrize(
    ("filtered_s", "delay_s", "lag_s", "bend_std_s2", "name", "doubtful"),
    [
        (200e-6, 0.0, 110e-6, 1e-9, "torque_lag", False),
        (200e-6, 0.0, 110e-6, 1e-8, "torque_lag", True),
        (90e-6, 110e-6, 0.0, 1e-9, "measurement_delay", True),  # there are filters that hardly bend
    ],
)
def test_a_filter_is_as_late_as_it_bends(
    filtered_s: float, delay_s: float, lag_s: float, bend_std_s2: float, name: str, *, doubtful: bool
) -> None:
    bend = 0.5 * filtered_s**2  # of a low-pass of first order; neither delay nor lag bends the speed
    recorded = prepared(filtered_s + delay_s, bend_s2=bend, bend_std_s2=bend_std_s2)
    found = shift(recorded, paper_machine(), times(filtered_s - lag_s))
    assert (found.name, found.doubtful) == (name, doubtful)
    assert found.seconds == pytest.approx(110e-6)


def test_no_filter_is_ahead_of_time() -> None:
    found = shift(prepared(112e-6), paper_machine(), times(-30e-6))
    assert (found.name, found.doubtful) == ("torque_lag", False)


@pytest.mark.parametrize(
    ("late_s", "named"), [(66e-6, False), (75e-6, True), (121e-6, False), (110e-6, True)]
)
def test_what_sampling_shifts_is_half_a_period_or_a_whole_one(late_s: float, *, named: bool) -> None:
    found = shift(prepared(late_s), paper_machine(), times(0.0))  # a controller at 8 kHz
    assert (found.name is not None) == named


def test_a_speed_made_of_the_angle_says_nothing_of_a_delay() -> None:
    assert shift(prepared(0.0, float("inf")), paper_machine(), times(-200e-6)).name is None


def test_what_a_poor_model_misses_may_pass_for_a_shift() -> None:
    poor = Times(0.0, 1e-6, 0.0, 1e-6, misfit=3.0)
    assert shift(prepared(40e-6), paper_machine(), poor).name is None
    assert shift(prepared(40e-6), paper_machine(), times(0.0)).name == "measurement_delay"
