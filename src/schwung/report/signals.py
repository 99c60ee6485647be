"""Pictures over time: what was commanded, what was recorded, what is left after denoising, what the export brought."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schwung.motion import Array
from schwung.report.content import FollowingError, ReportContent, SyncRow, Units
from schwung.report.style import (
    ESTIMATE,
    EXCITED,
    GOOD,
    GRID,
    INK,
    MUTED,
    PLAIN,
    UNUSABLE,
    Colour,
    in_style,
    key,
    limit_line,
    new_figure,
    thin,
)
from schwung.session.model import Run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from schwung.estimation import Estimate


def _curve(
    axes: Axes, time: Array, values: Array, colour: Colour, label: str = "", width: float = 1.2
) -> None:
    x, y = thin(time, values)
    axes.plot(x, y, color=colour.light, linewidth=width, label=label or "_")


def _shade_strokes(figure: Figure, run: Run) -> None:
    """Grey where the axis is asked to move."""
    if run.motion is None:
        return
    for axes in figure.axes:
        for start in run.motion.stroke_starts_s:
            axes.axvspan(start, start + run.motion.duration_s, color=GRID.light, alpha=0.45, linewidth=0)


def shown_run(content: ReportContent) -> Run:
    """The run that stands for the session: the first excited one, else the first."""
    return (content.session.excited or content.session.runs)[0]


@in_style
def command_figure(content: ReportContent) -> Figure:
    """Demanded position and speed, and injected torque, over the run's time."""
    run, units = shown_run(content), content.units
    time = run.time_s
    demand, label = run.position_demand_rad, "demand"
    if demand is None:
        demand, label = run.position_rad, "measured (no demand in the recording)"
    speed = np.gradient(demand, time)
    if run.motion is not None:
        speed = run.motion.demand(time).speed_rad_s
    torque = run.torque_added_nm
    if torque is None and run.excitation is not None:
        torque = run.excitation.torque(time)

    figure = new_figure(4.2 if torque is not None else 3.0, (1, 1, 1) if torque is not None else (1, 1))
    _curve(figure.axes[0], time, demand, INK, label)
    if label == "demand":
        _curve(figure.axes[0], time, run.position_rad, EXCITED, "measured", 0.9)
    _curve(figure.axes[1], time, speed, INK)
    figure.axes[0].set_title(f"Position, {units.position}")
    figure.axes[1].set_title(f"Demanded speed, {units.speed}")
    key(figure.axes[0])
    if torque is not None:
        _curve(figure.axes[2], time, torque, EXCITED, width=1.0)
        figure.axes[2].set_title(f"Injected {units.torque_word}, {units.torque}")
    figure.axes[-1].set_xlabel("time, s")
    _shade_strokes(figure, run)
    return figure


@in_style
def raw_figure(content: ReportContent) -> Figure:
    """Measured speed and torque of an excited run over those of its reference run."""
    units, excited = content.units, shown_run(content)
    plain = content.session.references[0] if content.session.references else None
    if content.estimate is not None and content.estimate.denoised:
        excited, plain = content.estimate.denoised[0].excited, content.estimate.denoised[0].reference
    figure = new_figure(4.2, (1, 1))
    for run, colour, label, width in (
        (excited, EXCITED, "with injection", 0.9),
        (plain, PLAIN, "without", 1.5),
    ):
        if run is not None and not (run is excited and colour is PLAIN):
            _curve(figure.axes[0], run.time_s, run.speed_rad_s, colour, label, width)
            _curve(figure.axes[1], run.time_s, run.torque_nm, colour, "", width)
    if content.machine is not None:
        _peak_torque(figure.axes[1], excited, content.machine.motor.peak_torque_nm)
    figure.axes[0].set_title(f"Measured speed, {units.speed}")
    figure.axes[1].set_title(f"Motor {units.torque_word}, {units.torque}")
    figure.axes[1].set_xlabel("time, s")
    key(figure.axes[0])
    _shade_strokes(figure, excited)
    return figure


def _peak_torque(axes: Axes, run: Run, peak: float) -> None:
    """Draw the clipping limits where the torque comes near to them."""
    if np.max(np.abs(run.torque_nm)) > 0.6 * peak:
        limit_line(axes, peak, "peak torque", UNUSABLE)
        axes.axhline(-peak, color=UNUSABLE.light, linewidth=1.0, linestyle=(0, (5, 3)))


@in_style
def denoised_figure(content: ReportContent, estimate: Estimate) -> Figure:
    """What the injection alone has caused: differences of speed and torque with their sliding amplitudes."""
    units, pair, trace = content.units, estimate.denoised[0], estimate.traces[0]
    lag_s = 0.5 / estimate.frequency_hz  # an amplitude belongs to the middle of its window
    figure = new_figure(4.2, (1, 1))
    for axes, signal, amplitude in (
        (figure.axes[0], pair.speed_rad_s, trace.speed_amplitude_rad_s),
        (figure.axes[1], pair.torque_nm, trace.torque_amplitude_nm),
    ):
        _curve(axes, pair.time_s, signal, ESTIMATE, "excited minus reference", 0.9)
        _curve(axes, trace.time_s - lag_s, amplitude, INK, "sliding amplitude at the injected frequency")
        _curve(axes, trace.time_s - lag_s, -amplitude, INK)
    figure.axes[0].set_title(f"Speed, {units.speed}")
    figure.axes[1].set_title(f"{units.torque_word.capitalize()}, {units.torque}")
    figure.axes[1].set_xlabel("time, s")
    key(figure.axes[0])
    _shade_strokes(figure, pair.excited)
    return figure


@in_style
def deviation_figure(content: ReportContent, estimate: Estimate) -> Figure:
    """θ_est − θ_RtR with its local mean over one period of the injected sine."""
    pair = estimate.denoised[0]
    period = max(round(pair.excited.sample_rate_hz / estimate.frequency_hz), 1)
    deviation = pair.position_deviation_rad * 1e3
    local = np.full(deviation.size, np.nan)
    if deviation.size > period:
        means = np.convolve(deviation, np.ones(period) / period, mode="valid")
        local[period // 2 : period // 2 + means.size] = means
    figure = new_figure(2.5)
    axes = figure.axes[0]
    _curve(axes, pair.time_s, deviation, ESTIMATE, "excited minus reference", 0.9)
    _curve(axes, pair.time_s, local, UNUSABLE, "mean over one period", 1.6)
    axes.set_title(f"Position deviation, m{content.units.position}")
    axes.set_xlabel("time, s")
    key(axes)
    _shade_strokes(figure, pair.excited)
    return figure


@in_style
def following_error_figure(errors: FollowingError, units: Units) -> Figure:
    """Following error of one motion before and after the table was written into the drive."""
    figure = new_figure(2.8)
    axes = figure.axes[0]
    for time, error, colour, word, rms in (
        (errors.before_time_s, errors.before_rad, PLAIN, "before", errors.before_rms_rad),
        (errors.after_time_s, errors.after_rad, GOOD, "after", errors.after_rms_rad),
    ):
        _curve(axes, time, error * 1e3, colour, f"{word} (RMS {rms * 1e3:.3g} m{units.position})", 1.4)
    axes.set_title(f"Following error, m{units.position}")
    axes.set_xlabel("time, s")
    key(axes)
    return figure


@in_style
def sync_figure(rows: tuple[SyncRow, ...]) -> Figure:
    """Deviation of SYNC from its ideal grid, one line per recording: RMS, 99th percentile, maximum."""
    figure = new_figure(1.1 + 0.24 * len(rows))
    axes = figure.axes[0]
    place = np.arange(len(rows))
    worst = np.array([row.max_s for row in rows]) * 1e6
    axes.hlines(place, 0, worst, color=GRID.light, linewidth=3)
    for attribute, label, colour, marker in (
        ("rms_s", "RMS", ESTIMATE, "o"),
        ("p99_s", "99 %", EXCITED, "D"),
        ("max_s", "maximum", MUTED, "|"),
    ):
        values = np.array([getattr(row, attribute) for row in rows]) * 1e6
        axes.plot(values, place, marker, color=colour.light, label=label, markersize=6, markeredgewidth=1.8)
    axes.set_yticks(place, [row.run for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(left=0)
    axes.set_title("SYNC off its grid")
    axes.set_xlabel("µs")
    key(axes)
    return figure
