"""An explanation: what the belief left out, how sure, the proof; and the motion that would tell most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from nicegui import ui

from schwung.service.pages.desk import Desk, grid, html, panel
from schwung.service.pages.markup import Safe, facts, link, muted, percent, si, table, verdict
from schwung.service.pages.reported import show_drawings
from schwung.service.pages.words import VERDICTS
from schwung.service.records import ResultRecord


def show_explanation(desk: Desk, found: ResultRecord) -> None:
    """Everything about an explanation; of one that an earlier version has stored, what can be read of it."""
    document = found.document
    tone, word = VERDICTS[found.verdict or "unexplained"]
    with panel("What the belief left out"):
        html(verdict(tone, word, [document["headline"]] if "headline" in document else []))
        for one in document.get("told", ()):
            html(escape(one["title"]), "h3", "sw-body")
            html(told_table(one["heads"], one["rows"]), "div", "" if any(one["heads"]) else "sw-body")
    with grid():
        show_drawings(desk, desk.service.run(found.run_id))
    notes = document.get("notes", ())
    if notes:
        with panel("What to know of it"):
            html("<ul>" + "".join(f"<li>{escape(note)}</li>" for note in notes) + "</ul>", "div", "sw-body")
    show_next_motion(desk, found)


def told_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> Safe:
    """A table in words; the first line of a name's cell is for people, the second for files."""
    if not any(heads):
        return facts((row[0], Safe("<br>".join(map(escape, row[1:])))) for row in rows)
    return table([_headed(head) for head in heads], [[_cell(cell) for cell in row] for row in rows])


def _headed(text: str) -> str:
    """With a capital, but for the name of a file."""
    return text if "." in text else text[:1].upper() + text[1:]


def _cell(text: str) -> Safe:
    return Safe("<br>".join(escape(line) for line in text.split("\n")))


def show_next_motion(desk: Desk, found: ResultRecord) -> None:
    """The motion that best tells apart what is confused, and its plan to look at; nothing where nobody asked."""
    chosen = found.document.get("next")
    if chosen is None:
        return
    with panel("What to measure next"), ui.element("div").classes("sw-body sw-column"):
        html(escape(chosen["sentence"]), "p")
        if chosen["rivals"]:
            rows = [
                (", ".join(one["names"]) or "nothing", percent(one["probability"]))
                for one in chosen["rivals"]
            ]
            html(table(("Left out could be", "Probability"), rows, (1,)))
        plan = chosen["plan"]
        if plan is None:
            return
        html(facts(planned(plan, chosen["start_rad"])))
        drive_id = desk.service.store.session(found.session_id or "").drive_id
        if drive_id is None:
            html(muted("The recording was brought from elsewhere: plan it at a drive of yours."))
            return

        url = f"/commission/{drive_id}?next={found.id}"
        html(link(url, "Commission with this motion: check, predict, confirm"), "p")


def planned(plan: Mapping[str, Any], start_rad: float) -> list[tuple[str, str]]:
    """The stroke in words."""
    return [
        ("Stroke", f"{si(plan['distance_rad'])} rad in {si(plan['duration_s'])} s, from {si(start_rad)} rad"),
        ("Injected", f"{si(plan['amplitude_nm'], 3)} N·m at {si(plan['frequency_hz'], 3)} Hz"),
    ]
