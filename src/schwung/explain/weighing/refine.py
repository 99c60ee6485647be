"""The shape of a cause between the points of its grid: where the evidence is highest, and how sharp it is there."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import minimize

from schwung.explain.weighing.candidate import Candidate, Shape
from schwung.explain.weighing.data import Atom, Data
from schwung.innovations.evidence import weigh
from schwung.motion import Array

#: A shape is refined until its evidence moves by less than this, or so often.
_SETTLED, _MOST = 0.05, 30
#: Of the width over which the evidence is measured, as a share of the grid's spacing; halved until it is about one.
_STEP = 0.25


def refined(data: Data, atom: Atom, members: Array, deviations: Array, scale: float) -> Atom | None:
    """An atom of a better shape beside `members`, or None where there is none within bounds.

    Its log share of all shapes is that of a Gaussian of the evidence's width among as many shapes as the grid has.
    """
    candidate = data.candidates[atom.candidate]
    whole = np.concatenate([deviations, scale * np.array(candidate.deviations)])
    spacing = np.array(candidate.spacing)
    start = _coded(candidate, atom.shape)
    part, both = data.part(members), data.statistics.at(members)

    def log_at(moved: Array) -> float:
        shape = _decoded(candidate, start + moved * spacing)
        if any(not low <= value <= high for value, (low, high) in zip(shape, candidate.bounds, strict=True)):
            return -np.inf
        return weigh(data.beside(part, both, candidate, shape)[0], whole).log_evidence

    first = log_at(np.zeros(start.size))
    simplex = 0.4 * np.vstack([np.zeros(start.size), np.eye(start.size)])
    best = minimize(
        lambda moved: min(-log_at(moved), 1e300), np.zeros(start.size), method="Nelder-Mead",
        options={"xatol": 1e-4, "fatol": _SETTLED, "maxfev": _MOST * start.size, "initial_simplex": simplex},
    )  # fmt: skip
    if -best.fun <= first:
        return None
    shape = _decoded(candidate, start + best.x * spacing)
    share, widths = -float(np.log(len(candidate.shapes))), np.zeros(start.size)
    for axis in range(start.size):
        along = np.eye(start.size)[axis]
        width = _width(partial(_on_line, log_at, best.x, along), -best.fun)
        share += min(0.0, float(np.log(np.sqrt(2 * np.pi) * width)))
        widths[axis] = width * spacing[axis] * (shape[axis] if candidate.logarithmic[axis] else 1.0)
    return data.append(atom.candidate, shape, share, tuple(widths.tolist()))


def _on_line(log_at: Callable[[Array], float], at: Array, along: Array, far: float) -> float:
    return log_at(at + far * along)


def _width(log_at: Callable[[float], float], top: float) -> float:
    """Standard deviation (in grid spacings) of a Gaussian that falls like the evidence about its top."""
    step = _STEP
    for _ in range(20):
        drop = top - (log_at(step) + log_at(-step)) / 2
        if not np.isfinite(drop) or drop > 2:
            step /= 3
            continue
        return float(step / np.sqrt(2 * max(drop, 1e-6)))
    return step


def _coded(candidate: Candidate, shape: Shape) -> Array:
    values = [np.log(v) if log else v for v, log in zip(shape, candidate.logarithmic, strict=True)]
    return np.array(values, dtype=float)


def _decoded(candidate: Candidate, code: Array) -> Shape:
    return tuple(
        float(np.exp(v)) if log else float(v) for v, log in zip(code, candidate.logarithmic, strict=True)
    )
