"""Steps 5 and 6: the machine moves, and what was found."""

from __future__ import annotations

from nicegui import ui

from schwung.service.pages.desk import actions, button, go, html, panel
from schwung.service.pages.diagrams import Scope
from schwung.service.pages.outcome import show_estimate
from schwung.service.pages.scope import TRACES, scope_url
from schwung.service.pages.watching import Watched
from schwung.service.pages.wizard.guide import EXPORT, PLAN, RESULT, RUN, Guide
from schwung.service.values import ENDED, RunView


def run(guide: Guide) -> None:
    """The scope, how far it is, and the way out."""
    desk, known = guide.desk, guide.known
    assert known.run is not None
    with panel("Progress") as head:
        with head:
            ways_out = ui.element("div")
            if desk.may_act and known.run.state not in ENDED:
                with ways_out:
                    button("Cancel, and stop the drive", lambda: _cancel(guide), "small")
        with ui.element("div").classes("sw-body"):
            watched = ui.element("div")
    with panel("Live"):
        Scope(scope_url(guide.drive.id), TRACES, 470)
    with ui.element("div").classes("sw-row") as foot:
        html("This page may be closed: the service goes on, and keeps everything.", "span", "muted")

    def ended(done: RunView) -> None:
        known.run = done
        if done.state == "done":
            guide.go(RESULT)
            return
        ways_out.clear()
        guide.fail()
        with foot:
            button("Plan anew", lambda: guide.go(PLAN))
            button("What was recorded", lambda: go(f"/run/{done.id}"), "primary")

    with watched:
        Watched(desk, known.run, ended)


def _cancel(guide: Guide) -> None:
    assert guide.known.run is not None
    guide.desk.service.cancel(guide.known.run.id, guide.desk.who)


def result(guide: Guide) -> None:
    """The curve, the verdict, and where it goes from here."""
    desk, done = guide.desk, guide.known.run
    assert done is not None
    found = done.result or {}
    with ui.element("div").classes("sw-column"):
        show_estimate(desk, desk.service.store.estimate(found["estimate_id"]))
    with actions():
        button("Everything about this run", lambda: go(f"/run/{done.id}"))
        button("Plan another", lambda: _anew(guide))
        unusable = found.get("verdict") == "unusable"
        why = "An unusable table does not go into a drive."
        button("Go on to the export", lambda: guide.go(EXPORT), "primary", enabled=not unusable, why=why)


def _anew(guide: Guide) -> None:
    guide.known.planned = guide.known.run = None
    guide.go(PLAN)


__all__ = ["RUN", "result", "run"]
