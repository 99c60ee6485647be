"""Motions through points: straight accelerations between them, the way back, and what is no stroke."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from schwung.motion import Motion


def of_cubic(n: int = 5) -> tuple[tuple[float, float, float], ...]:
    """3u² − 2u³, whose acceleration is straight: a few points have all of it."""
    u = np.linspace(0, 1, n)
    return tuple(zip(3 * u**2 - 2 * u**3, 6 * u * (1 - u), 6 - 12 * u, strict=True))


def motion(**changes: object) -> Motion:
    arguments = {"kind": "points", "distance_rad": 2.0, "duration_s": 0.5, "points": of_cubic(), **changes}
    return Motion.model_validate(arguments)


def test_between_points_the_cubic_is_exact() -> None:
    time = np.linspace(0.1, 0.6, 401)
    u = (time - 0.1) / 0.5
    demand = motion().demand(time)
    np.testing.assert_allclose(demand.position_rad, 2 * (3 * u**2 - 2 * u**3), atol=1e-12)
    np.testing.assert_allclose(demand.speed_rad_s[:-1], 2 / 0.5 * (6 * u * (1 - u))[:-1], atol=1e-12)
    np.testing.assert_allclose(demand.acceleration_rad_s2[:-1], 2 / 0.25 * (6 - 12 * u)[:-1], atol=1e-9)


def test_the_way_back_is_the_way_there_turned_round_in_time_or_its_own() -> None:
    early = ((0.0, 0.0, 6.0), (0.6875, 1.875, 1.5), (1.0, 0.0, -9.0))
    with pytest.raises(ValidationError, match="straight accelerations"):
        motion(points=early)
    skew = ((0.0, 0.0, 12.0), (0.5625, 1.5, -6.0), (1.0, 0.0, 0.0))
    points = _consistent(skew)
    turned = motion(points=points)
    there = turned.demand(np.linspace(0.1, 0.6, 101)).position_rad
    back = turned.demand(turned.stroke_starts_s[1] + np.linspace(0, 0.5, 101)).position_rad
    np.testing.assert_allclose(back, there[::-1], atol=1e-12)
    own = motion(points=points, points_back=of_cubic())
    halfway = own.demand(np.array([own.stroke_starts_s[1] + 0.25])).position_rad
    assert halfway[0] == pytest.approx(1.0)


def _consistent(rough: tuple[tuple[float, float, float], ...]) -> tuple[tuple[float, float, float], ...]:
    """Accelerations of a stroke that begins hard and ends softly, integrated, and scaled to rest and one stroke."""
    u, first = np.linspace(0, 1, 9), np.interp(np.linspace(0, 1, 9), [0, 0.5, 1], [row[2] for row in rough])
    acceleration = first - 2 * np.trapezoid(first, u) * u  # ends at rest
    speed = np.concatenate([[0], np.cumsum((acceleration[1:] + acceleration[:-1]) / 2 * np.diff(u))])
    step = u[1]
    rise = step * speed[:-1] + step**2 * (acceleration[:-1] / 3 + acceleration[1:] / 6)
    share = np.concatenate([[0], np.cumsum(rise)])
    return tuple(zip(share / share[-1], speed / share[-1], acceleration / share[-1], strict=True))


def test_one_way_and_its_way_back_are_the_same_as_both_in_one() -> None:
    points = _consistent(((0.0, 0.0, 12.0), (0.5, 1.0, -6.0), (1.0, 0.0, 0.0)))
    both = motion(points=points)
    alone = both.model_copy(update={"returns": False}).way_back()
    u = np.linspace(0, 0.5, 51)
    single = 2.0 + alone.demand(alone.start_time_s + u).position_rad
    np.testing.assert_allclose(both.demand(both.stroke_starts_s[1] + u).position_rad, single, atol=1e-12)


def test_it_survives_json_and_the_analytic_kinds_have_no_points() -> None:
    made = motion(points_back=of_cubic(9))
    assert Motion.model_validate_json(made.model_dump_json()) == made
    assert "points" not in Motion(kind="third", distance_rad=1.0, duration_s=0.1).model_dump()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"points": None}, "points are given with the kind"),
        ({"kind": "third"}, "points are given with the kind"),
        ({"points": of_cubic()[:1]}, "rest at both ends"),
        ({"points": of_cubic()[:-1]}, "rest at both ends"),
        ({"points": tuple((a, b, 2 * c) for a, b, c in of_cubic())}, "straight accelerations"),
        ({"points": tuple((a, b, float("nan")) for a, b, c in of_cubic())}, "finite"),
    ],
)
def test_what_is_no_stroke_is_refused(changes: dict[str, object], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        motion(**changes)


def test_the_cycloid_is_an_inclined_sine() -> None:
    made = Motion(kind="cycloid", distance_rad=1.0, duration_s=1.0, start_time_s=0.0)
    u = np.linspace(0, 1, 1001)
    demand = made.demand(u)
    np.testing.assert_allclose(np.gradient(demand.position_rad, u)[1:-1], demand.speed_rad_s[1:-1], atol=1e-4)
    assert np.max(demand.acceleration_rad_s2) == pytest.approx(2 * np.pi, rel=1e-4)
