"""The audit trail: who did what, in a chain of hashes."""

from __future__ import annotations

import json
from html import escape

from fastapi import Request

from schwung.service.audit import Entry
from schwung.service.pages.desk import Desk, button, frame, html, panel
from schwung.service.pages.markup import Safe, link, moment, table, verdict

_MOST = 500


def overview(desk: Desk, _request: Request) -> None:
    """The newest entries, and whether the chain holds."""
    trail = desk.service.trail
    entries = trail.entries()

    def check() -> None:
        judged.set_content(_judged(trail.verify()))

    with frame(
        desk, "Audit trail", "/trail", "Appended only: every entry carries the hash of the one before it."
    ):
        told = f"{len(entries)} entries"
        with panel("Who did what, the newest first", aside=told) as head:
            with head:
                button("Check the chain", check, "small")
            judged = html("")
            html(_table(desk, entries[::-1][:_MOST]))


def _judged(broken: int | None) -> Safe:
    if broken is None:
        return verdict("good", "unbroken", ["Every entry is as it was written, and follows the one before."])
    return verdict(
        "unusable", "broken", [f"Entry {broken} is not what was written, or does not follow the one before."]
    )


def _table(desk: Desk, entries: list[Entry]) -> Safe:
    drives = {drive.id: drive.name for drive in desk.service.store.drives()}
    rows = [
        (
            entry.number,
            Safe(f'<span class="nowrap">{moment(entry.at)}</span>'),
            entry.who,
            entry.action,
            drives.get(entry.drive_id or "", "–"),
            link(f"/run/{entry.run_id}", "run") if entry.run_id else "–",
            _detail(entry),
            Safe(f'<span class="mono" title="{entry.hash}">{entry.hash[:10]}</span>'),
        )
        for entry in entries
    ]
    heads = ("No.", "When (UTC)", "Who", "What", "Drive", "Run", "Detail", "Hash")
    return table(heads, rows, (0,), "Nothing was moved or written yet.")


def _detail(entry: Entry) -> Safe:
    text = ", ".join(
        f"{key} {value if isinstance(value, str) else json.dumps(value)}"
        for key, value in entry.detail.items()
    )
    short = text if len(text) <= 140 else text[:137] + "…"
    return Safe(f'<span title="{escape(text, quote=True)}">{escape(short)}</span>')
