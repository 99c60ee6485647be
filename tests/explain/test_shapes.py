"""A machine's friction has not the textbook's shape: one name still, and its numbers, not several names or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from schwung.drivetrain.machine import Load, Machine, Motor
from schwung.explain.publishing.publish import publish
from schwung.explain.values import Quantity
from schwung.motion import Array, Motion
from schwung.session.model import Run, Session

RATE_HZ, NOISE_NM = 2000.0, 0.05
MACHINE = Machine(
    name="rigid",
    motor=Motor(inertia_kgm2=0.01, viscous_friction_nms=0.05, peak_torque_nm=500.0),
    load=Load(viscous_friction_nms=0.1, inertia_kgm2=0.05),
)
#: More torque (N·m) at a position (rad), speed (rad/s), time since the motion began (s), and share of the session.
Hidden = Callable[[Array, Array, Array, float], Array]


def box(position: Array, speed: Array, _time: Array, _share: float) -> Array:
    """A tight spot with edges."""
    return np.asarray(np.where(np.abs(position - 1.1) < 0.2, 1.5, 0.0) * np.sign(speed))


def settling(_position: Array, speed: Array, _time: Array, share: float) -> Array:
    """Grease that warms up within the first third of the session."""
    return np.asarray(np.tanh(speed / 0.2) * (0.8 - 0.5 * np.expm1(-4 * share) / np.expm1(-4)))


def exponential(_position: Array, speed: Array, _time: Array, _share: float) -> Array:
    """Stribeck friction that falls with the first power of the speed, not the second."""
    return (2.0 + 3.0 * np.exp(-np.abs(speed) / 2.0)) * np.tanh(speed / 0.05)


def half_sine(_position: Array, _speed: Array, time: Array, _share: float) -> Array:
    """A blow against the motion that rises and falls at once."""
    share = (time - 0.1) / 0.08
    return np.where((share > 0) & (share < 1), -2.0 * np.sin(np.pi * np.clip(share, 0, 1)), 0.0)


def session(hidden: Hidden) -> Session:
    """Strokes there and back of three times, two of each, in turn."""
    chance, runs = np.random.default_rng(3), []
    for number in range(6):
        motion = Motion(
            kind="poly5",
            distance_rad=2.5,
            duration_s=(0.3, 0.4, 0.55)[number % 3],
            start_time_s=0.1,
            dwell_s=0.1,
        )
        time = motion.time(RATE_HZ)
        demand = motion.demand(time)
        more = hidden(demand.position_rad, demand.speed_rad_s, time - 0.1, number / 5)
        torque = 0.06 * demand.acceleration_rad_s2 + 0.15 * demand.speed_rad_s + more
        runs.append(
            Run(
                role="reference", repeat=number // 3, sample_rate_hz=RATE_HZ, time_s=time,
                position_rad=demand.position_rad + chance.normal(0.0, 2e-6, time.size),
                speed_rad_s=demand.speed_rad_s + chance.normal(0.0, 4e-3, time.size),
                torque_nm=torque + chance.normal(0.0, NOISE_NM, time.size), motion=motion,
            )
        )  # fmt: skip
    return Session(tuple(runs), created="2026-01-01T00:00:00", source="test")


#: What is hidden, the names that are right, and their numbers.
Case = tuple[Hidden, set[str], dict[str, float]]
SHAPES: tuple[Case, ...] = (
    (box, {"local_friction"}, {"torque_nm": 1.5, "centre_rad": 1.1, "width_rad": 0.4}),
    (
        settling,
        {"friction_drift", "coulomb_friction"},
        {"torque_nm": 0.8, "change_nm": -0.5, "settling": 4.0},
    ),
    (half_sine, {"load_event"}, {"time_s": 0.1, "duration_s": 0.08, "peak_nm": 2.0}),
)
FALLING: Case = (
    exponential,
    {"stribeck_friction"},
    {"coulomb_torque_nm": 2.0, "breakaway_torque_nm": 5.0, "stribeck_speed_rad_s": 2.0, "exponent": 1.0},
)


def has(told: Mapping[str, Quantity], true: dict[str, float]) -> None:
    """Every true number within a tenth, and within its interval."""
    for key, value in true.items():
        assert told[key].value == pytest.approx(value, rel=0.1), key
        low, high = told[key].ci95 or (np.nan, np.nan)
        assert low - 0.01 * abs(value) <= value <= high + 0.01 * abs(value), key


@pytest.mark.long
@pytest.mark.parametrize(("hidden", "names", "true"), [*SHAPES, FALLING])
def test_an_unusual_shape_is_one_name_with_its_numbers(
    hidden: Hidden, names: set[str], true: dict[str, float]
) -> None:
    found = [one for one in publish(session(hidden), MACHINE).names if one.in_file]
    assert {one.physics for one in found} == names
    has({key: quantity for one in found for key, quantity in one.parameters.items()}, true)
