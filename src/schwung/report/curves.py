"""Pictures over angle: the inertia curve, how far it is off, and how steady it was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schwung.drivetrain.inertia import InertiaTable
from schwung.motion import Array
from schwung.report.content import ReportContent
from schwung.report.style import (
    DOUBTFUL,
    ESTIMATE,
    FORMER,
    INK,
    MUTED,
    UNUSABLE,
    in_style,
    key,
    limit_line,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from schwung.estimation import Estimate

#: MIV below which the paper's machine always gave good estimates, and above which it never did (kg·m²).
MIV_GOOD_KGM2, MIV_UNUSABLE_KGM2 = 0.05, 0.08


@in_style
def inertia_figure(content: ReportContent, estimate: Estimate) -> Figure:
    """J_l(θ) with two standard deviations, the single sweeps, reference and former method; below it the error."""
    units, table, reference = content.units, estimate.table, content.reference
    figure = new_figure(4.9 if reference else 3.7, (3, 1) if reference else (1,))
    axes = figure.axes[0]
    for trace in estimate.traces:
        axes.plot(
            *_sweeps(trace.position_rad, trace.inertia_kgm2), color=ESTIMATE.light, linewidth=0.6, alpha=0.35
        )
    if content.contrast is not None:
        other = content.contrast.table
        axes.plot(other.position_rad, other.inertia_kgm2, color=FORMER.light, linewidth=1.2,
                  label=f"{content.contrast.method} method")  # fmt: skip
    band = 2 * table.std_kgm2 if table.std_kgm2 is not None else np.zeros(table.position_rad.size)
    low, high = table.inertia_kgm2 - band, table.inertia_kgm2 + band
    axes.fill_between(table.position_rad, low, high, color=ESTIMATE.light, alpha=0.18, linewidth=0)
    axes.plot(table.position_rad, table.inertia_kgm2, color=ESTIMATE.light, linewidth=2.0,
              label="estimate ± 2σ" if table.std_kgm2 is not None else "estimate")  # fmt: skip
    top = float(np.max(high))
    if reference is not None:
        position = _grid(table)
        axes.plot(position, reference.at(position), color=INK.light, linewidth=1.4, linestyle=(0, (4, 2)),
                  label=content.reference_label)  # fmt: skip
        top = max(top, float(np.max(reference.at(position))))
        _error_panel(figure.axes[1], content, estimate, reference)
    axes.set_ylim(0, 1.12 * top)
    axes.set_title(f"Load {units.inertia_word} {units.symbol}ₗ, {units.inertia}")
    figure.axes[-1].set_xlabel(f"{units.position_word}, {units.position}")
    key(axes)
    return figure


def _error_panel(axes: Axes, content: ReportContent, estimate: Estimate, reference: InertiaTable) -> None:
    table = estimate.table
    error = table.inertia_kgm2 - reference.at(table.position_rad)
    reach = 1.3 * float(np.max(np.abs(error)))
    if table.std_kgm2 is not None:
        axes.fill_between(table.position_rad, error - 2 * table.std_kgm2, error + 2 * table.std_kgm2,
                          color=ESTIMATE.light, alpha=0.18, linewidth=0)  # fmt: skip
        reach = max(reach, 1.1 * float(np.max(np.abs(error) + 2 * table.std_kgm2)))
    if content.contrast is not None:
        other = content.contrast.table
        axes.plot(other.position_rad, other.inertia_kgm2 - reference.at(other.position_rad),
                  color=FORMER.light, linewidth=1.2)  # fmt: skip
    axes.axhline(0, color=INK.light, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.plot(table.position_rad, error, color=ESTIMATE.light, linewidth=1.6)
    axes.set_ylim(-reach, reach)
    axes.set_title(f"Estimate minus {content.reference_label}, {content.units.inertia}")


@in_style
def variation_figure(content: ReportContent, estimate: Estimate) -> Figure:
    """|J(i) − J(i−N)| over angle with the paper's thresholds; below it the imaginary part of the inversion."""
    units = content.units
    imaginary = any(np.isfinite(trace.imaginary_kgm2).any() for trace in estimate.traces)
    figure = new_figure(4.0 if imaginary else 2.6, (3, 2) if imaginary else (1,))
    axes = figure.axes[0]
    for trace in estimate.traces:
        axes.plot(*_sweeps(trace.position_rad, np.abs(trace.inertia_variation_kgm2)),
                  color=ESTIMATE.light, linewidth=0.9, alpha=0.7)  # fmt: skip
        if imaginary:
            figure.axes[1].plot(*_sweeps(trace.position_rad, trace.imaginary_kgm2),
                                color=ESTIMATE.light, linewidth=0.9, alpha=0.7)  # fmt: skip
    top = 1.15 * estimate.trust.miv_kgm2
    if content.session.axis == "rotary":
        limit_line(axes, MIV_GOOD_KGM2, "good below", DOUBTFUL)
        limit_line(axes, MIV_UNUSABLE_KGM2, "unreliable above", UNUSABLE)
        top = max(top, 1.2 * MIV_UNUSABLE_KGM2)
    axes.set_ylim(0, top)
    axes.set_title(f"Change of the estimate within one period, {units.inertia}")
    if imaginary:
        figure.axes[1].axhline(0, color=MUTED.light, linewidth=1.0, linestyle=(0, (4, 2)))
        figure.axes[1].set_title(f"Imaginary part, {units.inertia}")
    figure.axes[-1].set_xlabel(f"{units.position_word}, {units.position}")
    return figure


def _grid(table: InertiaTable) -> Array:
    return np.linspace(table.position_rad[0], table.position_rad[-1], 400)


def _sweeps(position: Array, values: Array) -> tuple[Array, Array]:
    """Break the line wherever a sample is not valid, so that strokes are not joined across the rest."""
    valid = np.isfinite(position) & np.isfinite(values)
    return np.where(valid, position, np.nan), np.where(valid, values, np.nan)
