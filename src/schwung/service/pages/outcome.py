"""An estimate as people judge it: verdict in words, the curve with its band over earlier runs, and the numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from nicegui import ui

from schwung.service.pages.curves import NamedCurve, curve_of, inertia_diagram
from schwung.service.pages.desk import Desk, grid, html, panel
from schwung.service.pages.diagrams import Diagram
from schwung.service.pages.markup import (
    Safe,
    facts,
    link,
    moment,
    muted,
    numbers,
    percent,
    si,
    table,
    verdict,
)
from schwung.service.pages.words import VERDICTS
from schwung.service.records import ResultRecord

#: Earlier runs that are drawn behind a curve.
EARLIER = 12


def show_estimate(desk: Desk, found: ResultRecord) -> None:
    """Everything about an estimate."""
    document = found.document
    before = earlier_of(desk, found)
    curve = curve_of("this run", document)
    with grid():
        with panel("The verdict", "w12"):
            html(verdict_html(document))
            html(key_numbers(document))
        with panel("Load inertia over angle", "w8", _beside(before)) as head:
            with head:
                html(link(f"/compare?estimate={found.id}", "Compare"), "span")
            with ui.element("div").classes("sw-body"):
                Diagram(inertia_diagram(curve, [named(one) for one in before]), 400)
        with ui.element("div").classes("w4 sw-column"):
            with panel("In numbers"), ui.element("div").classes("sw-body"):
                html(_facts(document))
            if before:
                with panel("Against earlier runs"):
                    html(_drift(curve, before))


def _beside(before: Sequence[ResultRecord]) -> str:
    return (
        ""
        if not before
        else f"beside {len(before)} earlier run{'s' if len(before) > 1 else ''} of this machine"
    )


def named(record: ResultRecord) -> NamedCurve:
    """The curve of a stored estimate, named by when it was found."""
    return curve_of(moment(record.created)[:16], record.document)


def earlier_of(desk: Desk, found: ResultRecord) -> list[ResultRecord]:
    """Usable estimates of the same drive from before, the newest first; one per session."""
    store = desk.service.store
    session = store.session(found.session_id) if found.session_id else None
    drive_id = session.drive_id if session is not None else None
    if drive_id is None:
        return []
    kept: dict[str, ResultRecord] = {}
    for one in store.results("estimate", drive_id, limit=200):
        if one.created < found.created and one.session_id != found.session_id and one.verdict != "unusable":
            kept.setdefault(one.session_id or one.id, one)
    return list(kept.values())[:EARLIER]


def verdict_html(document: Mapping[str, Any]) -> Safe:
    """The verdict and its reasons; what the recording could tell at best."""
    trust = document["trust"]
    tone, word = VERDICTS.get(trust["verdict"], ("", trust["verdict"]))
    reach = document.get("reach") or {}
    reasons = [*trust["reasons"], *([reach["text"]] if reach.get("text") else [])]
    return verdict(tone, word, reasons)


def key_numbers(document: Mapping[str, Any]) -> Safe:
    """What is looked at first."""
    table_, trust = document["table"], document["trust"]
    inertia = np.asarray(table_["inertia_kgm2"])
    std = table_.get("std_kgm2")
    band = 2 * float(np.median(std)) if std is not None else None
    deviation = trust.get("position_amplitude_rad")
    return numbers(
        (
            (
                f"{si(float(inertia.min()), 3)} … {si(float(inertia.max()), 3)}",
                "kg·m²",
                "load inertia over the stroke",
            ),
            (si(band, 2), "kg·m²", "± 2σ, median over angle"),
            (si(trust.get("miv_kgm2"), 3), "kg·m²", f"MIV, {percent(trust.get('relative_miv'))} of the mean"),
            (
                si(1e3 * deviation, 3) if deviation is not None else "–",
                "mrad",
                "position deviation by the sine",
            ),
            (si(trust.get("dpr"), 3), "", "DPR, disturbance to position"),
            (si(document.get("frequency_hz"), 4), "Hz", "injected"),
        )
    )


def _facts(document: Mapping[str, Any]) -> Safe:
    table_, trust = document["table"], document["trust"]
    angles = table_["position_rad"]
    drift = trust.get("position_dc_rad")
    pairs: list[tuple[str, Any]] = [
        ("Method", f"{document['method']}, {document['inversion']} inversion"),
        (
            "Angles",
            f"{si(angles[0])} … {si(angles[-1])} rad ({si(math.degrees(angles[-1] - angles[0]), 4)}°)",
        ),
        ("Points", str(len(angles))),
        ("Mean wander", f"{si(1e3 * drift, 3)} mrad" if drift is not None else "–"),
        ("Expected error", percent(trust.get("predicted_error"))),
    ]
    notes = "".join(f"<li>{escape(note)}</li>" for note in document.get("notes", ()))
    how = (
        f'<details class="sw"><summary>How it was found</summary><ul>{notes}</ul></details>' if notes else ""
    )
    return Safe(facts(pairs) + how)


def _drift(curve: NamedCurve, before: Sequence[ResultRecord]) -> Safe:
    """Mean difference to each earlier run, in percent, and whether it is more than both bands."""
    rows: list[tuple[Any, ...]] = []
    for one in before[:6]:
        other = named(one)
        here = np.interp(
            curve.position_rad, other.position_rad, other.inertia_kgm2, left=np.nan, right=np.nan
        )
        both = np.isfinite(here)
        if not both.any():
            rows.append((muted(other.name), muted("other angles"), ""))
            continue
        change = float(np.mean(curve.inertia_kgm2[both] - here[both]) / np.mean(here[both]))
        noise = 2 * _share(curve, both) + 2 * _share(other, np.ones(other.position_rad.size, bool))
        told = "within the bands" if abs(change) <= noise else "beyond the bands"
        shown = f"{'+' if change >= 0 else '−'}{abs(100 * change):.2f} %"
        rows.append((link(f"/run/{one.run_id}", other.name), shown, told))
    return table(("Run (UTC)", "Mean", ""), rows, (1,))


def _share(curve: NamedCurve, where: Any) -> float:
    std = curve.std_kgm2[where]
    return float(np.nan_to_num(np.median(std) / np.mean(curve.inertia_kgm2[where]))) if std.size else 0.0
