"""Time shifts between angle, speed and torque: what filters and sampling do, and what is worth a name."""

from __future__ import annotations

import pytest

from schwung.drivetrain import paper_machine
from schwung.explain.signals import Noise, Prepared
from schwung.explain.timing import Times, shift

NOISE = Noise(1e-6, 1e-2, 1e-1)


def prepared(speed_delay_s: float, std_s: float = 1e-6) -> Prepared:
    """A 4 kHz session whose speed is so late behind the angle."""
    return Prepared((), 300.0, 4000.0, 4000.0, 5, NOISE, NOISE, speed_delay_s, std_s, 0.01, 20.0)


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


def test_a_speed_made_of_the_angle_says_nothing_of_a_delay() -> None:
    assert shift(prepared(0.0, float("inf")), paper_machine(), times(-200e-6)).name is None


def test_what_a_poor_model_misses_may_pass_for_a_shift() -> None:
    poor = Times(0.0, 1e-6, 0.0, 1e-6, misfit=3.0)
    assert shift(prepared(40e-6), paper_machine(), poor).name is None
    assert shift(prepared(40e-6), paper_machine(), times(0.0)).name == "measurement_delay"
