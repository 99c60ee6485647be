"""The columns that a residual is predicted from, by coordinate: simple shapes first, then free curves and bumps.

Everything that can be asked of them needs only their inner products, so a few hundred columns over all samples cost
one matrix product; a shape is then a set of weights on the columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schwung.explain.values import Coordinate, Model, Signal
from schwung.motion import Array
from schwung.session.model import Axis

TURN = 2 * np.pi
PLACES = 80  # hats over the visited positions, with and without the sign of speed
LIMITS = np.arange(0.3, 0.99, 0.02)  # of the largest torque, from which on it may be off
INSTANTS = 100  # hats over the time in motion
BUMPS = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 11.0, 15.0, 20.0)  # half widths in hats


@dataclass(frozen=True, eq=False)
class Residual:
    """What a model misses in one run, on a uniform grid, with the coordinates it may depend on; arrays (n,).

    `missed`: torque (N·m), or reported speed (rad/s), as `of` says, by whom says `by`; `noise`: standard deviation of a
    sample's, alike.
    `considered`: samples to use (standstill and edges are False). `injected_hz`: frequencies of an injected torque.
    On a linear axis: m, m/s, m/s², N.
    """

    run: int
    rate_hz: float
    time_in_motion_s: Array
    position_rad: Array
    speed_rad_s: Array
    acceleration_rad_s2: Array
    torque_nm: Array
    missed: Array
    considered: NDArray[np.bool_]
    noise: float
    injected_hz: tuple[float, ...] = ()
    of: Signal = "torque"
    by: Model = "the belief"


@dataclass(frozen=True, eq=False)
class Samples:
    """All considered samples of all runs in one row; arrays (n,)."""

    owner: Array  # index of the run within the session
    bounds: tuple[tuple[int, int], ...]  # first and past-last sample of each run
    grid_s: Array  # time on the run's uniform grid
    rate_hz: float
    run: Array
    time_s: Array
    position: Array
    speed: Array
    sign: Array
    acceleration: Array
    acceleration_rates: Array  # (n, 2) its first and second derivative
    torque: Array
    torque_rates: Array
    residual: Array
    noise: float
    injected_hz: tuple[tuple[float, ...], ...]  # of each run
    of: Signal
    by: Model

    def values(self, coordinate: Coordinate) -> Array:
        """The coordinate's value at each sample (n,); frequency has none and gives time on the run's grid."""
        return {
            "position": self.position,
            "speed": self.speed,
            "direction": self.sign,
            "acceleration": self.acceleration,
            "torque": self.torque,
            "time_in_motion": self.time_s,
            "frequency": self.grid_s,
            "run": self.run,
        }[coordinate]


def gather(residuals: Sequence[Residual]) -> Samples | None:
    """All considered samples of the runs that have any; None where there are too few to say anything."""
    used = [one for one in residuals if np.count_nonzero(one.considered) >= 8]
    if not used or sum(int(np.count_nonzero(one.considered)) for one in used) < 64:
        return None
    keep = [np.asarray(one.considered, dtype=bool) for one in used]
    sizes = [int(np.count_nonzero(mask)) for mask in keep]
    ends = np.cumsum(sizes)

    def joined(of: Sequence[Array]) -> Array:
        return np.concatenate([values[mask] for values, mask in zip(of, keep, strict=True)])

    return Samples(
        owner=np.repeat(np.arange(len(used)), sizes),
        bounds=tuple((int(end - size), int(end)) for end, size in zip(ends, sizes, strict=True)),
        grid_s=joined([np.arange(one.missed.size) / one.rate_hz for one in used]),
        rate_hz=used[0].rate_hz,
        run=np.repeat([float(one.run) for one in used], sizes),
        time_s=joined([one.time_in_motion_s for one in used]),
        position=joined([one.position_rad for one in used]),
        speed=joined([one.speed_rad_s for one in used]),
        sign=np.sign(joined([one.speed_rad_s for one in used])),
        acceleration=joined([one.acceleration_rad_s2 for one in used]),
        acceleration_rates=joined([_rates(one.acceleration_rad_s2, one.rate_hz) for one in used]),
        torque=joined([one.torque_nm for one in used]),
        torque_rates=joined([_rates(one.torque_nm, one.rate_hz) for one in used]),
        residual=joined([one.missed for one in used]),
        noise=float(np.sqrt(np.mean([one.noise**2 for one in used]))),
        injected_hz=tuple(one.injected_hz for one in used),
        of=used[0].of,
        by=used[0].by,
    )


def _rates(values: Array, rate_hz: float) -> Array:
    """First and second derivative (n, 2)."""
    first = np.gradient(values) * rate_hz
    return np.stack([first, np.gradient(first) * rate_hz], axis=1)


@dataclass(frozen=True, eq=False)
class Shape:
    """A set of columns of one coordinate, as weights on the dictionary's columns.

    `price`: how many free numbers it is charged for (a bump's place and width count). `bump`: centre and half width.
    """

    coordinate: Coordinate
    name: str
    weights: Array  # (columns, k); further columns of the dictionary are not its own
    price: float
    bump: tuple[float, float] | None = None
    signed: bool = False  # times the sign of speed
    period: float | None = None  # of a coordinate that comes back every turn

    @cached_property
    def own(self) -> NDArray[np.intp]:
        """The columns that it consists of (m,), most often a few of many."""
        return np.flatnonzero(self.weights.any(axis=1))


@dataclass(frozen=True, eq=False)
class Dictionary:
    """Columns (samples, k) and the shapes made of them."""

    columns: Array
    shapes: tuple[Shape, ...]


def hats(values: Array, lowest: float, highest: float, count: int) -> NDArray[Any]:
    """Piecewise linear hat functions on `count` even knots from lowest to highest (n, count)."""
    place = np.clip((values - lowest) / max(highest - lowest, 1e-300) * (count - 1), 0, count - 1)
    left = np.minimum(place.astype(np.int64), count - 2)
    share = place - left
    rows = np.arange(values.size)
    result = np.zeros((values.size, count), dtype=np.float32)
    result[rows, left] = 1 - share
    result[rows, left + 1] = share
    return result


def circular_hats(angle: Array, count: int) -> Array:
    """The same on an angle that comes back every turn: knot i at i/count of a turn (n, count)."""
    around = hats(np.mod(angle, TURN), 0.0, TURN, count + 1)
    around[:, 0] += around[:, count]
    return around[:, :count]


def raised_cosine(values: Array, centre: float, half_width: float, period: float | None = None) -> Array:
    """1 at the centre, 0 from half a width on (n,); with a period, at every return."""
    away = values - centre
    if period is not None:
        away = away - period * np.round(away / period)
    away = np.abs(away) / half_width
    bump: Array = np.where(away < 1, 0.5 * (1 + np.cos(np.pi * np.minimum(away, 1))), 0.0)
    return bump


class _Builder:
    def __init__(self, samples: Samples) -> None:
        self.samples = samples
        self.columns: list[Array] = []
        self.count = 0
        self.planned: list[tuple[int, Shape]] = []  # with weights on the columns from the first on

    def add(self, block: Array) -> int:
        """Put columns (n,) or (n, k) in; tells the first one's index."""
        block = block[:, None] if block.ndim == 1 else block
        first = self.count
        self.columns.append(block.astype(np.float32))
        self.count += block.shape[1]
        return first

    def shape(
        self, coordinate: Coordinate, name: str, first: int, weights: Array, price: float,
        bump: tuple[float, float] | None = None, signed: bool = False, period: float | None = None,
    ) -> None:  # fmt: skip
        """A shape with weights (rows, k) on the columns from `first` on."""
        self.planned.append((first, Shape(coordinate, name, weights, price, bump, signed, period)))

    def pick(self, coordinate: Coordinate, name: str, indices: Sequence[int], price: float) -> None:
        """A shape of whole columns."""
        first = min(indices)
        weights = np.zeros((max(indices) - first + 1, len(indices)))
        weights[np.asarray(indices) - first, np.arange(len(indices))] = 1.0
        self.shape(coordinate, name, first, weights, price)

    def curves(
        self, coordinate: Coordinate, first: int, span: tuple[float, float], count: int, signed: bool = False,
        period: float | None = None,
    ) -> None:  # fmt: skip
        """Free curves and bumps made of `count` hats from `first` on, over a span (of one period)."""
        lowest, highest = span
        knots = np.arange(float(count))
        for fine in (8, 16, 40):
            made = circular_hats(knots * TURN / count, fine) if period else hats(knots, 0, count - 1, fine)
            self.shape(coordinate, "curve", first, made, fine, None, signed, period)
        step = (highest - lowest) / (count if period else count - 1)
        for half in BUMPS:
            for centre in np.arange(0, count, max(half / 3, 1.0)):
                bump = raised_cosine(knots, centre, half, float(count) if period else None)
                self.shape(
                    coordinate, "bump", first, bump[:, None], 3.0, (lowest + centre * step, half * step),
                    signed, period,
                )  # fmt: skip

    def done(self) -> Dictionary:
        """All columns, and the shapes with weights on all of them."""
        shapes = []
        for first, shape in self.planned:
            full = np.zeros((self.count, shape.weights.shape[1]))
            full[first : first + shape.weights.shape[0]] = shape.weights
            shapes.append(replace(shape, weights=full))
        return Dictionary(np.concatenate(self.columns, axis=1), tuple(shapes))


def _scaled(values: Array) -> Array:
    size = float(np.max(np.abs(values), initial=0.0))
    return values / size if size > 0 else values


def dictionary(samples: Samples, axis: Axis) -> Dictionary:
    """The columns and shapes for a session's samples."""
    build = _Builder(samples)
    sign, speed = samples.sign, _scaled(samples.speed)
    torque = _scaled(samples.torque)

    level, dry = build.add(np.ones_like(sign)), build.add(sign)
    build.pick("direction", "dry", [dry], 1)
    build.pick("direction", "level", [level], 1)
    build.pick("direction", "levels", [level, dry], 2)

    viscous, drag = build.add(speed), build.add(speed * np.abs(speed))
    build.pick("speed", "proportional", [viscous], 1)
    build.pick("speed", "square", [drag], 1.5)
    build.pick("speed", "polynomial", [viscous, drag], 2.5)
    for slow in (0.015, 0.025, 0.04, 0.06, 0.08, 0.11, 0.15, 0.2):
        near = build.add(sign * np.exp(-((speed / slow) ** 2)))
        build.pick("speed", "near standstill", [near], 2)
        build.pick("speed", "falling", [dry, near], 3)
    root = hats(np.sqrt(np.abs(speed)), 0, 1, 8)
    odd = build.add(root * sign[:, None].astype(np.float32))
    even = build.add(root)
    build.pick("speed", "curve", range(odd, odd + 8), 8)
    build.pick("speed", "curve", range(odd, even + 8), 16)

    _inertia(build, samples, axis)
    _answers(build, "torque", samples.torque, samples.torque_rates)
    for limit in LIMITS:
        above = build.add(np.sign(torque) * np.maximum(np.abs(torque) - limit, 0) / (1 - limit))
        build.pick("torque", "large", [above], 2)

    _runs(build, samples)
    _positions(build, samples, axis)
    latest = float(np.max(samples.time_s))
    earliest = float(np.min(samples.time_s))
    if latest > earliest:
        first = build.add(hats(samples.time_s, earliest, latest, INSTANTS))
        build.curves("time_in_motion", first, (earliest, latest), INSTANTS)
    return build.done()


def _answers(build: _Builder, coordinate: Coordinate, values: Array, rates: Array) -> None:
    """What goes with values as they are, late, and as a coupling that they wind up and shake answers them."""
    proportional = build.add(_scaled(values))
    late, bent = (build.add(_scaled(rate)) for rate in rates.T)
    build.pick(coordinate, "proportional", [proportional], 1)
    build.pick(coordinate, "rate", [late], 1.5)
    build.pick(coordinate, "answer", [proportional, late], 2.5)
    build.pick(coordinate, "answer", [proportional, late, bent], 4)


def _inertia(build: _Builder, samples: Samples, axis: Axis) -> None:
    """Inertia that is off evenly, or over position (J a + ½ J' ω²) in waves of the range or the turn; or late."""
    _answers(build, "acceleration", samples.acceleration, samples.acceleration_rates)
    reach = float(np.ptp(samples.position))
    if reach <= 0:
        return
    angle, half_square = samples.position, 0.5 * samples.speed**2

    def mode(wave: float, phase: float) -> Array:
        inertia, slope = np.cos(wave * angle - phase), -wave * np.sin(wave * angle - phase)
        return _scaled(samples.acceleration * inertia + half_square * slope)

    even = np.pi / reach
    first = build.add(np.stack([mode(j * even, j * even * np.min(angle)) for j in range(8)], axis=1))
    build.pick("acceleration", "curve", range(first, first + 5), 5)
    build.pick("acceleration", "curve", range(first, first + 8), 8)
    if axis == "rotary":
        turns = [mode(1.0, 0.0), mode(1.0, np.pi / 2), mode(2.0, 0.0), mode(2.0, np.pi / 2)]
        begin = build.add(np.stack(turns, axis=1))
        build.pick("acceleration", "curve", [first, *range(begin, begin + 4)], 5)


def _runs(build: _Builder, samples: Samples) -> None:
    """Levels and dry friction that change from the first run to the last, where they start from nothing."""
    reach = float(np.ptp(samples.run))
    if reach <= 0:
        return
    share = (samples.run - np.min(samples.run)) / reach
    sign = samples.sign
    for factor in (sign, np.ones_like(sign), _scaled(samples.speed)):
        first = build.add(np.stack([share * factor, share**2 * factor], axis=1))
        build.pick("run", "change", [first], 1)
        build.pick("run", "curve", [first, first + 1], 2.5)


def _positions(build: _Builder, samples: Samples, axis: Axis) -> None:
    position, sign = samples.position, samples.sign.astype(np.float32)[:, None]
    lowest, highest = float(np.min(position)), float(np.max(position))
    if highest <= lowest:
        return
    middle = build.add((2 * position - lowest - highest) / (highest - lowest))
    build.pick("position", "proportional", [middle], 2)
    if axis == "rotary":
        waves = [np.cos(position), np.sin(position), np.cos(2 * position), np.sin(2 * position)]
        first = build.add(np.stack(waves, axis=1))
        build.pick("position", "once per turn", [first, first + 1], 2)
        build.pick("position", "twice per turn", range(first, first + 4), 4)
    span = (lowest, highest)
    plain = hats(position, lowest, highest, PLACES)
    build.curves("position", build.add(plain), span, PLACES)
    build.curves("position", build.add(plain * sign), span, PLACES, signed=True)
    if axis == "rotary" and highest - lowest > 1.05 * TURN:  # what the shaft meets again every turn
        folded = circular_hats(position, PLACES)
        build.curves("position", build.add(folded), (0.0, TURN), PLACES, period=TURN)
        build.curves("position", build.add(folded * sign), (0.0, TURN), PLACES, signed=True, period=TURN)
