"""Step 7: what is written into the drive: shown with old and new values, confirmed, read back."""

from __future__ import annotations

from schwung.service.pages.desk import button, html, panel
from schwung.service.pages.wizard.guide import RESULT, Guide


def export(guide: Guide) -> None:
    """Choose a form, see the difference, confirm."""
    with panel("Export"):
        html("Not there yet.", "div", "sw-empty")
    button("Back", lambda: guide.go(RESULT))
