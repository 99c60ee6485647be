"""The pictures, each a function that returns a matplotlib Figure (object interface, no pyplot state)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from schwung.drivetrain.inertia import InertiaTable, deviation
from schwung.estimation.trust import RELATIVE_MIV
from schwung.estimation.values import Denoised, Estimate, Trace
from schwung.motion import Array
from schwung.report.colours import (
    DOUBTFUL,
    ESTIMATE,
    EXCITED,
    FORMER,
    GOOD,
    GRID,
    INK,
    MOST_POINTS,
    MUTED,
    PLAIN,
    UNUSABLE,
)
from schwung.report.content import FollowingError, ReportContent, Units
from schwung.report.style import DASHED, curve, in_style, key, limit_line, new_figure
from schwung.session import Run

# ---------------------------------------------------------------------------------------------- over angle


@in_style
def inertia_figure(content: ReportContent, estimate: Estimate) -> Figure:
    """J_l(θ) with two standard deviations, single sweeps, reference and contrast; below it the error."""
    units, table = content.units, estimate.table
    reference = (
        content.reference if deviation(table, content.reference) else None
    )  # nothing in common: leave out
    figure = new_figure(4.9 if reference else 3.7, (3, 1) if reference else (1,))
    axes, band = figure.axes[0], _band(table)
    _sweeps(axes, estimate.traces, [trace.inertia_kgm2 for trace in estimate.traces], faint=True)
    _fill(axes, table.position_rad, table.inertia_kgm2, band)
    label = "estimate ± 2σ" if table.std_kgm2 is not None else "estimate"
    curve(axes, table.position_rad, table.inertia_kgm2, ESTIMATE, label=label, width=2.0)
    # fitted to estimate and reference: a wild band, or a contrast that fails, may leave the picture
    highest = float(np.max(table.inertia_kgm2))
    top = min(float(np.max(table.inertia_kgm2 + band)), 1.3 * highest)
    if reference is not None:
        position = np.linspace(table.position_rad[0], table.position_rad[-1], 400)
        believed, label = reference.at(position), content.reference_label
        axes.plot(position, believed, color=INK.light, linewidth=1.4, linestyle=DASHED, label=label)
        top = max(top, float(np.max(believed)))
        _error_panel(figure.axes[1], content, table, reference)
    if content.contrast is not None:
        other, label = content.contrast.table, f"{content.contrast.method} method"
        curve(axes, other.position_rad, other.inertia_kgm2, FORMER, label=label)
        axes.lines[-1].set_zorder(1.5)  # behind the estimate, though last in the key
    axes.set_ylim(0, 1.12 * top)
    axes.set_title(f"Load {units.inertia_word}, {units.inertia}")
    figure.axes[-1].set_xlabel(f"{units.position_word}, {units.position}")
    key(axes)
    return figure


def _error_panel(axes: Axes, content: ReportContent, table: InertiaTable, reference: InertiaTable) -> None:
    error, band = _difference(table, reference), _band(table)
    largest = float(np.nanmax(np.abs(error)))
    reach = 1.15 * min(float(np.nanmax(np.abs(error) + band)), 3 * largest)
    if content.contrast is not None:
        other = content.contrast.table
        off = _difference(other, reference)
        if np.nanmedian(np.abs(off)) < reach:  # else it would only cross the panel, from end to end
            curve(axes, other.position_rad, off, FORMER)
    _fill(axes, table.position_rad, error, band)
    curve(axes, table.position_rad, error, ESTIMATE, width=1.6)
    axes.axhline(0, color=INK.light, linewidth=1.0, linestyle=DASHED)
    axes.set_ylim(-reach or -1e-6, reach or 1e-6)
    axes.set_title(f"Estimate minus {content.reference_label}, {content.units.inertia}")


def _difference(table: InertiaTable, reference: InertiaTable) -> Array:
    """Table minus reference at the table's points, NaN where the reference has nothing to say."""
    known = (table.position_rad >= reference.position_rad[0]) & (
        table.position_rad <= reference.position_rad[-1]
    )
    return np.where(known, table.inertia_kgm2 - reference.at(table.position_rad), np.nan)


@in_style
def variation_figure(content: ReportContent, estimate: Estimate) -> Figure:
    """|J(i) − J(i−N)| over angle with its limits; below it the imaginary part of the complex inversion."""
    units, traces = content.units, estimate.traces
    both = has_imaginary(estimate)
    figure = new_figure(4.0 if both else 2.6, (3, 2) if both else (1,))
    axes, mean = figure.axes[0], float(np.mean(estimate.table.inertia_kgm2))
    _sweeps(axes, traces, [np.abs(trace.inertia_variation_kgm2) for trace in traces])
    for share, words, colour in zip(
        RELATIVE_MIV, ("good below", "unreliable above"), (DOUBTFUL, UNUSABLE), strict=True
    ):
        limit_line(axes, share * mean, f"{words} {100 * share:.0f} % of the mean", colour)
    limit = RELATIVE_MIV[-1] * mean
    top = min(max(1.25 * estimate.trust.miv_kgm2, 1.2 * limit), 3 * limit)
    _mark_largest(axes, traces, 0.85 * top)
    axes.set_ylim(0, top)
    axes.set_title(f"Change of the estimate within one period, {units.inertia}")
    if both:
        figure.axes[1].axhline(0, color=MUTED.light, linewidth=1.0, linestyle=DASHED)
        _sweeps(figure.axes[1], traces, [trace.imaginary_kgm2 for trace in traces])
        figure.axes[1].set_title(f"Imaginary part of the estimate, {units.inertia}")
    figure.axes[-1].set_xlabel(f"{units.position_word}, {units.position}")
    return figure


def has_imaginary(estimate: Estimate) -> bool:
    """Whether the method gives an imaginary part at all: all zero or NaN where it does not."""
    return any(bool(np.nan_to_num(trace.imaginary_kgm2).any()) for trace in estimate.traces)


def _mark_largest(axes: Axes, traces: Sequence[Trace], highest: float) -> None:
    """A dot, with its name, where the estimate changed most: the MIV; an arrow where that is out of sight."""
    position = np.concatenate([trace.position_rad for trace in traces])
    change = np.abs(np.concatenate([trace.inertia_variation_kgm2 for trace in traces]))
    valid = np.isfinite(position) & np.isfinite(change)
    if not valid.any():
        return
    at = int(np.where(valid, change, -1.0).argmax())
    seen = min(change[at], highest)
    axes.plot(position[at], seen, "o" if seen == change[at] else "^", color=INK.light, markersize=4)
    axes.annotate(
        f"MIV {change[at]:.3g}",
        (position[at], seen),
        xytext=(0, 5),
        textcoords="offset points",
        ha="center",
        fontsize=8,
        fontweight="bold",
    )


def _sweeps(axes: Axes, traces: Sequence[Trace], values: Sequence[Array], *, faint: bool = False) -> None:
    """One thin line per stroke, not joined across the rest between them."""
    width, alpha = (0.6, 0.35) if faint else (0.9, 0.7)
    most = max(MOST_POINTS // max(len(traces), 1), 400)  # many sweeps on one another need no more
    for trace, quantity in zip(traces, values, strict=True):
        strokes = np.zeros(quantity.size, dtype=np.int64) if trace.stroke is None else trace.stroke
        for stroke in np.unique(strokes):
            inside = (strokes == stroke) & np.isfinite(trace.position_rad)
            x, y = trace.position_rad[inside], quantity[inside]
            curve(axes, x, y, ESTIMATE, width=width, alpha=alpha, most=most)


def _band(table: InertiaTable) -> Array:
    return 2 * table.std_kgm2 if table.std_kgm2 is not None else np.zeros(table.position_rad.size)


def _fill(axes: Axes, position: Array, middle: Array, band: Array) -> None:
    axes.fill_between(position, middle - band, middle + band, color=ESTIMATE.light, alpha=0.18, linewidth=0)


# ----------------------------------------------------------------------------------------------- over time


@in_style
def command_figure(run: Run, units: Units) -> Figure:
    """Demanded position and speed, and injected torque, over the run's time."""
    time, demand, label = run.time_s, run.position_demand_rad, "demand"
    if demand is None:
        demand, label = run.position_rad, "measured; the recording has no demand"
    speed = run.motion.demand(time).speed_rad_s if run.motion else np.gradient(demand, time)
    torque = run.torque_added_nm
    if torque is None and run.excitation is not None:
        torque = run.excitation.torque(time)

    figure = new_figure(3.0, (1, 1)) if torque is None else new_figure(4.2, (1, 1, 1))
    curve(figure.axes[0], time, demand, INK, label=label)
    if demand is not run.position_rad:
        colour = EXCITED if run.role == "excited" else PLAIN
        curve(figure.axes[0], time, run.position_rad, colour, label="measured", width=0.9)
    curve(figure.axes[1], time, speed, INK)
    figure.axes[0].set_title(f"Position, {units.position}")
    figure.axes[1].set_title(f"Demanded speed, {units.speed}")
    if torque is not None:
        curve(figure.axes[2], time, torque, EXCITED, width=1.0)
        figure.axes[2].set_title(f"Injected {units.torque_word}, {units.torque}")
    return _finished(figure, run)


@in_style
def raw_figure(excited: Run, plain: Run | None, units: Units, peak_torque_nm: float | None = None) -> Figure:
    """Measured speed and torque of one run over those of the same motion without injection."""
    figure = new_figure(4.2, (1, 1))
    for run, colour, label, width in (
        (excited, EXCITED if plain else PLAIN, "with injection" if plain else excited.role, 0.9),
        (plain, PLAIN, "without", 1.5),
    ):
        if run is not None:
            curve(figure.axes[0], run.time_s, run.speed_rad_s, colour, label=label, width=width)
            curve(figure.axes[1], run.time_s, run.torque_nm, colour, width=width)
    if peak_torque_nm and np.max(np.abs(excited.torque_nm)) > 0.6 * peak_torque_nm:
        limit_line(figure.axes[1], peak_torque_nm, f"peak {units.torque_word}", UNUSABLE)
        limit_line(figure.axes[1], -peak_torque_nm, "", UNUSABLE)
    figure.axes[0].set_title(f"Measured speed, {units.speed}")
    figure.axes[1].set_title(f"Motor {units.torque_word}, {units.torque}")
    return _finished(figure, excited)


@in_style
def denoised_figure(pair: Denoised, trace: Trace, units: Units) -> Figure:
    """What the injection alone has caused: differences of speed and torque with their sliding amplitudes."""
    figure = new_figure(4.2, (1, 1))
    for axes, signal, amplitude in (
        (figure.axes[0], pair.speed_rad_s, trace.speed_amplitude_rad_s),
        (figure.axes[1], pair.torque_nm, trace.torque_amplitude_nm),
    ):
        curve(axes, pair.time_s, signal, ESTIMATE, label="excited minus reference", width=0.9)
        curve(axes, trace.time_s, amplitude, INK, label="sliding amplitude")
        curve(axes, trace.time_s, -amplitude, INK)
    figure.axes[0].set_title(f"Speed, {units.speed}")
    figure.axes[1].set_title(f"{units.torque_word.capitalize()}, {units.torque}")
    return _finished(figure, pair.excited)


@in_style
def deviation_figure(pair: Denoised, frequency_hz: float, units: Units) -> Figure:
    """θ_est − θ_RtR (equation 16) with its mean over one period of the injected sine."""
    difference = pair.position_deviation_rad * 1e3
    period = max(round(pair.excited.sample_rate_hz / frequency_hz), 1)
    figure = new_figure(2.5)
    axes = figure.axes[0]
    curve(axes, pair.time_s, difference, ESTIMATE, label="excited minus reference", width=0.9)
    if difference.size > period:
        mean = np.convolve(difference, np.ones(period) / period, mode="valid")
        middle = pair.time_s[: mean.size] + (period - 1) / 2 / pair.excited.sample_rate_hz
        curve(axes, middle, mean, INK, label="mean over one period", width=1.6)
    axes.set_title(f"Position deviation, m{units.position}")
    return _finished(figure, pair.excited)


@in_style
def following_error_figure(errors: FollowingError, units: Units) -> Figure:
    """Following error of one motion before and after the table was written into the drive."""
    figure = new_figure(2.8)
    for time, error, colour, word, rms in (
        (errors.before_time_s, errors.before_rad, PLAIN, "before", errors.before_rms_rad),
        (errors.after_time_s, errors.after_rad, GOOD, "after", errors.after_rms_rad),
    ):
        label = f"{word}: RMS {rms * 1e3:.3g} m{units.position}"
        curve(figure.axes[0], time, error * 1e3, colour, label=label, width=1.4)
    figure.axes[0].set_title(f"Following error, m{units.position}")
    return _finished(figure)


def _finished(figure: Figure, run: Run | None = None) -> Figure:
    """Name the time axis and the curves; grey where the axis is asked to move."""
    figure.axes[-1].set_xlabel("time, s")
    key(figure.axes[0])
    if run is not None and run.motion is not None:
        for axes in figure.axes:
            for start in run.motion.stroke_starts_s:
                axes.axvspan(start, start + run.motion.duration_s, color=GRID.light, alpha=0.45, linewidth=0)
    return figure
