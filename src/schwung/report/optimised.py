"""Pictures of the best motion beside the reference: over time, over angle, and as played."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from schwung.motion import Array
from schwung.optimise.dynamics import Followed
from schwung.report.colours import ESTIMATE, INK, MUTED, PLAIN, UNUSABLE
from schwung.report.style import DASHED, curve, in_style, key, limit_line, new_figure


@dataclass(frozen=True, eq=False)
class Shown:
    """One motion as a picture shows it; arrays (n,)."""

    name: str
    time_s: Array
    position_rad: Array
    speed_rad_s: Array
    torque_nm: Array


def shown_of(name: str, made: Followed) -> Shown:
    """The stroke, and a third of its time behind it."""
    until = made.time_s <= 4 / 3 * made.duration_s
    return Shown(
        name, made.time_s[until], made.position_rad[until], made.speed_rad_s[until], made.torque_nm[until]
    )


@in_style
def motion_figure(ours: Shown, reference: Shown, torque_max_nm: float) -> Figure:
    """Angle, speed and torque over time."""
    figure = new_figure(6.4, (1.0, 1.0, 1.4))
    axes = figure.axes
    for shown, colour, width in ((reference, PLAIN, 1.2), (ours, ESTIMATE, 2.0)):
        time = shown.time_s * 1e3
        curve(axes[0], time, shown.position_rad, colour, label=shown.name, width=width)
        curve(axes[1], time, shown.speed_rad_s, colour, width=width)
        curve(axes[2], time, shown.torque_nm, colour, width=width)
    highest = max(float(np.max(np.abs(s.torque_nm))) for s in (ours, reference))
    if torque_max_nm < 1.6 * highest:
        for sign in (1, -1):
            limit_line(axes[2], sign * torque_max_nm, "limit" if sign > 0 else "", UNUSABLE)
    for ax, title in zip(axes, ("angle (rad)", "speed (rad/s)", "motor torque (N·m)"), strict=True):
        ax.set_title(title)
    axes[2].set_xlabel("time (ms)")
    key(axes[0])
    return figure


@in_style
def angle_figure(ours: Shown, reference: Shown, angle_rad: Array, inertia_kgm2: Array) -> Figure:
    """Inertia, speed and torque over the angle: why the best motion is where it is."""
    figure = new_figure(6.0, (0.8, 1.0, 1.2))
    axes = figure.axes
    curve(axes[0], angle_rad, inertia_kgm2, INK, width=1.6)
    for shown, colour, width in ((reference, PLAIN, 1.2), (ours, ESTIMATE, 2.0)):
        curve(axes[1], shown.position_rad, shown.speed_rad_s, colour, label=shown.name, width=width)
        curve(axes[2], shown.position_rad, shown.torque_nm, colour, width=width)
    axes[2].axhline(0.0, color=MUTED.light, linewidth=0.8)
    titles = ("load inertia (kg·m²)", "speed (rad/s)", "motor torque (N·m)")
    for ax, title in zip(axes, titles, strict=True):
        ax.set_title(title)
    axes[2].set_xlabel("motor angle (rad)")
    key(axes[1])
    return figure


@in_style
def played_figure(played: Sequence[tuple[Shown, Shown]]) -> Figure:
    """Measured torque and speed of each motion with what was predicted, dashed; pairs of (measured, predicted)."""
    figure = new_figure(4.8, (1.0, 1.3))
    axes = figure.axes
    for (measured, predicted), colour in zip(played, (PLAIN, ESTIMATE), strict=False):
        curve(axes[0], measured.time_s * 1e3, measured.speed_rad_s, colour, label=measured.name, width=1.6)
        curve(axes[1], measured.time_s * 1e3, measured.torque_nm, colour, width=1.6)
        for ax, values in ((axes[0], predicted.speed_rad_s), (axes[1], predicted.torque_nm)):
            ax.plot(predicted.time_s * 1e3, values, color=INK.light, linewidth=0.8, linestyle=DASHED)
    axes[0].plot([], [], color=INK.light, linewidth=0.8, linestyle=DASHED, label="predicted")
    axes[0].set_title("speed (rad/s)")
    axes[1].set_title("motor torque as reported (N·m)")
    axes[1].set_xlabel("time (ms)")
    key(axes[0])
    return figure


@in_style
def played_angle_figure(played: Sequence[tuple[Shown, Shown]]) -> Figure:
    """Measured speed and torque of each motion over the angle."""
    figure = new_figure(4.8, (1.0, 1.3))
    axes = figure.axes
    for (measured, _), colour in zip(played, (PLAIN, ESTIMATE), strict=False):
        curve(axes[0], measured.position_rad, measured.speed_rad_s, colour, label=measured.name, width=1.6)
        curve(axes[1], measured.position_rad, measured.torque_nm, colour, width=1.6)
    axes[0].set_title("speed (rad/s)")
    axes[1].set_title("motor torque as reported (N·m)")
    axes[1].set_xlabel("motor angle (rad)")
    key(axes[0])
    return figure


@in_style
def front_figure(x: Sequence[float], y: Sequence[float], x_name: str, y_name: str) -> Figure:
    """A Pareto front: every point is one best motion."""
    figure = new_figure(3.6)
    axes = figure.axes[0]
    axes.plot(x, y, color=ESTIMATE.light, linewidth=1.6, marker="o", markersize=4)
    axes.set_ylim(bottom=0.0)
    axes.set_title(y_name)
    axes.set_xlabel(x_name)
    return figure
