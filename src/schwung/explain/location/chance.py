"""Permutation tests: could noise as this session's have made a coordinate look as good beyond the others?

The remainder before the coordinate is put in (Freedman and Lane 1983) is shifted circularly and flipped in sign run by
run, which keeps its autocorrelation and breaks its tie to the coordinate. Where it holds far more energy than the noise
floor allows, the draws are scaled down to what noise can have: an effect is judged against noise, not against itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.explain.location.columns import Samples
from schwung.explain.location.lines import Comb
from schwung.explain.location.space import Space
from schwung.explain.values import Coordinate
from schwung.motion import Array

DRAWS = 99
LINE_DRAWS = 49
SEED = 20240117  # the same session gives the same answer
#: The floor may be this much larger than stated (it was itself estimated).
FLOOR_MARGIN = 1.5


@dataclass(frozen=True, eq=False)
class Null:
    """Draws of noise (n, DRAWS) float32, and their products with a space's columns (K, DRAWS)."""

    noise: NDArray[np.float32]
    products: Array

    @classmethod
    def of(cls, samples: Samples, space: Space, remainder: Array) -> Null:
        """Permute what is left of the residual."""
        noise = permuted(samples, remainder)
        return cls(noise, (space.columns.T @ noise).astype(np.float64))


def permuted(samples: Samples, remainder: Array, draws: int = DRAWS) -> NDArray[np.float32]:
    """Draws (n, draws), float32: every run shifted circularly by a lag of its own, with a sign of its own."""
    chance = np.random.default_rng(SEED)
    allowed = (FLOOR_MARGIN * samples.noise) ** 2 * remainder.size
    scale = np.sqrt(min(1.0, allowed / max(float(remainder @ remainder), 1e-300)))
    result = np.empty((draws, remainder.size), dtype=np.float32)
    for start, end in samples.bounds:
        size = end - start
        twice = np.tile(scale * remainder[start:end], 2).astype(np.float32)
        lags, signs = chance.integers(0, size, draws), chance.choice([-1, 1], draws)
        for draw in range(draws):
            result[draw, start:end] = signs[draw] * twice[lags[draw] : lags[draw] + size]
    return result.T


def p_of_shapes(space: Space, others: Sequence[int], coordinate: Coordinate, null: Null) -> float:
    """p-value of the coordinate's best shape beyond the others, among all its shapes (lines aside), not corrected."""
    which = np.array([shape.coordinate == coordinate and shape.name != "line" for shape in space.shapes])
    beyond = space.beyond(others)
    gains = beyond.gains(space.products, which)[which]
    chance = beyond.gains(null.products, which)[which]
    degrees = np.array([shape.weights.shape[1] for shape in space.shapes])[which]
    mean = np.mean(chance, axis=1)
    usable = mean > 0
    if not np.any(usable):
        return 1.0
    heights = _normal(gains[usable] / mean[usable], degrees[usable])
    limits = _normal(chance[usable] / mean[usable, None], degrees[usable, None])
    return _tail(float(np.max(heights)), np.max(limits, axis=0))


def p_of_position_line(comb: Comb, remainder: Array, null: Null) -> float:
    """p-value of the strongest line over position, among all wave numbers, not corrected."""
    tops = [np.max(comb.powers(row.astype(np.float64))) for row in null.noise.T[:LINE_DRAWS]]
    return _tail(float(np.max(comb.powers(remainder))), np.array(tops))


def _normal(ratio: Array, degrees: Array) -> Array:
    """About a standard normal from χ²/mean (Wilson and Hilferty 1931)."""
    spread = 2 / (9 * degrees)
    normal: Array = (np.cbrt(ratio) - (1 - spread)) / np.sqrt(spread)
    return normal


def _tail(observed: float, draws: Array) -> float:
    """Chance to reach the observed maximum: counted, and beyond the draws from a Gumbel law fitted to them."""
    counted = (1 + int(np.count_nonzero(draws >= observed))) / (draws.size + 1)
    if counted > 5 / (draws.size + 1):
        return counted
    scale = max(float(np.std(draws)) * np.sqrt(6) / np.pi, 1e-300)
    mode = float(np.mean(draws)) - np.euler_gamma * scale
    return max(float(-np.expm1(-np.exp(-min((observed - mode) / scale, 700.0)))), 1e-12)
