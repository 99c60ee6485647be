"""Diagrams: what is drawn is decided here, as plain data; how, in static/panels.js."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from nicegui.element import Element

from schwung.api.looks import thin
from schwung.api.watching import Array

#: Points of a curve beyond which smallest and largest stand for their neighbours.
MOST_POINTS = 2400
_DIGITS = 6


class Diagram(Element, component="static/diagram.js"):
    """Stacked diagrams over one axis; zoom by dragging or + and −, Home shows all."""

    def __init__(self, content: Mapping[str, Any], height_px: int = 300) -> None:
        super().__init__()
        self._props["content"] = content
        self._props["height"] = height_px

    def show(self, content: Mapping[str, Any]) -> None:
        """Draw something else."""
        self._props["content"] = content
        self.update()


class Scope(Element, component="static/scope.js"):
    """The live scope of one drive; `url` is the web socket of its samples (scope.py)."""

    def __init__(
        self, url: str, traces: Sequence[Mapping[str, Any]], height_px: int = 420, window_s: float = 5.0
    ) -> None:
        super().__init__()
        self._props["url"] = url
        self._props["traces"] = list(traces)
        self._props["height"] = height_px
        self._props["initial_s"] = window_s


def diagram(
    x_label: str, x_unit: str, panels: Sequence[Mapping[str, Any]], label: str, *, log: bool = False
) -> dict[str, Any]:
    """The content of a Diagram."""
    return {"x": {"label": x_label, "unit": x_unit, "log": log}, "panels": list(panels), "label": label}


def panel(
    title: str,
    series: Iterable[Mapping[str, Any]],
    lines: Iterable[Mapping[str, Any]] = (),
    *,
    share: float = 1.0,
    zero: bool = False,
    log: bool = False,
) -> dict[str, Any]:
    """One of the stacked diagrams. `zero`: its axis begins there; `share`: of the height."""
    return {
        "title": title,
        "series": list(series),
        "lines": list(lines),
        "share": share,
        "zero": zero,
        "log": log,
    }


def line(
    name: str,
    x: Array,
    y: Array,
    colour: str,
    *,
    width: float = 1.6,
    dash: Sequence[float] = (),
    alpha: float = 1.0,
) -> dict[str, Any]:
    """A curve through (n,) points; what is not finite is a gap."""
    x, y = _thinned(np.asarray(x, float), np.asarray(y, float))
    return {
        "kind": "line", "name": name, "x": _list(x), "y": _list(y), "colour": colour, "width": width,
        "dash": list(dash), "alpha": alpha,
    }  # fmt: skip


def band(name: str, x: Array, low: Array, high: Array, colour: str, alpha: float = 0.2) -> dict[str, Any]:
    """A filled range over (n,) points."""
    return {
        "kind": "band", "name": name, "x": _list(np.asarray(x)), "low": _list(np.asarray(low)),
        "high": _list(np.asarray(high)), "colour": colour, "alpha": alpha,
    }  # fmt: skip


def points(name: str, x: Array, y: Array, colour: str, size: float = 2.0) -> dict[str, Any]:
    """Dots at (n,) points."""
    return {
        "kind": "points", "name": name, "x": _list(np.asarray(x)), "y": _list(np.asarray(y)), "colour": colour,
        "size": size,
    }  # fmt: skip


def limit(value: float, text: str, colour: str = "unusable", *, always: bool = False) -> dict[str, Any]:
    """A dashed line with its name; `always`: the axis reaches to it."""
    return {"value": float(value), "text": text, "colour": colour, "always": always}


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    return thin(x, y, MOST_POINTS)


def _list(values: Array) -> list[float | None]:
    return [float(f"{v:.{_DIGITS}g}") if np.isfinite(v) else None for v in values.tolist()]
