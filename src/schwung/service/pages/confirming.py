"""Who says that something may be moved or written: a name, marks, and the button that is no other button."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any

from nicegui import ui

from schwung.service.pages.desk import LOOK_S, Desk, button, enable, html
from schwung.service.pages.fields import line_of_text
from schwung.service.pages.markup import Safe, table
from schwung.service.pages.words import kind_name
from schwung.service.values import RunView
from schwung.service.work import KINDS

NOT_LOGGED_IN = "Log in with the token first."
#: What has to be seen to before a machine moves.
CLEAR = (
    "Nobody is in reach of the machine, and nothing is in its way.",
    "I see the machine, and have its emergency stop in reach.",
)
#: And before something is written.
READ = ("I have read what will be written.",)


class Confirmation:
    """Name and marks; `button` makes the button that they allow, `started` gets the run that was asked for."""

    def __init__(
        self, desk: Desk, proposal: Mapping[str, Any], marks: Sequence[str], drive_id: str | None
    ) -> None:
        self._desk, self._proposal, self._drive_id = desk, proposal, drive_id
        self._name = line_of_text(
            "Your name", "" if desk.who == "somebody" else desk.who, "As it shall stand in the audit trail."
        )
        self._marks = [ui.checkbox(mark).props("dense") for mark in marks]

    def button(self, word: str, started: Callable[[RunView], Any], kind: str = "moves") -> None:
        """The button that carries it out."""

        def start() -> None:
            if not self._is_given:
                return
            proposal = self._proposal
            request = {"kind": proposal["carries_out"]} | {k: proposal[k] for k in ("proposal_id", "digest")}
            started(self._desk.service.submit(request, self._name.value.strip()[:60]))

        element = button(word, start, kind)

        def judge() -> None:
            stopped = self._desk.service.latch.stopped is not None
            why = (
                "The service is stopped: release it first."
                if stopped
                else "Your name and every mark are needed."
            )
            if busy := self._busy_with():
                why = busy
            fine = self._is_given and not stopped and not busy and self._desk.may_act
            enable(element, fine, why if self._desk.may_act else NOT_LOGGED_IN)

        self._name.on_value_change(judge)
        for mark in self._marks:
            mark.on_value_change(judge)
        judge()
        ui.timer(LOOK_S, judge)

    def _busy_with(self) -> str:
        """Who moves or writes there now: what is confirmed begins while somebody looks, not when its turn comes."""
        for run in self._desk.service.active():
            if run.drive_id == self._drive_id and KINDS[run.kind].acts:
                return f"{kind_name(run.kind)} of {run.who} goes on there: wait for its end, and look again."
        return ""

    @property
    def _is_given(self) -> bool:
        return bool((self._name.value or "").strip()) and all(mark.value for mark in self._marks)


def changes_table(changes: Sequence[Mapping[str, Any]], heads: tuple[str, str] = ("Old", "New")) -> Safe:
    """What is written over what, with its unit where somebody knows it."""
    rows = [
        (
            change["object"],
            Safe(f"<del>{escape(_value(change, 'old'))}</del>"),
            Safe(f"<ins>{escape(_value(change, 'new'))}</ins>"),
            Safe(escape(change.get("unit") or "")),
            Safe("" if change["old"] != change["new"] else "as it is"),
        )
        for change in changes
    ]
    return table(
        ("Parameter", *heads, "Unit", ""), rows, (1, 2), "Nothing: the drive holds these values already."
    )


def _value(change: Mapping[str, Any], key: str) -> str:
    raw, worth = change[key], change.get(f"{key}_si")
    told = str(raw["hex"]) if isinstance(raw, Mapping) else str(raw)
    return f"{worth:.5g}" if isinstance(worth, int | float) else told


def say_changes(changes: Sequence[Mapping[str, Any]]) -> None:
    """A table of changes, long ones in a box that scrolls."""
    element = html(changes_table(changes))
    if len(changes) > 14:
        element.style("max-height:420px;overflow:auto")
