"""Inputs of a form: a label above, the unit and what is meant below, and a sentence where it is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from html import escape
from typing import Any

from nicegui import ui

from schwung.errors import InputError
from schwung.quantities import UNITS, parse_quantity
from schwung.service.pages.desk import html
from schwung.service.pages.markup import si


class QuantityField:
    """One quantity in SI, or with a unit behind it. `value` is in SI; None where it may be left out and is."""

    def __init__(
        self,
        label: str,
        what: str,
        initial: str = "",
        help: str = "",
        *,
        signed: bool = False,
        optional: bool = False,
    ) -> None:
        self.label, self._what, self._signed, self._optional = label, what, signed, optional
        self._help = help
        unit = next(iter(UNITS[what])).replace("nm", "N·m").replace("hz", "Hz")
        with ui.element("div").classes("sw-field"):
            html(escape(label), "div", "sw-label")
            self.input = ui.input(value=initial, validation=self._wrong)
            self.input.props(
                f'dense outlined suffix="{unit}" aria-label="{escape(label, quote=True)}" hide-bottom-space'
            )
            self._said = html(escape(self._hint()), "div", "help")
        self.input.on_value_change(lambda: self._said.set_content(escape(self._hint())))

    def _wrong(self, text: str) -> str | None:
        try:
            self._parsed(text)
        except InputError as error:
            return f"{error.problem}. {error.remedy}" if error.remedy else error.problem
        return None

    def _parsed(self, text: str) -> float | None:
        if not (text or "").strip():
            if self._optional:
                return None
            raise InputError(self.label, "is missing")
        return parse_quantity(text, self._what, self.label, signed=self._signed)

    def _hint(self) -> str:
        try:
            value = self._parsed(self.input.value)
        except InputError:
            return self._help
        if value is None or self._what != "angle":
            return self._help
        shown = f"{si(value)} rad = {si(math.degrees(value), 3)}°"
        return f"{shown}. {self._help}" if self._help else shown

    @property
    def value(self) -> float | None:
        """In SI. Raises InputError where it is wrong."""
        return self._parsed(self.input.value)


def choice(
    label: str,
    options: Mapping[Any, str],
    initial: Any,
    on_change: Callable[[Any], None] | None = None,
    help: str = "",
) -> ui.select:
    """One of several."""
    with ui.element("div").classes("sw-field"):
        name = html(escape(label), "label", "sw-label")
        element = ui.select(dict(options), value=initial)
        named = f"choice-{element.id}"  # of the very element that has the focus: an aria-label stays outside of it
        name.props(f'for="{named}"')
        element.props(f'dense outlined options-dense for="{named}" hide-bottom-space')
        if help:
            html(escape(help), "div", "help")
    if on_change is not None:
        element.on_value_change(lambda event: on_change(event.value))
    return element


def count(label: str, initial: int, low: int, high: int, help: str = "") -> ui.number:
    """A whole number."""
    with ui.element("div").classes("sw-field"):
        html(escape(label), "div", "sw-label")
        element = ui.number(value=initial, min=low, max=high, step=1, precision=0)
        element.props(f'dense outlined aria-label="{escape(label, quote=True)}" hide-bottom-space')
        if help:
            html(escape(help), "div", "help")
    return element


def line_of_text(label: str, initial: str = "", help: str = "", placeholder: str = "") -> ui.input:
    """A name, or another short text."""
    with ui.element("div").classes("sw-field"):
        html(escape(label), "div", "sw-label")
        element = ui.input(value=initial, placeholder=placeholder)
        element.props(
            f'dense outlined maxlength=60 aria-label="{escape(label, quote=True)}" hide-bottom-space'
        )
        if help:
            html(escape(help), "div", "help")
    return element
