"""The reliability diagram of a tally: how often names were true, beside the probability that they were given.

python benchmarks/explain_rates.py --read sessions.jsonl --picture docs/reliability.png
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from explain_tally import Told, bins_of, calibration_error, calibration_interval, interval_of_rate
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from schwung.files import replace_file
from schwung.report.colours import ESTIMATE, GRID, INK
from schwung.report.style import in_style, key, new_figure, to_png

#: How wide a bin's column is drawn, of the room that it has.
_WIDTH = 0.7


@in_style
def reliability_figure(sessions: Sequence[Told]) -> Figure:
    """Of names by their probability, the share that was true, with Wilson's interval of 95 %, and how many there are.

    A column for each bin, evenly spaced, for most names are as good as sure. Probabilities hold where the dot's
    interval holds the black line, the mean of what was said; below it, names are too sure of themselves.
    """
    bins = bins_of(sessions)
    figure = new_figure(4.2)
    axes = figure.axes[0]
    for place, one in enumerate(bins):
        first = place == 0
        corner, height = (place - _WIDTH / 2, 100 * one.low), 100 * (one.high - one.low)
        axes.add_patch(Rectangle(corner, _WIDTH, height, color=GRID.light, linewidth=0))
        said = 100 * one.mean
        axes.plot(
            [place - _WIDTH / 2, place + _WIDTH / 2], [said, said], color=INK.light, linewidth=1.6,
            label="said, mean" if first else "_",
        )  # fmt: skip
        low, high = interval_of_rate(one.true, one.count)
        axes.plot([place, place], [100 * low, 100 * high], color=ESTIMATE.light, linewidth=2.2)
        axes.plot(
            place, 100 * one.true / one.count, "o", color=ESTIMATE.light, markersize=6,
            label="true, with 95 %" if first else "_",
        )  # fmt: skip
    labels = [f"{100 * one.low:.0f} to {100 * one.high:.0f} %\n{one.true} of {one.count}" for one in bins]
    axes.set_xticks(range(len(bins)), labels)
    axes.set(xlim=(-0.6, max(len(bins), 1) - 0.4), ylim=(-2, 102))
    axes.set_xlabel("probability that names were given · how many of them were true")
    axes.set_title(f"Names that were true, % · {_counted(sessions)}")
    axes.grid(visible=False, axis="x")
    if bins:
        key(axes)
    return figure


def _counted(sessions: Sequence[Told]) -> str:
    if not sessions:
        return "no sessions"
    low, high = calibration_interval(sessions)
    return f"{len(sessions)} sessions, calibration error {calibration_error(sessions):.3f} ({low:.3f} to {high:.3f})"


def write_reliability(sessions: Sequence[Told], path: Path) -> None:
    """As a PNG, whole or not at all."""
    replace_file(path, to_png(reliability_figure(sessions), dpi=110))
