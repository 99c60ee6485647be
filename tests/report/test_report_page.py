"""The page: complete, self-contained, safe, and without holes."""

from __future__ import annotations

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from report_samples import bare, estimated, full, session

from schwung.drivetrain.inertia import InertiaTable
from schwung.errors import InputError
from schwung.estimation import Verdict
from schwung.estimation.reach import Reach
from schwung.report.colours import PALETTE
from schwung.report.content import ChangeRow, FollowingError
from schwung.report.html import render, write_report

_VOID = {"meta", "br", "link", "img"}


class _Page(HTMLParser):
    """Checks the nesting and collects what a reader sees outside the pictures."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.attributes: list[tuple[str, str]] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.headings: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in _VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in _VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" not in self.open:
            self.text.append(data)
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


@pytest.fixture(scope="module")
def page() -> str:
    return render(full())


@pytest.fixture(scope="module")
def parsed(page: str) -> _Page:
    return _Page(page)


def test_nesting_is_sound_and_every_id_is_used_once(parsed: _Page) -> None:
    assert parsed.open == []
    assert len(parsed.ids) == len(set(parsed.ids)) > 0


def test_pictures_are_well_formed_and_named(page: str) -> None:
    drawn = re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL)
    assert len(drawn) == 7
    for svg in drawn:
        ET.fromstring(svg.replace("xlink:href", "href"))
        assert 'role="img" aria-label="' in svg


def test_nothing_is_fetched_and_nothing_runs(page: str, parsed: _Page) -> None:
    assert parsed.tags.isdisjoint({"script", "link", "iframe", "object", "img", "base", "form"})
    outside = [
        (name, value)
        for name, value in parsed.attributes
        if (name in ("src", "href", "xlink:href", "srcset") and not value.startswith("#"))
        or name.startswith("on")
    ]
    assert outside == []
    assert set(re.findall(r"url\((.)", page)) == {"#"}
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_hostile_text_is_shown_as_text(page: str, parsed: _Page) -> None:
    seen = " ".join(parsed.text)
    for text in (
        "Press <7> & friends",
        "<script>alert(1)</script>",
        "Move more <slowly>.",
        "exported & read back",
        "cyclic <position>",
        "Mind the <gap>.",
        "true <i>inertia</i> at $5 & $6",
    ):
        assert text in seen
    assert "<script" not in page
    assert "<gap>" not in page


def test_everything_given_has_its_place(parsed: _Page) -> None:
    assert parsed.headings == [
        "What the export brought",
        "Is it steady?",
        "Is it linear?",
        "What was commanded",
        "What was recorded",
        "What the injection alone has caused",
        "Preflight",
        "Parameters changed in the drive",
        "SYNC timing",
        "Settings",
        "Drive",
        "Believed machine",
        "Notes",
    ]
    seen = " ".join(parsed.text)
    assert "csp, pp" in seen
    assert "motor inertia, kg·m²" in seen
    assert "1.2 ms" in seen  # the worst SYNC
    for reason in estimated().trust.reasons:
        assert reason[1:] in seen


def test_missing_parts_leave_no_holes() -> None:
    parsed = _Page(render(bare()))
    assert parsed.headings == ["What was commanded", "What was recorded", "Drive"]
    seen = " ".join(parsed.text)
    assert "No estimate" in seen
    for hole in ("None", "nan", "MIV", "RMSE"):
        assert hole not in seen


def test_an_empty_session_is_still_a_page() -> None:
    content = replace(bare(), session=replace(session(), runs=(), drive=None))
    parsed = _Page(render(content))
    assert parsed.open == []
    assert parsed.headings == []


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("verdict", ["good", "doubtful", "unusable"])
def test_the_verdict_stands_at_the_top_in_words(verdict: Verdict) -> None:
    judged = replace(estimated(), trust=replace(estimated().trust, verdict=verdict), denoised=())
    page = render(replace(bare(), session=replace(session(), runs=()), estimate=judged))
    assert f'class="verdict {verdict}"' in page
    assert page.index(verdict.capitalize() + ":") < page.index("<svg")


@pytest.mark.usefixtures("undrawn")
def test_rmse_is_that_of_the_table_to_the_reference() -> None:
    table = estimated().table
    shifted = InertiaTable(table.position_rad, table.inertia_kgm2 + 0.0025)
    seen = " ".join(_Page(render(replace(bare(), estimate=estimated(), reference=shifted))).text)
    assert "0.0025 kg·m²" in seen
    assert "largest 0.0025" in seen


def test_a_reference_over_other_angles_is_left_out() -> None:
    elsewhere = InertiaTable(np.array([50.0, 51.0]), np.array([0.1, 0.1]))
    page = render(replace(bare(), estimate=estimated(), reference=elsewhere, reference_label="CAD"))
    assert "RMSE" not in page
    assert "CAD" not in page


def test_a_long_table_scrolls_and_a_note_is_told_once() -> None:
    changes = tuple(ChangeRow(f"0x2300:{number:02X} Inertia", "0", str(number)) for number in range(1, 65))
    content = replace(
        bare(), session=replace(session(), runs=()), changes=changes, notes=("Twice.", "Twice.")
    )
    page = render(content)
    assert 'class="wide long"' in page
    assert "0x2300:40 Inertia" in page
    assert page.count("Twice.") == 1


@pytest.mark.usefixtures("undrawn")
def test_a_worse_following_error_is_said_plainly() -> None:
    time = np.array([0.0, 1.0])
    errors = FollowingError(time, np.array([0.001, 0.001]), time, np.array([0.002, -0.002]))
    assert errors.improvement == pytest.approx(0.5)
    assert "grown 2-fold: do not keep this table" in render(replace(bare(), following_error=errors))


def test_following_errors_of_two_lengths_are_refused() -> None:
    with pytest.raises(InputError, match="2 instants for 1 values"):
        FollowingError(np.zeros(2), np.zeros(1), np.zeros(1), np.zeros(1))


def test_a_linear_axis_has_its_own_units() -> None:
    unspoken = replace(estimated(), trust=replace(estimated().trust, reasons=()), notes=())
    content = replace(bare(), session=replace(session(), axis="linear"), estimate=unspoken)
    seen = " ".join(_Page(render(content)).text)
    assert "Load mass, kg" in seen
    assert "Motor force, N" in seen
    for rotary in ("rad", "N·m", "kg·m²", "°", "torque", "inertia"):
        assert rotary not in seen


def test_colours_follow_the_readers_theme(page: str) -> None:
    for svg in re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL):
        assert re.findall(r"#[0-9a-f]{6}\b", svg) == []
        assert set(re.findall(r"var\(--(\w+)\)", svg)) <= {colour.name for colour in PALETTE}
    assert "@media screen and (prefers-color-scheme:dark)" in page  # on paper it stays light


def test_the_same_content_gives_the_same_file(page: str) -> None:
    assert render(full()) == page


@pytest.mark.usefixtures("undrawn")
def test_the_file_is_written_whole_into_a_new_folder(tmp_path: Path) -> None:
    path = write_report(bare(), tmp_path / "new" / "report.html")
    assert path.read_text("utf-8") == render(bare())
    assert [entry.name for entry in path.parent.iterdir()] == ["report.html"]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file.*cannot be made"):
        write_report(bare(), tmp_path / "file" / "report.html")


def test_pyplot_is_never_loaded() -> None:
    code = "import sys, schwung.report; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.usefixtures("undrawn")
def test_the_bound_stands_beside_the_band(page: str) -> None:
    told = render(replace(full(), reach=Reach(0.0010, 0.0001, "denoised")))
    assert "±0.001 kg·m²" in told
    assert "at best ±0.0001 from this recording" in told
    assert "a better method would tell more" in told
    assert "at best" not in page


@pytest.mark.usefixtures("undrawn")
def test_an_estimate_without_traces_has_a_page_all_the_same(page: str) -> None:
    estimate = replace(estimated(), traces=(), denoised=())
    without = render(replace(full(), estimate=estimate, contrast=None))
    assert "Is it steady?" in page
    assert "Is it steady?" not in without
    assert ">MIV<" not in without
