"""Where a belief misses: in the torque, or in what is reported of the speed."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from schwung.explain.publishing.places import with_places
from schwung.explain.values import Located, Signal

TIME = np.arange(1500) / 1000
SPEED = 12 * np.sin(2 * np.pi * TIME / 1.5) ** 2 * np.sign(0.75 - TIME)
ACCELERATION = np.gradient(SPEED, TIME)
NOISE_NM, NOISE_RAD_S, LATE_S = 0.2, 0.02, 4e-4


def shown(seed: int, late_s: float, dry_nm: float, measured: bool = True) -> Any:
    """A run: its noise, dry friction that the belief lacks, and a speed that is reported late."""
    chance = np.random.default_rng(seed)
    torque, speed = (size * chance.standard_normal(TIME.size) for size in (NOISE_NM, NOISE_RAD_S))
    along = SimpleNamespace(
        run=SimpleNamespace(step_s=1e-3, time_s=TIME, quiet=lambda values: values),
        motion_time_s=TIME, load_angle=np.cumsum(SPEED) * 1e-3, speed=SPEED, acceleration=ACCELERATION,
        torque=2e-2 * ACCELERATION, moves=np.abs(SPEED) > 0.5,
    )  # fmt: skip
    return SimpleNamespace(
        run=seed, along=along, missed_nm=-dry_nm * np.sign(SPEED) - torque,
        torque_noise_nm=np.full(TIME.size, NOISE_NM), speed_noise_rad_s=np.full(TIME.size, NOISE_RAD_S),
        missed_rad_s=speed - late_s * ACCELERATION if measured else None, injected_hz=(),
    )  # fmt: skip


@dataclass(frozen=True)
class Told:
    """As much of what is published as is asked."""

    verdict: str = "explained"
    axis: str = "rotary"
    in_file: tuple[str, ...] = ("something",)
    mismatch: tuple[Located, ...] = ()
    remainder: tuple[Located, ...] = ()


def located(**hidden: Any) -> tuple[Located, ...]:
    """What such runs miss; the file takes all of it."""
    runs: Any = [shown(seed, **hidden) for seed in range(6)]
    told: Any = Told()
    return with_places(told, runs, runs, 160.0).mismatch


@pytest.mark.parametrize(
    ("late_s", "dry_nm", "of", "coordinate"),
    [
        (LATE_S, 0.0, "speed", "acceleration"),
        (0.0, 1.0, "torque", "direction"),
        (LATE_S, 5.0, "torque", "direction"),
    ],
)
def test_it_is_where_more_is_missed_over_its_noise(
    late_s: float, dry_nm: float, of: Signal, coordinate: str
) -> None:
    first = located(late_s=late_s, dry_nm=dry_nm)[0]
    assert (first.of, first.coordinate) == (of, coordinate)
    assert ("of the reported speed" in first.text) == (of == "speed")


def test_without_a_measured_speed_it_is_the_torque() -> None:
    first = located(late_s=LATE_S, dry_nm=1.0, measured=False)[0]
    assert (first.of, first.coordinate) == ("torque", "direction")


def test_who_misses_it_is_said() -> None:
    """What the file leaves is no longer what the belief misses."""
    before, after = ([shown(seed, 0.0, dry_nm) for seed in range(6)] for dry_nm in (5.0, 1.0))
    told: Any = Told(verdict="partly_explained")
    found = with_places(told, before, after, 160.0)
    assert "what the belief misses" in found.mismatch[0].text
    assert "what the file misses" in found.remainder[0].text
