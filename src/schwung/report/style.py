"""One look for every picture: colours that mean the same everywhere, in light, in dark and on paper.

Pictures are drawn once, in the light colours; within the page each colour becomes a CSS variable, so that the same
picture follows the reader's theme.
"""

from __future__ import annotations

import functools
import io
import re
from collections.abc import Callable, Sequence
from html import escape
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from schwung.motion import Array
from schwung.report.colours import GRID, INK, MOST_POINTS, MUTED, PALETTE, SURFACE, Colour, thin

P = ParamSpec("P")
R = TypeVar("R")


WIDTH_IN = 9.2
_PAD_IN = 3 / 72  # around each axes with its labels
_SVG_DPI = 72  # its unit is the point
DASHED = (0, (4, 2))

_SETTINGS: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # ships with matplotlib: the same picture everywhere
    "font.size": 8.5,
    "svg.fonttype": "none",
    "svg.hashsalt": "schwung",  # the same content gives the same file
    "figure.facecolor": SURFACE.light,
    "savefig.facecolor": SURFACE.light,
    "axes.facecolor": SURFACE.light,
    "axes.edgecolor": MUTED.light,
    "axes.labelcolor": MUTED.light,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK.light,
    "axes.titlepad": 7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.spines.left": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "axes.unicode_minus": True,
    "grid.color": GRID.light,
    "xtick.color": MUTED.light,
    "ytick.color": MUTED.light,
    "ytick.major.size": 0,
    "text.parse_math": False,  # a "$" in a name is a dollar
    "text.color": INK.light,
    "legend.frameon": False,
}


def in_style(draw: Callable[P, R]) -> Callable[P, R]:
    """Run a drawing function with the report's settings and leave matplotlib's own as they were."""

    @functools.wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> R:
        with matplotlib.rc_context():
            matplotlib.rcdefaults()  # what the user's matplotlibrc says is for the user's own pictures
            matplotlib.rcParams.update(_SETTINGS)
            return draw(*args, **kwargs)

    return styled


def new_figure(height_in: float, ratios: Sequence[float] = (1.0,)) -> Figure:
    """A figure of the report's width with one axes per ratio, one above the other, sharing their x-axis."""
    figure = Figure(figsize=(WIDTH_IN, height_in))
    FigureCanvasAgg(figure)
    figure.subplots_adjust(left=0.07, right=0.99, bottom=0.12, top=0.92)  # about as it will be laid out
    figure.subplots(len(ratios), 1, sharex=True, gridspec_kw={"height_ratios": list(ratios)})
    return figure


def curve(
    axes: Axes,
    x: Array,
    y: Array,
    colour: Colour,
    *,
    label: str = "_",
    width: float = 1.2,
    alpha: float = 1.0,
    most: int = MOST_POINTS,
) -> None:
    """Draw a signal, thinned to what the eye can see. A label that begins with "_" is not shown."""
    x, y = thin(x, y, most)
    axes.plot(x, y, color=colour.light, linewidth=width, alpha=alpha, label=label)


def key(axes: Axes) -> None:
    """Name the labelled curves above the axes, each in its own colour."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 0.99),
        ncols=8,
        labelcolor="linecolor",
        handlelength=1.4,
        handletextpad=0.5,
        columnspacing=1.6,
        borderaxespad=0.2,
        fontsize=8.5,
    )


def limit_line(axes: Axes, value: float, text: str, colour: Colour) -> None:
    """A horizontal limit with its name written on it."""
    axes.axhline(value, color=colour.light, linewidth=1.0, linestyle=DASHED)
    axes.annotate(
        text,
        (1.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(-2, 3),
        textcoords="offset points",
        ha="right",
        color=colour.light,
        fontsize=8,
    )


@in_style
def to_svg(figure: Figure, name: str, title: str) -> str:
    """The figure as an SVG element for inlining: ids made unique by `name`, colours as CSS variables."""
    svg = _drawn(figure)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    opening = rf'<svg \1 role="img" aria-label="{escape(title)}">'
    svg = re.sub(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', opening, svg, count=1)
    for colour in PALETTE:
        svg = svg.replace(colour.light, f"var(--{colour.name})")
    return svg


@in_style
def to_png(figure: Figure, dpi: float = 150) -> bytes:
    """The figure as a PNG, in the light colours on white."""
    _lay_out(figure, figure.canvas.get_renderer())  # type: ignore[attr-defined]
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


def _drawn(figure: Figure) -> str:
    """The figure as an SVG file. What `savefig` does, but that one renderer lays it out and draws it: to measure a text
    takes longer than to write it, and a renderer measures each once."""
    buffer, dpi = io.StringIO(), figure.dpi
    grounds = [
        ground for ground in (figure.patch, *(axes.patch for axes in figure.axes)) if ground.get_visible()
    ]
    try:
        figure.dpi = _SVG_DPI
        for ground in grounds:  # what is behind the picture is the page's
            ground.set_visible(False)
        width, height = figure.bbox.size
        metadata = {"Date": None, "Creator": None}
        svg = RendererSVG(width, height, buffer, image_dpi=dpi, metadata=metadata)  # type: ignore[no-untyped-call]
        renderer: Any = MixedModeRenderer(figure, width, height, dpi, svg)  # type: ignore[no-untyped-call]
        _lay_out(figure, renderer)
        figure.draw(renderer)
        renderer.finalize()
    finally:
        figure.dpi = dpi
        for ground in grounds:
            ground.set_visible(True)
    return buffer.getvalue()


def _lay_out(figure: Figure, renderer: RendererBase) -> None:
    """Make room for all labels. savefig draws a figure that has an engine of its own twice, once for the layout; the
    engine looks at all labels twice, which takes longer than to draw them, and a column needs it once."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if not axis.label.get_text():  # else all labels of its ticks are measured for where it would be
                axis.set_label_coords(0.5, 0.5)
                axis.label.set_visible(False)
    if not _stack(figure, renderer):
        ConstrainedLayoutEngine().execute(figure)


def _stack(figure: Figure, renderer: RendererBase) -> bool:
    """Lay out axes that stand one above the other, as `new_figure` makes them; False where they are more than that.

    All are as wide as the widest labels leave; what labels leave of the height is shared as the grid's ratios say.
    """
    column = [(axes, axes.get_subplotspec()) for axes in figure.axes]
    grids = {spec.get_gridspec() if spec else None for _, spec in column}
    grid = grids.pop() if len(grids) == 1 else None
    if grid is None or grid.ncols != 1 or grid.nrows != len(column) or figure.legends or figure.texts:
        return False
    pad = _PAD_IN * figure.dpi
    around = np.transpose([_around(axes, renderer) for axes, _ in column])
    left, below, right, above = np.maximum(around, 0.0) + pad
    wide, high = figure.bbox.width, figure.bbox.height
    ratios = np.asarray(grid.get_height_ratios(), dtype=float)
    heights = (high - np.sum(below) - np.sum(above)) * ratios / np.sum(ratios)
    if np.any(heights <= 0) or wide <= max(left) + max(right):
        return False
    bottoms = high - np.cumsum(above + heights + np.append(0.0, below[:-1]))

    def place(margin: float) -> None:
        for (axes, _), bottom, height in zip(column, bottoms, heights, strict=True):
            across = (margin / wide, 1 - (margin + max(right)) / wide)
            axes.set_position((across[0], bottom / high, across[1], height / high))

    place(max(left))
    place(max(*left, *(_beside(axes, renderer) + pad for axes, _ in column)))
    return True


def _around(axes: Axes, renderer: RendererBase) -> tuple[float, float, float, float]:
    """How far all but the y-axis reaches out to the left, below, to the right and above, in pixels."""
    shown = axes.yaxis.get_visible()
    axes.yaxis.set_visible(False)  # which ticks it has depends on its height
    inner, outer = axes.get_window_extent(), axes.get_tightbbox(renderer, for_layout_only=True)
    axes.yaxis.set_visible(shown)
    if outer is None:  # nothing of it is visible
        return 0.0, 0.0, 0.0, 0.0
    return inner.x0 - outer.x0, inner.y0 - outer.y0, outer.x1 - inner.x1, outer.y1 - inner.y1


def _beside(axes: Axes, renderer: RendererBase) -> float:
    """How far the y-axis reaches out to the left, in pixels."""
    labels = axes.yaxis.get_tightbbox(renderer)
    return 0.0 if labels is None else float(axes.get_window_extent().x0 - labels.x0)


def css_variables() -> str:
    """The palette as CSS: light by default and on paper, dark where the reader's screen says so."""
    light = "".join(f"--{c.name}:{c.light};" for c in PALETTE)
    dark = "".join(f"--{c.name}:{c.dark};" for c in PALETTE)
    return (
        f":root{{color-scheme:light;{light}}}\n"
        f"@media screen and (prefers-color-scheme:dark){{:root{{color-scheme:dark;{dark}}}}}\n"
    )
