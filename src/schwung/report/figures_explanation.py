"""Pictures of an explanation: before and after, where the mismatch is, and what it follows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from schwung.explain.values import Located, Overlay
from schwung.motion import Array
from schwung.report.colours import ESTIMATE, EXCITED, GOOD, GRID, INK, MUTED, PLAIN, Colour
from schwung.report.content import Units
from schwung.report.style import WIDTH_IN, curve, in_style, key, new_figure

_CELLS = (34, 18)  # of the map, over position and over speed
_FAINTEST = 0.04  # opacity of a visited cell in which nothing is left
_OUT_OF_SIGHT = 6.0  # what is so many times smaller needs a panel of its own
_SURE = 0.05  # p-values below it are called significant


def rms(values: Array) -> float:
    """Root mean square of the finite values; 0 where there are none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else 0.0


def compared(overlay: Overlay) -> NDArray[np.bool_]:
    """Which samples the explanation was judged by, (n,)."""
    return np.asarray(overlay.considered > 0)


def residual(overlay: Overlay, needed_nm: Array) -> Array:
    """Torque as recorded minus torque as needed (N·m), (n,), NaN where it was not compared."""
    return np.where(compared(overlay), overlay.torque_nm - needed_nm, np.nan)


def judged(overlays: Sequence[Overlay]) -> tuple[Overlay, ...]:
    """The runs to show: those kept aside, or all where none of them is at hand."""
    kept = tuple(overlay for overlay in overlays if overlay.heldout)
    return kept or tuple(overlays)


def shown_overlay(overlays: Sequence[Overlay]) -> Overlay | None:
    """The run that stands for all: of those kept aside the one in which most was missing."""
    runs = judged(overlays)
    return max(runs, key=lambda run: rms(residual(run, run.before_nm)), default=None)


@in_style
def overlay_figure(
    overlay: Overlay, floor_nm: float, units: Units, *, named: bool = True, floor_share: float = 0.0
) -> Figure:
    """One run: torque as measured and as needed, by the belief and with the named physics; below, what is left.

    `floor_share`: of the torque, which the noise floor has beside what does not depend on it.
    Where the belief misses so much that the floor could not be seen beside it, what the physics leaves has a
    panel of its own.
    """
    before, after = (residual(overlay, needed) for needed in (overlay.before_nm, overlay.after_nm))
    floor = np.hypot(floor_nm, floor_share * overlay.torque_nm)
    highest = float(np.max(floor))
    own = named and rms(before) > _OUT_OF_SIGHT * max(rms(floor), rms(after))
    figure = new_figure(6.2 if own else 5.2, (3, 1.6, 1.6) if own else (3, 2))
    above, below, time = figure.axes[0], figure.axes[1], overlay.time_s
    curve(above, time, overlay.torque_nm, INK, label="measured", width=1.7)
    curve(above, time, overlay.before_nm, EXCITED, label="belief", width=1.3)
    curve(below, time, before, EXCITED, width=1.0)
    if named:
        curve(above, time, overlay.after_nm, GOOD, label="belief + physics", width=1.1)
        for axes in figure.axes[1:]:
            curve(axes, time, after, GOOD, width=1.0)
    for axes in figure.axes[1:]:
        axes.fill_between(time, -2 * floor, 2 * floor, color=GRID.light, linewidth=0, zorder=0.5)
    _reach(below, (before, after) if named else (before,), 3 * highest)
    above.set_title(f"Motor {units.torque_word}, {units.torque}")
    below.set_title(f"Measured minus needed, {units.torque} · grey: ± 2 × noise floor")
    if own:
        _reach(figure.axes[2], (after,), 3 * highest)
        figure.axes[2].set_title("The same, belief + physics alone")
    figure.axes[-1].set_xlabel("time, s")
    key(above)
    return figure


@in_style
def speed_figure(overlay: Overlay, noise_rad_s: float, units: Units, *, named: bool = True) -> Figure | None:
    """One run: what the reported speed is beyond what follows, by the belief and with the named physics; None where no
    speed was measured.

    `noise_rad_s`: its standard deviation.
    """
    before, after = overlay.speed_before_rad_s, overlay.speed_after_rad_s
    if before is None or after is None:
        return None
    before, after = (np.where(compared(overlay), values, np.nan) for values in (before, after))
    figure = new_figure(2.8)
    (axes,) = figure.axes
    curve(axes, overlay.time_s, before, EXCITED, label="belief", width=1.2)
    if named:
        curve(axes, overlay.time_s, after, GOOD, label="belief + physics", width=1.0)
    axes.axhspan(-2 * noise_rad_s, 2 * noise_rad_s, color=GRID.light, linewidth=0, zorder=0.5)
    _reach(axes, (before, after) if named else (before,), 3 * noise_rad_s)
    axes.set_title(f"Reported minus expected speed, {units.speed} · grey: ± 2 × noise")
    axes.set_xlabel("time, s")
    key(axes)
    return figure


def _reach(axes: Axes, signals: Sequence[Array], least: float) -> None:
    """Symmetric limits that hold all but single spikes."""
    sizes = [np.abs(signal[np.isfinite(signal)]) for signal in signals]
    reach = max([least, *(1.2 * float(np.quantile(size, 0.998)) for size in sizes if size.size)])
    axes.set_ylim(-reach or -1e-9, reach or 1e-9)


# --------------------------------------------------------------------------------------------------- the map


@in_style
def map_figure(runs: Sequence[Overlay], floor_nm: float, units: Units, *, named: bool = True) -> Figure:
    """Mean of what is left in each cell of position and speed: by the belief, and with the named physics."""
    figure = Figure(figsize=(WIDTH_IN, 3.5))
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2 if named else 1, sharex=True, sharey=True, squeeze=False)[0]
    position, speed = _joined(runs, "position_rad"), _joined(runs, "speed_rad_s")
    before = np.concatenate([residual(run, run.before_nm) for run in runs])
    after = np.concatenate([residual(run, run.after_nm) for run in runs])
    edges = tuple(_edges(values, n) for values, n in zip((position, speed), _CELLS, strict=True))
    maps = [_cells(position, speed, values, edges) for values in ((before, after) if named else (before,))]
    full = max(float(np.nanmax(np.abs(maps[0]), initial=0.0)), 2 * floor_nm) or 1.0
    for panel, cells, title in zip(axes, maps, ("belief", "belief + physics"), strict=False):
        _draw_cells(panel, edges, cells, full)
        panel.set_title(title.capitalize())
        panel.set_xlabel(f"{units.position_word}, {units.position}")
        panel.grid(visible=False)
    axes[0].set_ylabel(f"speed, {units.speed}")
    steps = (-1.0, -0.5, 0.0, 0.5, 1.0)
    figure.legend(
        handles=[Patch(facecolor=_shade(step), label=_signed(step * full)) for step in steps],
        loc="outside upper right", ncols=len(steps), fontsize=8, handlelength=1.2,
        title=f"measured minus needed, mean of each cell, {units.torque}", title_fontsize=8, alignment="right",
    )  # fmt: skip
    return figure


def _signed(value: float) -> str:
    return f"{value:+.2g}".replace("-", "−") if value else "0"


def _joined(runs: Sequence[Overlay], name: str) -> Array:
    return np.concatenate([np.asarray(getattr(run, name)) for run in runs])


def _edges(values: Array, cells: int) -> Array:
    low, high = float(values.min()), float(values.max())
    margin = 1e-6 * max(high - low, abs(low), abs(high), 1e-9)
    return np.linspace(low - margin, high + margin, cells + 1)


def _cells(position: Array, speed: Array, values: Array, edges: Sequence[Array]) -> Array:
    """Mean of the finite values in each cell, (positions, speeds), NaN where there is none."""
    known = np.isfinite(values)
    place = (position[known], speed[known])
    sums, *_ = np.histogram2d(*place, bins=(edges[0], edges[1]), weights=values[known])
    counts, *_ = np.histogram2d(*place, bins=(edges[0], edges[1]))
    return np.asarray(np.where(counts > 0, sums / np.maximum(counts, 1), np.nan))


def _draw_cells(axes: Axes, edges: Sequence[Array], cells: Array, full: float) -> None:
    """Coloured rectangles, vectors as the rest of the page: they follow the reader's theme."""
    x, y = edges
    visited = np.argwhere(np.isfinite(cells))
    corners = [[(x[i], y[j]), (x[i + 1], y[j]), (x[i + 1], y[j + 1]), (x[i], y[j + 1])] for i, j in visited]
    colours = [_shade(cells[i, j] / full) for i, j in visited]
    axes.add_collection(PolyCollection(corners, facecolors=colours, edgecolors="none"))
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


def _shade(share: float) -> tuple[float, float, float, float]:
    """Colour by sign, opacity by size: share −1…1 of the largest."""
    colour: Colour = EXCITED if share > 0 else ESTIMATE if share < 0 else MUTED
    red, green, blue, _ = to_rgba(colour.light)
    return red, green, blue, float(np.clip(abs(share), _FAINTEST, 1.0))


# ------------------------------------------------------------------------------------------------ bars


@in_style
def located_figure(located: Sequence[Located], words: Sequence[str], title: str) -> Figure:
    """Share of the mismatch's energy that each coordinate can predict, with its p-value."""
    figure = new_figure(0.75 + 0.33 * len(located))
    axes = figure.axes[0]
    for row, where in enumerate(located):
        colour = ESTIMATE if where.p_value < _SURE else PLAIN
        axes.barh(row, 100 * where.share_of_energy, color=colour.light, height=0.62)
        text = f"{100 * where.share_of_energy:.0f} %, p {probability(where.p_value)}"
        axes.annotate(
            text, (100 * where.share_of_energy, row), xytext=(4, 0), textcoords="offset points", va="center",
            color=colour.light, fontsize=8,
        )  # fmt: skip
    axes.set_yticks(range(len(located)), list(words))
    axes.set_ylim(len(located) - 0.4, -0.6)
    axes.set_xlim(0, max(100.0, 118 * max((where.share_of_energy for where in located), default=0.0)))
    axes.grid(visible=False, axis="y")
    axes.set_title(title)
    return figure


def probability(p_value: float) -> str:
    """'= 0.03', or '< 0.001' where it is smaller."""
    return "< 0.001" if p_value < 0.001 else f"= {p_value:.2g}"
