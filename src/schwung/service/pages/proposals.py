"""What a run has proposed, and the way to carry it out: putting back a configuration, a frequency response."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nicegui import ui

from schwung.service.pages.confirming import CLEAR, READ, Confirmation, say_changes
from schwung.service.pages.desk import Desk, go, html, panel
from schwung.service.pages.markup import muted, problem, table
from schwung.service.pages.words import kind_name
from schwung.service.values import RunView

_MOVES = ("commission", "bode", "play")


def show_proposal(desk: Desk, run: RunView) -> None:
    """Changes, and a confirmation where it can start; a plan is confirmed in the wizard."""
    document: Mapping[str, Any] = run.result or {}
    if "changes" in document:
        with panel("What changes in the drive" if "proposal_id" in document else "What was changed"):
            say_changes(document["changes"])
            left = document.get("left_out") or ()
            if left:
                with ui.element("details").classes("sw sw-body"):
                    html(f"{len(left)} parameters are left out", "summary")
                    html(table(("Parameter", "Because"), [(row["object"], row["because"]) for row in left]))
    if "proposal_id" not in document or document["carries_out"] == "commission":
        return
    if not document.get("can_start", True):
        html(
            problem(
                {
                    "place": kind_name(document["carries_out"]),
                    "problem": "preflight says no: see the findings",
                }
            )
        )
        return
    if "changes" in document and all(change["old"] == change["new"] for change in document["changes"]):
        return  # there is nothing to do
    moves = document["carries_out"] in _MOVES or bool(document.get("motion"))
    with panel("Carry it out"):
        with ui.element("div").classes("sw-body sw-column"):
            if moves:
                html(f'<div class="sw-moves"><b>The machine will move</b>{_how_long(document)}.</div>')
            given = Confirmation(desk, document, CLEAR if moves else READ, run.drive_id)
            html(muted("A proposal is used once, and lost with the process that made it."))
        with ui.element("div").classes("sw-foot"):
            html("", "span", "spring")
            word = "Move the machine" if moves else "Write into the drive"
            given.button(word, lambda started: go(f"/run/{started.id}"))


def _how_long(document: Mapping[str, Any]) -> str:
    motions, lasting = document.get("motions"), document.get("duration_s")
    if not isinstance(motions, int) or not isinstance(lasting, int | float):
        return ""
    return f", {motions} times in about {lasting:.0f} s"
