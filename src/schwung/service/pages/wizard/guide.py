"""The steps of a commissioning, what is known so far, and the way between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

from nicegui import ui
from nicegui.element import Element

from schwung.service.pages.desk import Desk, html, set_address
from schwung.service.records import DriveRecord
from schwung.service.values import RunView

STEPS = ("Connect", "Check", "Plan", "Confirm", "Run", "Result", "Export")
CONNECT, CHECK, PLAN, CONFIRM, RUN, RESULT, EXPORT = range(7)


@dataclass
class Known:
    """What the steps leave for each other."""

    machine_id: str | None = None
    checked: RunView | None = None
    wishes: dict[str, Any] = field(default_factory=dict)  # the texts of the form
    planned: RunView | None = None
    run: RunView | None = None
    written: RunView | None = None

    @property
    def plan(self) -> Mapping[str, Any]:
        """The plan's document; empty where there is none yet."""
        return (self.planned.result if self.planned is not None else None) or {}


class Step(Element, component="../static/step.js"):
    """What one step shows; with a heading, that gets the focus when this appears, and the next Tab goes on there."""

    def __init__(self, heading: Element | None = None) -> None:
        super().__init__()
        self._props["heading"] = heading.html_id if heading is not None else ""


class Guide:
    """One commissioning at one page. It keeps nothing that the store lacks, but wishes that were not asked for yet."""

    def __init__(self, desk: Desk, drive: DriveRecord, builders: Sequence[Callable[[Guide], None]]) -> None:
        """`builders`: what shows each of STEPS, in their order."""
        self.desk, self.drive, self._builders = desk, drive, builders
        self.known = Known(machine_id=drive.machine_id)
        self.step = CONNECT
        self._failed = self._shown = False
        self._client = ui.context.client  # steps are built by what they replace
        self._bar = html("", "ol", "sw-steps").props('aria-label="steps" tabindex="-1"')
        self._place = ui.element("div")

    def go(self, step: int) -> None:
        """Show a step."""
        came, self.step, self._failed = self._shown, step, False
        self._shown = True
        self._show_bar()
        self._place.clear()
        with self._place, Step(self._bar if came else None):  # what had the focus goes
            self._builders[step](self)
        run = self.known.run
        keeps = step >= RUN and run is not None
        set_address(
            self._client,
            f"/commission/{self.drive.id}" + (f"?run={run.id}" if keeps and run is not None else ""),
        )

    def refresh(self) -> None:
        """Show the same step anew."""
        self.go(self.step)

    def fail(self) -> None:
        """Mark the step as one that did not go well."""
        self._failed = True
        self._show_bar()

    def _show_bar(self) -> None:
        items = []
        for n, name in enumerate(STEPS):
            kind = (
                "failed"
                if n == self.step and self._failed
                else "now"
                if n == self.step
                else "done"
                if n < self.step
                else ""
            )
            mark = "✓" if kind == "done" else "!" if kind == "failed" else str(n + 1)
            now = ' aria-current="step"' if n == self.step else ""
            items.append(f'<li class="{kind}"{now}><span class="n">{mark}</span>{escape(name)}</li>')
        self._bar.set_content("".join(items))


def wishes_of(plan: Mapping[str, Any]) -> dict[str, Any]:
    """What stands in the form of step 3 for the fields of a PlanRequest, in SI."""
    quantities = {"Stroke": "distance_rad", "Time of one stroke": "duration_s", "Frequency": "frequency_hz",
                  "Amplitude": "amplitude_nm"}  # fmt: skip
    texts = {label: f"{plan[key]:.6g}" for label, key in quantities.items() if plan.get(key) is not None}
    return texts | {
        "kind": plan["profile_kind"],
        "repeats": plan["repeats"],
        "phases": 4 if plan["phases"] > 1 else 1,  # as the form has them
        "returns": plan["returns"],
    }
