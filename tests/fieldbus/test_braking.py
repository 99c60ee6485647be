"""Slowing down, judged by positions alone: of any ramp, with counts and noise, until it no longer does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from schwung.fieldbus.braking import PATIENCE_S, Slowing, unseen_s

STEP_S = 0.005


def looked_at(speed: np.ndarray, count: float = 1e-5) -> list[bool]:
    """What it says at each step of an axis that turns at these speeds (rad/s), in counts."""
    slowing, position = Slowing(), np.cumsum(speed) * STEP_S
    return [slowing.look(i * STEP_S, round(x / count)) for i, x in enumerate(position)]


@pytest.mark.parametrize("deceleration", [0.2, 1.0, 10.0, 300.0])
@pytest.mark.parametrize("count", [1e-6, 6e-3])
def test_a_brake_is_waited_for_to_its_end(deceleration: float, count: float) -> None:
    time = np.arange(0.0, 8.0 / deceleration, STEP_S)
    assert all(looked_at(8.0 - deceleration * time, count))


def test_one_that_begins_late_and_one_that_fades_are() -> None:
    time = np.arange(0.0, 12.0, STEP_S)
    assert all(looked_at(np.where(time < 1.5, 8.0, 8.0 - 0.7 * (time - 1.5))))
    assert all(looked_at(8.0 * np.exp(-time / 3.0)))


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_a_speed_that_stays_or_grows_is_no_brake(noise: float) -> None:
    time = np.arange(0.0, 4 * PATIENCE_S, STEP_S)
    chance = np.random.default_rng(3).normal(0.0, noise, time.size)
    for speed in (np.full(time.size, 5.0), 1.0 + time, 3.0 - 4.0 * (time < 0.5)):
        told = looked_at(speed * (1 + chance))
        assert told[-1] is False
        assert all(told[: round(PATIENCE_S / STEP_S)])


def test_an_axis_that_goes_to_and_fro_is_given_up() -> None:
    time = np.arange(0.0, 20.0, STEP_S)
    assert looked_at(5.0 * np.sin(2 * np.pi * 0.7 * time))[-1] is False


def test_what_cannot_be_seen_is_no_progress() -> None:
    slowing = Slowing()
    told = [slowing.look(i * STEP_S, math.nan) for i in range(600)]
    assert told[-1] is False
    assert "still turned, no slower" in str(slowing.given_up("node 5", None))


def test_unseen_it_gets_the_time_of_its_ramp_within_bounds() -> None:
    assert unseen_s(9.0, None) == PATIENCE_S
    assert unseen_s(9.0, 400.0) == PATIENCE_S
    assert unseen_s(9.0, 3.0) == pytest.approx(4.1)
    assert unseen_s(9.0, 1e-3) == 10.0
