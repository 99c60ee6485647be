"""Files and a recipe -> a session: columns to SI, angles unwrapped, a uniform time base, motions cut into runs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array
from schwung.quantities import Effort
from schwung.session.imports.canframes import log_kind
from schwung.session.imports.clock import Clock, read_clock, resample
from schwung.session.imports.dbc import read_by_dbc
from schwung.session.imports.foreign import read_mdf, read_parquet
from schwung.session.imports.matlab import read_matlab
from schwung.session.imports.motions import Piece, cut, with_repeats
from schwung.session.imports.recipe import Recipe
from schwung.session.imports.rows import unwrap_angles, whole, without_gaps
from schwung.session.imports.signals import derive_speed
from schwung.session.imports.table import Column, Table, bare_name
from schwung.session.imports.text import read_text
from schwung.session.imports.units import Quantity, Unit, axis_of, header_unit, unit, unit_in_name
from schwung.session.model import Axis, Run, Session

#: The session's datasets in the order in which they are asked for, and the quantity of each.
_QUANTITIES: Mapping[str, Quantity] = {
    "position": "position",
    "torque": "torque",
    "speed": "speed",
    "position_demand": "position",
    "torque_added": "torque",
}
_FIELDS = {
    "position": "position_rad",
    "torque": "torque_nm",
    "speed": "speed_rad_s",
    "position_demand": "position_demand_rad",
    "torque_added": "torque_added_nm",
}
_TIME_NAMES = ("time", "t", "timestamp", "zeit")
_SI: dict[Axis, dict[Quantity, str]] = {
    "rotary": {"time": "s", "position": "rad", "speed": "rad/s", "torque": "N·m"},
    "linear": {"time": "s", "position": "m", "speed": "m/s", "torque": "N"},
}


@dataclass(frozen=True, eq=False)
class Imported:
    """A session from elsewhere, and everything about it that somebody should know (sentences). `cut`: of these, how it
    was cut into runs, and which of them repeat one motion."""

    session: Session
    notes: tuple[str, ...]
    cut: tuple[str, ...] = ()


@dataclass
class _Recording:
    """One file on its way: signals (n,) by dataset, in SI, on one time base."""

    place: str
    rate_hz: float
    start_s: float
    signals: dict[str, Array]
    extra: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    effort: Effort = "torque"


def read_table(path: Path, dbc: Path | None = None, channel: str | None = None) -> Table:
    """The columns of a CSV, TwinCAT Scope, MAT, MDF or Parquet file, or of a CAN log by a DBC.

    Raises InputError where it is none, or not there.
    """
    if not path.is_file():
        raise InputError(str(path), "there is no such file", "Check the path.")
    try:
        with path.open("rb") as file:
            head = file.read(128)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be read: {reason}", "Check its permissions.") from None
    if not head:
        raise InputError(str(path), "is empty", "Give a file with samples.")
    if path.suffix.lower() == ".mat" or head.startswith((b"MATLAB", b"\x89HDF")):
        return read_matlab(path)
    if head.startswith(b"PAR1"):
        return read_parquet(path)
    if head.startswith(b"MDF ") and dbc is None:
        return read_mdf(path)
    if dbc is not None:
        return read_by_dbc(path, dbc, channel)
    if log_kind(path) is not None:
        raise InputError(str(path), "is a log of a CAN bus", "Add --eds DRIVE.eds, or --dbc BUS.dbc.")
    return read_text(path)


def import_recordings(files: Sequence[Path], recipe: Recipe) -> Imported:
    """Read recordings as the recipe says into one session; each file gives one run or more.

    Raises InputError, naming file and column, for what cannot be read or is not what the session file demands.
    """
    if not files:
        raise InputError(
            "schwung import", "no file is given", "Give CSV or MAT files, or `files` in the recipe."
        )
    axis = _axis(recipe)
    runs: list[Run] = []
    notes: list[str] = []
    ways: list[str] = []
    created: str | None = None
    efforts: dict[Effort, Path] = {}
    for path in files:
        table = read_table(path, Path(recipe.dbc) if recipe.dbc else None, recipe.channel)
        created = created or table.created
        for recording in _recordings(table, recipe, axis):
            efforts[recording.effort] = path
            found, how = _runs(recording, recipe)
            runs += found
            place = f"{recording.place}: " if len(files) > 1 else ""
            notes += [f"{place}{note}" for note in (*recording.notes, how)]
            ways.append(f"{place}{how}")
    rates = sorted({run.sample_rate_hz for run in runs})
    if len(rates) > 1:
        listed = ", ".join(f"{rate:g}" for rate in rates)
        notes.append(
            f"the runs are sampled at different rates ({listed} Hz): they are not compared with each other"
        )
    if len(efforts) > 1:
        raise InputError(str(efforts["current"]), f"is in A, {efforts['torque']} in N·m",
                         "Give --torque-unit A=N·m per ampere, or import them one by one.")  # fmt: skip
    numbered = with_repeats(runs)
    told = _repeat_notes(numbered)
    notes += told
    session = Session(
        runs=numbered,
        created=created or datetime.now(UTC).isoformat(timespec="seconds"),
        source=f"imported from {', '.join(path.name for path in files)} ({_described(recipe)})",
        axis=axis,
        effort=next(iter(efforts)),
    )
    return Imported(session, tuple(dict.fromkeys(notes)), (*ways, *told))


def _axis(recipe: Recipe) -> Axis:
    """As said; else the one that the unit of position belongs to; else rotary."""
    told = axis_of(recipe.position_unit) if recipe.position_unit else None
    return recipe.axis or told or "rotary"


def _described(recipe: Recipe) -> str:
    said = recipe.model_dump(exclude_defaults=True, exclude={"files"})
    return ", ".join(f"{key} {value}" for key, value in said.items())


def _recordings(table: Table, recipe: Recipe, axis: Axis) -> list[_Recording]:
    """The recordings of one file: one, or several where samples are missing between them."""
    notes: list[str] = [f"read as {table.described}: {len(table.columns)} columns"]
    columns = {
        name: table.column(wanted, f"--{name.replace('_', '-')}")
        for name in _QUANTITIES
        if (wanted := getattr(recipe, name)) is not None
    }
    signals: dict[str, Array] = {}
    taken: dict[str, Unit] = {}
    for name, column in columns.items():
        taken[name] = _taken_in(table, column, name, recipe, axis, notes)
        values = column.values if recipe.resample else whole(column, table.path)
        signals[name] = values * taken[name].factor
    effort = _effort(taken, table.path, notes)
    times = _times(table, columns, recipe, notes)
    if times is not None and recipe.resample:
        signals, times = without_gaps(signals, times, table.path, notes)
    if axis == "rotary" and recipe.unwrap:
        unwrap_angles(signals, notes)
    if times is None:
        rate = recipe.rate
        if rate is None:
            raise InputError(str(table.path), "has no time that could be found",
                             "Name it with --time, or give --rate HZ.")  # fmt: skip
        _same_length(signals, table.path)
        source = {"source_file": table.path.name}
        return [_Recording(str(table.path), rate, 0.0, signals, source, notes, effort)]
    return [replace(each, effort=effort) for each in _timed(table, columns, signals, times, recipe, notes)]


def _taken_in(table: Table, column: Column, name: str, recipe: Recipe, axis: Axis, notes: list[str]) -> Unit:
    """What a column's numbers are multiplied with: the scale, and the unit as said, as in the file, or SI."""
    quantity = _QUANTITIES[name]
    scale = table.number(getattr(recipe, f"{quantity}_scale"), f"--{quantity}-scale")
    said: str | None = getattr(recipe, f"{quantity}_unit")
    if said is not None:
        told = unit(said, quantity, axis)
        return replace(told, factor=scale * told.factor)
    found: Unit | None = header_unit(column.unit, quantity, axis) or unit_in_name(column.name, quantity, axis)
    if found is not None and abs(scale) == 1.0:  # another scale makes SI of it
        notes.append(f"{name} is taken in {found.text}, as the file says")
        return replace(found, factor=scale * found.factor)
    if column.unit and found is None:
        notes.append(f'{name}: the file says unit "{column.unit}", taken as {_SI[axis][quantity]}')
    return Unit(_SI[axis][quantity], scale)


def _effort(units: Mapping[str, Unit], path: Path, notes: list[str]) -> Effort:
    """What the torques are. Raises InputError where one is a torque and the other a current."""
    efforts = {name: each.effort for name, each in units.items() if _QUANTITIES[name] == "torque"}
    if len(set(efforts.values())) > 1:
        listed = ", ".join(f"{name} a {effort}" for name, effort in efforts.items())
        raise InputError(str(path), f"its torques do not go together: {listed}",
                         "Give --torque-unit A=N·m per ampere.")  # fmt: skip
    effort = efforts["torque"]
    if effort == "current":
        notes.append("torque is a current and stays one, in A: how many N·m an ampere makes is unknown")
    return effort


def _times(
    table: Table, columns: Mapping[str, Column], recipe: Recipe, notes: list[str]
) -> dict[str, Array] | None:
    """The stamps (s) of each signal, None where the file has none."""
    if recipe.time is not None:
        column = table.column(recipe.time, "--time")
    elif all(each.time_s is not None for each in columns.values()):
        return {name: each.time_s for name, each in columns.items() if each.time_s is not None}
    elif recipe.rate is not None and not recipe.resample:
        return None
    else:
        named = [each for each in table.columns if bare_name(each.name).strip().lower() in _TIME_NAMES]
        if len(named) != 1:
            return None
        column = named[0]
        notes.append(f"time is taken from column {column.name}")
    said = recipe.time_unit
    found = header_unit(column.unit, "time", "rotary") or unit_in_name(column.name, "time", "rotary")
    factor = unit(said, "time", "rotary").factor if said else found.factor if found else 1.0
    if found and not said:
        notes.append(f"time is taken in {found.text}, as the file says")
    time = (column.values if recipe.resample else whole(column, table.path)) * factor
    return dict.fromkeys(columns, time)


def _same_length(signals: Mapping[str, Array], path: Path) -> None:
    sizes = {name: values.size for name, values in signals.items()}
    if len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
        raise InputError(str(path), f"its columns have different lengths ({listed} samples)",
                         "Give columns that were sampled together.")  # fmt: skip


def _timed(
    table: Table,
    columns: Mapping[str, Column],
    signals: Mapping[str, Array],
    times: Mapping[str, Array],
    recipe: Recipe,
    notes: list[str],
) -> list[_Recording]:
    """Signals with stamps on one uniform time base; resampled where that was asked for and is needed."""
    for name, values in signals.items():
        if values.size != times[name].size:
            raise InputError(f"{table.path}: {columns[name].name}",
                             f"has {values.size} samples, its time has {times[name].size}",
                             "Give columns that were sampled together.")  # fmt: skip
    clocks = {name: read_clock(times[name], f"{table.path}: time of {name}") for name in signals}
    main = clocks["position"]
    apart = [name for name in signals if not _same_times(times["position"], times[name], main.rate_hz)]
    wanted = recipe.rate if recipe.resample else None
    notes.append(f"time: {main.describe()}")
    if main.rounded:
        notes.append("the stamps deviate by no more than they were rounded: taken as uniform")
    if main.uniform and not apart and (wanted is None or wanted == main.rate_hz):
        if recipe.resample:
            notes.append("the time is uniform: nothing was resampled")
        return [_recording(table, main.rate_hz, main.start_s, dict(signals), notes)]
    if not recipe.resample:
        raise _not_uniform(table, clocks, apart)
    rate = wanted or min(_round_rate(_rate_between(times[name])) for name in clocks)
    if wanted and wanted > main.rate_hz * 1.01:
        notes.append(f"{wanted:g} Hz is more than was sampled: the samples between add nothing")
    made: list[_Recording] = []
    for start, stop in _common_spans(times, clocks):
        grid = start + np.arange(int((stop - start) * rate * (1 + 1e-9)) + 1) / rate
        if grid.size < 16:
            notes.append(f"{grid.size} samples between gaps, at {start:.6g} s, left out")
            continue
        placed = {name: resample(times[name], values, grid) for name, values in signals.items()}
        made.append(_recording(table, rate, float(grid[0]), placed, notes if not made else []))
        made[-1].extra["resampled"] = f"to {rate:g} Hz from stamps of {main.describe()}"
    if not made:
        raise InputError(str(table.path), "has no part without gaps that is long enough", "Record again.")
    notes.append(
        f"resampled to {rate:g} Hz by cubic interpolation, in {len(made)} piece{'s' * (len(made) > 1)}"
    )
    return made


def _rate_between(time_s: Array) -> float:
    """The rate of sampling (Hz), whether samples are lost or not: a long step counts as several usual ones."""
    steps = np.diff(time_s)
    return float(max(np.sum(np.rint(steps / np.median(steps))), 1) / (time_s[-1] - time_s[0]))


def _round_rate(rate_hz: float) -> float:
    """A rate of three digits, so that nobody reads 499.903 Hz."""
    return float(f"{rate_hz:.3g}")


def _same_times(first: Array, second: Array, rate_hz: float) -> bool:
    return first is second or (
        first.size == second.size and bool(np.max(np.abs(first - second)) * rate_hz < 0.01)
    )


def _not_uniform(table: Table, clocks: Mapping[str, Clock], apart: Sequence[str]) -> InputError:
    main = clocks["position"]
    if apart:
        other = clocks[apart[0]]
        what = f"from {other.start_s:.6g} s at {other.rate_hz:.6g} Hz"
        return InputError(f"{table.path}: {apart[0]}", f"is not sampled together with position ({what} against "
                          f"{main.start_s:.6g} s at {main.rate_hz:.6g} Hz)",
                          "Add --resample to bring them on one time base.")  # fmt: skip
    return InputError(f"{table.path}: time", f"is not uniform: {main.describe()}",
                      "Add --resample, or, where the samples were equidistant and only the stamps are late, "
                      "leave --time out and give --rate.")  # fmt: skip


def _common_spans(times: Mapping[str, Array], clocks: Mapping[str, Clock]) -> list[tuple[float, float]]:
    """Spans of time (s) in which every signal has samples without gaps."""
    spans: list[tuple[float, float]] = [(-np.inf, np.inf)]
    for name, clock in clocks.items():
        own = [(float(times[name][piece][0]), float(times[name][piece][-1])) for piece in clock.pieces]
        spans = [
            (max(a, c), min(b, d)) for a, b in spans for c, d in own if max(a, c) < min(b, d)
        ]  # fmt: skip
    return spans


def _recording(
    table: Table, rate: float, start: float, signals: dict[str, Array], notes: list[str]
) -> _Recording:
    return _Recording(str(table.path), rate, start, signals, {"source_file": table.path.name}, notes)


def _runs(recording: _Recording, recipe: Recipe) -> tuple[list[Run], str]:
    """The runs of a recording, and in which words it was cut."""
    signals, rate = recording.signals, recording.rate_hz
    extra = dict(recording.extra)
    if "speed" not in signals:
        derived = derive_speed(signals["position"], rate)
        signals["speed"] = derived.speed
        extra["speed_origin"] = derived.how
        recording.notes.append(f"speed {derived.how}")
    pieces = cut(signals["position"], rate, recipe.split, recipe.piece_s)
    runs = [_run(signals, piece, recording, recipe, extra) for piece in pieces.pieces]
    count = f"{len(runs)} run{'s' * (len(runs) > 1)}"
    return runs, f"{count}: {pieces.how}"


def _run(
    signals: Mapping[str, Array],
    piece: Piece,
    recording: _Recording,
    recipe: Recipe,
    extra: Mapping[str, Any],
) -> Run:
    rate = recording.rate_hz
    begin = piece.start / rate
    excitation = recipe.excitation
    if excitation is not None and begin:
        turned = excitation.phase_rad + 2 * np.pi * excitation.frequency_hz * begin  # t is the run's own time
        excitation = excitation.model_copy(update={"phase_rad": float(np.mod(turned, 2 * np.pi))})
    arrays: dict[str, Any] = {
        _FIELDS[name]: np.ascontiguousarray(values[piece.start : piece.stop], dtype=np.float64)
        for name, values in signals.items()
    }
    return Run(
        role=recipe.role,
        repeat=0,
        sample_rate_hz=rate,
        time_s=np.arange(len(piece)) / rate,
        excitation=excitation,
        name=re.sub(r"\s+", " ", recording.place),
        extra={**extra, "source_start_s": recording.start_s + begin},
        **arrays,
    )


def _repeat_notes(runs: Sequence[Run]) -> list[str]:
    """Which runs repeat one motion, in one sentence for each motion."""
    groups: dict[int, list[int]] = {}
    for index, run in enumerate(runs):
        groups.setdefault(run.extra["same_motion"], []).append(index)
    repeated = [group for group in groups.values() if len(group) > 1]
    notes = [f"runs {', '.join(map(str, group))} repeat one motion" for group in repeated]
    if len(runs) > 1 and not repeated:
        notes.append("no run repeats another's motion")
    disturbed = [index for index, run in enumerate(runs) if "same_path" in run.extra]
    if disturbed:
        listed = ", ".join(map(str, disturbed))
        notes.append(
            f"runs {listed} follow the path of another run with another torque: not counted as repeats"
        )
    return notes
