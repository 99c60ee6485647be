"""Machines as they are believed to be, before they are measured: machine.toml, and a new one."""

from __future__ import annotations

from html import escape

from fastapi import Request
from nicegui import ui

from schwung.service.pages.desk import Desk, button, frame, go, grid, html, panel
from schwung.service.pages.fields import line_of_text
from schwung.service.pages.markup import Safe, moment, table

_EXAMPLE = """\
[motor]
inertia = 0.012            # kg·m²
viscous_friction = 0.2     # N·m·s/rad
peak_torque = 233.0        # N·m

[coupling]
stiffness = 24963.0        # N·m/rad
damping = 8.62             # N·m·s/rad

[load]
viscous_friction = 0.1
inertia = 0.11             # a guess is enough
"""


def overview(desk: Desk, _request: Request) -> None:
    """All machines, and a form for another."""
    store = desk.service.store
    with frame(
        desk, "Machines", "/machines", "What is believed before it is measured: motor, coupling, load."
    ):
        rows = [
            (
                machine.name,
                moment(machine.created),
                machine.who,
                Safe(f'<span class="mono">{machine.sha256[:12]}</span>'),
            )
            for machine in store.machines()
        ]
        with panel("Known machines"):
            html(table(("Machine", "Added (UTC)", "By", "SHA-256"), rows, empty="None yet."))
        with grid():
            with panel("Add a machine", "w6"), ui.element("div").classes("sw-body sw-column"):
                name = line_of_text("Name", placeholder="Slider-crank, line 3")
                html("machine.toml", "div", "sw-label")
                toml = ui.textarea(value=_EXAMPLE).props(
                    'outlined autogrow aria-label="machine.toml" input-class="mono"'
                )

                def add() -> None:
                    desk.service.add_machine(name.value or "", toml.value or "", {}, desk.who)
                    go("/machines")

                button("Add", add, "primary", enabled=desk.may_act, why="Log in first.")
            with panel("What the first one says", "w6"), ui.element("div").classes("sw-body"):
                machines = store.machines()
                if machines:
                    text = store.machine_path(machines[0].id).read_text(encoding="utf-8")
                    html(f'<pre class="mono" style="white-space:pre-wrap;margin:0">{escape(text)}</pre>')
                else:
                    html("Nothing yet.", "div", "muted")
