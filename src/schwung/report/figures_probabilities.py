"""Pictures of an explanation by probabilities: bars, curves with their bands."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from schwung.explain.publishing.values import Curve, Published, percent
from schwung.explain.weighing.values import NAMED
from schwung.explain.words import words_of
from schwung.report.colours import ESTIMATE, EXCITED, GOOD, INK, MUTED, Colour
from schwung.report.content import Units
from schwung.report.style import DASHED, curve, in_style, key, new_figure

_MOST_BARS = 14
_BAND = 1.96


@in_style
def probabilities_figure(of: Published) -> Figure:
    """Probabilities of names and of what has none, as bars."""
    linear = of.axis == "linear"
    bars: list[tuple[str, float, Colour]] = [
        (words_of(one.physics, linear=linear).name, one.probability, GOOD if one.in_file else MUTED)
        for one in of.names
    ]
    for one in of.curves:
        name = words_of(one.like, linear=linear).name if one.like else ""
        what = f"unnamed, like {name}" if name else f"unnamed, over {one.over}"
        bars.append((what, one.probability, ESTIMATE if one.in_file else MUTED))
    bars = sorted(bars, key=lambda bar: -bar[1])[:_MOST_BARS][::-1]
    lines = max(len(bars), 2)
    figure = new_figure(1.0 + 0.34 * lines)
    axes = figure.axes[0]
    places = np.arange(len(bars))
    axes.barh(places, [100 * p for _, p, _ in bars], color=[colour.light for *_, colour in bars], height=0.62)
    for place, (_, p, _) in zip(places, bars, strict=True):
        axes.annotate(
            percent(p), (100 * p, float(place)), xytext=(4, 0), textcoords="offset points", va="center",
            color=INK.light,
        )  # fmt: skip
    axes.axvline(100 * NAMED, color=MUTED.light, linestyle=DASHED, linewidth=1)
    axes.set_yticks(places, [name for name, *_ in bars])
    axes.set_ylim(len(bars) - lines - 0.6, len(bars) - 0.4)
    axes.set_xlim(0, 108)
    axes.set_xlabel("probability, %")
    axes.grid(axis="y", visible=False)
    return figure


@in_style
def curve_figure(one: Curve, units: Units) -> Figure:
    """A curve without a name over its coordinate, forward and backward, with bands of 95 %."""
    of = one.drawn
    assert of is not None
    figure = new_figure(3.4)
    axes = figure.axes[0]
    axes.axhline(0, color=MUTED.light, linewidth=0.8)
    sides = [("forward" if of.directed else "torque", of.forward_nm, of.forward_std_nm, ESTIMATE)]
    if of.directed:
        sides.append(("backward", of.backward_nm, of.backward_std_nm, EXCITED))
    for label, values, deviation, colour in sides:
        band = _BAND * deviation
        axes.fill_between(of.x, values - band, values + band, color=colour.light, alpha=0.18, linewidth=0)
        curve(axes, of.x, values, colour, label=label, width=1.7)
    axes.margins(x=0.01)
    name = one.coordinate.replace("_", " ")
    axes.set_xlabel(
        "share of the session" if of.over == "run" else f"{name}, {one.unit}" if one.unit else name
    )
    axes.set_title(f"Added to the {units.torque_word}, {units.torque}")
    key(axes)
    return figure


@in_style
def presliding_figure(torque_nm: float, stiffness_nm_rad: float, units: Units) -> Figure:
    """Friction that is a spring before it slides, over the way: from rest, and after a reversal."""
    distance = torque_nm / stiffness_nm_rad
    way = np.linspace(0.0, 5 * distance, 200)
    figure = new_figure(2.8)
    axes = figure.axes[0]
    axes.axhline(0, color=MUTED.light, linewidth=0.8)
    curve(axes, way, torque_nm * (1 - np.exp(-way / distance)), ESTIMATE, label="from rest", width=1.7)
    curve(
        axes, way, torque_nm * (1 - 2 * np.exp(-way / distance)), EXCITED, label="since a reversal", width=1.7
    )
    axes.axvline(distance, color=MUTED.light, linestyle=DASHED, linewidth=1)
    axes.set_xlabel(f"way, {units.position}; dashed: {units.torque_word} over stiffness")
    axes.set_title(f"Friction, {units.torque}")
    key(axes)
    return figure


#: How each of the slices of a plane is drawn, from the lowest to the highest value of its second coordinate.
_SLICES = ((EXCITED, 1.0), (EXCITED, 0.5), (INK, 1.0), (ESTIMATE, 0.5), (ESTIMATE, 1.0))


@in_style
def plane_figure(one: Curve, units: Units) -> Figure:
    """What depends on two coordinates at once: over the first, at a few values of the second."""
    of = one.plane
    assert of is not None
    figure = new_figure(3.4)
    axes = figure.axes[0]
    axes.axhline(0, color=MUTED.light, linewidth=0.8)
    (first, second), (unit, other) = (
        [part.strip() for part in text.replace("_", " ").split(",")] for text in (one.coordinate, one.unit)
    )
    for value, (colour, alpha) in zip(np.linspace(of.y[0], of.y[-1], len(_SLICES)), _SLICES, strict=True):
        along = of.at(of.x, np.full_like(of.x, value))
        curve(axes, of.x, along, colour, label=f"{value:.3g} {other}", width=1.5, alpha=alpha)
    axes.margins(x=0.01)
    axes.set_xlabel(f"{first}, {unit}")
    axes.set_title(f"Added to the {units.torque_word}, {units.torque}, at a {second} of")
    key(axes)
    return figure
