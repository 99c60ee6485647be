"""What was done: the list, and one run with what came of it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from functools import partial
from html import escape
from typing import Any

from fastapi import Request
from nicegui import ui

from schwung.errors import SchwungError
from schwung.service.pages.curves import prediction_diagram
from schwung.service.pages.desk import LOOK_S, Desk, button, frame, go, grid, html, panel
from schwung.service.pages.diagrams import Diagram, Scope
from schwung.service.pages.explaining import show_explanation
from schwung.service.pages.fields import choice
from schwung.service.pages.following import show_next
from schwung.service.pages.guessing import show_by_hand, show_guess
from schwung.service.pages.markup import Safe, checks, facts, link, moment, problem, table
from schwung.service.pages.motions import show_motions
from schwung.service.pages.outcome import show_estimate
from schwung.service.pages.proposals import show_proposal
from schwung.service.pages.reported import show_drawings
from schwung.service.pages.scope import TRACES, scope_url
from schwung.service.pages.told import show_told
from schwung.service.pages.watching import Watched
from schwung.service.pages.words import field_text, kind_name, run_tag, verdict_tag
from schwung.service.records import RunHead
from schwung.service.values import ENDED, RunView
from schwung.service.work import KINDS

_KIND_CHOICE = {"": "all kinds", **{kind: kind_name(kind) for kind in KINDS}}
_MOST = 300
_REMEMBERED = 4000
#: The report's picture that the page draws itself.
CURVE = "The inertia curve"


def runs_table(desk: Desk, drive_id: str | None = None, kind: str | None = None, limit: int = _MOST) -> Safe:
    """Runs, the newest first."""
    drives = {drive.id: drive.name for drive in desk.service.store.drives()}
    going_on = {run.id: run for run in desk.service.active()}
    rows = []
    for run in desk.service.store.run_heads(drive_id=drive_id, kind=kind, limit=limit):
        told: Any = _outcome(desk, run)
        at = going_on.get(run.id)
        if at is not None and at.progress is not None and at.state == "running":
            share = at.progress.share
            told = at.progress.phase + (f", {100 * share:.0f} %" if share is not None else "")
        rows.append(
            (
                Safe(f'<span class="nowrap">{moment(run.created)}</span>'),
                link(run_url(run), kind_name(run.kind)),
                drives.get(run.drive_id or "", "–"),
                run.who,
                run_tag(run.state),
                told,
            )
        )
    return table(
        ("Asked for (UTC)", "What", "Drive", "Who", "State", "Outcome"), rows, empty="Nothing was done yet."
    )


#: What came of runs that have ended, by their ids: read once, since it does not change.
_OUTCOMES: OrderedDict[str, Safe | str] = OrderedDict()


def _outcome(desk: Desk, head: RunHead) -> Safe | str:
    if head.state not in ENDED:
        return ""
    if head.id not in _OUTCOMES:
        run = desk.service.store.run(head.id)
        word = run.error.get("text", "") if run.error and run.state == "failed" else ""
        _OUTCOMES[head.id] = verdict_tag((run.result or {}).get("verdict")) or word[:110]
        while len(_OUTCOMES) > _REMEMBERED:
            _OUTCOMES.popitem(last=False)
    return _OUTCOMES[head.id]


def run_url(run: RunView | RunHead) -> str:
    """Where a run is shown: one that goes on and has a scope, in the wizard."""
    if run.kind == "commission" and run.state not in ENDED:
        return f"/commission/{run.drive_id}?run={run.id}"
    return f"/run/{run.id}"


def overview(desk: Desk, request: Request) -> None:
    """All runs."""
    wanted = {"kind": request.query_params.get("kind", ""), "drive": request.query_params.get("drive", "")}
    drives = {"": "all drives", **{drive.id: drive.name for drive in desk.service.store.drives()}}
    with frame(desk, "Runs", "/runs", "Everything that was asked for is kept, with its recording."):
        with ui.element("div").classes("sw-row"):
            choice(
                "What", _KIND_CHOICE, _known(wanted["kind"], _KIND_CHOICE), lambda kind: narrow("kind", kind)
            )
            choice("Drive", drives, _known(wanted["drive"], drives), lambda drive: narrow("drive", drive))
            html("", "span", "spring")
        with panel("Runs, the newest first") as head:
            with head:
                html(link("/compare", "Compare estimates"), "span")
            listed = html("")
        shown = [""]

        def narrow(key: str, value: str) -> None:
            wanted[key] = value
            look()

        def look() -> None:
            text = runs_table(desk, wanted["drive"] or None, wanted["kind"] or None)
            if text != shown[0]:
                shown[0] = text
                listed.set_content(text)

        look()
        ui.timer(4 * LOOK_S, look)


def _known(value: str, options: Mapping[str, str]) -> str:
    return value if value in options else ""


def one(desk: Desk, request: Request) -> None:
    """One run."""
    try:
        run = desk.service.run(request.path_params["run_id"])
    except SchwungError as error:
        with frame(desk, "No such run", "/runs"):
            html(problem(error))
        return
    with frame(desk, kind_name(run.kind), "/runs", f"{moment(run.created)} UTC, asked for by {run.who}"):
        with grid():
            with panel("How it went", "w8") as head:
                with head:
                    if run.state not in ENDED and desk.may_act:
                        button("Cancel", partial(_cancel, desk, run.id), "small")
                with ui.element("div").classes("sw-body sw-column"):
                    Watched(desk, run, None if run.state in ENDED else lambda done: go(f"/run/{done.id}"))
                    html(_asked(desk, run))
            with panel("Files", "w4") as head:
                if run.state in ENDED:
                    with head:
                        html(f'<a href="/api/runs/{run.id}/archive">All as one archive (zip)</a>', "span")
                html(_files(desk, run))
        if run.state in ENDED:
            show_result(desk, run)
        elif run.drive_id is not None and KINDS[run.kind].acts:
            with panel("Live"):
                Scope(scope_url(run.drive_id), TRACES)


def _cancel(desk: Desk, run_id: str) -> None:
    desk.service.cancel(run_id, desk.who)


def _files(desk: Desk, run: RunView) -> Safe:
    rows = [
        (Safe(f'<a href="/api/files/{file.id}" target="_blank">{escape(file.name)}</a>'), _size(file.size))
        for file in desk.service.store.files(run.id)
    ]
    return table(("File", "Size"), rows, (1,), "None.")


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"


def _asked(desk: Desk, run: RunView) -> Safe:
    left_out: tuple[Any, ...] = (None, [], {}, run.drive_id, run.kind)
    asked = [field_text(key, value) for key, value in run.request.items() if value not in left_out]
    pairs: list[tuple[str, Any]] = [pair for pair in asked if pair[1] != "–"]
    if run.drive_id is not None:
        pairs.insert(
            0, ("Drive", link(f"/drive/{run.drive_id}", desk.service.store.drive(run.drive_id).name))
        )
    return facts(pairs)


def show_result(desk: Desk, run: RunView) -> None:
    """What came of a run that has ended, by what is in its result."""
    result = run.result or {}
    store = desk.service.store
    if result.get("estimate_id") and run.kind in ("commission", "estimate"):
        show_estimate(desk, store.estimate(result["estimate_id"]))
    if result.get("explanation_id"):
        show_explanation(desk, store.explanation(result["explanation_id"]))
    if result.get("predicted"):
        with panel("Predicted motion"), ui.element("div").classes("sw-body"):
            Diagram(prediction_diagram(result), 520)
    if result.get("checks"):
        with panel("Checks"):
            html(checks(result["checks"]))
    if "nodes" in result:
        with panel("Nodes"):
            html(_nodes(result["nodes"]))
    show_told(desk, run)
    show_guess(desk, run)
    show_by_hand(desk, run)
    show_proposal(desk, run)
    with grid():
        show_motions(desk, run)
    if not result.get("explanation_id"):
        with grid():
            show_drawings(desk, run, (CURVE,))
    notes = result.get("notes") or ()
    if notes:
        with panel("Notes"), ui.element("div").classes("sw-body"):
            html("<ul>" + "".join(f"<li>{escape(str(note))}</li>" for note in notes) + "</ul>")
    show_next(desk, run)


def _nodes(nodes: list[Mapping[str, Any]]) -> Safe:
    keys = list(nodes[0]) if nodes else []
    rows = [[str(node[key]) for key in keys] for node in nodes]
    return table([key.replace("_", " ").capitalize() for key in keys], rows, empty="Nobody answers.")
