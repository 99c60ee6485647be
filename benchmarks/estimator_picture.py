"""The benchmark's picture: error over motion time, and what real life adds to it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from estimator_cases import BOUND, CLEAN, CONDITIONS, DURATIONS_S, USUAL_S, usual_runs
from estimator_score import Score
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure

from schwung.report.colours import ESTIMATE, EXCITED, FORMER, GOOD, INK, MUTED, SURFACE
from schwung.report.style import DASHED, WIDTH_IN, in_style, to_png

_LOUD = {"trajectory": GOOD, "multiphase": ESTIMATE, "denoised": EXCITED, "former": FORMER}
_REFUSED = "#d9dde3"


@in_style
def _figure(scores: Sequence[Score], methods: Sequence[str]) -> Figure:
    figure = Figure(figsize=(WIDTH_IN * 1.3, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
    _over_time(left, scores, methods)
    _over_conditions(right, scores, methods)
    return figure


def draw(scores: Sequence[Score], methods: Sequence[str], path: Path) -> None:
    """Write the picture."""
    path.write_bytes(to_png(_figure(scores, methods), dpi=110))


def _median(scores: Sequence[Score], method: str, duration: float, condition: str) -> float:
    values = [
        s.rmse for s in scores
        if (s.method, s.duration_s, s.condition, s.runs) == (method, duration, condition, usual_runs(method))
    ]  # fmt: skip
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


def _over_time(axes: Axes, scores: Sequence[Score], methods: Sequence[str]) -> None:
    """One line a method; the rivals quiet."""
    times = 1e3 * np.array(DURATIONS_S)
    ends = []
    for method in (*methods, BOUND):
        errors = np.array([1e3 * _median(scores, method, d, CLEAN) for d in DURATIONS_S])
        if method == BOUND:
            axes.plot(times, errors, color=INK.light, linestyle=DASHED, linewidth=1.2)
            ends.append((errors[-1], "Cramér-Rao bound", INK.light))
            continue
        colour = _LOUD.get(method, MUTED)
        axes.plot(times, errors, color=colour.light, linewidth=2.2 if method in _LOUD else 0.9,
                  alpha=1.0 if method in _LOUD else 0.55)  # fmt: skip
        ends.append((errors[-1], method, colour.light))
    axes.set(xscale="log", yscale="log", xlabel="motion time, ms")
    axes.set_title("Median RMSE over four machines, nothing added, 10⁻³ kg·m²")
    axes.set_xticks(times, [f"{t:g}" for t in times])
    axes.set_yticks([0.01, 0.1, 1, 10, 100], ["0.01", "0.1", "1", "10", "100"])
    axes.minorticks_off()
    axes.invert_xaxis()
    for place, (_, name, shade) in zip(_apart([e for e, _, _ in ends]), ends, strict=True):
        axes.annotate(name, (times[-1], place), xytext=(6, 0), textcoords="offset points", va="center",
                      color=shade, fontsize=8)  # fmt: skip


def _apart(values: Sequence[float], step: float = 0.14) -> list[float]:
    """The values, moved apart so that labels do not overlap; `step` in decades."""
    logs = np.log10(np.nan_to_num(np.array(values), nan=1.0))
    order = np.argsort(logs)
    placed = logs[order]
    for _ in range(200):
        gaps = np.diff(placed)
        near = np.flatnonzero(gaps < step - 1e-6)
        if near.size == 0:
            break
        for i in near:
            push = (step - (placed[i + 1] - placed[i])) / 2
            placed[i] -= push
            placed[i + 1] += push
    result = np.empty_like(placed)
    result[order] = placed
    return [float(10**v) for v in result]


def _over_conditions(axes: Axes, scores: Sequence[Score], methods: Sequence[str]) -> None:
    """Errors as numbers on colour; refused ones grey."""
    values = np.array([[1e3 * _median(scores, m, USUAL_S, c) for c in CONDITIONS] for m in methods])
    ramp = LinearSegmentedColormap.from_list("error", [GOOD.light, "#f4f1de", FORMER.light], N=256)
    ramp.set_bad(_REFUSED)
    axes.imshow(values, norm=LogNorm(0.01, 30.0), cmap=ramp, aspect="auto", alpha=0.85)
    for (row, column), value in np.ndenumerate(values):
        text = f"{value:.2g}" if np.isfinite(value) else "refused"
        strong = not np.isfinite(value) or 0.04 < value < 8
        axes.text(column, row, text, ha="center", va="center", fontsize=7.5 if np.isfinite(value) else 6,
                  color=INK.light if strong else SURFACE.light)  # fmt: skip
    axes.set_xticks(range(len(CONDITIONS)), list(CONDITIONS), rotation=35, ha="right")
    axes.set_yticks(range(len(methods)), list(methods))
    axes.grid(visible=False)
    axes.set_title(f"The same at {1e3 * USUAL_S:g} ms, by what is added")
    for side in ("bottom", "left"):
        axes.spines[side].set_visible(False)
