"""Where the mismatch is: how much of the residual's energy follows from which coordinate, and on which interval.

The residual is predicted jointly (additively) from shapes of eight coordinates; a coordinate's share is what it
predicts beyond those that earn more for their price, so that what several could predict is credited to the simplest
that does. Every coordinate is tested beyond the others by permutation (chance.py), with its best shape sought in every
draw.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schwung.explain.location.columns import Residual, dictionary, gather
from schwung.explain.location.interval import interval_of
from schwung.explain.location.lines import Comb
from schwung.explain.location.search import COORDINATES, DEAR, LEAST_SHARE, SIGNIFICANT, Search
from schwung.explain.location.space import Space
from schwung.explain.location.words import sentence, unit_of
from schwung.explain.values import Coordinate, Located
from schwung.motion import Array
from schwung.session.model import Axis

HELD_WIDTH = 0.84  # of a raised cosine's width: where nearly all of it is, as in interval_of
EQUAL = 0.01  # of a coordinate's gain: another one that misses no more than this cannot be told from it


def locate(residuals: Sequence[Residual], axis: Axis, *, surely: bool = True) -> tuple[Located, ...]:
    """The coordinates that the residual follows significantly, by share; empty where it is noise.

    A coordinate that this session cannot tell from a named one comes with it, its text says so. Not `surely`: where
    none is significant, the one that comes closest, its text says that, too.
    """
    search = _searched(residuals, axis)
    if search is None:
        return ()
    tested = _tested(search)
    kept = [c for c, p in tested.items() if p < SIGNIFICANT]
    if not surely and not kept and tested:
        kept = [min(tested, key=lambda coordinate: tested[coordinate])]
    search.chosen = [i for i in search.chosen if search.space.shapes[i].coordinate in kept]
    credit, found = _credited(search), list[Located]()
    for coordinate in kept:
        mine = _of(search, coordinate)
        contribution = search.space.contribution(search.chosen, mine)
        share = sum(credit[i] for i in mine) / search.space.energy
        p_value = tested[coordinate]
        if share < LEAST_SHARE and p_value < SIGNIFICANT:
            continue
        interval = _interval(search, coordinate, mine, contribution)
        found.append(_located(search, coordinate, interval, min(share, 1.0), p_value, axis, None))
        found.extend(_twins(search, coordinate, mine, min(share, 1.0), p_value, axis))
    return tuple(_once(sorted(found, key=lambda one: -one.share_of_energy)))


def _searched(residuals: Sequence[Residual], axis: Axis) -> Search | None:
    samples = gather(residuals)
    if samples is None or not np.any(samples.residual):
        return None
    search = Search(samples, Space.of(samples, dictionary(samples, axis)), Comb.of(samples, axis))
    search.run()
    return search


def _of(search: Search, coordinate: Coordinate) -> list[int]:
    return [i for i in search.chosen if search.space.shapes[i].coordinate == coordinate]


def _tested(search: Search) -> dict[Coordinate, float]:
    """p-value of every coordinate that has a part, beyond the others."""
    parts = {coordinate: _of(search, coordinate) for coordinate in COORDINATES}
    return {
        coordinate: search.p_value(coordinate, mine, [i for i in search.chosen if i not in mine])
        for coordinate, mine in parts.items()
        if mine
    }


def _credited(search: Search) -> dict[int, float]:
    """Energy that each chosen shape predicts beyond those before it, the one that earns most for its price first."""
    space, credit, left = search.space, dict[int, float](), search.space.energy
    asked = np.isin(np.arange(len(space.shapes)), search.chosen)
    while len(credit) < len(search.chosen):
        earned = search.earned(space.beyond(list(credit)).gains(space.products, asked), left, DEAR)
        first = max((i for i in search.chosen if i not in credit), key=lambda i: earned[i])
        before, left = left, space.energy - space.explained([*credit, first])
        credit[first] = before - left
    return credit


def _interval(
    search: Search, coordinate: Coordinate, mine: Sequence[int], contribution: Array
) -> tuple[float, float]:
    samples = search.samples
    if coordinate == "frequency":
        places = [search.line_place[i] for i in mine]
        span = 1 / float(
            np.median([samples.grid_s[end - 1] - samples.grid_s[a] for a, end in samples.bounds])
        )
        return min(places) - 0.5 * span, max(places) + 0.5 * span
    values = samples.values(coordinate)
    if coordinate == "run":
        return float(np.min(values)), float(np.max(values))
    if coordinate == "direction":
        sizes = {sign: float(np.mean(np.abs(contribution[values == sign]))) for sign in np.unique(values)}
        heavy = [sign for sign, size in sizes.items() if size > 0.05 * max(sizes.values())]
        return float(min(heavy)), float(max(heavy))
    bumps = [search.space.shapes[i] for i in mine if search.space.shapes[i].bump is not None]
    if bumps and len(bumps) == len(mine):
        main = max(mine, key=lambda i: float(np.sum(search.space.contribution(search.chosen, [i]) ** 2)))
        (centre, half), period = (
            search.space.shapes[main].bump or (0.0, 0.0),
            search.space.shapes[main].period,
        )
        if period is not None:
            lo = float(np.mod(centre - HELD_WIDTH * half, period))
            return lo, lo + 2 * HELD_WIDTH * half
        return max(centre - HELD_WIDTH * half, float(np.min(values))), min(
            centre + HELD_WIDTH * half, float(np.max(values))
        )
    return interval_of(values, contribution, held=0.9)


def _twins(
    search: Search, coordinate: Coordinate, mine: list[int], share: float, p_value: float, axis: Axis
) -> list[Located]:
    """Coordinates that would do as well with a shape no richer, given the rest."""
    space = search.space
    others = [i for i in search.chosen if i not in mine]
    own = space.explained(search.chosen) - space.explained(others)
    price = sum(space.shapes[i].price for i in mine)
    gains = space.beyond(others).gains(space.products)
    slack = max(EQUAL * own, 6 * search.samples.noise**2)
    found = []
    for other in COORDINATES:
        if other in (coordinate, "frequency") or _of(search, other):
            continue
        fit = [
            i
            for i, shape in enumerate(space.shapes)
            if shape.coordinate == other and shape.price <= price and gains[i] >= own - slack
        ]
        if not fit:
            continue
        best = max(fit, key=lambda i: gains[i])
        contribution = space.contribution([*others, best], [best])
        interval = (
            interval_of(search.samples.values(other), contribution, held=0.9)
            if other not in ("run", "direction")
            else _interval(search, other, [best], contribution)
        )
        less = share * min(gains[best] / own, 1.0) * (1 - 1e-9)
        found.append(_located(search, other, interval, less, p_value, axis, coordinate))
    return found


def _located(
    search: Search, coordinate: Coordinate, interval: tuple[float, float], share: float, p_value: float,
    axis: Axis, twin: Coordinate | None,
) -> Located:  # fmt: skip
    values = search.samples.values(coordinate)
    visited = (float(np.min(values)), float(np.max(values)))
    interval, share = (float(interval[0]), float(interval[1])), float(share)
    shapes = [
        shape for shape in (search.space.shapes[i] for i in search.chosen) if shape.coordinate == coordinate
    ]
    each_turn = bool(shapes) and all(shape.bump is not None and shape.period is not None for shape in shapes)
    of = search.samples.of
    text = sentence(coordinate, interval, visited, share, axis, twin, each_turn, of, search.samples.by)
    if p_value >= SIGNIFICANT:
        text += f" This may be chance (p {p_value:.2g}); nothing else stands out more."
    return Located(coordinate, interval, unit_of(coordinate, axis), share, float(p_value), text, of)


def _once(found: Sequence[Located]) -> list[Located]:
    """Each coordinate once, where it says most."""
    seen: dict[Coordinate, Located] = {}
    for one in found:
        seen.setdefault(one.coordinate, one)
    return list(seen.values())
