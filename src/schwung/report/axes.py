"""One value drawn on one axes that somebody else has made: what notebooks show."""

from __future__ import annotations

from matplotlib.axes import Axes

from schwung.drivetrain import InertiaTable, Simulated
from schwung.explain.publishing.values import Published
from schwung.motion import Array
from schwung.report.colours import ESTIMATE, EXCITED, INK, PLAIN, Colour
from schwung.report.content import Units
from schwung.report.figures_explanation import residual, shown_overlay
from schwung.report.style import DASHED, curve
from schwung.session import Run


def draw_inertia(axes: Axes, table: InertiaTable, units: Units) -> None:
    """Inertia over angle, and two standard deviations around it where they are known."""
    curve(axes, table.position_rad, table.inertia_kgm2, ESTIMATE, width=2.0)
    if table.std_kgm2 is not None:
        low, high = (table.inertia_kgm2 + sign * 2 * table.std_kgm2 for sign in (-1, 1))
        axes.fill_between(table.position_rad, low, high, color=ESTIMATE.light, alpha=0.2, linewidth=0)
    name(
        axes, f"load {units.inertia_word} ({units.inertia})", f"load {units.position_word} ({units.position})"
    )


def draw_torque(axes: Axes, run: Run, units: Units) -> None:
    """A run's torque over time."""
    colour = EXCITED if run.role == "excited" else PLAIN
    curve(axes, run.time_s, run.torque_nm, colour, label=f"{run.role} {run.repeat}")
    name(axes, f"motor {units.torque_word} ({units.torque})", "time (s)")


def draw_positions(axes: Axes, runs: tuple[Run, ...], units: Units) -> None:
    """All runs' positions over time: without injection, and with it."""
    for role, colour in (("reference", PLAIN), ("excited", EXCITED)):
        for number, run in enumerate(run for run in runs if run.role == role):
            curve(axes, run.time_s, run.position_rad, colour, label="_" if number else role)
    name(axes, f"motor {units.position_word} ({units.position})", "time (s)")


def draw_simulated(axes: Axes, simulated: Simulated, units: Units) -> None:
    """A simulated motion's torque over time."""
    curve(axes, simulated.time_s, simulated.torque_nm, ESTIMATE, width=1.6)
    name(axes, f"motor {units.torque_word} ({units.torque}), simulated", "time (s)")


def draw_explanation(axes: Axes, found: Published, units: Units) -> None:
    """What belief and learned machine miss of the torque over one run kept aside; probabilities where there is none."""
    run = shown_overlay(found.overlays)
    if run is not None:
        curve(axes, run.time_s, residual(run, run.before_nm), PLAIN, label="belief")
        curve(axes, run.time_s, residual(run, run.after_nm), ESTIMATE, label="learned machine")
    for sign in (1, -1):
        axes.axhline(sign * found.noise.torque_nm, color=INK.light, linewidth=0.8, linestyle=DASHED)
    name(axes, f"missed {units.torque_word} ({units.torque}), noise dashed", "time (s)")


def draw_torques(axes: Axes, curves: tuple[tuple[str, Array, Array], ...], limit_nm: float) -> None:
    """Torque of several motions over time: name, s and N·m each; the first is ours."""
    colours: tuple[Colour, ...] = (ESTIMATE, PLAIN)
    for (label, time_s, torque_nm), colour in zip(curves, colours, strict=False):
        curve(axes, time_s, torque_nm, colour, label=label, width=1.6)
    if curves and limit_nm < 1.6 * max(float(abs(torque).max()) for _, _, torque in curves):
        for sign in (1, -1):
            axes.axhline(sign * limit_nm, color=INK.light, linewidth=0.8, linestyle=DASHED)
    name(axes, "motor torque (N·m)", "time (s)")


def name(axes: Axes, title: str, x_name: str) -> None:
    """Title, x-axis, and the labelled curves, each in its own colour."""
    axes.set_title(title)
    axes.set_xlabel(x_name)
    if len(axes.get_legend_handles_labels()[1]) > 1:
        axes.legend(labelcolor="linecolor", frameon=False, fontsize="small")
