"""Columns of a strange recording: what they seem to be and why; confirmed or put right before anything is taken in."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from html import escape
from typing import Any

from nicegui import ui

from schwung.errors import InputError
from schwung.service.pages.confirming import NOT_LOGGED_IN
from schwung.service.pages.desk import Desk, button, go, grid, html, panel
from schwung.service.pages.fields import line_of_text
from schwung.service.pages.markup import Safe, muted, table, tag
from schwung.service.values import RunView

#: What may be put right, in the order in which people look at it.
_KEYS = (
    "time", "position", "speed", "torque", "position_demand", "torque_added", "time_unit", "position_unit",
    "speed_unit", "torque_unit", "position_scale", "speed_scale", "torque_scale", "rate", "axis", "split", "role",
)  # fmt: skip
_NUMBERS = ("rate",)


def show_guess(desk: Desk, run: RunView) -> None:
    """Each axis of the file: its picture, the evidence, and a form; nothing for runs that guessed nothing."""
    result = run.result or {}
    proposals = result.get("proposals") or ()
    pictures = {file.name: file.id for file in desk.service.store.files(run.id)}
    for number, proposal in enumerate(proposals, start=1):
        several = f" ({number} of {len(proposals)})" if len(proposals) > 1 else ""
        name = str(proposal["name"] or "the axis")
        with grid():
            with panel(f"What {name} seems to be{several}", "w12"):
                html(_evidence(proposal))
            with panel("Why: what position, speed and torque must satisfy", "w8"):
                picture = pictures.get(str(proposal["picture"]), "")
                html(
                    f'<img src="/api/files/{picture}" alt="what is taken for what, and why">',
                    "div",
                    "sw-body sw-picture",
                )
            with panel("Confirm, or put right", "w4"), ui.element("div").classes("sw-body sw-column"):
                _form(desk, str(result["file_id"]), run, proposal)


def _evidence(proposal: Mapping[str, Any]) -> Safe:
    rows = []
    for guess in proposal["guesses"]:
        others = "; ".join(guess["alternatives"])
        rows.append(
            (
                Safe(f"<b>{escape(guess['what'])}</b>"),
                guess["column"] or "none",
                guess["unit"] or "",
                tag("clear", "good") if guess["sure"] else tag("please confirm", "doubtful"),
                Safe(escape(guess["evidence"]) + (f"<br>{muted('or else: ' + others)}" if others else "")),
            )
        )
    cut = "".join(f"<li>{escape(told)}</li>" for told in proposal.get("cut") or ())
    runs = f'<div class="sw-body"><b>Runs</b><ul>{cut}</ul></div>' if cut else ""
    return Safe(table(("", "Column", "Unit", "", "Evidence"), rows) + runs)


def show_by_hand(desk: Desk, run: RunView) -> None:
    """Where nothing could be guessed, or taken in: the file is kept, and somebody may know its columns."""
    if run.kind not in ("import", "import_as") or run.state != "failed":
        return
    file_id = run.request.get("file_id")
    if run.kind == "import":
        if run.request["what"] != "recording":
            return
        file_id = next((file.id for file in desk.service.store.files(run.id)), None)
    if file_id is None:
        return
    with (
        panel("The file is kept: name the columns that you know"),
        ui.element("div").classes("sw-body sw-column"),
    ):
        _form(desk, str(file_id), run, {"options": run.request["options"], "questions": ()})


def _form(desk: Desk, file_id: str, run: RunView, proposal: Mapping[str, Any]) -> None:
    given: Mapping[str, Any] = proposal["options"]
    known = [key for key in _KEYS if given.get(key) is not None]
    fields = {key: line_of_text(_label(key), _text(given[key])) for key in known}
    with ui.element("details").classes("sw").props("open" if not known else ""):
        html("Others" if known else "Columns and units", "summary")
        with ui.element("div").classes("sw-form"):
            fields |= {key: line_of_text(_label(key)) for key in _KEYS if key not in known}
    marks = [ui.checkbox(question).props("dense") for question in proposal["questions"]]

    def asked(guess: bool) -> None:
        options = {key: value for key, value in given.items() if key not in _KEYS}
        texts = {key: (field.value or "").strip() for key, field in fields.items()}
        options |= {key: _value(key, text) for key, text in texts.items() if text}
        request = {
            "kind": "import_as", "file_id": file_id, "options": options, "drive_id": run.drive_id,
            "machine_id": run.machine_id, "guess": guess,
        }  # fmt: skip
        go(f"/run/{desk.service.submit(request, desk.who).id}")

    def take_in() -> None:
        if not all(mark.value for mark in marks):
            raise InputError("confirmation", "is missing", "Tick what you have checked.")
        asked(guess=False)

    with ui.element("div").classes("sw-row"):
        button("Take it in with these columns", take_in, "primary", enabled=desk.may_act, why=NOT_LOGGED_IN)
        button("Guess the rest again", partial(asked, guess=True), enabled=desk.may_act, why=NOT_LOGGED_IN)


def _label(key: str) -> str:
    return key.replace("_", " ").capitalize()


def _text(value: Any) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _value(key: str, text: str) -> Any:
    """As a recipe has it. Raises InputError for a number that is none."""
    if key not in _NUMBERS:
        return text.strip()
    try:
        return float(text)
    except ValueError:
        raise InputError(_label(key), f'"{text[:40]}" is no number', "Write for instance 1000.") from None
