"""Results that are tables or texts: what differs, a profile checked or drafted, the archive, the paper."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from schwung.service.pages.desk import Desk, html, panel
from schwung.service.pages.markup import Safe, Tone, link, si, table, tag
from schwung.service.pages.words import verdict_tag
from schwung.service.values import RunView

_MOST = 400  # rows of a table; the files have all


def show_told(desk: Desk, run: RunView) -> None:
    """What there is of these in a run's result; nothing else."""
    result = run.result or {}
    if "diff" in result:
        _diff(result["diff"])
    if "findings" in result:
        _checked(result)
    if "profile" in result and "missing" in result:
        _drafted(result)
    if "batch" in result:
        _batch(desk, result["batch"])
    if "reproduced" in result:
        for one in result["reproduced"].values():
            with panel(str(one["title"])):
                words = (f"<p><b>{name}</b>: {escape(str(one[key]))}</p>" for key, name in _PAPER)
                html("".join(words), "div", "sw-body sw-column")


_PAPER = (("paper", "Paper"), ("here", "Here"), ("difference", "Difference"))


def _diff(found: Mapping[str, Any]) -> None:
    first, second = found["a"]["source"], found["b"]["source"]
    alone = f"{len(found['only_in_a'])} only in the first, {len(found['only_in_b'])} only in the second"
    with panel(
        "What differs", aside=f"{len(found['different'])} differ, {found['equal']} are equal; {alone}"
    ):
        html(_values(found["different"], first, second, "Nothing: what both have is equal."))
    for title, rows in ((first, found["only_in_a"]), (second, found["only_in_b"])):
        if rows:
            with panel(f"Only in {title}"):
                html(f'<details class="sw sw-body"><summary>{len(rows)} parameters</summary>'
                     f"{_values(rows, first, second)}</details>")  # fmt: skip


def _values(rows: Any, first: str, second: str, empty: str = "") -> Safe:
    cells = [
        (
            Safe(f"{escape(row['index'])}:{row['subindex']:02X} {escape(row['name'])}"),
            _value(row, "a"),
            _value(row, "b"),
            row["unit"] or "",
        )
        for row in rows[:_MOST]
    ]
    return table(("Parameter", first, second, "Unit"), cells, (1, 2), empty)


def _value(row: Mapping[str, Any], side: str) -> str:
    raw, worth = row[side], row[f"{side}_si"]
    if raw is None:
        return "–"
    return (
        si(worth, 5)
        if isinstance(worth, int | float)
        else str(raw["hex"])
        if isinstance(raw, Mapping)
        else str(raw)
    )


def _checked(result: Mapping[str, Any]) -> None:
    tones: dict[str, Tone] = {"error": "unusable", "warning": "doubtful"}
    rows = [
        (
            tag(one["severity"], tones.get(one["severity"], "")),
            one["place"],
            f"{one['problem']}. {one['remedy']}",
        )
        for one in result["findings"]
    ]
    with panel(f"{result['family']}: what the EDS says of it"):
        html(table(("", "Place", "Finding"), rows, empty="Nothing to mend."))
    if result["left_to_you"]:
        with panel("Left to you: units that whoever has the machine gives"):
            html(table(("", "Hint"), list(result["left_to_you"].items())))
    if result["eds_warnings"]:
        odd = [
            (f"line {one['line']}", one["section"], f"{one['problem']}. {one['remedy']}")
            for one in result["eds_warnings"]
        ]
        with panel("Odd in the EDS itself"):
            html(table(("", "Section", "Finding"), odd))


def _drafted(result: Mapping[str, Any]) -> None:
    if result["missing"]:
        with panel("Not found in the EDS"):
            html(
                "<ul>" + "".join(f"<li>{escape(one)}</li>" for one in result["missing"]) + "</ul>",
                "div",
                "sw-body",
            )
    with panel("profile.toml, as drafted"):
        html(
            f'<pre class="mono" style="white-space:pre-wrap;margin:0">{escape(result["profile"])}</pre>',
            "div",
            "sw-body",
        )


def _batch(desk: Desk, found: Mapping[str, Any]) -> None:
    rows = []
    bad = sum(1 for one in found["sessions"] if one.get("error"))
    for one in found["sessions"][:_MOST]:
        run_id = str(one["file"]).split("/")[1] if str(one["file"]).startswith("runs/") else ""
        name = link(f"/run/{run_id}", str(one.get("created") or "")[:16] or run_id) if run_id else one["file"]
        figures = [si(one[key], 3) for key in _FIGURES if key in one]
        rows.append(
            (
                name,
                verdict_tag(one.get("verdict")) or "–",
                *figures,
                one.get("physics") or "",
                one.get("error") or "",
            )
        )
    some = found["sessions"][0] if found["sessions"] else {}
    heads = (
        "Session",
        "Verdict",
        *(head for key, head in _FIGURES.items() if key in some),
        "Left out",
        "Trouble",
    )
    told = f"{len(found['sessions']) - bad} of {len(found['sessions'])} have a result"
    with panel("Session by session", aside=told):
        html(table(heads, rows, tuple(range(2, len(heads) - 2)), "There was no session."))


_FIGURES = {
    "inertia_min_kgm2": "Least, kg·m²", "inertia_mean_kgm2": "Mean, kg·m²", "inertia_max_kgm2": "Most, kg·m²",
    "rmse_before_nm": "Missed before, N·m", "rmse_after_nm": "After, N·m",
}  # fmt: skip
