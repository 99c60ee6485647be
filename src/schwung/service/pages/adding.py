"""A new drive: who is on the bus, and what shall be known of the one that is added."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from html import escape
from typing import Any

from fastapi import Request
from nicegui import ui

from schwung.api.profiles import list_profiles
from schwung.service.pages.asking import Asked
from schwung.service.pages.confirming import NOT_LOGGED_IN
from schwung.service.pages.desk import Desk, button, frame, go, grid, html, panel
from schwung.service.pages.fields import choice, count, line_of_text
from schwung.service.pages.markup import Safe, muted, table, tag
from schwung.service.values import RunView

BY_IDENTITY = "by identity"


def add_drive(desk: Desk, _request: Request) -> None:
    """Scan a bus, and add one of those that answer; or one that is silent yet."""
    buses = {entry.name: f"{entry.name} ({entry.text})" for entry in desk.service.settings.buses}
    with frame(desk, "Add a drive", "/", "Scanning reads only."):
        if not buses:
            html("The service was started without a bus.", "div", "sw-empty")
            return
        with grid():
            with panel("Who is on the bus", "w7"), ui.element("div").classes("sw-body sw-column"):
                bus = choice("Bus", buses, next(iter(buses)))
                with ui.element("div").classes("sw-form"):
                    first = count("From node", 1, 1, 127)
                    last = count("To node", 127, 1, 127)
                asked = Asked(desk)

                def scan() -> None:
                    found.clear()
                    nodes = {"first": int(first.value or 1), "last": int(last.value or 127)}
                    asked.ask({"kind": "scan", "bus": bus.value, **nodes}, show)

                with ui.element("div"):
                    button("Scan the bus", scan, "primary", enabled=desk.may_act, why=NOT_LOGGED_IN)
                asked.place()
                found = ui.element("div").classes("sw-column")
            with panel("The drive", "w5"), ui.element("div").classes("sw-body sw-column"):
                form = _Form(desk, buses)

        def show(run: RunView) -> None:
            nodes = (run.result or {}).get("nodes", ())
            with found:
                if run.state == "done":
                    _answered(desk, nodes, bus.value, form)


def _answered(desk: Desk, nodes: Any, bus: str, form: _Form) -> None:
    """Who answers, each with a button that fills in the form."""
    known = {drive.node_id for drive in desk.service.store.drives() if drive.bus == bus}
    if not nodes:
        html("Nobody answers. Is the drive on, its bit rate ours, and the bus terminated?", "div", "sw-empty")
        return
    rows = []
    for node in nodes:
        there = node["node_id"] in known
        rows.append(
            (str(node["node_id"]), node_name(node), tag("added", "good") if there else muted("not added yet"))
        )
    html(table(("Node", "Says it is", ""), rows, (0,)))
    with ui.element("div").classes("sw-row"):
        for node in nodes:
            if node["node_id"] not in known:
                button(f"Take node {node['node_id']}", partial(form.take, bus, node), "small")


def node_name(node: Mapping[str, Any]) -> Safe:
    """What a node that answered says of itself."""
    families = ", ".join(str(one) for one in node.get("profiles") or ())
    name = escape(str(node.get("name") or "unnamed"))
    return Safe(f"<b>{name}</b><br>{muted(families or 'no profile fits: draft one from its EDS')}")


class _Form:
    def __init__(self, desk: Desk, buses: Mapping[str, str]) -> None:
        families = {"": BY_IDENTITY, **{profile.family: profile.name for profile in list_profiles()}}
        machines = {"": "none yet", **{machine.id: machine.name for machine in desk.service.store.machines()}}
        self._name = line_of_text("Name", placeholder="Axis 3, pusher")
        self._bus = choice("On", buses, next(iter(buses)))
        self._node = count("Node", 1, 1, 247)
        self._profile = choice("Profile", families, "", help="What the family offers, in which units.")
        self._machine = choice("Machine behind it", machines, "")
        html('<a href="/machines">Add a machine</a>', "div")

        def add() -> None:
            node = int(self._node.value or 1)
            drive = desk.service.add_drive(
                (self._name.value or "").strip() or f"Node {node}", self._bus.value, node, self._profile.value or None,
                self._machine.value or None, desk.who,
            )  # fmt: skip
            go(f"/drive/{drive.id}")

        with ui.element("div"):
            button("Add the drive", add, "primary", enabled=desk.may_act, why=NOT_LOGGED_IN)

    def take(self, bus: str, node: Mapping[str, Any]) -> None:
        """Fill in what a node has said."""
        self._bus.value, self._node.value = bus, node["node_id"]
        if not (self._name.value or "").strip():
            self._name.value = str(node.get("name") or f"Node {node['node_id']}")[:60]
