"""The page in a browser, against the bench over a real socket: the whole way of a commissioning, and STOP."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest
from page_process import Served, visiting

from schwung.cli.demo import BELIEF

#: From click to frame: the aim is 100 ms (benchmarks/service_stop.py measures it); a computer that tests something
#: else meanwhile gets ten times that.
STOP_WITHIN_S = 1.0
ENABLED = ":not([aria-disabled])"


def _until(found: Callable[[], Any], within_s: float, page: Any) -> Any:
    end = time.monotonic() + within_s
    while not (value := found()):
        assert time.monotonic() < end, "it does not come"
        page.wait_for_timeout(20)
    return value


def _to_confirm(page: Any, served: Served) -> None:
    page.goto(f"{served.url}/")
    page.get_by_role("link", name="Commission").first.click()
    page.click(f"button:has-text('Check the drive'){ENABLED}")
    later = page.locator(
        f"button:has-text('Plan the motion'){ENABLED}, button:has-text('Go on to confirm'){ENABLED}"
    )
    later.first.wait_for(timeout=90_000)
    if page.locator("button:has-text('Plan the motion')").count():
        page.click("button:has-text('Plan the motion')")
    page.click(f"button:has-text('Go on to confirm'){ENABLED}", timeout=90_000)


@pytest.mark.long
@pytest.mark.timeout(300)  # half a minute on a computer that has nothing else to do
def test_the_whole_wizard(page: Any, served: Served) -> None:
    _to_confirm(page, served)
    move = page.locator("button:has-text('Move the machine')")
    assert move.get_attribute("aria-disabled") == "true"  # nobody has said yet that it may
    move.click(force=True)
    assert page.locator("text=What will happen").count() == 1
    page.get_by_label("Your name").fill("Wizard Tester")
    page.click("text=Nobody is in reach")
    page.click("text=I see the machine")
    page.click(f"button:has-text('Move the machine'){ENABLED}")
    page.locator(".sw-scope canvas").wait_for()
    _until(
        lambda: page.evaluate("Number(document.querySelector('.sw-scope')?.dataset.frames || 0)"), 20, page
    )
    page.get_by_text("The verdict").wait_for(timeout=90_000)
    assert page.locator(".sw-verdict").first.inner_text().split()[0] in ("good", "doubtful")
    assert "/commission/" in page.url
    assert "run=" in page.url  # whoever loads it again comes back to this
    page.reload()
    page.get_by_text("The verdict").wait_for(timeout=60_000)
    _export(page)
    page.goto(f"{served.url}/trail")
    assert page.get_by_text("Wizard Tester").count() == 3  # moved; asked for the export; what was written


def _export(page: Any) -> None:
    page.click("button:has-text('Go on to the export')")
    page.get_by_text("What changes in the drive").wait_for()
    assert page.get_by_text("0x2300:01 Inertia table").count() == 1
    assert page.get_by_text("kg·m²").count() > 60  # each with its unit
    write = page.locator("button:has-text('Write into the drive')")
    assert write.get_attribute("aria-disabled") == "true"
    page.get_by_label("Your name").fill("Wizard Tester")
    page.click("text=I have read what will be written")
    page.click(f"button:has-text('Write into the drive'){ENABLED}")
    page.get_by_text("read back equal").wait_for()


@pytest.mark.long
@pytest.mark.parametrize("way", ["pointer", "Escape", "s"])
def test_stop_reaches_the_bus(page: Any, served: Served, way: str) -> None:
    run = served.begin_motion()
    page.goto(f"{served.url}/commission/{served.drive_id}?run={run['id']}")
    page.locator(".sw-scope canvas").wait_for()
    served.watch.begin()
    page.evaluate("window.pressed.length = 0")
    began = time.time()
    if way == "pointer":
        page.click("#stop")
        began = page.evaluate("window.pressed[0]")
    else:
        page.keyboard.press(way)
    stopped = _until(lambda: served.watch.stopped_s, 20, page)
    assert stopped - began < STOP_WITHIN_S
    assert served.ended(run["id"])["state"] == "cancelled"
    page.get_by_text("STOPPED", exact=True).wait_for()  # and it says so until somebody releases it
    page.click("button:has-text('release')")
    _until(lambda: not served.call("GET", "/api/stop")["stopped"], 20, page)


@pytest.mark.long
def test_stop_works_while_the_page_hangs(page: Any, served: Served) -> None:
    """Neither the page's socket nor its framework has any part in it."""
    run = served.begin_motion()
    page.goto(f"{served.url}/commission/{served.drive_id}?run={run['id']}")
    page.locator(".sw-scope canvas").wait_for()
    page.evaluate("window.socket && window.socket.disconnect(); document.querySelector('#app').remove()")
    served.watch.begin()
    page.click("#stop")
    assert _until(lambda: served.watch.stopped_s, 20, page)
    page.get_by_text("Stopped · answered in").wait_for()
    served.ended(run["id"])
    served.call("POST", "/api/release")


@pytest.mark.long
def test_stop_is_first_in_tab_order_and_says_when_nobody_answers(page: Any, served: Served) -> None:
    page.goto(f"{served.url}/")
    page.locator("h1").wait_for()
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "stop"
    page.route("**/*stop", lambda route: route.abort())
    page.click("#stop")
    page.get_by_text("Use the emergency stop").wait_for()
    page.unroute("**/*stop")
    page.troubles.clear()  # the browser has told of the requests that were cut
    assert not served.call("GET", "/api/stop")["stopped"] or served.call("POST", "/api/release")


def test_without_the_token_one_may_look_and_stop(browser: Any, served: Served) -> None:
    with visiting(browser, served, logged_in=False) as page:
        page.goto(f"{served.url}/")
        page.get_by_text("needs the token").wait_for()
        page.goto(f"{served.url}/commission/{served.drive_id}")
        page.get_by_text("Position").wait_for()  # the drive has answered
        assert page.locator(f"button:has-text('Check the drive'){ENABLED}").count() == 0
        page.click("#stop")
        _until(lambda: served.call("GET", "/api/stop")["stopped"], 20, page)
        assert page.locator("button:has-text('release')").count() == 0
        served.call("POST", "/api/release")


def test_what_a_stranger_writes_is_text(page: Any, served: Served) -> None:
    served.call("POST", "/api/machines", {"name": "<img src=x onerror=alert(1)>", "toml": BELIEF})
    page.goto(f"{served.url}/machines")
    page.get_by_text("<img src=x").wait_for()
    assert page.locator("img[src=x]").count() == 0
