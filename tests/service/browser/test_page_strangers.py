"""Two people, a page loaded again in the middle of a run, an old token: nobody is surprised by a machine."""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import urlsplit

import pytest
from page_process import Served, visiting

from schwung.service.guard import COOKIE

sync_api = pytest.importorskip("playwright.sync_api")
ENABLED = ":not([aria-disabled])"


@pytest.mark.long
@pytest.mark.timeout(240)
def test_who_confirms_while_another_moves_is_told_and_waits(browser: Any, page: Any, served: Served) -> None:
    asked = {"kind": "propose_bode", "drive_id": served.drive_id, "angles_rad": [0.0]}
    proposed = served.ended(served.call("POST", "/api/runs", asked)["id"])
    assert proposed["state"] == "done", proposed
    with visiting(browser, served) as second:
        second.goto(f"{served.url}/run/{proposed['id']}")
        second.get_by_label("Your name").fill("Second")
        for mark in second.get_by_role("checkbox").all():
            mark.click()
        move = second.locator("button:has-text('Move the machine')")
        second.locator(f"button:has-text('Move the machine'){ENABLED}").wait_for()
        run = served.begin_motion()
        told = re.compile("Commissioning of tests goes on there")
        sync_api.expect(move).to_have_attribute("title", told, timeout=10_000)
        assert move.get_attribute("aria-disabled") == "true"
    address = f"{served.url}/commission/{served.drive_id}?run={run['id']}"
    page.goto(address)
    page.get_by_text("Cancel, and stop the drive").wait_for()
    page.reload()  # and again: it is the same run, and STOP comes first
    page.get_by_text("Cancel, and stop the drive").wait_for()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "stop"
    page.click("button:has-text('Cancel, and stop the drive')")
    page.get_by_text("Plan anew").wait_for()
    assert served.ended(run["id"])["state"] == "cancelled"
    page.goto(f"{served.url}/runs")
    page.go_back()  # it has ended, and says how
    page.get_by_text("cancelled").first.wait_for()


def test_an_old_token_may_look_and_is_told(browser: Any, served: Served) -> None:
    with visiting(browser, served) as page:
        place = {"domain": urlsplit(served.url).hostname, "path": "/"}
        page.context.add_cookies([{"name": COOKIE, "value": "of-last-year", **place}])
        page.goto(f"{served.url}/files")
        page.get_by_text("needs the token").wait_for()
        assert page.locator(f"form.sw-upload button{ENABLED}").count() == 0
        page.get_by_label("token").fill(served.token)
        page.click("button:has-text('Log in')")
        page.get_by_role("heading", name="Drives").first.wait_for()
        assert page.get_by_text("needs the token").count() == 0
