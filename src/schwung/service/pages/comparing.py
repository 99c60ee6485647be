"""Estimates beside each other: drift with wear, another payload, before and after a change."""

from __future__ import annotations

from typing import Any

import numpy as np
from fastapi import Request
from nicegui import ui

from schwung.service.pages.curves import NamedCurve, at, comparison_diagram
from schwung.service.pages.desk import Desk, frame, grid, html, panel, set_address
from schwung.service.pages.diagrams import Diagram
from schwung.service.pages.markup import Safe, link, moment, si, table
from schwung.service.pages.outcome import named
from schwung.service.pages.words import verdict_tag
from schwung.service.records import ResultRecord

_MOST = 6


def compare(desk: Desk, request: Request) -> None:
    """Two to six estimates."""
    store = desk.service.store
    known = {one.id: one for one in store.results("estimate", limit=200)}
    asked = [one for one in request.query_params.getlist("estimate") if one in known]
    chosen = asked[:_MOST] or list(known)[:2]
    drives = {drive.id: drive.name for drive in store.drives()}
    client = ui.context.client
    with frame(desk, "Compare", "/compare", "Up to six estimates of the load inertia over angle."), grid():
        with panel("Curves", "w8"), ui.element("div").classes("sw-body"):
            drawn = ui.element("div")
        with panel("In numbers, against the first", "w4"):
            told = html("")

        def refresh() -> None:
            curves = [named(known[one]) for one in chosen if one in known]
            drawn.clear()
            with drawn:
                if curves:
                    Diagram(comparison_diagram(curves), 520)
                else:
                    html("Tick two estimates or more.", "div", "sw-empty")
            told.set_content(_numbers(curves))
            if chosen:
                set_address(client, "/compare?" + "&".join(f"estimate={one}" for one in chosen))

        with panel("Which", "w12", "the first that is ticked is what the others are held against"):
            _choose(known, chosen, drives, refresh)
        refresh()


def _choose(known: dict[str, ResultRecord], chosen: list[str], drives: dict[str, str], changed: Any) -> None:
    if not known:
        html("No estimate yet. Commission a drive first.", "div", "sw-empty")
        return

    def ticked(estimate_id: str, value: bool) -> None:
        if value and estimate_id not in chosen:
            if len(chosen) >= _MOST:
                ui.notify(f"{_MOST} at most: untick one first.", position="top")
            else:
                chosen.append(estimate_id)
        elif not value and estimate_id in chosen:
            chosen.remove(estimate_id)
        changed()

    with ui.element("div").classes("sw-scroll"), ui.element("table").classes("sw middle"):
        html(
            "<tr><th></th><th>Found (UTC)</th><th>Drive</th><th>Verdict</th><th>Load inertia, kg·m²</th>"
            "<th>Run</th></tr>",
            "thead",
        )
        with ui.element("tbody"):
            for one in known.values():
                with ui.element("tr"):
                    with ui.element("td"):
                        box = ui.checkbox(value=one.id in chosen).props(
                            f'dense aria-label="compare {moment(one.created)}"'
                        )
                        box.on_value_change(lambda event, key=one.id: ticked(key, event.value))
                    inertia = one.document["table"]["inertia_kgm2"]
                    for cell in (
                        moment(one.created),
                        drives.get(one.drive_id or "", "–"),
                        verdict_tag(one.verdict) or "–",
                        f"{si(min(inertia), 3)} … {si(max(inertia), 3)}",
                        link(f"/run/{one.run_id}", "show"),
                    ):
                        html(str(cell), "td")


def _numbers(curves: list[NamedCurve]) -> Safe:
    rows = []
    for n, curve in enumerate(curves):
        mean = float(np.mean(curve.inertia_kgm2))
        change, largest = "–", "–"
        if n:
            difference = curve.inertia_kgm2 - at(curves[0], curve.position_rad)
            seen = np.isfinite(difference)
            if seen.any():
                share = float(np.mean(difference[seen]) / np.mean(at(curves[0], curve.position_rad)[seen]))
                change = f"{'+' if share >= 0 else '−'}{abs(100 * share):.2f} %"
                largest = si(float(np.max(np.abs(difference[seen]))), 3)
        mark = Safe(f'<span style="color:var(--trace-{n % 6 + 1});font-weight:700">▬</span> {curve.name}')
        rows.append((mark, si(mean, 4), change, largest))
    return table(("Run (UTC)", "Mean", "Change", "Largest"), rows, (1, 2, 3), "Nothing to compare yet.")
