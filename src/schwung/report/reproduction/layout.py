"""What one reproduced figure or table is, and how its panels are laid out and drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from schwung.motion import Array
from schwung.report.colours import DOUBTFUL, INK, MUTED, UNUSABLE, Colour
from schwung.report.reproduction.experiments import RATE_HZ, STROKE_RAD, Case, Result, truth
from schwung.report.style import DASHED, WIDTH_IN, curve

PAPER_MIV_KGM2 = (0.05, 0.08)


@dataclass(frozen=True, eq=False)
class Reproduced:
    """A figure or table of the paper, done again: what the paper reports, what came out, why they differ."""

    title: str
    paper: str
    here: str
    difference: str
    figure: Figure | None = None
    table: str = ""  # Markdown


def panels(height_in: float, mosaic: Sequence[str], ratios: Sequence[float] = ()) -> Panels:
    """A figure of the report's width with axes named by letters, one row per word; a letter twice spans both."""
    figure = Figure(figsize=(WIDTH_IN, height_in))
    FigureCanvasAgg(figure)
    axes = figure.subplot_mosaic(
        [list(row) for row in mosaic], gridspec_kw={"height_ratios": list(ratios) or [1] * len(mosaic)}
    )
    return Panels(figure, axes)


@dataclass(frozen=True, eq=False)
class Panels:
    """A figure and its axes by name."""

    figure: Figure
    axes: Mapping[str, Axes]

    def __getitem__(self, name: str) -> Axes:
        return self.axes[name]

    def same_x(self, names: str, label: str) -> None:
        """Share the x-axis of axes stacked on each other; the last one carries label and numbers."""
        *upper, last = list(names)
        for name in upper:
            self.axes[name].sharex(self.axes[last])
            self.axes[name].tick_params(labelbottom=False)
        self.axes[last].set_xlabel(label)


def legend(axes: Axes) -> None:
    """Name the curves within a panel, each in its own colour, where they leave room."""
    axes.legend(labelcolor="linecolor", fontsize=8, handlelength=1.4, borderaxespad=0.2, loc="best")


def draw_truth(axes: Axes, label: str = "true (inferred)") -> None:
    """The inertia that the simulation has, dashed."""
    angle = np.linspace(0, STROKE_RAD, 300)
    axes.plot(
        angle, truth().at(angle), color=INK.light, linewidth=1.2, linestyle=DASHED, label=label, zorder=3
    )


def draw_estimate(
    axes: Axes, result: Result, colour: Colour, label: str = "_", *, width: float = 1.3, dashed: bool = False
) -> None:
    """The estimated inertia over the load angle."""
    table = result.estimate.table
    curve(axes, table.position_rad, table.inertia_kgm2, colour, label=label, width=width)
    if dashed:
        axes.lines[-1].set_linestyle(DASHED)


def draw_error(axes: Axes, result: Result, colour: Colour, *, dashed: bool = False) -> None:
    """Estimate minus truth over the load angle."""
    axes.axhline(0, color=MUTED.light, linewidth=0.8)
    curve(axes, result.position_rad, result.error_kgm2, colour)
    if dashed:
        axes.lines[-1].set_linestyle(DASHED)


def draw_variation(axes: Axes, result: Result, colour: Colour, *, dashed: bool = False) -> None:
    """|J(i) − J(i−N)| over the load angle, where the axis goes on to new angles."""
    trace = result.estimate.traces[0]
    known = np.isfinite(trace.inertia_variation_kgm2) & np.isfinite(trace.position_rad)
    angle = np.where(known, trace.position_rad, -np.inf)
    shown = known & (angle >= np.maximum.accumulate(angle))
    curve(axes, trace.position_rad[shown], np.abs(trace.inertia_variation_kgm2[shown]), colour)
    if dashed:
        axes.lines[-1].set_linestyle(DASHED)


def draw_miv_limits(axes: Axes) -> None:
    """The paper's two bounds, named on the left, where the curves start from zero."""
    for value, words, colour in zip(
        PAPER_MIV_KGM2, ("good below 0.05", "unreliable above 0.08"), (DOUBTFUL, UNUSABLE), strict=True
    ):
        axes.axhline(value, color=colour.light, linewidth=1.0, linestyle=DASHED)
        axes.annotate(
            words,
            (0.0, value),
            xycoords=("axes fraction", "data"),
            xytext=(2, 3),
            textcoords="offset points",
            color=colour.light,
            fontsize=8,
        )


def draw_deviation(axes: Axes, result: Result, case: Case, colour: Colour) -> None:
    """Position deviation (16) in mrad over the time since the start of the motion, ms."""
    pair = result.estimate.denoised[0]
    curve(axes, 1e3 * (pair.time_s - case.start_s), 1e3 * pair.position_deviation_rad, colour, width=0.9)


def mean_deviation(result: Result) -> Array:
    """Mean of the position deviation over one period about each sample (rad), (n,), NaN at the ends."""
    values = result.estimate.denoised[0].position_deviation_rad
    samples = round(RATE_HZ / result.estimate.frequency_hz)
    mean, half = np.full(values.size, np.nan), samples // 2
    inner = np.convolve(values, np.ones(samples) / samples, "valid")
    mean[half : half + inner.size] = inner
    return mean


def dc_mrad(case: Case, result: Result) -> float:
    """Largest mean of the position deviation over one period, while the axis moves (mrad)."""
    time, mean = result.estimate.denoised[0].time_s, mean_deviation(result)
    moving = (time > case.start_s) & (time < case.start_s + case.duration_s + 1 / case.frequency_hz)
    return float(1e3 * np.max(np.abs(mean[moving])))


def named(case: Case) -> str:
    """Motion time, and the frequency where it is not 50 Hz."""
    words = f"{1e3 * case.duration_s:.0f} ms"
    return words if case.frequency_hz == 50.0 else f"{words}, {case.frequency_hz:.0f} Hz"
