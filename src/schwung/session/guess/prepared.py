"""Columns of a file made comparable: numbers, on one uniform clock, slow enough for differences of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.imports.clock import Clock, read_clock
from schwung.session.imports.signals import unwrap, white_noise
from schwung.session.imports.table import Column, Table, bare_name
from schwung.session.imports.units import header_unit, unit, unit_in_name

_TIME_WORDS = ("time", "timestamp", "zeit", "stamp", "clock")
_INDEX_WORDS = ("index", "sample", "no", "nr", "n", "count")
#: Sampling of servo axes lies between these, from a logger of a PLC to the drive's own current loop (Hz).
_SLOWEST_HZ, _FASTEST_HZ = 20.0, 50e3
_TIME_UNITS = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
#: Ticks of Windows, .NET and TwinCAT are 100 ns.
_TICK_WORDS, _TICKS = ("tick", "ticks", "filetime"), (("100ns", 1e-7), *_TIME_UNITS)
_STEADY_SHARE = 0.5  # of the steps of a time column lie this near to their median, as a share of it
_SETTLED = 12  # rows: thinned out, they are an eighth of the period at its edge apart, or less
_MOST_SAMPLES = 200_000
_ANALYSED = 20_000
_MOVING_SHARE = 0.999  # of a column's power lies below the frequency up to which it is looked at
_NOISE_FLOORS = 4.0  # a line of noise is seldom so many times its usual power
_FEWEST = 64
_TURNS = (2 * np.pi, 360.0, 1.0, *(float(1 << k) for k in range(8, 33)))


@dataclass(frozen=True)
class TimeFound:
    """Which column the time is, in which unit, and why. `column` None: the file's own clock, or none at all."""

    column: Column | None
    unit: str | None
    factor: float
    evidence: str
    alternatives: tuple[str, ...]
    sure: bool


@dataclass(frozen=True, eq=False)
class Prepared:
    """Columns on one clock. `raw`, `slow` and `slope` are (n, columns): as sampled; without what is faster than the
    motion; and how fast the latter changes (per s). `noise` (columns,) is the white noise of each."""

    table: Table
    columns: tuple[Column, ...]
    time: TimeFound
    clock: Clock | None
    rate_hz: float
    raw: NDArray[np.float64]
    slow: NDArray[np.float64]
    slope: NDArray[np.float64]
    noise: Array
    edge: int  # rows at either end within which the low pass has not settled
    dropped: int  # rows without a number somewhere, or with the stamp of the row before

    def index(self, column: Column) -> int:
        """The place of a column."""
        return next(k for k, each in enumerate(self.columns) if each is column)

    def differentiated(self, values: Array) -> Array:
        """The slope (per s) of values (n,) on this clock."""
        return np.asarray(np.gradient(values, 1 / self.rate_hz))


def find_time(table: Table, said: str | None, said_unit: str | None, rate: float | None) -> TimeFound:
    """The column of stamps: one that always grows, in steps of one size. Raises InputError for a name that is none."""
    if rate is not None:
        return TimeFound(None, None, 1.0, f"{rate:g} Hz, as you say", (), True)
    if said is None and all(column.time_s is not None for column in table.columns):
        return TimeFound(None, None, 1.0, "every channel has stamps of its own in the file", (), True)
    grown = [column for column in table.columns if _grows(column)]
    if said is not None:
        return _with_unit(table.column(said, "--time"), said_unit, ())
    named = [
        column for column in grown
        if _has_word(column.name, _TIME_WORDS) or bare_name(column.name).strip().lower() == "t"
    ]  # fmt: skip
    first = named or [column for column in grown if not _has_word(column.name, _INDEX_WORDS)] or grown
    if not first:
        return TimeFound(None, None, 1.0, "no column grows steadily: give --rate HZ", (), False)
    chosen = first[0]
    others = tuple(f"{column.name} grows steadily as well" for column in grown if column is not chosen)
    return _with_unit(chosen, said_unit, others)


def _with_unit(column: Column, said: str | None, others: tuple[str, ...]) -> TimeFound:
    """A column of stamps in the unit that is said, that the file says, or that makes its steps a usual rate's."""
    step = float(np.median(np.diff(_numbers(column))))
    grows = f"grows in steps of {step:.6g}"
    known = header_unit(column.unit, "time", "rotary") or unit_in_name(column.name, "time", "rotary")
    if said is not None:
        factor = unit(said, "time", "rotary").factor
        return TimeFound(column, said, factor, f"{grows}, in {said} as you say", others, True)
    if known is not None:
        return TimeFound(column, None, known.factor, f"{grows} {known.text}, as the file says", others, True)
    units = _TICKS if _has_word(column.name, _TICK_WORDS) else _TIME_UNITS
    fitting = [(name, factor) for name, factor in units if _SLOWEST_HZ <= 1 / (step * factor) <= _FASTEST_HZ]
    if not fitting:
        return TimeFound(column, None, 1.0, f"{grows}, which in no unit is a usual rate", others, False)
    name, factor = fitting[0]
    also = tuple(f"in {other} it were {1 / (step * scale):g} Hz" for other, scale in fitting[1:])
    evidence = f"{grows}: {1 / (step * factor):.4g} Hz if it is in {name}"
    if step == 1.0 and (_has_word(column.name, _INDEX_WORDS) or column.name.startswith("column ")):
        counted = f"{evidence}; it may be a mere count of samples: then give --rate"
        return TimeFound(column, name, factor, counted, (*also, *others), False)
    return TimeFound(column, name, factor, evidence, (*also, *others), not also)


def _has_word(name: str, words: Sequence[str]) -> bool:
    parts = "".join(char.lower() if char.isalpha() else " " for char in name).split()
    return any(word in parts for word in words)


def _numbers(column: Column) -> Array:
    values = column.values
    return values[np.isfinite(values)]


def _grows(column: Column) -> bool:
    values = _numbers(column)
    if values.size < _FEWEST:
        return False
    steps = np.diff(values)
    middle = float(np.median(steps))
    if middle <= 0 or np.mean(steps >= 0) < 1.0:
        return False
    near = np.abs(steps - middle) <= _STEADY_SHARE * middle
    return bool(np.mean(near) > 0.9)


def prepare(table: Table, time: TimeFound, rate: float | None) -> Prepared:
    """All columns on one clock. Raises InputError where the file has too few samples that are whole."""
    data = [column for column in table.columns if column is not time.column]
    own = all(column.time_s is not None for column in data)
    sizes = [column.values.size for column in data]
    if not data or max(sizes) < _FEWEST:
        raise InputError(str(table.path), "has too few samples to guess from", f"{_FEWEST} are the least.")
    if not any(np.ptp(values) > 0 for column in data if (values := _numbers(column)).size):
        raise InputError(str(table.path), "has no column that ever changes", "Record a motion.")
    clock: Clock | None = None
    dropped = 0
    if own:
        start = max(float(column.time_s[0]) for column in data if column.time_s is not None)
        stop = min(float(column.time_s[-1]) for column in data if column.time_s is not None)
        first = data[0].time_s
        assert first is not None
        clock = read_clock(first, f"{table.path}: time")
        hz = clock.rate_hz
        grid = start + np.arange(int(max(stop - start, 0) * hz)) / hz
        kept = [column for column in data if np.ptp(_numbers(column)) > 0]
        matrix = np.column_stack([np.interp(grid, column.time_s, column.values) for column in kept])  # type: ignore[arg-type]
    else:
        size = max(set(sizes), key=sizes.count)
        kept = [column for column in data if column.values.size == size]
        stamps = (
            np.arange(size) / (rate or 1.0)
            if time.column is None
            else time.column.values[:size] * time.factor
        )
        numbers = [k for k, column in enumerate(kept) if np.mean(np.isfinite(column.values)) > 0.5]
        kept = [kept[k] for k in numbers if np.ptp(_numbers(kept[k])) > 0]
        raw = np.column_stack([column.values for column in kept]) if kept else np.empty((size, 0))
        whole = np.all(np.isfinite(raw), axis=1) & np.isfinite(stamps)
        stamps, raw = stamps[whole], raw[whole]
        grown = (
            np.concatenate(([True], np.diff(np.maximum.accumulate(stamps)) > 0)) if stamps.size else whole[:0]
        )
        dropped = size - int(np.count_nonzero(grown))
        stamps, raw = stamps[grown], raw[grown]
        if stamps.size < _FEWEST:
            raise InputError(str(table.path), "has too few rows that hold a number in every column",
                             "Leave out columns that are mostly empty.")  # fmt: skip
        clock = read_clock(stamps, f"{table.path}: time")
        hz = clock.rate_hz
        grid = stamps[0] + np.arange(int((stamps[-1] - stamps[0]) * hz) + 1) / hz
        matrix = np.column_stack([np.interp(grid, stamps, values) for values in raw.T])
    if matrix.shape[0] < _FEWEST or matrix.shape[1] == 0:
        raise InputError(
            str(table.path), "has no columns that change and were sampled together", "Check the file."
        )
    matrix = np.column_stack([_unwrapped(values) for values in matrix[:_MOST_SAMPLES].T])
    noise = np.array([white_noise(values) for values in matrix.T])
    slow, slow_rate = _slowed(matrix, hz)
    slope = np.gradient(slow, 1 / slow_rate, axis=0)
    return Prepared(table, tuple(kept), time, clock, slow_rate, matrix, slow, slope, noise, _SETTLED, dropped)


def _unwrapped(values: Array) -> Array:
    """An angle without jumps of a whole turn, in whichever unit it is."""
    span = float(np.ptp(values))
    for turn in _TURNS:
        if 0.8 * turn < span <= turn * (1 + 1e-6):
            return unwrap(values, turn).position
    return values


def _slowed(matrix: NDArray[np.float64], rate_hz: float) -> tuple[NDArray[np.float64], float]:
    """Columns through a low pass without lag, thinned out. It passes what the smoothest column moves by: that is the
    position, whatever its name, and the rest is told by it."""
    size = matrix.shape[0]
    power = np.abs(np.fft.rfft((matrix - matrix.mean(axis=0)) * np.hanning(size)[:, None], axis=0)) ** 2
    floor = np.median(power[power.shape[0] // 2 :], axis=0)  # noise: it has no part in the motion
    slope = np.clip(power - _NOISE_FLOORS * floor, 0, None) * np.arange(power.shape[0])[:, None] ** 2
    share = np.cumsum(slope, axis=0) / np.maximum(slope.sum(axis=0), 1e-300)
    edges = np.argmax(share >= _MOVING_SHARE, axis=0) * rate_hz / size
    edge = float(np.clip(4 * edges.min(), 4 * rate_hz / size, 0.4 * rate_hz))
    slow = sosfiltfilt(butter(4, edge / (rate_hz / 2), output="sos"), matrix, axis=0)
    thin = max(1, min(int(rate_hz / (8 * edge)), size // (4 * _FEWEST)))
    thin = max(thin, -(-size // _ANALYSED) if rate_hz / edge > 4 * size / _ANALYSED else thin)
    return np.asarray(slow[::thin]), rate_hz / thin
