"""A page that is slow to connect: what is entered meanwhile is not lost, and does not overtake itself."""

from __future__ import annotations

from typing import Any

import pytest
from page_process import Served

pytest.importorskip("playwright.sync_api")
#: Whatever the page's sockets send leaves so much later, in its order.
SLOWLY = """(() => {
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (...what) { setTimeout(() => send.apply(this, what), 1500); };
})();"""
NAME = "Pusher 0123456789"


@pytest.mark.long
@pytest.mark.timeout(240)
def test_what_is_entered_before_it_is_connected_arrives_in_its_order(page: Any, served: Served) -> None:
    """Each key is a value of its own: with only a few of them, or after the press, half a name was kept, or the old."""
    page.add_init_script(SLOWLY)
    try:
        page.goto(f"{served.url}/drive/{served.drive_id}")
        field = page.get_by_label("Name", exact=True)
        field.fill("")
        field.press_sequentially(NAME, delay=3)
        page.click("button:has-text('Keep the changes')")
        assert page.evaluate("window.did_handshake") is False  # else this tells nothing
        page.get_by_role("heading", name=NAME, exact=True).wait_for()
        assert [drive["name"] for drive in served.call("GET", "/api/drives")] == [NAME]
    finally:
        served.call("PATCH", f"/api/drives/{served.drive_id}", {"name": "Test axis"})  # it keeps its history
