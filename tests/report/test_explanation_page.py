"""The page of an explanation: what each verdict shows, in which words, safely."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from explanation_samples import COULOMB, COULOMB_NM, NOISE_NM, OTHERS, consistent, explained, session

from schwung.drivetrain.machine import paper_machine
from schwung.drivetrain.physics import PHYSICS as CONTRACT
from schwung.explain.terms import LIBRARY
from schwung.explain.values import Explanation, Located, Quantity
from schwung.explain.words import PHYSICS, told_apart_by, words_of
from schwung.report.explanation import (
    ExplanationContent,
    explanation_pictures,
    finding_row,
    headline,
    label_of,
    place_of,
    render_explanation,
    runs_text,
    separations,
    value_text,
    write_explanation,
)

LOCAL = next(effect for effect in OTHERS if effect.physics == "local_friction")


def _content(explanation: Explanation) -> ExplanationContent:
    return ExplanationContent("A <press>", explanation, paper_machine(), session(), 'name = "a & b"\n')


def _headings(page: str) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", page)


def test_an_explained_session_shows_everything_in_order() -> None:
    page = render_explanation(_content(explained()))
    assert _headings(page) == [
        "What was left out", "What cannot be told apart", "Before and after", "Where it is missing",
        "Dry friction, over speed", "The proof", "What the mismatch follows", "Notes", "The learned machine",
    ]  # fmt: skip
    assert 'class="verdict good"' in page
    assert "torque: 4.00 N·m (3.92\u00a0…\u00a04.10)" in page
    assert "coulomb_friction" in page
    assert "Drive the same stroke several times slower" in page
    assert "kept aside; chosen and fitted on 0–3" in page


def test_nothing_is_fetched_nothing_runs_and_text_stays_text() -> None:
    page = render_explanation(_content(explained()))
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "A &lt;press&gt;" in page
    assert "a &amp; b" in page
    assert "rests on &lt;one&gt; pair" in page
    assert not re.findall(r'(?:src|href)="(?!#)', page)
    assert "default-src 'none'" in page
    for svg in re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL):
        ET.fromstring(svg.replace("xlink:href", "href"))
    ids = re.findall(r'\bid="([^"]*)"', page)
    assert len(ids) == len(set(ids)) > 0


def test_a_consistent_session_has_a_short_page() -> None:
    page = render_explanation(_content(consistent()))
    assert _headings(page) == ["Measured and believed", "The proof", "Notes", "The learned machine"]
    assert "no more than the noise floor" in page
    assert "belief + physics" not in page
    assert "Nothing was learned" in page


def test_an_unexplained_session_says_where_and_names_nothing() -> None:
    explanation = explained((), "unexplained", unnamed=(LOCAL,))
    page = render_explanation(_content(explanation))
    assert 'class="verdict unusable"' in page
    assert "Where it is missing" in _headings(page)
    assert "What was left out" not in _headings(page)
    assert "position, 0.9 … 1.5 rad" in headline(explanation)
    assert "no term of the library accounts for them" in headline(explanation)


def test_a_partly_explained_session_shows_what_is_left() -> None:
    explanation = explained((COULOMB,), "partly_explained", unnamed=(LOCAL,))
    page = render_explanation(_content(explanation))
    assert 'class="verdict doubtful"' in page
    assert "What is left" in _headings(page)
    assert "what is left lies over position, 0.9 … 1.5 rad" in page


def test_the_headline_has_both_errors_and_the_floor() -> None:
    explanation = explained()
    fit = explanation.fit
    assert fit.before.torque_rmse_nm == pytest.approx((COULOMB_NM**2 + NOISE_NM**2) ** 0.5, rel=0.02)
    assert fit.after.torque_rmse_nm == pytest.approx(NOISE_NM, rel=0.1)
    words = headline(explanation)
    assert words.startswith("the belief leaves out dry friction; with it the error falls from 4.0")
    assert words.endswith("(noise floor 0.25 N·m)")
    assert "with them" in headline(explained((COULOMB, LOCAL)))
    assert "dry friction and a tight spot" in headline(explained((COULOMB, LOCAL)))


def test_a_linear_axis_speaks_of_force_and_newtons() -> None:
    explanation = replace(explained(), axis="linear")
    page = render_explanation(_content(explanation))
    assert "Motor force, N<" in page
    assert "force: 4.00" in page
    assert "Motor torque" not in page


def test_a_page_without_pictures_or_session_still_stands(tmp_path: Path) -> None:
    explanation = replace(explained(), overlays=())
    path = write_explanation(
        ExplanationContent("t", explanation, paper_machine()), tmp_path / "new" / "e.html"
    )
    assert _headings(path.read_text("utf-8")) == [
        "What was left out", "What cannot be told apart", "The proof", "What the mismatch follows", "Notes",
    ]  # fmt: skip


def test_every_physics_of_the_contract_has_words_and_a_picture() -> None:
    effects = (COULOMB, *OTHERS)
    assert set(CONTRACT) == {*PHYSICS, "residual"}  # which says of its curve what it is
    assert {effect.physics for effect in effects} == {
        *LIBRARY,
        "periodic_disturbance",
        "measurement_delay",
    } & set(PHYSICS)
    law = [number for number, effect in enumerate(effects) if words_of(effect.physics).view == "wind_up"]
    drawn = [picture.name for picture in explanation_pictures(_content(explained(effects)))]
    named = [name for name in drawn if name.startswith(("term", "coupling"))]
    assert named == [*(f"term{i}" for i in range(24) if i not in law), "coupling"]


def test_the_manual_has_the_same_words() -> None:
    manual = (Path(__file__).parents[2] / "docs" / "explain.md").read_text("utf-8")
    for physics, words in PHYSICS.items():
        assert f"| `{physics}` | {words.name} | {words.shown_by} |" in manual
    for one, other in re.findall(r"\| `(\w+)` \| `(\w+)` \|", manual):
        assert f"| `{one}` | `{other}` | {told_apart_by(one, other)} |" in manual


def test_a_name_from_a_later_version_is_shown_as_it_is() -> None:
    assert words_of("moon_phase").name == "moon phase"
    assert "the same stroke" in told_apart_by("moon_phase", "sun_spots")


# ---------------------------------------------------------------------------------------------- words


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


def test_a_pair_that_cannot_be_told_apart_is_named_once_with_the_motion_that_would() -> None:
    stribeck = replace(OTHERS[0], like=("coulomb_friction",))
    (line,) = separations(explained((COULOMB, stribeck)))
    assert "stribeck_friction" in line
    assert told_apart_by("stribeck_friction", "coulomb_friction") in line
    assert told_apart_by("coulomb_friction", "stribeck_friction") == told_apart_by(
        "stribeck_friction", "coulomb_friction"
    )


def test_no_pair_is_without_a_remedy() -> None:
    names = list(PHYSICS)
    for one in names:
        for other in names:
            if one != other:
                sentence = told_apart_by(one, other)
                assert sentence.endswith(".")
                assert sentence[0].isupper()
                assert "torque" not in told_apart_by(one, other, linear=True)


def test_a_row_for_the_terminal_is_the_one_of_the_page() -> None:
    finding = explained().findings[0]
    row = finding_row(finding)
    assert row[0] == "Dry friction\ncoulomb_friction"
    assert row[2] == "speed, −12 … 12 rad/s\n90 % of the mismatch, p\u00a0<\u00a00.001"
    assert row[3] == "dry friction that falls with speed near standstill"
