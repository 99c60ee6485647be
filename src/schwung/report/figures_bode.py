"""Pictures of frequency responses: points with their spread, fit and coherence (the paper's Fig. 12)."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from schwung.estimation.bode_values import BodeFit
from schwung.estimation.proposal import Proposal
from schwung.estimation.response import MIN_COHERENCE, ComplexArray, Response
from schwung.motion import Array
from schwung.report.colours import DOUBTFUL, ESTIMATE, EXCITED, FORMER, GOOD, INK, MUTED, UNUSABLE, Colour
from schwung.report.style import DASHED, in_style, key, limit_line, new_figure

_ANGLES = (ESTIMATE, EXCITED, GOOD, FORMER, DOUBTFUL, UNUSABLE)
#: More angles than this have no names of their own: they are too many to tell apart by colour.
_NAMED = len(_ANGLES)
#: Numbers as they are: mathematical text is off, a "$" in a name is a dollar.
_PLAIN = FuncFormatter(lambda value, _: f"{value:g}")


def colour_of(number: int) -> Colour:
    """The colour of an angle, by its place."""
    return _ANGLES[number % len(_ANGLES)]


@in_style
def bode_figure(fit: BodeFit) -> Figure:
    """Magnitude, phase and coherence of speed over torque at every angle, and the fit through them."""
    figure = new_figure(6.6, (3, 2, 1))
    magnitude, phase, coherence = figure.axes
    fine = _fine_grid(fit)
    for i, response in enumerate(fit.responses):
        colour = colour_of(i)
        label = f"{math.degrees(response.position_rad):.4g}°" if i < _NAMED else "_"
        f, measured = response.frequency_hz, fit.corrected[i]
        used = response.used
        magnitude.errorbar(
            f[used], np.abs(measured[used]), yerr=_visible(response)[:, used], fmt="o", color=colour.light,
            markersize=3.2, markerfacecolor="none", markeredgewidth=0.9, elinewidth=0.9, label="_",
        )  # fmt: skip
        magnitude.plot(f[~used], np.abs(measured[~used]), "x", color=colour.light, markersize=3.5, alpha=0.5)
        modelled = fit.response_at(i, fine)
        magnitude.plot(fine, np.abs(modelled), color=colour.light, linewidth=1.4, label=label)
        phase.plot(f[used], _degrees(measured[used]), "o", color=colour.light, markersize=3.2, markerfacecolor="none",
                   markeredgewidth=0.9)  # fmt: skip
        phase.plot(fine, _degrees(modelled), color=colour.light, linewidth=1.4)
        coherence.plot(f, response.coherence, "o-", color=colour.light, markersize=2.6, linewidth=0.8)
        _mark_extremes(magnitude, fit, i, colour)
    _finish(figure, fine)
    return figure


def _fine_grid(fit: BodeFit) -> Array:
    ends = np.array([[r.frequency_hz.min(), r.frequency_hz.max()] for r in fit.responses])
    return np.geomspace(ends[:, 0].min() / 1.1, ends[:, 1].max() * 1.1, 1200)


def _visible(response: Response) -> Array:
    """Error bars on a logarithmic axis: not longer downwards than the point is high."""
    size = np.abs(response.response)
    return np.vstack([np.minimum(response.std, 0.9 * size), response.std])


def _degrees(values: ComplexArray) -> Array:
    return np.asarray(np.degrees(np.angle(values)))


def _mark_extremes(axes: Axes, fit: BodeFit, number: int, colour: Colour) -> None:
    """Anti-resonance and resonance as ticks at the foot of the picture."""
    angle = fit.angles[number]
    for fitted, marker in ((angle.anti_resonance, "v"), (angle.resonance, "^")):
        if fitted is not None:
            axes.plot(
                [fitted.value], [0.02], marker=marker, color=colour.light, markersize=5,
                transform=axes.get_xaxis_transform(), clip_on=True, linestyle="none",
            )  # fmt: skip


def _finish(figure: Figure, fine: Array) -> None:
    magnitude, phase, coherence = figure.axes
    magnitude.set(xscale="log", yscale="log", xlim=(fine[0], fine[-1]))
    magnitude.set_title("Speed over torque, rad/s per N·m    ▾ anti-resonance  ▴ resonance")
    phase.set_title("Phase, °")
    phase.set(ylim=(-125, 125), yticks=[-90, 0, 90])
    coherence.set_title("Coherence")
    coherence.set_ylim(min(0.75, coherence.get_ylim()[0]), 1.02)
    limit_line(coherence, MIN_COHERENCE, "fitted above", MUTED)
    coherence.set_xlabel("Frequency, Hz")
    coherence.xaxis.set_major_formatter(_PLAIN)
    magnitude.yaxis.set_major_formatter(_PLAIN)
    coherence.xaxis.set_minor_formatter(NullFormatter())
    ticks = [t for t in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000) if fine[0] <= t <= fine[-1]]
    coherence.set_xticks(ticks)
    coherence.minorticks_off()
    key(magnitude)


@in_style
def proposal_figure(proposal: Proposal) -> Figure:
    """Expected error of J_l over the injected frequency, by cause, and the frequency that is proposed."""
    figure = new_figure(2.9)
    axes = figure.axes[0]
    rows = sorted(proposal.candidates, key=lambda c: c.frequency_hz)
    f = np.array([c.frequency_hz for c in rows])
    for name, colour in (("noise", EXCITED), ("model", FORMER), ("blur", GOOD)):
        values = np.array([100 * getattr(c, f"{name}_kgm2") / c.inertia_kgm2 for c in rows])
        if np.any(values > 0):
            axes.plot(f, values, color=colour.light, linewidth=1.1, label=name)
    axes.plot(f, [100 * c.relative for c in rows], color=INK.light, linewidth=1.8, label="expected error")
    axes.axvline(proposal.best.frequency_hz, color=ESTIMATE.light, linewidth=1.2, linestyle=DASHED)
    right = proposal.best.frequency_hz > 0.8 * f.max()  # then the text goes to the line's left
    axes.annotate(
        f"{proposal.best.frequency_hz:.4g} Hz", (proposal.best.frequency_hz, 1.0),
        xycoords=("data", "axes fraction"), xytext=(-4 if right else 4, -9), textcoords="offset points",
        ha="right" if right else "left", color=ESTIMATE.light, fontsize=8,
    )  # fmt: skip
    axes.set(yscale="log", xlabel="Injected frequency, Hz")
    axes.yaxis.set_major_formatter(_PLAIN)
    axes.set_title("Expected error at the worst angle, % of the load inertia")
    key(axes)
    return figure
