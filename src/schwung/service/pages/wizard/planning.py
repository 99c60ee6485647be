"""Step 3: the motion that is wished for, and the plan with what it is predicted to do."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from nicegui import ui

from schwung.errors import SchwungError
from schwung.service.pages.asking import Asked
from schwung.service.pages.curves import prediction_diagram
from schwung.service.pages.desk import actions, button, enable, grid, html, panel
from schwung.service.pages.diagrams import Diagram
from schwung.service.pages.fields import QuantityField, choice, count
from schwung.service.pages.markup import Safe, checks, facts, percent, problem, si, table, tag
from schwung.service.pages.wizard.guide import CHECK, CONFIRM, Guide
from schwung.service.values import RunView

_KINDS = {
    "third": "1/3 trapezoid",
    "poly5": "5th-order polynomial",
    "scurve": "S-curve",
    "cosine": "cosine",
    "cycloid": "cycloid",
}


class _Form:
    """The wishes, kept as they were typed so that they are there again on the way back."""

    def __init__(self, kept: Mapping[str, Any]) -> None:
        with ui.element("div").classes("sw-form"):
            self._distance = QuantityField(
                "Stroke", "angle", kept.get("Stroke", "180deg"), "Signed, from where it stands.", signed=True
            )
            self._duration = QuantityField(
                "Time of one stroke", "time", kept.get("Time of one stroke", "250ms")
            )
            self._kind = choice("Profile", _KINDS, kept.get("kind", "third"))
            self._repeats = count("Repeats", kept.get("repeats", 2), 1, 50, "How often everything is made.")
        self._returns = ui.checkbox("And back again", value=kept.get("returns", True)).props("dense")
        with _more("Injection"):
            self._frequency = _optional("Frequency", "frequency", kept, "Empty: proposed.")
            self._amplitude = _optional("Amplitude", "torque", kept, "Empty: proposed.")
            phases = {1: "1", 4: "4: more accurate"}
            self._phases = choice("Phases", phases, kept.get("phases", 1), help="Excited motions per repeat.")
        with _more("Limits, tighter than the drive's own"):
            self._limits = {
                "position_min_rad": _optional("Lower end", "angle", kept, signed=True),
                "position_max_rad": _optional("Upper end", "angle", kept, signed=True),
                "speed_max_rad_s": _optional("Speed", "speed", kept),
                "torque_max_nm": _optional("Torque", "torque", kept),
                "following_error_rad": _optional("Following error", "angle", kept),
            }

    @property
    def _quantities(self) -> tuple[QuantityField, ...]:
        return (self._distance, self._duration, self._frequency, self._amplitude, *self._limits.values())

    def texts(self) -> dict[str, Any]:
        """What stands in the form."""
        return {field.label: field.input.value for field in self._quantities} | {
            "kind": self._kind.value,
            "repeats": int(self._repeats.value or 1),
            "phases": self._phases.value,
            "returns": bool(self._returns.value),
        }

    def request(self) -> dict[str, Any]:
        """As the service takes it, but for drive and machine. Raises InputError where a field is wrong."""
        return {
            "kind": "plan",
            "distance_rad": self._distance.value,
            "duration_s": self._duration.value,
            "profile_kind": self._kind.value,
            "returns": bool(self._returns.value),
            "repeats": int(self._repeats.value or 1),
            "phases": self._phases.value,
            "frequency_hz": self._frequency.value,
            "amplitude_nm": self._amplitude.value,
            "limits": {key: field.value for key, field in self._limits.items()},
        }


def _more(name: str) -> Any:
    with ui.element("details").classes("sw"):
        html(escape(name), "summary")
        return ui.element("div").classes("sw-form")


def _optional(
    label: str, what: str, kept: Mapping[str, Any], help: str = "", *, signed: bool = False
) -> QuantityField:
    return QuantityField(label, what, kept.get(label, ""), help, signed=signed, optional=True)


def plan(guide: Guide) -> None:
    """Wishes on the left, what they lead to on the right."""
    desk, known = guide.desk, guide.known

    def predict() -> None:
        known.wishes = form.texts()
        request = form.request() | {"drive_id": guide.drive.id, "machine_id": known.machine_id}
        shown.clear()
        known.planned = None
        enable(onward, False, "The prediction goes on.")
        asked.ask(request, planned)

    def planned(run: RunView) -> None:
        known.planned = run
        document = run.result or {}
        can_start = run.state == "done" and bool(document.get("can_start"))
        enable(onward, can_start, "Preflight says no: see the findings.")
        if not can_start:
            guide.fail()
        shown.clear()
        with shown:
            if document.get("predicted"):
                _predicted(document)

    with grid():
        with panel("The motion", "w4"):
            with ui.element("div").classes("sw-body sw-column"):
                form = _Form(known.wishes)
            with ui.element("div").classes("sw-foot"):
                button("Back", lambda: guide.go(CHECK))
                html("", "span", "spring")
                button("Predict", predict, "primary", enabled=desk.may_act)
        with ui.element("div").classes("w8 sw-column"):
            asked = Asked(desk)
            asked.place()
            shown = ui.element("div").classes("sw-column")
    with actions("Planning reads the drive and simulates. Nothing is switched on, nothing moves."):
        onward = button(
            "Go on to confirm", lambda: guide.go(CONFIRM), "primary", enabled=False, why="Predict first."
        )
    if known.planned is not None:
        planned(known.planned)
    elif desk.may_act:
        try:
            predict()
        except SchwungError as error:
            with shown:
                html(problem(error))


def _predicted(document: Mapping[str, Any]) -> None:
    told = f"{document['motions']} motions, about {document['duration_s']:.0f} s"
    with panel("What it is predicted to do", "w12", told):
        html(limits_table(document))
        with ui.element("div").classes("sw-body"):
            Diagram(prediction_diagram(document), 430)
    with panel("Preflight", "w12"):
        html(checks(document["checks"]))
    with panel("Why so", "w12"), ui.element("div").classes("sw-body"):
        excitation = document["excitation"]
        played = f"{document['mode']}, sampled by {document['sampling']}, {si(document['sync_rate_hz'])} Hz"
        rows = (
            (
                "Injection",
                f"{si(excitation['amplitude_nm'], 3)} N·m at {si(excitation['frequency_hz'], 4)} Hz",
            ),
            ("Played as", played),
            ("First", document.get("creep") or "–"),
        )
        html(facts(rows))
        html("<ul>" + "".join(f"<li>{escape(reason)}</li>" for reason in document["reasons"]) + "</ul>")


def limits_table(document: Mapping[str, Any]) -> Safe:
    """Predicted peaks against the limits."""
    limits, excited = document["limits"], document["predicted"]["excited"]
    low, high = excited["travel_rad"]
    inside = limits["position_min_rad"] <= low and high <= limits["position_max_rad"]
    window = f"{si(limits['position_min_rad'])} … {si(limits['position_max_rad'])} rad"
    rows = [("Travel", f"{si(low, 3)} … {si(high, 3)} rad", window, "", _fits(inside))]
    for name, key, limit, unit in (
        ("Speed", "peak_speed_rad_s", "speed_max_rad_s", "rad/s"),
        ("Torque", "peak_torque_nm", "torque_max_nm", "N·m"),
        ("Following error", "peak_following_error_rad", "following_error_rad", "rad"),
    ):
        peak, most = excited[key], limits[limit]
        rows.append(
            (
                name,
                f"{si(peak, 3)} {unit}",
                f"{si(most, 3)} {unit}",
                percent(peak / most),
                _fits(peak <= most),
            )
        )
    return table(("", "Predicted peak", "Limit", "Used", ""), rows, (3,))


def _fits(fits: bool) -> Safe:
    return tag("within", "good") if fits else tag("beyond", "unusable")
