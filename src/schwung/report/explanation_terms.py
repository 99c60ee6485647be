"""A named term drawn over what it depends on: friction over speed, cogging over angle, play over wind-up, …

Dots are what the recording asks of the term: the measured torque minus all that the model needs without it.
The line is the term as fitted. Where both agree over the whole coordinate, the name is right.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from schwung.drivetrain.hysteresis import yielded
from schwung.drivetrain.machine import Machine
from schwung.explain.values import Overlay, Quantity
from schwung.explain.words import View, words_of
from schwung.motion import Array
from schwung.report.colours import EXCITED, GOOD, GRID, INK, MUTED, PLAIN, thin
from schwung.report.content import Units
from schwung.report.figures_explanation import compared, residual
from schwung.report.style import DASHED, curve, in_style, key, new_figure

_DOTS = 900
_BINS = 60
_FINE_BINS = 140  # over position, where teeth have to show
_FOLDED = 2  # periods shown of a term that repeats more often than _REPEATS times
_REPEATS = 5
_CARRIED = 0.97  # of what the term explains lies below the highest frequency drawn, but for a margin
_HYSTERESIS = "coupling_hysteresis"
_WIND_UP_POINTS = 401


class Term(Protocol):
    """What is drawn: a physics name and its parameters."""

    @property
    def physics(self) -> str:
        """As machine.toml has it."""

    @property
    def parameters(self) -> Mapping[str, Quantity]:
        """By the file's keys."""


@dataclass(frozen=True, eq=False)
class _Samples:
    """The compared samples of all runs along one coordinate; each (n,)."""

    x: Array
    asked_nm: Array  # what the recording asks of the term
    term_nm: Array
    forward: Array  # 1 where the axis moves forward, −1 backward


@in_style
def term_figure(term: Term, runs: Sequence[Overlay], units: Units) -> Figure | None:
    """The term over its own coordinate, from all runs given; None where there is nothing to draw it from.

    Terms of the coupling's law have no such picture: `coupling_figure` draws it.
    """
    view = words_of(term.physics).view
    with_term = [run for run in runs if term.physics in run.terms_nm and compared(run).any()]
    if not with_term or view == "wind_up":
        return None
    if view == "frequency":
        return _spectrum_figure(term, with_term, units)
    if view == "run":
        return _drift_figure(term, with_term, units)
    return _scatter_figure(term, with_term, view, units)


# ----------------------------------------------------------------------------------------- over samples


def _scatter_figure(term: Term, runs: Sequence[Overlay], view: View, units: Units) -> Figure:
    figure = new_figure(3.0)
    axes = figure.axes[0]
    samples = _samples(term, runs, _coordinate(view))
    since_start = all(run.motion_time_s is not None for run in runs)
    label = _axis_label(view, units, since_start=since_start)
    period = _period(term)
    if view == "position" and period and np.ptp(samples.x) > _REPEATS * period:
        samples = _Samples(samples.x % (_FOLDED * period), samples.asked_nm, samples.term_nm, samples.forward)
        label = f"{units.position_word}, {_FOLDED} periods of many laid on each other, {units.position}"
    chosen = np.linspace(0, samples.x.size - 1, min(_DOTS, samples.x.size)).astype(np.int64)
    axes.plot(
        samples.x[chosen], samples.asked_nm[chosen], ".", color=PLAIN.light, markersize=2.2, alpha=0.45,
        label="asked for by the recording",
    )  # fmt: skip
    _draw_means(axes, samples, view)
    axes.axhline(0, color=MUTED.light, linewidth=0.8)
    usual = float(np.quantile(np.abs(samples.asked_nm), 0.99))
    reach = 1.15 * max(usual, float(np.max(np.abs(samples.term_nm)))) or 1e-9
    axes.set_ylim(-reach, reach)
    axes.set_title(f"{units.torque_word.capitalize()}, {units.torque}")  # the page's heading has the name
    axes.set_xlabel(label)
    key(axes)
    return figure


def _samples(term: Term, runs: Sequence[Overlay], coordinate: Callable[[Overlay], Array]) -> _Samples:
    parts = []
    for run in runs:
        inside = compared(run)
        fitted = np.asarray(run.terms_nm[term.physics])
        asked = run.torque_nm - (run.after_nm - fitted)
        parts.append(
            [values[inside] for values in (coordinate(run), asked, fitted, np.sign(run.speed_rad_s))]
        )
    return _Samples(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _coordinate(view: View) -> Callable[[Overlay], Array]:
    choices: dict[str, Callable[[Overlay], Array]] = {
        "speed": lambda run: run.speed_rad_s,
        "position": lambda run: run.position_rad,
        "torque": lambda run: run.torque_nm,
        "torque_rate": lambda run: np.gradient(run.before_nm, run.time_s),
        "acceleration": lambda run: run.acceleration_rad_s2,
    }
    return choices.get(view, _time)


def _time(run: Overlay) -> Array:
    """Since the motion began where that is known, else the run's."""
    return run.time_s if run.motion_time_s is None else run.motion_time_s


def _axis_label(view: View, units: Units, *, since_start: bool) -> str:
    return {
        "speed": f"speed, {units.speed}",
        "position": f"{units.position_word}, {units.position}",
        "torque": f"motor {units.torque_word}, {units.torque}",
        "torque_rate": f"rate of change of the {units.torque_word} needed, {units.torque}/s",
        "acceleration": f"acceleration, {units.position}/s²",
    }.get(view, "time since the motion began, s" if since_start else "time in the run, s")


def _period(term: Term) -> float | None:
    """After how much angle (rad, or m) a term repeats; None where it does not."""
    if term.physics not in ("cogging", "encoder_eccentricity"):
        return None
    order = term.parameters.get("order")
    turns = float(order.value) if order is not None and isinstance(order.value, int | float) else 1.0
    return 2 * np.pi / abs(turns) if turns else None


def _draw_means(axes: Axes, samples: _Samples, view: View) -> None:
    """The term as fitted, one line per direction where it differs by direction, and the dots' own mean."""
    directions = (1.0, -1.0) if view in ("position", "time") and _by_direction(samples) else (0.0,)
    for direction in directions:
        of_it = samples.forward == direction if direction else np.ones(samples.x.size, dtype=bool)
        edges = _bins(samples.x, view)
        x, asked = _bin_means(samples.x[of_it], samples.asked_nm[of_it], edges)
        label = "their mean" if direction == directions[0] else "_"
        axes.plot(x, asked, "o", color=INK.light, markersize=2.8, label=label)
        x, term = _bin_means(samples.x[of_it], samples.term_nm[of_it], edges)
        name = {1.0: "named, forward", -1.0: "named, backward"}.get(direction, "named")
        axes.plot(
            x, term, color=GOOD.light, linewidth=2.0, label=name, linestyle=DASHED if direction < 0 else "-"
        )


def _by_direction(samples: _Samples) -> bool:
    """Whether the term is clearly another one on the way back, at the same place."""
    ways = [samples.forward > 0, samples.forward < 0]
    if not all(way.any() for way in ways):
        return False
    edges = _bins(samples.x, "speed")
    ahead, back = (_bin_values(samples.x[way], samples.term_nm[way], edges) for way in ways)
    both = np.isfinite(ahead) & np.isfinite(back)
    size = float(np.max(np.abs(samples.term_nm), initial=0.0))
    return bool(both.any()) and float(np.max(np.abs(ahead - back)[both])) > 0.2 * size


def _bins(x: Array, view: View) -> Array:
    """Edges over all values; over speed, torque and the like zero is one of them, for what jumps there."""
    count = _FINE_BINS if view in ("position", "time") else _BINS
    low, high = float(x.min()), float(x.max())
    if view not in ("position", "time") and low < 0 < high:
        high = max(-low, high)
        low = -high
    return np.linspace(low, high if high > low else low + 1e-9, count + 1)


def _bin_values(x: Array, y: Array, edges: Array) -> Array:
    counts, _ = np.histogram(x, edges)
    sums, _ = np.histogram(x, edges, weights=y)
    return np.asarray(np.where(counts > 0, sums / np.maximum(counts, 1), np.nan))


def _bin_means(x: Array, y: Array, edges: Array) -> tuple[Array, Array]:
    """Middles and means of the bins that hold anything."""
    means = _bin_values(x, y, edges)
    middles = (edges[1:] + edges[:-1]) / 2
    known = np.isfinite(means)
    return middles[known], means[known]


# --------------------------------------------------------------------------------- over run and frequency


def _drift_figure(term: Term, runs: Sequence[Overlay], units: Units) -> Figure:
    """Friction of each run, as the mean of what acts against the motion."""
    figure = new_figure(2.6)
    axes = figure.axes[0]
    ordered = sorted(runs, key=lambda run: run.run)
    numbers, asked, named = [], [], []
    for run in ordered:
        samples = _samples(term, [run], _coordinate("time"))
        numbers.append(run.run)
        asked.append(float(np.mean(samples.asked_nm * samples.forward)))
        named.append(float(np.mean(samples.term_nm * samples.forward)))
    axes.plot(numbers, asked, "o", color=INK.light, markersize=4, label="asked for by the recording")
    axes.plot(numbers, named, color=GOOD.light, linewidth=2.0, label="named")
    axes.axhline(0, color=MUTED.light, linewidth=0.8)
    axes.set_title(f"Change of friction, mean of each run, {units.torque}")
    axes.set_xlabel("number of the run")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    key(axes)
    return figure


def _spectrum_figure(term: Term, runs: Sequence[Overlay], units: Units) -> Figure:
    """Amplitude of what is left over frequency, root mean square over the runs, before and after."""
    figure = new_figure(3.0)
    axes = figure.axes[0]
    longest = max(run.time_s.size for run in runs)
    step = float(np.median(np.diff(runs[0].time_s)))
    f = np.asarray(np.fft.rfftfreq(longest, step), dtype=np.float64)
    without = [residual(run, run.after_nm - run.terms_nm[term.physics]) for run in runs]
    before = _mean_amplitude(without, longest)
    after = _mean_amplitude([residual(run, run.after_nm) for run in runs], longest)
    carried = np.cumsum(np.maximum(before**2 - after**2, 0.0))
    last = min(int(np.searchsorted(carried, _CARRIED * carried[-1]) * 1.5) + 8, f.size)
    x, y = thin(f[1:last], before[1:last])
    axes.fill_between(x, y, color=EXCITED.light, alpha=0.25, linewidth=0)
    axes.plot(x, y, color=EXCITED.light, linewidth=1.1, label="without it")
    curve(axes, f[1:last], after[1:last], GOOD, label="with it", width=1.6)
    _mark_frequency(axes, term)
    axes.set_ylim(bottom=0)
    axes.set_title(f"Amplitude of what is left, {units.torque}")
    axes.set_xlabel("frequency, Hz")
    key(axes)
    return figure


def _mean_amplitude(signals: Sequence[Array], length: int) -> Array:
    """Root mean square of the signals' amplitude spectra, (length//2 + 1,)."""
    squares = [_amplitude(values, length) ** 2 for values in signals]
    return np.asarray(np.sqrt(np.mean(squares, axis=0)), dtype=np.float64)


def _amplitude(values: Array, length: int) -> Array:
    """Amplitude spectrum (2/Σw |X|) of what was compared, Hann window, (length//2 + 1,)."""
    known = np.isfinite(values)
    window = np.hanning(int(known.sum()))
    weighted = np.zeros(length)
    weighted[: values.size][known] = values[known] * window
    return np.asarray(2 * np.abs(np.fft.rfft(weighted)) / max(float(window.sum()), 1e-300))


def _mark_frequency(axes: Axes, term: Term) -> None:
    quantity = term.parameters.get("frequency_hz")
    if quantity is None or not isinstance(quantity.value, int | float):
        return
    axes.axvline(float(quantity.value), color=MUTED.light, linewidth=1.0, linestyle=DASHED)
    axes.annotate(
        f"{quantity.value:.4g} Hz", (float(quantity.value), 1.0), xycoords=("data", "axes fraction"),
        xytext=(4, -9), textcoords="offset points", color=MUTED.light, fontsize=8,
    )  # fmt: skip


# ------------------------------------------------------------------------------------- over wind-up


@in_style
def coupling_figure(
    terms: Sequence[Term], runs: Sequence[Overlay], believed: Machine, units: Units
) -> Figure | None:
    """Torque in the coupling over its wind-up: as believed and as named; None where no run is at hand."""
    if not runs:
        return None
    figure = new_figure(3.0)
    axes = figure.axes[0]
    motor = believed.motor
    reached = [
        run.torque_nm
        - motor.inertia_kgm2 * run.acceleration_rad_s2
        - motor.viscous_friction_nms * run.speed_rad_s
        for run in runs
    ]  # what the motor passes on: C of (1)
    low, high = min(float(c.min()) for c in reached), max(float(c.max()) for c in reached)
    most = 1.15 * max(-low, high, 1e-9)
    torque = np.linspace(-most, most, _WIND_UP_POINTS)
    stiffness = believed.coupling.stiffness_nm_rad if believed.coupling is not None else np.inf
    axes.axhspan(low, high, color=GRID.light, linewidth=0, zorder=0.5, label="reached in the session")
    label = "belief" if np.isfinite(stiffness) else "belief: rigid"
    axes.plot(1e3 * torque / stiffness, torque, color=EXCITED.light, linewidth=1.4, label=label)
    wind_up, torque = _with_hysteresis(terms, _wind_up(terms, torque, stiffness), torque)
    axes.plot(1e3 * wind_up, torque, color=GOOD.light, linewidth=2.0, label="belief + physics")
    axes.set_title(f"{units.torque_word.capitalize()} in the coupling, {units.torque}")
    axes.set_xlabel(f"wind-up, m{units.position}")
    axes.legend(loc="upper left", fontsize=8.5, handlelength=1.4)
    return figure


def _wind_up(terms: Sequence[Term], torque: Array, stiffness: float) -> Array:
    """Wind-up (rad) at each torque (N·m), (n,), of the coupling with all that was named of it.

    |T| = k δ + c δ³ beyond half of the play, k as named or as believed (infinite: rigid).
    """
    numbers = _numbers([term for term in terms if term.physics != _HYSTERESIS])
    stiffness = numbers.get("stiffness_nm_rad", stiffness)
    cubic, gap = numbers.get("cubic_nm_rad3", 0.0), numbers.get("gap_rad", 0.0)
    size = np.abs(torque)
    wound = size / stiffness
    if cubic and np.isfinite(stiffness):
        reach = np.linspace(0.0, 2.0 * float(wound.max()), 4 * _WIND_UP_POINTS)
        held = np.maximum.accumulate(stiffness * reach + cubic * reach**3)  # to where it softens to nothing
        wound = np.interp(size, held, reach)
    return np.asarray(np.sign(torque) * (wound + gap / 2))


def _with_hysteresis(terms: Sequence[Term], wound: Array, torque: Array) -> tuple[Array, Array]:
    """Wind-up (rad) and torque (N·m) from rest to the largest, to the smallest and back, where there is hysteresis."""
    numbers = _numbers([term for term in terms if term.physics == _HYSTERESIS])
    if not numbers:
        return wound, torque
    yields_at, over = numbers["torque_nm"], numbers["torque_nm"] / numbers["stiffness_nm_rad"]
    largest = float(np.max(wound))
    way = largest * np.sin(np.linspace(0.0, 2.5 * np.pi, 5 * _WIND_UP_POINTS))
    held = yields_at * yielded(way, over, numbers.get("exponent", 2.0))
    return way, np.interp(way, wound, torque) + held


def _numbers(terms: Sequence[Term]) -> dict[str, float]:
    """Of several terms, those of their parameters that are numbers."""
    named = {key: quantity.value for term in terms for key, quantity in term.parameters.items()}
    return {key: float(value) for key, value in named.items() if isinstance(value, int | float)}
