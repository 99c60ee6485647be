"""The pictures of a run's report in the page; they follow its theme, since their colours are variables."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path

from schwung.errors import SchwungError
from schwung.service.pages.desk import Desk, html, panel
from schwung.service.values import RunView

#: Reports that a run may have, in the order in which they are looked for.
REPORTS = ("explanation.html", "report.html")
_SECTION = re.compile(r"<section><h2>(.*?)</h2>(.*?)</section>", re.DOTALL)
_FIGURE = re.compile(r"(<svg\b.*?</svg>)\s*(?:<figcaption>(.*?)</figcaption>)?", re.DOTALL)
_STYLE = re.compile(r"<style\b.*?</style>", re.DOTALL)  # for the whole page; theme.css has what it says
#: What no drawing of ours has; one in which it is found is left out.
_ACTIVE = re.compile(
    r"<\s*(script|foreignobject|iframe|style|animate|set)\b|\bon\w+\s*=|javascript:|href=\"(?!#|data:image/png)",
    re.IGNORECASE,
)
_MOST_BYTES = 20_000_000


@dataclass(frozen=True)
class Drawing:
    """A picture: its heading, the SVG, what to look for."""

    title: str
    svg: str
    caption: str


def drawings(page: str) -> Iterator[Drawing]:
    """The pictures of a report, as text; one that holds anything active is left out."""
    for title, inner in _SECTION.findall(page):
        for svg, caption in _FIGURE.findall(inner):
            plain = _STYLE.sub("", svg)
            if not _ACTIVE.search(plain):
                yield Drawing(unescape(title), plain, unescape(re.sub(r"<[^>]*>", "", caption)))


def show_drawings(desk: Desk, run: RunView, leave_out: tuple[str, ...] = ()) -> None:
    """The pictures of a run's report, each in a panel; nothing where it has none."""
    path = _report_of(desk, run)
    if path is None:
        return
    for drawing in drawings(path.read_text(encoding="utf-8", errors="replace")):
        if drawing.title not in leave_out:
            with panel(drawing.title):
                html(
                    f'<div class="drawn">{drawing.svg}</div><p>{escape(drawing.caption)}</p>',
                    "div",
                    "sw-body sw-figure",
                )


def _report_of(desk: Desk, run: RunView) -> Path | None:
    store = desk.service.store
    files = {file.name: file for file in store.files(run.id)}
    for name in REPORTS:
        if name in files and files[name].size <= _MOST_BYTES:
            try:
                return store.file_path(files[name].id)
            except SchwungError:
                return None
    return None
