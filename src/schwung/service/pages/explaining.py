"""An explanation: what the belief left out, where, how sure, and the proof on runs that were kept aside."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from schwung.api.looks import label_of, probability, words_of
from schwung.service.pages.desk import Desk, grid, html, panel
from schwung.service.pages.markup import Safe, muted, numbers, percent, si, table, verdict
from schwung.service.pages.reported import show_drawings
from schwung.service.pages.weighed import show_next_motion, show_weighed
from schwung.service.pages.words import VERDICTS
from schwung.service.records import ResultRecord


def show_explanation(desk: Desk, found: ResultRecord) -> None:
    """Everything about an explanation."""
    document = found.document
    if "told" in document:  # weighed: names with probabilities
        show_weighed(desk, found)
        return
    tone, word = VERDICTS.get(document["verdict"], ("", document["verdict"]))
    findings, mismatch = document["findings"], document["mismatch"]
    reasons = [one["text"] for one in findings or mismatch] or [
        "Nothing is missed: the belief explains every run."
    ]
    with panel("What the belief left out"):
        html(verdict(tone, word, reasons))
        html(proof_numbers(document))
        if findings:
            html(findings_table(findings))
    with grid():
        show_drawings(desk, desk.service.run(found.run_id))
    left = document.get("remainder") or ()
    notes = [*(one["text"] for one in left), *document.get("cautions", document.get("notes", ()))]
    if notes:
        with panel("What is left, and what would help"):
            html("<ul>" + "".join(f"<li>{escape(note)}</li>" for note in notes) + "</ul>", "div", "sw-body")
    show_next_motion(desk, found)


def proof_numbers(document: Mapping[str, Any]) -> Safe:
    """Before and after, on runs that were kept aside, against the noise."""
    fit, floor = document["fit"], document["noise_floor"]["torque_nm"]
    before, after = fit["before"]["torque_rmse_nm"], fit["after"]["torque_rmse_nm"]
    count = len(fit["heldout_runs"])
    aside = f"{count} run{'s' if count > 1 else ''} kept aside" if count else "the runs it was fitted to"
    share = f"{before / after:.3g} ×" if after and document["findings"] else "–"
    return numbers(
        (
            (si(before, 3), "N·m", f"missed before, RMS on {aside}"),
            (si(after, 3), "N·m", "missed with the named physics"),
            (share, "", "better"),
            (si(floor, 3), "N·m", "noise: nobody can be better"),
        )
    )


def findings_table(findings: list[Mapping[str, Any]]) -> Safe:
    """Named physics with parameters, place, share of the mismatch, and what it could as well be."""
    rows = []
    for one in findings:
        where = one["where"]
        name = Safe(
            f"<b>{escape(words_of(one['physics']).name.capitalize())}</b><br>"
            f'<span class="mono">{escape(one["physics"])}</span>'
        )
        values = "<br>".join(escape(f"{label_of(key)}: {_value(q)}") for key, q in one["parameters"].items())
        place = f"{escape(where['text'])}<br>{muted('p ' + probability(where['p_value']))}"
        others = (
            ", ".join(words_of(other).name for other in one["indistinguishable_from"]) or "nothing else known"
        )
        rows.append((name, Safe(values), Safe(place), percent(where["share_of_energy"]), others))
    heads = ("Physics", "Parameters (95 %)", "Where", "Share", "Could as well be")
    return table(heads, rows, (3,))


def _value(quantity: Mapping[str, Any]) -> str:
    value, interval = quantity["value"], quantity.get("ci95")
    unit = f" {quantity['unit']}" if quantity["unit"] not in ("", "1") else ""
    if isinstance(value, list):
        return f"a curve of {len(value)} points{unit}"
    told = f"{si(value, 3)}{unit}"
    return f"{told} ({si(interval[0], 3)} … {si(interval[1], 3)})" if interval else told
