"""The page of an explanation: what each verdict shows, in which words, safely."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest
from explanation_samples import COULOMB, COULOMB_NM, NOISE_NM, OTHERS, consistent, explained, session

from schwung.drivetrain.machine import paper_machine
from schwung.explain.terms import LIBRARY
from schwung.explain.values import Explanation
from schwung.explain.words import PHYSICS, told_apart_by, words_of
from schwung.report.explanation import (
    ExplanationContent,
    explanation_pictures,
    finding_row,
    headline,
    render_explanation,
    separations,
    write_explanation,
)

LOCAL = next(effect for effect in OTHERS if effect.physics == "local_friction")


def _content(explanation: Explanation) -> ExplanationContent:
    return ExplanationContent("A <press>", explanation, paper_machine(), session(), 'name = "a & b"\n')


def _headings(page: str) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", page)


@pytest.mark.usefixtures("undrawn")
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


@pytest.mark.usefixtures("undrawn")
def test_an_unexplained_session_says_where_and_names_nothing() -> None:
    explanation = explained((), "unexplained", unnamed=(LOCAL,))
    page = render_explanation(_content(explanation))
    assert 'class="verdict unusable"' in page
    assert "Where it is missing" in _headings(page)
    assert "What was left out" not in _headings(page)
    assert "position, 0.9 … 1.5 rad" in headline(explanation)
    assert "no term of the library accounts for them" in headline(explanation)


@pytest.mark.usefixtures("undrawn")
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
    assert {effect.physics for effect in effects} == {
        *LIBRARY,
        "periodic_disturbance",
        "measurement_delay",
    } & set(PHYSICS)
    law = [number for number, effect in enumerate(effects) if words_of(effect.physics).view == "wind_up"]
    drawn = [picture.name for picture in explanation_pictures(_content(explained(effects)))]
    named = [name for name in drawn if name.startswith(("term", "coupling"))]
    assert named == [*(f"term{i}" for i in range(24) if i not in law), "coupling"]


def test_a_pair_that_cannot_be_told_apart_is_named_once_with_the_motion_that_would() -> None:
    stribeck = replace(OTHERS[0], like=("coulomb_friction",))
    (line,) = separations(explained((COULOMB, stribeck)))
    assert "stribeck_friction" in line
    assert told_apart_by("stribeck_friction", "coulomb_friction") in line
    assert told_apart_by("coulomb_friction", "stribeck_friction") == told_apart_by(
        "stribeck_friction", "coulomb_friction"
    )


def test_a_row_for_the_terminal_is_the_one_of_the_page() -> None:
    finding = explained().findings[0]
    row = finding_row(finding)
    assert row[0] == "Dry friction\ncoulomb_friction"
    assert row[2] == "speed, −12 … 12 rad/s\n90 % of the mismatch, p\u00a0<\u00a00.001"
    assert row[3] == "dry friction that falls with speed near standstill"
