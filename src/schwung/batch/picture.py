"""An archive in pictures: how a machine's curve, or what its belief leaves out, changes with time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure

from schwung.batch.archive import Kind
from schwung.batch.summary import Row, when
from schwung.files import replace_file
from schwung.motion import Array
from schwung.report.colours import ESTIMATE, INK, MUTED, PLAIN
from schwung.report.content import LINEAR, ROTARY, Units
from schwung.report.style import WIDTH_IN, in_style, key, to_png

_MARKS = {"good": "o", "doubtful": "^", "unusable": "x"}
_OLD_TO_NEW = LinearSegmentedColormap.from_list("age", ("#9fc9e8", ESTIMATE.light, "#04203a"))  # light is old
_MOST_MACHINES = 50  # one picture each


def write_pictures(rows: Sequence[Row], kind: Kind, folder: Path) -> tuple[Path, ...]:
    """Write one PNG per machine, `<machine>.png`; returns where. Raises InputError where that fails."""
    draw = drift_figure if kind == "estimate" else left_out_figure
    written: dict[Path, Figure] = {}
    for machine in sorted({row.machine for row in rows if not row.error})[:_MOST_MACHINES]:
        name = "".join(c if c.isalnum() else "-" for c in machine).strip("-").lower()[:60] or "machine"
        path = folder / f"{name}.png"
        while path in written:  # two names may differ in what a file's cannot have
            path = path.with_stem(f"{path.stem}-2")
        written[path] = draw([row for row in rows if row.machine == machine and not row.error])
        replace_file(path, to_png(written[path]))
    return tuple(written)


@in_style
def drift_figure(rows: Sequence[Row]) -> Figure:
    """One machine's curves over angle, and below each one's mean over the date, in the same colours; oldest first."""
    units, days = _units(rows), _days(rows)
    figure, (above, below) = _figure()
    shade = ScalarMappable(Normalize(days.min(), days.max() + (days.max() == days.min())), _OLD_TO_NEW)
    for row, day in zip(rows, days, strict=True):
        if row.curve is not None and row.verdict != "unusable":
            above.plot(
                row.curve.position_rad, row.curve.inertia_kgm2, color=shade.to_rgba(day), linewidth=1.0
            )
    above.set_ylim(bottom=0)
    above.set_title(f"{rows[0].machine}: load {units.inertia_word} of each session, {units.inertia}")
    above.set_xlabel(f"{units.position_word}, {units.position}")
    for verdict, mark in _MARKS.items():
        for row, day in zip(rows, days, strict=True):
            if row.verdict == verdict and row.curve is not None:
                mean, colour = float(np.mean(row.curve.inertia_kgm2)), shade.to_rgba(day)
                std = row.curve.std_kgm2
                band = None if std is None or verdict == "unusable" else 2 * float(np.mean(std))
                below.errorbar(day, mean, yerr=band, fmt=mark, color=colour, markersize=5, elinewidth=1.0)
        if any(row.verdict == verdict for row in rows):
            below.plot([], [], mark, color=MUTED.light, markersize=5, label=verdict)
    key(below)
    below.set_title(f"Mean over the {units.position_word} ± 2σ, {units.inertia}")
    _dates(below)
    return figure


@in_style
def left_out_figure(rows: Sequence[Row]) -> Figure:
    """Over the date: which physics a machine's belief leaves out, and the error on runs kept aside."""
    units, days = _units(rows), _days(rows)
    figure, (above, below) = _figure()
    named = [row.physics.split(", ") if row.physics else [] for row in rows]
    names = sorted({name for each in named for name in each}, reverse=True)
    for number, name in enumerate(names):
        here = [day for day, each in zip(days, named, strict=True) if name in each]
        above.plot(here, [number] * len(here), "s", color=ESTIMATE.light, markersize=5)
    above.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    above.set_ylim(-0.6, max(len(names), 1) - 0.4)
    if not names:
        above.text(0.5, 0.5, "nothing was named", transform=above.transAxes, ha="center", color=MUTED.light)
    above.set_title(f"{rows[0].machine}: what the belief leaves out")
    for values, label, colour in (
        ([row.rmse_before_nm for row in rows], "belief", PLAIN),
        ([row.rmse_after_nm for row in rows], "belief + physics", ESTIMATE),
    ):
        below.plot(days, np.array(values, dtype=float), "o", color=colour.light, markersize=4, label=label)
    below.set_ylim(bottom=0)
    below.set_title(f"Error on runs kept aside, RMS, {units.torque}")
    key(below)
    _dates(below)
    above.sharex(below)
    return figure


def _figure() -> tuple[Figure, tuple[Axes, Axes]]:
    figure = Figure(figsize=(WIDTH_IN, 6.4))
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, gridspec_kw={"height_ratios": [3, 2]})
    return figure, (above, below)


def _units(rows: Sequence[Row]) -> Units:
    return LINEAR if rows[0].axis == "linear" else ROTARY


def _days(rows: Sequence[Row]) -> Array:
    return np.array([date2num(when(row)) for row in rows], dtype=np.float64)  # type: ignore[no-untyped-call]


def _dates(axes: Axes) -> None:
    locator = AutoDateLocator(minticks=3, maxticks=9)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes.margins(x=0.03, y=0.15)
    axes.tick_params(axis="x", colors=INK.light)
