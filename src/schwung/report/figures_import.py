"""A recording from elsewhere in one picture, before anything is computed: what is taken for what, and why."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from schwung.report.colours import ESTIMATE, EXCITED, GRID, INK, MUTED, PLAIN
from schwung.report.style import WIDTH_IN, curve, in_style, key
from schwung.session import Session
from schwung.session.guess import Guess, Proposal

_CHARACTERS = 165  # of a line of text over the picture's width
_LINE_IN = 0.155


@in_style
def import_figure(proposal: Proposal, session: Session, title: str) -> Figure:
    """Position with the runs that it is cut into; speed and the slope of position; torque and what explains it; torque
    over acceleration; the steps of the stamps; and each part's evidence in words."""
    words = [line for guess in proposal.guesses for line in _words(guess)]
    text_in = _LINE_IN * (len(words) + 1)
    figure = Figure(figsize=(WIDTH_IN, 7.4 + text_in))
    FigureCanvasAgg(figure)
    figure.set_layout_engine("constrained")
    grid = figure.add_gridspec(5, 2, height_ratios=(1.7, 1.4, 1.4, 1.6, text_in))
    position, speed, torque = (figure.add_subplot(grid[row, :]) for row in range(3))
    for axes in (speed, torque):
        axes.sharex(position)
    scatter, steps = figure.add_subplot(grid[3, 0]), figure.add_subplot(grid[3, 1])
    _position(position, session, proposal.curves.start_s, title)
    _speed(speed, proposal)
    _torque(torque, proposal)
    torque.set_xlabel("time in the file, s")
    _scatter(scatter, proposal)
    _steps(steps, proposal)
    _text(figure.add_subplot(grid[4, :]), words)
    return figure


def _words(guess: Guess) -> list[str]:
    head = f"{guess.what}: {guess.column or 'none'}" + (f" in {guess.unit}" if guess.unit else "")
    told = f"{'' if guess.sure else '(not sure) '}{guess.evidence}"
    lines = [head, *textwrap.wrap(told, _CHARACTERS, initial_indent="   ", subsequent_indent="   ")]
    if guess.alternatives:
        others = "or else: " + "; ".join(guess.alternatives)
        lines += textwrap.wrap(others, _CHARACTERS, initial_indent="   ", subsequent_indent="   ")
    return lines


def _position(axes: Axes, session: Session, start_s: float, title: str) -> None:
    unit = "rad" if session.axis == "rotary" else "m"
    low = min(float(run.position_rad.min()) for run in session.runs)
    high = max(float(run.position_rad.max()) for run in session.runs)
    for number, run in enumerate(session.runs):
        start = float(run.extra.get("source_start_s", 0.0)) - start_s
        time = start + run.time_s
        if number % 2 == 0:
            axes.axvspan(float(time[0]), float(time[-1]), color=GRID.light, linewidth=0, zorder=0)
        curve(axes, time, run.position_rad, ESTIMATE if run.role == "reference" else EXCITED)
        if len(session.runs) <= 24:
            motion = run.extra.get("same_motion", number)
            axes.annotate(f"{number}·m{motion}", (float(time[0]), high), color=MUTED.light, fontsize=7, va="bottom",
                          xytext=(2, 2), textcoords="offset points", annotation_clip=True)  # fmt: skip
    axes.set_ylim(low - 0.05 * (high - low), high + 0.15 * (high - low))
    axes.set_title(f"{title}: {_counted(session)}; position, {unit}")


def _counted(session: Session) -> str:
    runs = len(session.runs)
    return "1 run" if runs == 1 else f"{runs} runs, each with the number of its motion"


def _speed(axes: Axes, proposal: Proposal) -> None:
    curves = proposal.curves
    curve(axes, curves.time_s, curves.slope, PLAIN, label="slope of the position", width=2.2, alpha=0.6)
    if curves.speed is not None:
        curve(axes, curves.time_s, curves.speed, ESTIMATE, label="speed as recorded, scaled", width=0.9)
    unit = next(guess.unit for guess in proposal.guesses if guess.what == "position")
    axes.set_title(f"Speed, {unit.partition('=')[0]}/s")
    key(axes)


def _torque(axes: Axes, proposal: Proposal) -> None:
    curves = proposal.curves
    guess = next(guess for guess in proposal.guesses if guess.what == "torque")
    curve(axes, curves.time_s, curves.torque, PLAIN, label="as recorded", width=1.8, alpha=0.7)
    curve(
        axes, curves.time_s, curves.fitted, ESTIMATE, label="acceleration, speed, friction, weight", width=0.9
    )
    axes.set_title(f"{guess.column}, without what is faster than the motion")
    key(axes)


def _scatter(axes: Axes, proposal: Proposal) -> None:
    curves = proposal.curves
    every = max(1, curves.acceleration.size // 3000)
    x, y = curves.acceleration[::every], curves.gathering[::every]
    axes.plot(x, y, ".", color=PLAIN.light, markersize=2, alpha=0.5)
    ends = np.array([x.min(), x.max()])
    axes.plot(ends, curves.inertia * ends, color=ESTIMATE.light, linewidth=1.4)
    axes.set_title("Without speed, friction and weight, over acceleration")
    axes.set_xlabel(f"acceleration, as in the file: the slope is {curves.inertia:.3g}")


def _steps(axes: Axes, proposal: Proposal) -> None:
    steps = proposal.curves.steps_s
    if not steps.size:
        axes.text(0.5, 0.5, "no stamps in the file", ha="center", transform=axes.transAxes, color=MUTED.light)
        axes.set_axis_off()
        return
    shown = steps * 1e3
    axes.plot(np.arange(shown.size), shown, ".", color=PLAIN.light, markersize=1.5)
    axes.axhline(float(np.median(shown)), color=ESTIMATE.light, linewidth=1.0)
    top = float(np.percentile(shown, 99.9))
    axes.set_ylim(0, 1.4 * max(top, float(np.median(shown))))
    axes.set_title(
        f"From stamp to stamp, ms (median {float(np.median(shown)):.4g}, most {float(shown.max()):.4g})"
    )
    axes.set_xlabel("sample")


def _text(axes: Axes, words: list[str]) -> None:
    axes.set_axis_off()
    for number, line in enumerate(words):
        head = not line.startswith(" ")
        axes.text(0, 1 - (number + 0.5) / (len(words) + 1), line, transform=axes.transAxes, va="center", fontsize=7.5,
                  color=INK.light if head else MUTED.light, fontweight="bold" if head else "normal")  # fmt: skip
