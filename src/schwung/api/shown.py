"""How values show themselves in notebooks: a short table, a small picture, columns for pandas.

The values themselves are made below, where nothing is drawn; what programs get is a subclass that can.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from html import escape
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeVar
from zlib import crc32

import numpy as np

from schwung.errors import InputError
from schwung.extras import MissingLibraryError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

S = TypeVar("S")

_PICTURE_IN = 2.4  # height of the small picture


class Shown:
    """A value with a table, a picture and columns; which ones is said by three methods of the subclass."""

    def _facts(self) -> Sequence[tuple[str, str]]:
        """The rows of the short table: what, and how much."""
        return ()

    def _draw(self, axes: Axes) -> None:
        """The picture. Raises InputError where the value has none."""
        raise InputError(type(self).__name__, "has no picture of its own", "Plot one of its parts.")

    def _columns(self) -> Mapping[str, Any]:
        """The columns, of one length. Raises InputError where the value has none."""
        raise InputError(type(self).__name__, "is no table", "Take one of its parts.")

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw it on the given axes, else on pyplot's present ones; returns the axes."""
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.gca()
        self._draw(ax)
        return ax

    def to_dataframe(self) -> Any:
        """As a pandas DataFrame: names carry their units. Raises InputError where pandas is not installed."""
        columns = self._columns()
        if find_spec("pandas") is None:
            raise MissingLibraryError("to_dataframe", "pandas", "pandas")
        import pandas

        return pandas.DataFrame(dict(columns))

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr><th scope="row">{escape(name)}</th><td>{escape(text)}</td></tr>'
            for name, text in self._facts()
        )
        table = f"<table><caption>{escape(type(self).__name__)}</caption>{rows}</table>"
        return f'<div class="schwung-value"><style>{_css()}</style>{table}{self._picture()}</div>'

    def _picture(self) -> str:
        """The picture as SVG; nothing where the value has none."""
        from schwung.report.style import in_style, new_figure, to_svg

        @in_style
        def drawn() -> str:
            figure = new_figure(_PICTURE_IN)
            self._draw(figure.axes[0])
            return to_svg(figure, f"v{crc32(repr(self._facts()).encode()):x}", type(self).__name__)

        try:
            return drawn()
        except InputError:
            return ""


def _css() -> str:
    """The report's colours: dark where the page around says so, be it JupyterLab, VS Code or the documentation."""
    from schwung.report.colours import PALETTE

    light = "".join(f"--{c.name}:{c.light};" for c in PALETTE)
    dark = "".join(f"--{c.name}:{c.dark};" for c in PALETTE)
    within = "[data-jp-theme-light=false],.vscode-dark,html[data-theme=dark]"
    return (
        f".schwung-value{{{light}max-width:46rem}}"
        f":is({within}) .schwung-value{{{dark}}}"
        ".schwung-value table{border-collapse:collapse;color:var(--ink);background:var(--surface)}"
        ".schwung-value caption{caption-side:top;text-align:left;font-weight:600;padding:.2rem 0;"
        "color:var(--ink);background:var(--surface)}"
        ".schwung-value th{text-align:left;font-weight:400;color:var(--muted);padding:.1rem 1rem .1rem 0}"
        ".schwung-value td{text-align:left;white-space:normal}"
        ".schwung-value svg{width:100%;height:auto;background:var(--surface)}"
    )


def as_shown(kind: type[S], value: Any, **parts: Any) -> S:
    """A value from below as the kind that shows itself, with some of its parts in the place of its own."""
    if isinstance(value, kind) and not parts:
        return value
    content = {field.name: getattr(value, field.name) for field in fields(value)}
    return kind(**content | parts)


def number(value: float, unit: str = "") -> str:
    """Four significant digits and the unit."""
    return f"{value:.4g} {unit}".rstrip()


def span(values: Any, unit: str) -> str:
    """From the smallest to the largest."""
    return f"{np.min(values):.4g} … {np.max(values):.4g} {unit}"
