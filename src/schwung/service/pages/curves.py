"""Inertia over angle, and what was predicted of a motion, as diagrams.

Documents are those of Estimate.to_json, and of a plan (work/moving.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.api.watching import Array
from schwung.service.pages.diagrams import band, diagram, limit, line, panel

#: Colours of several runs beside each other; theme.css has them for both themes.
TRACES = ("trace-1", "trace-2", "trace-3", "trace-4", "trace-5", "trace-6")
_TWO = 2.0  # standard deviations of a band
#: A limit beyond so many times the peak is not drawn to: the motion would look flat.
_NEAR = 3.0


@dataclass(frozen=True, eq=False)
class NamedCurve:
    """An inertia curve with its name: arrays (n,); std is NaN where it is not known."""

    name: str
    position_rad: Array
    inertia_kgm2: Array
    std_kgm2: Array


def curve_of(name: str, document: Mapping[str, Any]) -> NamedCurve:
    """The curve of an estimate's document."""
    table = document["table"]
    position = np.asarray(table["position_rad"], dtype=float)
    std = table.get("std_kgm2")
    known = np.full(position.size, np.nan) if std is None else np.asarray(std, dtype=float)
    return NamedCurve(name, position, np.asarray(table["inertia_kgm2"], dtype=float), known)


def inertia_diagram(curve: NamedCurve, earlier: Sequence[NamedCurve] = ()) -> dict[str, Any]:
    """J_l(θ) with its band of two standard deviations; beneath it in grey the range that earlier runs cover."""
    series = []
    if earlier:
        low, high = covered(curve.position_rad, earlier)
        name = "the run before" if len(earlier) == 1 else f"range of {len(earlier)} earlier runs"
        series.append(band(name, curve.position_rad, low, high, "plain", 0.3))
        series += [line("", c.position_rad, c.inertia_kgm2, "plain", width=0.8, alpha=0.6) for c in earlier]
    series += _with_band(curve, "estimate")
    return diagram(
        "Load angle, rad", "rad", [panel("Load inertia, kg·m²", series, zero=True)], "load inertia over angle"
    )


def comparison_diagram(curves: Sequence[NamedCurve]) -> dict[str, Any]:
    """Several curves over each other; below, each minus the first."""
    above = [item for n, c in enumerate(curves) for item in _with_band(c, TRACES[n % len(TRACES)], 0.12)]
    first, below = curves[0], []
    for n, c in enumerate(curves[1:], start=1):
        difference = c.inertia_kgm2 - at(first, c.position_rad)
        colour = TRACES[n % len(TRACES)]
        if np.isfinite(c.std_kgm2).any():
            own = np.hypot(
                c.std_kgm2, np.nan_to_num(np.interp(c.position_rad, first.position_rad, first.std_kgm2))
            )
            below.append(
                band("", c.position_rad, difference - _TWO * own, difference + _TWO * own, colour, 0.12)
            )
        below.append(line(c.name, c.position_rad, difference, colour))
    panels = [panel("Load inertia, kg·m²", above, share=1.6, zero=True)]
    if below:
        panels.append(panel(f"Minus {first.name}, kg·m²", below, [limit(0.0, "", "muted")]))
    return diagram("Load angle, rad", "rad", panels, "load inertia of several runs")


def _with_band(curve: NamedCurve, colour: str, alpha: float = 0.2) -> list[dict[str, Any]]:
    x, y, std = curve.position_rad, curve.inertia_kgm2, curve.std_kgm2
    drawn = []
    if np.isfinite(std).all():
        drawn.append(band("± 2σ" if alpha == 0.2 else "", x, y - _TWO * std, y + _TWO * std, colour, alpha))
    return [*drawn, line(curve.name, x, y, colour, width=2.2)]


def covered(position_rad: Array, curves: Sequence[NamedCurve]) -> tuple[Array, Array]:
    """Lowest and highest of several curves at the given angles, (n,) each; NaN where none of them was measured."""
    values = np.array([at(c, position_rad) for c in curves])
    seen = np.isfinite(values)
    low = np.where(seen.any(axis=0), np.min(np.where(seen, values, np.inf), axis=0), np.nan)
    high = np.where(seen.any(axis=0), np.max(np.where(seen, values, -np.inf), axis=0), np.nan)
    return low, high


def at(curve: NamedCurve, position_rad: Array) -> Array:
    """The curve at angles (n,); NaN outside."""
    return np.asarray(
        np.interp(position_rad, curve.position_rad, curve.inertia_kgm2, left=np.nan, right=np.nan)
    )


def prediction_diagram(document: Mapping[str, Any]) -> dict[str, Any]:
    """Travel, speed and torque as simulated, without and with the injection, against the limits."""
    limits, predicted = document["limits"], document["predicted"]
    plain, excited = predicted["reference"], predicted["excited"]

    def drawn(key: str) -> list[dict[str, Any]]:
        one = line(
            "with injection", np.asarray(excited["time_s"]), np.asarray(excited[key]), "excited", width=1.3
        )
        if plain == excited:  # a frequency response is nothing but injection
            return [one]
        return [one, line("without", np.asarray(plain["time_s"]), np.asarray(plain[key]), "plain")]

    def sides(low: float, high: float, key: str) -> list[dict[str, Any]]:
        """Both limits; the axis reaches to them unless the motion would be flat then."""
        peak = max(np.max(np.abs(excited[key])), np.max(np.abs(plain[key])))
        near = max(abs(low), abs(high)) < _NEAR * peak
        return [limit(low, "limit", always=near), limit(high, "limit", always=near)]

    low, high = limits["position_min_rad"], limits["position_max_rad"]
    speed, torque = limits["speed_max_rad_s"], limits["torque_max_nm"]
    panels = [
        panel("Position, rad", drawn("position_rad"), sides(low, high, "position_rad")),
        panel("Speed, rad/s", drawn("speed_rad_s"), sides(-speed, speed, "speed_rad_s")),
        panel("Torque, N·m", drawn("torque_nm"), sides(-torque, torque, "torque_nm"), share=1.3),
    ]
    return diagram("Time, s", "s", panels, "predicted position, speed and torque against their limits")
