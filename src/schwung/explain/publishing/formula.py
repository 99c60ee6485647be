"""A formula for a curve: few elementary terms, by weighted least squares over all small sets of them.

y = Σ aᵢ·termᵢ(x), the terms out of 1, x, x², x³, |x|, √|x|, sign x, cos(k·x + φ) and exp(−|x|/s); k and s are refined.
Which of the sets is shown is decided by runs that were not fitted (`published.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import minimize_scalar

from schwung.motion import Array

#: Terms that have no number of their own.
_PLAIN: dict[str, Callable[[Array], Array]] = {
    "1": np.ones_like,
    "x": lambda x: x,
    "x²": lambda x: x**2,
    "x³": lambda x: x**3,
    "|x|": np.abs,
    "√|x|": lambda x: np.sqrt(np.abs(x)),
    "sign x": np.sign,
}
#: Terms of a set at most.
MOST = 3
_WAVES, _DECAYS = 48, 16
_WAVE, _DECAY = "cos", "exp"


@dataclass(frozen=True, eq=False)
class Formula:
    """A sum of terms of one coordinate; `text` has numbers and the coordinate's letter."""

    text: str
    terms: int
    at: Callable[[Array], Array]
    misfit: float  # mean of squares over the deviations


def formulas(x: Array, y: Array, deviation: Array, letter: str) -> list[Formula]:
    """The best formula of one term, of two, and of three; (n,) each."""
    scale = 1 / np.maximum(deviation, 1e-3 * max(float(np.max(np.abs(y))), 1e-300))
    signed = bool(np.min(x) < 0 < np.max(x))
    names = [name for name in _PLAIN if signed or name not in ("|x|", "sign x")]
    found = []
    for count in range(1, MOST + 1):
        sets = (_best(x, y, scale, chosen) for chosen in _sets(names, count))
        found.append(min(sets, key=lambda one: one[0]))
    return [
        _told(x, y, scale, chosen, number, letter, count)
        for count, (_, chosen, number) in enumerate(found, 1)
    ]


def _sets(names: list[str], count: int) -> Iterator[tuple[str, ...]]:
    """Sets of so many terms, one of those with a number at most."""
    yield from combinations(names, count)
    for own in (_WAVE, _DECAY):
        yield from ((*others, own) for others in combinations(names, count - 1))


def _best(x: Array, y: Array, scale: Array, chosen: tuple[str, ...]) -> tuple[float, tuple[str, ...], float]:
    """Misfit of a set with its best number."""
    if chosen[-1] not in (_WAVE, _DECAY):
        return _missed(x, y, scale, chosen, 0.0), chosen, 0.0
    span = float(np.ptp(x))
    apart = float(np.median(np.diff(np.unique(x))))
    tried = (
        np.linspace(1.0 / span, min(40.0 / span, np.pi / (2 * apart)), _WAVES)
        if chosen[-1] == _WAVE
        else np.geomspace(max(2 * apart, span / 50), span, _DECAYS)
    )
    each = [_missed(x, y, scale, chosen, float(number)) for number in tried]
    top = int(np.argmin(each))
    ends = tried[max(top - 1, 0)], tried[min(top + 1, tried.size - 1)]
    refined = minimize_scalar(lambda n: _missed(x, y, scale, chosen, float(n)), bounds=ends, method="bounded")
    return float(refined.fun), chosen, float(refined.x)


def _columns(x: Array, chosen: tuple[str, ...], number: float) -> Array:
    columns = [_PLAIN[name](x) for name in chosen if name in _PLAIN]
    if _WAVE in chosen:
        columns += [np.cos(number * x), np.sin(number * x)]
    if _DECAY in chosen:
        columns.append(np.exp(-np.abs(x) / number))
    return np.stack(columns, 1)


def _solved(x: Array, y: Array, scale: Array, chosen: tuple[str, ...], number: float) -> Array:
    columns = _columns(x, chosen, number)
    size = np.maximum(np.max(np.abs(columns), axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(columns / size * scale[:, None], y * scale, rcond=1e-9)[0] / size)


def _missed(x: Array, y: Array, scale: Array, chosen: tuple[str, ...], number: float) -> float:
    rest = _columns(x, chosen, number) @ _solved(x, y, scale, chosen, number) - y
    return float(np.mean((rest * scale) ** 2))


def _told(
    x: Array, y: Array, scale: Array, chosen: tuple[str, ...], number: float, letter: str, count: int
) -> Formula:
    factors = _solved(x, y, scale, chosen, number)
    plain = [name for name in chosen if name in _PLAIN]
    positive = bool(np.min(x) >= 0)
    called = [name.replace("|x|", "x" if positive else "|x|").replace("x", letter) for name in plain]
    parts = [_term(float(a), name) for a, name in zip(factors, called, strict=False)]
    if _WAVE in chosen:
        size, phase = float(np.hypot(*factors[-2:])), float(-np.arctan2(factors[-1], factors[-2]))
        sign = "+" if phase >= 0 else "−"
        parts.append(_term(size, f"cos({number:.4g}·{letter} {sign} {abs(phase):.3g})"))
    if _DECAY in chosen:
        far = letter if positive else f"|{letter}|"
        parts.append(_term(float(factors[-1]), f"exp(−{far}/{number:.3g})"))
    text = " ".join(parts).removeprefix("+ ")
    missed = _missed(x, y, scale, chosen, number)

    def at(where: Array) -> Array:
        return np.asarray(_columns(where, chosen, number) @ factors)

    return Formula(text.replace("− ", "−", 1) if text.startswith("−") else text, count, at, missed)


def _term(factor: float, what: str) -> str:
    sign = "−" if factor < 0 else "+"
    size = f"{abs(factor):.3g}"
    return f"{sign} {size}" if what == "1" else f"{sign} {size}·{what}"
