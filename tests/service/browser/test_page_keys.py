"""By keyboard alone, and for everybody's eyes: the whole wizard, focus that is seen, names of fields, contrast."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from page_process import Served, visiting

sync_api = pytest.importorskip("playwright.sync_api")
MOTIONS = re.compile(r"^\d+ motions, about")
ENABLED = ":not([aria-disabled])"
CONTRAST = (Path(__file__).parent / "contrast.js").read_text(encoding="utf-8").partition("\n() =>")
#: Whether a field says to everybody what it is.
NAMED = "e => e.getAttribute('aria-label') || (e.labels && e.labels.length)"
#: What has the focus: its accessible text, and whether it shows that it has it.
FOCUSED = """() => {
  const element = document.activeElement, style = getComputedStyle(element), field = element.closest('.q-field');
  const inner = element.querySelector('.q-checkbox__inner');
  const around = [field && field.querySelector('.q-field__control'), inner].filter(Boolean);
  const shown = [style, ...around.map((e) => getComputedStyle(e))];
  const label = element.labels && element.labels[0] ? element.labels[0].innerText : '';
  return {
    text: (element.getAttribute('aria-label') || label || element.innerText || '').trim(),
    seen: shown.some((s) => s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 2),
    tag: element.tagName,
  };
}"""


def _tab_to(page: Any, text: str, most: int = 60) -> None:
    """Tab until that has the focus; everything on the way has a name and shows that it has the focus."""
    for _ in range(most):
        page.keyboard.press("Tab")
        page.wait_for_function(f"() => ({FOCUSED})().seen || document.activeElement === document.body")
        found = page.evaluate(FOCUSED)
        assert found["text"], found
        if found["tag"] != "BODY" and text in found["text"]:
            return
    raise AssertionError(f"no way to {text}")


def _press(page: Any, word: str) -> None:
    page.locator(f"button:has-text('{word}'){ENABLED}").wait_for(timeout=90_000)
    _tab_to(page, word)
    page.keyboard.press("Enter")


#: What has the focus in the moment when a step's content appears, before anybody could press a key.
FOCUS_AT_ONCE = """() => {
  const noted = window.focus_at_once = [];
  const step = () => document.querySelector('[aria-current="step"]')?.innerText;
  const note = () => noted.push([step(), document.activeElement.getAttribute('aria-label')]);
  new MutationObserver(note).observe(document.querySelector('main'), {childList: true, subtree: true});
}"""


@pytest.mark.long
@pytest.mark.timeout(300)
def test_the_whole_wizard_by_keyboard(page: Any, served: Served) -> None:
    """And the focus comes with the step, not after it: a name that is typed at once is typed into its field, an S
    beside it would stop the machine."""
    page.goto(f"{served.url}/")
    page.get_by_role("link", name="Commission").first.wait_for()
    _tab_to(page, "Commission")
    page.keyboard.press("Enter")
    page.locator(f"button:has-text('Check the drive'){ENABLED}").wait_for()
    page.evaluate(FOCUS_AT_ONCE)
    _press(page, "Check the drive")
    _press(page, "Plan the motion")
    page.locator(f"button:has-text('Go on to confirm'){ENABLED}").wait_for(timeout=90_000)
    _tab_to(page, "Repeats")
    page.keyboard.press("Control+A")
    page.keyboard.type("50")  # minutes: it is cancelled before it ends
    before = page.get_by_text(MOTIONS).inner_text()
    _press(page, "Predict")
    sync_api.expect(page.get_by_text(MOTIONS)).not_to_have_text(before, timeout=90_000)
    _press(page, "Go on to confirm")
    page.get_by_text("What will happen").wait_for()
    _tab_to(page, "Your name")
    page.keyboard.press("Control+A")
    page.keyboard.type("Susi Stopless")  # an S that is typed stops nothing
    for mark in ("Nobody is in reach", "I see the machine"):
        _tab_to(page, mark)
        page.keyboard.press("Space")
    _press(page, "Move the machine")
    page.get_by_text("Cancel, and stop the drive").wait_for(timeout=90_000)
    assert not served.call("GET", "/api/stop")["stopped"]
    seen = page.evaluate("window.focus_at_once")
    first = {step.split()[-1]: focus for step, focus in reversed(seen)}
    assert [first.get(step) for step in ("Check", "Plan", "Confirm", "Run")] == ["steps"] * 4, seen
    _press(page, "Cancel, and stop the drive")
    page.get_by_text("Plan anew").wait_for()
    done = served.commissioned()  # one that was left to its end
    page.goto(f"{served.url}/commission/{served.drive_id}?run={done}")
    page.get_by_text("The verdict").wait_for()
    _press(page, "Go on to the export")
    page.get_by_text("What changes in the drive").wait_for()
    page.keyboard.press("s")  # and one that is not typed anywhere stops
    page.get_by_text("STOPPED", exact=True).wait_for()
    served.call("POST", "/api/release")
    assert page.troubles == []


@pytest.mark.long
@pytest.mark.timeout(240)
def test_every_text_can_be_read_nothing_is_wider_than_a_phone_or_asked_of_another_host(
    browser: Any, served: Served
) -> None:
    """Each page loaded in one theme and turned into the other, in turns."""
    served.commissioned()
    done = [run for run in served.call("GET", "/api/runs?limit=100") if run["state"] == "done"]
    runs = {run["kind"]: run["id"] for run in done if run["kind"] in ("plan", "commission", "doctor")}
    pages = ["/", "/runs", "/compare", "/machines", "/files", "/trail", "/add", f"/drive/{served.drive_id}"]
    themes = ["light", "dark"]
    with visiting(browser, served, color_scheme="light", reduced_motion="reduce") as page:
        for path in (*pages, *(f"/run/{run}" for run in runs.values())):
            page.goto(served.url + path)
            page.locator("h1").wait_for()  # all comes at once with it
            assert page.locator("h1").count() == 1
            for theme in themes:
                page.emulate_media(color_scheme=theme, reduced_motion="reduce")
                page.wait_for_function(f"document.documentElement.dataset.theme === '{theme}'")
                found = page.evaluate(f"() =>{CONTRAST[2]}")
                assert found["count"] > 10
                assert found["poor"] == [], (path, theme)
            themes.reverse()
            _fits_a_phone(page, path)
            for field in page.locator("input:visible, select:visible").all():
                assert field.evaluate(NAMED), path
        own = urlsplit(served.url).hostname
        asked = {urlsplit(url).hostname for url in page.asked if not url.startswith(("data:", "blob:"))}
        assert asked == {own}
        assert page.troubles == []


def _fits_a_phone(page: Any, path: str) -> None:
    page.set_viewport_size({"width": 390, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390, path
    stop = page.locator("#stop").bounding_box()
    assert stop["x"] + stop["width"] <= 390
    page.set_viewport_size({"width": 1280, "height": 900})
