"""Step 7: what is written into the drive: shown with old and new values, confirmed, read back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nicegui import ui

from schwung.service.pages.asking import Asked
from schwung.service.pages.confirming import CLEAR, READ, Confirmation, say_changes
from schwung.service.pages.curves import prediction_diagram
from schwung.service.pages.desk import actions, button, go, grid, html, panel
from schwung.service.pages.diagrams import Diagram, Scope
from schwung.service.pages.fields import QuantityField, choice
from schwung.service.pages.markup import Safe, checks, numbers, si, verdict
from schwung.service.pages.scope import TRACES, scope_url
from schwung.service.pages.wizard.guide import RESULT, Guide
from schwung.service.values import RunView

_FORMS = {
    "table": "table over angle",
    "harmonics": "harmonics over a turn",
    "mean": "one number: the mean",
    "max": "one number: the largest",
    "at": "one number: at an angle",
}


def export(guide: Guide) -> None:
    """Choose a form, see the difference, confirm; then what was written, as it reads back."""
    if guide.known.written is not None:
        _written(guide, guide.known.written)
        return
    desk, done = guide.desk, guide.known.run
    assert done is not None
    estimate_id = (done.result or {})["estimate_id"]

    def chosen(value: str) -> None:
        at_place.set_visibility(value == "at")

    def compare() -> None:
        request = {
            "kind": "propose_export",
            "drive_id": guide.drive.id,
            "estimate_id": estimate_id,
            "form": form.value,
            "at_rad": at.value if form.value == "at" else None,
            "store": bool(store.value),
            "verify": bool(verify.value),
        }
        shown.clear()
        asked.ask(request, proposed)

    def proposed(run: RunView) -> None:
        shown.clear()
        if run.state == "done" and run.result:
            with shown:
                _difference(guide, run.result)

    with grid():
        with panel("What shall be written", "w4"), ui.element("div").classes("sw-body sw-column"):
            form = choice("Form", _FORMS, "table", chosen)
            with ui.element("div") as at_place:
                at = QuantityField("Angle", "angle", "90deg", signed=True)
            at_place.set_visibility(False)
            store = ui.checkbox("Save in the drive's memory (1010)", value=True).props("dense")
            verify = ui.checkbox("Show the effect: the same motion before and after", value=False).props(
                "dense"
            )
            button("Compare with the drive", compare, enabled=desk.may_act)
        with ui.element("div").classes("w8 sw-column"):
            asked = Asked(desk)
            asked.place()
            shown = ui.element("div").classes("sw-column")
    with actions("Comparing reads the drive. Nothing is written before you confirm."):
        button("Back to the result", lambda: guide.go(RESULT))
        button("Finish without writing", lambda: go(f"/run/{done.id}"))
    if desk.may_act:
        compare()


def _difference(guide: Guide, document: Mapping[str, Any]) -> None:
    moves = document.get("motion")
    told = (
        f"{sum(1 for c in document['changes'] if c['old'] != c['new'])} of {len(document['changes'])} change"
    )
    with panel("What changes in the drive", "w12", told):
        say_changes(document["changes"])
    if moves:
        with panel("The motion before and after", "w12"):
            with ui.element("div").classes("sw-body"):
                Diagram(prediction_diagram(moves), 360)
            html(checks(moves["checks"]))
    with panel("Who confirms it", "w12"):
        with ui.element("div").classes("sw-body sw-column"):
            given = Confirmation(guide.desk, document, (*READ, *CLEAR) if moves else READ, guide.drive.id)
        with ui.element("div").classes("sw-foot"):
            html(
                "Every value is read back and compared; the old ones are kept as the way back.",
                "span",
                "muted",
            )
            html("", "span", "spring")
            word = "Write, and move the machine" if moves else "Write into the drive"
            if document.get("can_start", True):
                given.button(word, lambda run: _carried_out(guide, run))


def _carried_out(guide: Guide, run: RunView) -> None:
    guide.known.written = run
    guide.refresh()


def _written(guide: Guide, run: RunView) -> None:
    desk = guide.desk

    def ended(done: RunView) -> None:
        guide.known.written = done
        if done.state != "done" or not done.result:
            guide.fail()
            with place:
                button("Look again", lambda: _again(guide))
            return
        live.set_visibility(False)
        with place:
            _read_back(done.result)

    with panel("Export"), ui.element("div").classes("sw-body sw-column"):
        asked = Asked(desk)
        asked.place()
        place = ui.element("div").classes("sw-column")
    with ui.element("div") as live, panel("Live"):
        Scope(scope_url(guide.drive.id), TRACES, 360)
    with actions("The values before are kept with this run: it can be put back from there."):
        button("To the run, and the way back", lambda: go(f"/run/{run.id}"))
        button("To the drive", lambda: go(f"/drive/{guide.drive.id}"), "primary")
    asked.watch(run, ended)


def _again(guide: Guide) -> None:
    guide.known.written = None
    guide.refresh()


def _read_back(result: Mapping[str, Any]) -> None:
    stored = "saved in its memory" if result.get("stored") else "until power-off"
    html(
        verdict(
            "good", "written", [f"{len(result['changes'])} parameters written, read back equal, {stored}."]
        )
    )
    before, after = (result.get(f"following_error_rms_{when}_rad") for when in ("before", "after"))
    if before and after:
        times = Safe(f"{before / after:.2f} ×")
        html(
            numbers(
                (
                    (si(1e3 * before, 3), "mrad", "following error before, RMS"),
                    (si(1e3 * after, 3), "mrad", "after"),
                    (times, "", "smaller" if after < before else "of what it is now"),
                )
            )
        )
    say_changes(result["changes"])
