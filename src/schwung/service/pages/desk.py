"""What every page needs: the service, who looks, whether he may act; and the frame around the content."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import Any, Protocol

from fastapi import Request
from nicegui import Client, ui
from nicegui.element import Element

from schwung.errors import SchwungError
from schwung.service.pages.markup import Safe, moment, problem, tag
from schwung.service.pages.words import cia402_tone
from schwung.service.service import Service

#: How often a page looks whether something has changed (s). It is a look into memory.
LOOK_S = 0.25

_ROOMS = (
    ("/", "Drives"),
    ("/runs", "Runs"),
    ("/compare", "Compare"),
    ("/machines", "Machines"),
    ("/files", "Files"),
    ("/trail", "Audit trail"),
)
_LOGO = (
    '<svg viewBox="0 0 26 26" fill="none" aria-hidden="true"><path d="M2 13c2.5-9 6-9 8.5 0s5.5 9 8 0S23 5 24.5 6" '
    'stroke="#5db8f5" stroke-width="2.4" stroke-linecap="round"/><circle cx="10.5" cy="13" r="2.6" fill="#ff9550"/>'
    "</svg>"
)
_THEME = (
    '<svg viewBox="0 0 20 20" aria-hidden="true"><circle cx="10" cy="10" r="7" fill="none" stroke="currentColor" '
    'stroke-width="2"/><path d="M10 3a7 7 0 0 1 0 14z" fill="currentColor"/></svg>'
)


class Gate(Protocol):
    """Who may act; guard.Guard."""

    def may_act(self, connection: Any) -> bool: ...

    def who(self, connection: Any) -> str: ...


@dataclass(frozen=True)
class Desk:
    """One visitor at one page."""

    service: Service
    may_act: bool
    who: str

    @classmethod
    def of(cls, service: Service, gate: Gate, request: Request) -> Desk:
        """The desk of whoever asks for a page."""
        return cls(service, gate.may_act(request), gate.who(request))


@contextmanager
def frame(desk: Desk, title: str, room: str = "", aside: str = "") -> Iterator[None]:
    """Head, rooms and the banner of a STOP; the content comes within. `room`: address of the room that is marked."""
    ui.page_title(f"{title} · Schwung")
    marks = ((url, name, ' aria-current="page"' if url == room else "") for url, name in _ROOMS)
    nav = "".join(f'<a href="{url}"{mark}>{name}</a>' for url, name, mark in marks)
    html(
        f'<a class="sw-brand" href="/">{_LOGO}Schwung</a><nav class="sw-nav" aria-label="rooms">{nav}</nav>'
        '<span class="spring"></span><button class="sw-icon" type="button" onclick="Schwung.turnTheme()" '
        f'aria-label="light or dark" title="Light or dark">{_THEME}</button>',
        "header",
        "sw-head",
    )
    with ui.element("main").classes("sw-main"):
        banner = ui.element("div")
        _keep_banner(desk, banner)
        if not desk.may_act:
            _ask_for_token()
        html(f'<h1>{escape(title)}</h1><span class="aside">{escape(aside)}</span>', "div", "sw-title")
        yield


def _keep_banner(desk: Desk, banner: Element) -> None:
    """Says as long as it is so that the service is stopped."""
    shown: list[Any] = [None]

    def look() -> None:
        stopped = desk.service.latch.stopped
        if stopped == shown[0]:
            return
        shown[0] = stopped
        banner.clear()
        if stopped is None:
            return
        with banner, ui.element("div").classes("sw-latched").props('role="alert"'):
            html(
                f"<b>STOPPED</b> by {escape(stopped.who)}, {moment(stopped.at)} UTC. Nothing moves and nothing is "
                "written until it is released."
            )
            if desk.may_act:
                button("The machine is clear: release", lambda: desk.service.release(desk.who), "small")

    look()
    ui.timer(LOOK_S, look)


def _ask_for_token() -> None:
    with ui.element("form").classes("sw-verdict live sw-row").props('action="/login" method="get"'):
        html(
            "You may look, and STOP. What moves or writes needs the token that stands in the start line of the service."
        )
        ui.element("input").props(
            'name="token" type="password" autocomplete="off" aria-label="token" placeholder="Token" class="sw-token"'
        )
        with ui.element("button").classes("sw-button small").props('type="submit"'):
            ui.html("Log in", sanitize=False, tag="span")


def html(content: str, element: str = "div", classes: str = "") -> ui.html:
    """HTML of ours, everything of others escaped already (markup.py)."""
    return ui.html(content, sanitize=False, tag=element).classes(classes)


@contextmanager
def panel(title: str, classes: str = "w12", aside: str = "") -> Iterator[Element]:
    """A titled box; yields its head, for further buttons."""
    with (
        ui.element("section")
        .classes(f"sw-panel {classes}")
        .props(f'aria-label="{escape(title, quote=True)}"')
    ):
        with ui.element("header") as head:
            html(escape(title), "h2")
            html("", "span", "spring")
            if aside:
                html(escape(aside), "span", "muted")
        yield head


@contextmanager
def grid(classes: str = "") -> Iterator[Element]:
    """Twelve columns."""
    with ui.element("div").classes(f"sw-grid {classes}") as element:
        yield element


@contextmanager
def actions(remark: str = "") -> Iterator[None]:
    """The way on and back, in sight wherever the page is scrolled to."""
    with ui.element("div").classes("sw-panel sw-actions"), ui.element("div").classes("sw-foot"):
        html(escape(remark), "span", "muted")
        html("", "span", "spring")
        yield


Handler = Callable[[], Any]


def button(word: str, handler: Handler, kind: str = "", *, enabled: bool = True, why: str = "") -> Element:
    """A button; errors that we raise on purpose are shown where it stands. `why`: says why it is not enabled."""
    element = ui.element("button").classes(f"sw-button {kind}").props('type="button"')
    with element:
        html(escape(word), "span")
    enable(element, enabled, why)

    async def pressed() -> None:
        if element.props.get("aria-disabled"):
            return
        try:
            result = handler()
            if isinstance(result, Coroutine):  # no dialog: to await one is to open it
                await result
        except SchwungError as error:
            show_problem(error)

    element.on("click", pressed)
    return element


def enable(element: Element, enabled: bool, why: str = "") -> None:
    """A button that may be pressed, or not, and why not. It stays in the tab order, so that the reason can be read."""
    if enabled:
        element.props(remove="aria-disabled title")
    else:
        element.props(f'aria-disabled="true" title="{escape(why, quote=True)}"')


def show_problem(error: BaseException) -> None:
    """The sentence and the remedy, until it is read."""
    with ui.dialog() as dialog, ui.element("div").classes("sw-panel").style("max-width:560px"):
        html(problem(error), "div", "sw-body")
        with ui.element("div").classes("sw-foot"):
            button("Close", dialog.close, "primary")
    dialog.props("no-esc-dismiss")  # Escape is STOP, and nothing else
    dialog.open()


def go(url: str) -> None:
    """To another page."""
    ui.navigate.to(url)


def set_address(client: Client, url: str) -> None:
    """What the address bar of a visitor says, without leaving: whoever loads it again comes back to this."""
    client.run_javascript(f"history.replaceState(null, '', {json.dumps(url)})")


def state_tag(status: Any) -> Safe:
    """A drive's state in words."""
    if status.state is None:
        return tag(
            "not connected" if not status.trouble else "does not answer",
            "off" if not status.trouble else "doubtful",
        )
    return tag(status.state.cia402, cia402_tone(status.state.cia402))
