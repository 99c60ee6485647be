"""The best motion beside the usual ones: what each costs, and its pictures."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from schwung.service.pages.desk import Desk, html, panel
from schwung.service.pages.markup import Safe, si, table
from schwung.service.values import RunView

_COLUMNS = (
    ("copper_n2m2s", "Copper loss, N²m²s"),
    ("rms_torque_nm", "RMS torque, N·m"),
    ("peak_torque_nm", "Peak torque, N·m"),
    ("peak_speed_rad_s", "Peak speed, rad/s"),
)


def show_motions(desk: Desk, run: RunView) -> None:
    """What optimising or playing has led to; nothing for other runs."""
    result = run.result or {}
    found = result.get("optimised") or result.get("played") or {}
    motions = found.get("motions") or ()
    if motions:
        saving = found.get("copper_saving")
        told = (
            f"{100 * saving:.0f} % less copper loss than the usual one"
            if isinstance(saving, int | float)
            else ""
        )
        with panel("Motions beside each other", aside=told):
            html(motions_table(motions))
    for file in desk.service.store.files(run.id):
        if file.name.endswith(".png") and not file.name.startswith("guess_"):
            name = file.name.removesuffix(".png").replace("_", " ").capitalize()
            with panel(name, "w6"):
                picture = f'<img src="/api/files/{file.id}" alt="{escape(name)}" loading="lazy">'
                html(picture, "div", "sw-body sw-picture")


def motions_table(motions: Any) -> Safe:
    """One row per motion; what breaks a limit says which."""
    rows = []
    for one in motions:
        broken = ", ".join(str(limit) for limit in one.get("breaks") or ()) or "keeps all"
        values = [si(one.get(key), 3) for key, _ in _COLUMNS]
        rows.append((_name(one), si(one.get("duration_s"), 3), *values, broken))
    heads = ("Motion", "Time, s", *(head for _, head in _COLUMNS), "Limits")
    return table(heads, rows, tuple(range(1, 2 + len(_COLUMNS))))


def _name(motion: Mapping[str, Any]) -> str:
    return str(motion.get("name", "")).replace("_", " ")
