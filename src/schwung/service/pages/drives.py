"""The drives: all of them with their live state, and each by itself."""

from __future__ import annotations

import math
import time

from fastapi import Request
from nicegui import ui

from schwung.service.lanes import DriveStatus
from schwung.service.pages.at_rest import show_changes, show_look, show_more, show_unsettled
from schwung.service.pages.desk import LOOK_S, Desk, button, frame, go, grid, html, panel, state_tag
from schwung.service.pages.diagrams import Scope
from schwung.service.pages.markup import (
    Safe,
    link,
    muted,
    numbers,
    problem,
    si,
    table,
    tag,
)
from schwung.service.pages.runs import runs_table
from schwung.service.pages.scope import TRACES, scope_url
from schwung.service.pages.words import cia402_meaning
from schwung.service.records import DriveRecord
from schwung.service.values import RunView

_SHOWN_RUNS = 12


def overview(desk: Desk, _request: Request) -> None:
    """All drives."""
    with frame(desk, "Drives", "/", _buses(desk)):
        with panel("Drives on the bus") as head:
            with head:
                html(link("/add", "Add a drive"), "span")
            listed = html("")
        with panel("Going on and lately done") as head:
            with head:
                html(link("/runs", "All runs"), "span")
            lately = html("")
        shown = ["", ""]

        def look() -> None:
            for n, (element, text) in enumerate(
                ((listed, _drives_table(desk)), (lately, runs_table(desk, limit=8)))
            ):
                if text != shown[n]:
                    shown[n] = text
                    element.set_content(text)

        look()
        ui.timer(2 * LOOK_S, look)


def _buses(desk: Desk) -> str:
    entries = desk.service.settings.buses
    return (
        ", ".join(f"{entry.name} ({entry.text})" for entry in entries)
        or "started without a bus: to look only"
    )


def _drives_table(desk: Desk) -> Safe:
    rows = []
    for drive in desk.service.store.drives():
        status = desk.service.status(drive.id)
        state = status.state
        name = Safe(f"<b>{link(f'/drive/{drive.id}', drive.name)}</b><br>{muted(_identity(drive))}")
        told = Safe(
            f"{state_tag(status)}<br>{muted(cia402_meaning(state.cia402) if state else status.trouble)}"
        )
        doing = "–"
        if status.busy_with is not None:
            run = desk.service.run(status.busy_with)
            phase = run.progress.phase if run.progress else run.kind
            doing = Safe(link(_address(run), phase))
        rows.append(
            (
                name,
                f"{drive.bus}, node {drive.node_id}",
                told,
                si(state.position_rad) if state else "–",
                doing,
                Safe(f'<a class="sw-button small primary" href="/commission/{drive.id}">Commission</a>'),
            )
        )
    heads = ("Drive", "Place", "State", "Position, rad", "Doing", "")
    return table(heads, rows, (3,), "No drive yet: add one that is on the bus.")


def _address(run: RunView) -> str:
    return f"/commission/{run.drive_id}?run={run.id}" if run.kind == "commission" else f"/run/{run.id}"


def _identity(drive: DriveRecord) -> str:
    known = drive.identity or {}
    parts = [str(known.get("name") or ""), drive.profile or ""]
    return ", ".join(part for part in parts if part) or "profile by identity"


def one(desk: Desk, request: Request) -> None:
    """One drive: what it says, what can be done with it, what was done."""
    drive_id = request.path_params["drive_id"]
    try:
        drive = desk.service.store.drive(drive_id)
    except Exception as error:
        with frame(desk, "No such drive"):
            html(problem(error))
        return
    with frame(desk, drive.name, "/", f"{drive.bus}, node {drive.node_id}"):
        show_unsettled(desk, drive)
        with grid():
            with panel("State", "w12") as head:
                with head:
                    button("Commission", lambda: go(f"/commission/{drive_id}"), "primary small")
                live = html("")
            with panel("Live", "w8"):
                Scope(scope_url(drive_id), TRACES, 420)
            show_look(desk, drive)
            show_more(desk, drive)
            with panel("Runs of this drive", "w8"):
                done = html("")
            show_changes(desk, drive)
    shown = ["", ""]

    def look() -> None:
        for n, (element, text) in enumerate(
            (
                (live, _state(desk.service.status(drive_id))),
                (done, runs_table(desk, drive_id=drive_id, limit=_SHOWN_RUNS)),
            )
        ):
            if text != shown[n]:
                shown[n] = text
                element.set_content(text)

    look()
    ui.timer(LOOK_S, look)


def _state(status: DriveStatus) -> Safe:
    state = status.state
    if state is None:
        return Safe(f'<div class="sw-body">{state_tag(status)} {muted(status.trouble)}</div>')
    old = f"{time.monotonic() - status.seen_s:.0f} s ago" if status.seen_s is not None else ""
    fine = "yes" if state.voltage else "no: STO, or no mains" if state.voltage is False else "not told"
    given = "yes" if state.remote else "no: not in remote" if state.remote is False else "not told"
    left = numbers(
        (
            (Safe(state_tag(status)), "", cia402_meaning(state.cia402) or "state (CiA 402)"),
            (si(state.position_rad), "rad", f"position, {si(math.degrees(state.position_rad), 4)}°"),
            (Safe(tag(state.nmt.lower())), "", "communication (NMT)"),
            (fine, "", "power stage supplied"),
            (given, "", "takes commands"),
            (_inputs(state.inputs), "", "limit switches"),
            (
                "busy" if status.busy_with else "idle",
                "",
                f"seen {old}" if old and old != "0 s ago" else "seen now",
            ),
        )
    )
    trouble = "".join(
        f'<div class="sw-body">{problem({"text": text})}</div>'
        for text in (state.error, state.others)
        if text
    )
    return Safe(left + trouble)


def _inputs(inputs: int | None) -> str:
    if inputs is None:
        return "not told"
    hit = [name for bit, name in ((0, "negative"), (1, "positive"), (3, "interlock")) if inputs >> bit & 1]
    return ", ".join(hit) or "free"
