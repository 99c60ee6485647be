"""Explanations in words: values, places and runs, and what each physics name is called."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from schwung.drivetrain.effects import PHYSICS as CONTRACT
from schwung.explain.values import Located, Quantity
from schwung.explain.words import PHYSICS, told_apart_by, words_of
from schwung.report.wording import label_of, place_of, runs_text, value_text


def test_every_physics_of_the_contract_has_words() -> None:
    assert set(CONTRACT) == {*PHYSICS, "residual"}  # which says of its curve what it is


def test_the_manual_has_the_same_words() -> None:
    manual = (Path(__file__).parents[2] / "docs" / "explain.md").read_text("utf-8")
    for physics, words in PHYSICS.items():
        assert f"| `{physics}` | {words.name} | {words.shown_by} |" in manual
    for one, other in re.findall(r"\| `(\w+)` \| `(\w+)` \|", manual):
        assert f"| `{one}` | `{other}` | {told_apart_by(one, other)} |" in manual


def test_a_name_from_a_later_version_is_shown_as_it_is() -> None:
    assert words_of("moon_phase").name == "moon phase"
    assert "the same stroke" in told_apart_by("moon_phase", "sun_spots")


@pytest.mark.parametrize(
    ("quantity", "text"),
    [
        (Quantity(2.1034, "N·m", (2.04, 2.16)), "2.10 N·m (2.04 … 2.16)"),
        (Quantity(-3.16, "N", (-3.4, -2.9)), "−3.2 N (−3.4 … −2.9)"),
        (Quantity(24963.0, "N·m/rad", (24100.0, 25800.0)), "25000 N·m/rad (24100 … 25800)"),
        (Quantity(0.0015, "s", (0.00147, 0.00154)), "1.50 ms (1.47 … 1.54)"),
        (Quantity(3.1e9, "N·m/rad³", (2.9e9, 3.3e9)), "3.1·10⁹ N·m/rad³ (2.9·10⁹ … 3.3·10⁹)"),
        (Quantity(0.93, "1", (0.92, 0.94)), "0.930 (0.920 … 0.940)"),
        (Quantity(24.0, "1/rev", (23.98, 24.03)), "24.00 per turn (23.98 … 24.03)"),
        (Quantity(5.0, "N·m", None), "5 N·m"),
        (Quantity(5.0, "N·m", (float("-inf"), float("inf"))), "5.0000 N·m (−∞ … ∞)"),
        (Quantity(((0.0, -1.0), (1.0, 4.5)), "N·m", None), "2 points, −1 … 4.5 N·m"),
    ],
)
def test_values_have_the_digits_that_their_interval_deserves(quantity: Quantity, text: str) -> None:
    assert value_text(quantity).replace("\u00a0", " ") == text


@pytest.mark.parametrize(
    ("key", "label"),
    [
        ("torque_nm", "torque"),
        ("stribeck_speed_rad_s", "stribeck speed"),
        ("coefficient_nms2", "coefficient"),
        ("cubic_nm_rad3", "cubic"),
        ("time_constant_s", "time constant"),
        ("order", "order"),
        ("torque_positive_nm", "torque positive"),
    ],
)
def test_keys_lose_their_unit(key: str, label: str) -> None:
    assert label_of(key) == label


def test_places_and_runs_in_words() -> None:
    def located(coordinate: Any, low: float, high: float, unit: str) -> Located:
        return Located(coordinate, (low, high), unit, 0.5, 0.01, "")

    assert place_of(located("speed", -0.5, 0.5, "rad/s")) == "speed, −0.5 … 0.5 rad/s"
    assert place_of(located("direction", -1, -1, "1")) == "direction of motion, backward"
    assert place_of(located("direction", -1, 1, "1")) == "direction of motion"
    assert place_of(located("run", 0, 5, "1")) == "number of the run, 0 … 5"
    assert runs_text([7, 0, 1, 2, 3, 5, 8]) == "0–3, 5, 7, 8"
    assert runs_text([]) == "none"


def test_no_pair_is_without_a_remedy() -> None:
    names = list(PHYSICS)
    for one in names:
        for other in names:
            if one != other:
                sentence = told_apart_by(one, other)
                assert sentence.endswith(".")
                assert sentence[0].isupper()
                assert "torque" not in told_apart_by(one, other, linear=True)
