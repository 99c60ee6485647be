"""Whether a reported speed was made of the reported angle, or was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from schwung.motion import Array
from schwung.session.derived import speed_is_derived
from schwung.session.model import Run

RATE_HZ, COUNT = 2000.0, 2 * np.pi / 2**17
TIME = np.arange(1600) / RATE_HZ


def _run(angle: Array, speed: Array) -> Run:
    return Run(
        role="reference", repeat=0, sample_rate_hz=RATE_HZ, time_s=TIME, position_rad=angle, speed_rad_s=speed,
        torque_nm=np.cos(9 * TIME),
    )  # fmt: skip


def _moved() -> tuple[Array, Array]:
    """Angle and speed of a stroke and its swing."""
    share = np.clip((TIME - 0.1) / 0.5, 0, 1)
    angle = 2.4 * (share - np.sin(2 * np.pi * share) / (2 * np.pi)) + 1e-3 * np.sin(2 * np.pi * 41 * TIME)
    return angle, np.gradient(angle, 1 / RATE_HZ, edge_order=2)


def _counted(angle: Array) -> Array:
    return np.floor(angle / COUNT) * COUNT


def _difference(angle: Array) -> Array:
    return np.diff(angle, prepend=angle[0]) * RATE_HZ


MADE = {
    "a difference": _difference,
    "a filtered difference": lambda angle: lfilter([0.3], [1, -0.7], _difference(angle)),
    "through two filters": lambda angle: lfilter([0.25], [1, -1, 0.25], _difference(angle)),
    "counts within 8 samples": lambda angle: lfilter(np.full(8, 1 / 8), 1, _difference(angle)),
    "both neighbours": lambda angle: np.gradient(angle, 1 / RATE_HZ),
    "rounded": lambda angle: np.round(_difference(angle), 2),
}


@pytest.mark.parametrize("how", MADE)
@pytest.mark.parametrize("errors", ["counted", "noisy"])
def test_a_speed_that_is_made_of_the_angle_has_its_errors(how: str, errors: str) -> None:
    noise = 0.4 * COUNT * np.random.default_rng(3).standard_normal(TIME.size)
    angle = _counted(_moved()[0]) if errors == "counted" else _moved()[0] + noise
    assert speed_is_derived([_run(angle, MADE[how](angle))])


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-2, 0.3])
@pytest.mark.parametrize("errors", ["none", "counted", "noisy"])
def test_a_speed_that_was_measured_knows_nothing_of_the_angles_errors(noise: float, errors: str) -> None:
    """However much better or worse it is than differences of the angle."""
    chance = np.random.default_rng(4)
    angle, speed = _moved()
    if errors != "none":
        angle = _counted(angle) if errors == "counted" else angle + COUNT * chance.standard_normal(TIME.size)
    speed = speed + noise * chance.standard_normal(TIME.size)
    assert not speed_is_derived([_run(angle, speed)])


def test_all_runs_are_of_one_drive() -> None:
    """A run at rest says nothing, and its own word is enough."""
    angle, speed = _moved()
    still, moved = _run(0 * angle, 0 * speed), _run(_counted(angle), _difference(_counted(angle)))
    assert speed_is_derived([still, moved])
    assert not speed_is_derived([still])
    assert not speed_is_derived([])
    assert not speed_is_derived([_run(angle, 0 * speed)])
    assert speed_is_derived([replace(_run(angle, speed), extra={"speed_origin": "derived"})])
