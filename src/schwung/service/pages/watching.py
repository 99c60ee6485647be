"""What goes on, shown as it goes on: a run's progress, looked at by a timer of the page."""

from __future__ import annotations

from collections.abc import Callable
from html import escape

from nicegui import ui

from schwung.errors import SchwungError
from schwung.service.pages.desk import LOOK_S, Desk, html
from schwung.service.pages.markup import problem, time_left
from schwung.service.pages.words import kind_name, run_tag
from schwung.service.values import ENDED, RunView


class Watched:
    """A run: its progress drawn here while it goes on; `ended` is called once, with the run as it ended."""

    def __init__(self, desk: Desk, run: RunView, ended: Callable[[RunView], None] | None = None) -> None:
        self._desk, self._id, self._ended = desk, run.id, ended
        self._shown = ""
        self._folder = escape(f"{desk.service.settings.folder}/")
        self._element = html("", "div", "sw-progress").props('aria-live="polite"')
        self._timer = ui.timer(LOOK_S, self._look)
        self._look()

    def _behind(self, run: RunView) -> str:
        """Who is at it where a run waits."""
        if run.state != "queued" or run.drive_id is None:
            return ""
        first = next((one for one in self._desk.service.active() if one.drive_id == run.drive_id), run)
        return "" if first.id == run.id else f" behind: {kind_name(first.kind)} of {first.who}"

    def _look(self) -> None:
        try:
            run = self._desk.service.run(self._id)
        except SchwungError as error:
            self._timer.cancel()
            self._element.set_content(problem(error))
            return
        # where the service keeps its files is nobody's business
        shown = progress_html(run, self._behind(run)).replace(self._folder, "")
        if shown != self._shown:
            self._shown = shown
            self._element.set_content(shown)
        if run.state in ENDED:
            self._timer.cancel()
            if self._ended is not None:
                ended, self._ended = self._ended, None
                ended(run)


def progress_html(run: RunView, behind: str = "") -> str:
    """How far a run is, in words and as a bar; where it failed, why. `behind`: whom it waits for."""
    if run.state in ENDED:
        words = f'<div class="words">{run_tag(run.state)}<b>{escape(kind_name(run.kind))}</b></div>'
        return words + (problem(run.error) if run.error and run.state != "done" else "")
    progress = run.progress
    share = progress.share if progress is not None else None
    phase = progress.phase if progress is not None else ""
    left = time_left(progress.left_s) if progress is not None else ""
    wide = 100 * share if share is not None else 0
    percent = f"{wide:.0f} %" if share else ""
    notes = "".join(
        f'<div class="muted">{escape(note)}</div>' for note in (progress.notes if progress else ())[-4:]
    )
    name = f"<b>{escape(phase or kind_name(run.kind))}</b>{escape(behind)}"
    busy = "" if share else " busy"
    return (
        f'<div class="words">{run_tag(run.state)}{name}<span class="spring"></span>'
        f"<span>{percent}</span><span>{left}</span></div>"
        f'<div class="bar{busy}" role="progressbar" aria-valuenow="{wide:.0f}" aria-valuemin="0" aria-valuemax="100" '
        f'aria-label="progress"><i style="width:{wide:.1f}%"></i></div>{notes}'
    )
