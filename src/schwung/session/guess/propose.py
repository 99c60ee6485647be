"""A stranger's table -> the import that it seems to want, each part with its evidence and what else it might be."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.guess.prepared import Prepared, find_time, prepare
from schwung.session.guess.signals import (
    CURRENT_WORDS,
    DEMAND_WORDS,
    SURE_GAIN,
    Joint,
    find_joints,
    sounds_like,
)
from schwung.session.guess.units import find_units, told_unit
from schwung.session.imports.table import Column, Table
from schwung.session.imports.units import axis_of
from schwung.session.model import Axis

_QUANTITIES = ("position", "speed", "torque", "position_demand")
_RELATIVE = {"%": "%", "percent": "%", "‰": "permille", "permille": "permille", "pct": "%"}
_AMPERES = ("a", "amp", "ampere", "arms", "apk")


@dataclass(frozen=True)
class Guess:
    """One part of a proposal: what, which column in which unit, why, what else it might be, and whether only this can
    be. `options` are those of `schwung import`."""

    what: str
    column: str
    unit: str
    evidence: str
    alternatives: tuple[str, ...]
    sure: bool
    options: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Proposal:
    """How one axis in a file seems to want to be imported. `curves` are what the picture shows, in the file's units."""

    name: str
    guesses: tuple[Guess, ...]
    curves: Curves

    @property
    def options(self) -> dict[str, Any]:
        """Options of `schwung import`, by their names in a recipe."""
        return {key: value for guess in self.guesses for key, value in guess.options.items()}

    @property
    def questions(self) -> tuple[str, ...]:
        """What should be confirmed, since the file itself does not settle it."""
        return tuple(f"{guess.what}: {guess.evidence}" for guess in self.guesses if not guess.sure)

    def command(self, path: str, out: str, given: Mapping[str, Any] | None = None) -> str:
        """The very command that does it, with what the user gives besides."""
        words = ["schwung", "import", path, "-o", out]
        for key, value in (self.options | dict(given or {})).items():
            words += _option(key, value)
        return shlex.join(words)


def _option(key: str, value: Any) -> list[str]:
    """An option as it is written; a sine is numbers after each other."""
    flag = f"--{key.replace('_', '-')}"
    if isinstance(value, bool):
        return [flag if value else flag.replace("--", "--no-", 1)]
    if isinstance(value, Mapping):
        return [flag, ",".join(f"{number:g}" for number in value.values())]
    return [flag, str(value)]


@dataclass(frozen=True, eq=False)
class Curves:
    """What shows why: (n,) over time (s), in SI where the unit is known; and the torque against what explains it.
    `gathering` is the torque without what speed, friction and weight account for; over acceleration its slope is
    `inertia`. `start_s` is the file's own time at 0."""

    time_s: Array
    slope: Array
    speed: Array | None
    torque: Array
    fitted: Array
    gathering: Array
    acceleration: Array
    inertia: float
    steps_s: Array
    start_s: float


def propose(table: Table, said: Mapping[str, Any]) -> tuple[Proposal, ...]:
    """A proposal for each axis in the file. `said`: options of `schwung import` that the user gives, which are taken as
    they are.

    Raises InputError where nothing in the file looks like a position with its torque.
    """
    time = find_time(table, said.get("time"), said.get("time_unit"), said.get("rate"))
    given = prepare(table, time, said.get("rate"))
    fixed = {
        name: given.index(column)
        for name in _QUANTITIES
        if said.get(name) is not None
        and (column := table.column(str(said[name]), f"--{name}")) in given.columns
    }
    joints = find_joints(given, fixed)
    if not joints:
        raise InputError(
            str(table.path), "has no column that gathers the speed of another, as a torque does",
            "Name what you know: --position NAME or --torque NAME, or a longer part of the recording.",
        )  # fmt: skip
    named = [given.columns[joint.position].name for joint in joints]
    names = [f"{name} {k}" if named.count(name) > 1 else name for k, name in enumerate(named, start=1)]
    return tuple(_proposal(given, joint, name, said) for joint, name in zip(joints, names, strict=True))


def _proposal(given: Prepared, joint: Joint, name: str, said: Mapping[str, Any]) -> Proposal:
    position = given.columns[joint.position]
    speed = None if joint.speed is None else given.columns[joint.speed]
    axis = _axis(position, said)
    units = {key: str(said[f"{key}_unit"]) for key in ("position", "speed") if said.get(f"{key}_unit")}
    found = find_units(position, speed, joint.ratio, axis, units, joint.correlation)
    torque = joint.torques[0]
    turned = joint.ratio is not None and joint.ratio < 0
    against = torque.sign < 0
    flip = turned and against
    guesses = [_time(given, said)]
    options: dict[str, Any] = {"position": _reference(given, position)}
    if axis == "linear" and axis_of(found.position) is None:
        options["axis"] = "linear"
    options |= {"position_unit": found.position} | ({"position_scale": "-1"} if flip else {})
    others = [given.columns[k].name for k in joint.others]
    alternatives = [f"{other} follows it as well" for other in others]
    turned_evidence = "; speed and torque both run against it: turned" if flip else ""
    why = "" if speed is None else f"{speed.name} is its slope; "
    guesses.append(
        Guess("position", position.name, found.position, why + found.evidence + turned_evidence,
              (*found.alternatives, *alternatives), found.sure, options)
    )  # fmt: skip
    if joint.demand is not None:
        demand = given.columns[joint.demand]
        sure = not joint.demand_evidence.startswith(("neither", "by its name"))
        guesses.append(Guess("demanded position", demand.name, found.position, joint.demand_evidence,
                             (f"{position.name} is the demand",) if not sure else (), sure,
                             {"position_demand": _reference(given, demand)}))  # fmt: skip
    guesses.append(_speed(given, joint, speed, found.speed, turned and not flip))
    guesses.append(_torque(given, joint, against and not flip, axis, said))
    return Proposal(name, tuple(guesses), _curves(given, joint))


def _reference(given: Prepared, column: Column) -> str:
    """How the column is named to `schwung import`: by name, or by number where several have that name."""
    same = [each for each in given.table.columns if each.name == column.name]
    return column.name if len(same) == 1 else str(given.table.columns.index(column))


def _axis(position: Column, said: Mapping[str, Any]) -> Axis:
    if said.get("axis") in ("rotary", "linear"):
        return "linear" if said["axis"] == "linear" else "rotary"
    if said.get("position_unit"):
        return axis_of(str(said["position_unit"])) or "rotary"
    linear = told_unit(position, "position", "linear") and not told_unit(position, "position", "rotary")
    return "linear" if linear else "rotary"


def _time(given: Prepared, said: Mapping[str, Any]) -> Guess:
    time, clock = given.time, given.clock
    options: dict[str, Any] = {}
    if time.column is not None:
        options["time"] = _reference(given, time.column)
        if time.unit is not None:
            options["time_unit"] = time.unit
    elif said.get("rate"):
        options["rate"] = said["rate"]
    evidence = time.evidence
    uneven = given.dropped > 0 or clock is None or not clock.uniform
    if clock is not None:
        evidence += f"; {clock.describe()}"
    if given.dropped:
        evidence += f"; {given.dropped} rows are empty somewhere, or have the stamp of the row before"
    if uneven and not said.get("rate"):
        options["resample"] = True
    name = "" if time.column is None else time.column.name
    return Guess("time", name, time.unit or "", evidence, time.alternatives, time.sure, options)


def _speed(given: Prepared, joint: Joint, speed: Column | None, unit: str | None, turned: bool) -> Guess:
    if speed is None:
        return Guess("speed", "", "", "no column is the slope of the position: it is derived", (), True, {})
    options: dict[str, Any] = {"speed": _reference(given, speed)}
    options |= {"speed_unit": unit} if unit else {}
    options |= {"speed_scale": "-1"} if turned else {}
    evidence = f"correlates with the slope of the position by {abs(joint.correlation):.4f}"
    steps = np.unique(np.abs(np.diff(np.unique(speed.values[np.isfinite(speed.values)]))))
    coarse = float(np.ptp(speed.values[np.isfinite(speed.values)])) / float(steps[0]) if steps.size else 0.0
    if 0 < coarse < 500:
        evidence += f"; it is coarse, {coarse:.0f} steps over its range (leave it out, and it is derived from position)"
    if turned:
        evidence += "; runs against it: turned"
    others = tuple(f"{given.columns[pair.speed].name} ({abs(pair.correlation):.4f})" for pair in joint.speeds
                   if pair.speed != joint.speed)  # fmt: skip
    return Guess("speed", speed.name, unit or "", evidence, others, True, options)


def _torque(given: Prepared, joint: Joint, turned: bool, axis: Axis, said: Mapping[str, Any]) -> Guess:
    best = joint.torques[0]
    column = given.columns[best.column]
    options: dict[str, Any] = {"torque": _reference(given, column)} | (
        {"torque_scale": "-1"} if turned else {}
    )
    evidence = (
        f"acceleration, speed, friction and weight explain {100 * best.explained:.0f} % of it; "
        f"of what the others leave, acceleration explains {100 * best.by_acceleration:.0f} %"
    )
    if turned and best.by_acceleration > SURE_GAIN:
        evidence += "; it brakes where the axis gathers speed: turned"
    elif turned:
        evidence += "; turned"
    others = [
        f"{given.columns[each.column].name} ({100 * each.explained:.0f} %)" for each in joint.torques[1:4]
    ]
    others += [f"{given.columns[k].name} is the same in another unit" for k in joint.twins]
    unit, sure, said_why = _torque_unit(column, axis, said)
    options |= {"torque_unit": unit} if unit else {}
    if sounds_like(column.name, DEMAND_WORDS):
        others.append("by its name it is a demand")
    clear = best.by_acceleration > SURE_GAIN
    if not clear:
        said_why += "; acceleration hardly shows in it: its sign is such that the motor puts work in, which is not sure"
    return Guess(
        "torque", column.name, unit or "", f"{evidence}; {said_why}", tuple(others), sure and clear, options
    )


def _torque_unit(column: Column, axis: Axis, said: Mapping[str, Any]) -> tuple[str | None, bool, str]:
    """The unit as `--torque-unit` takes it, whether that is settled, and in which words."""
    if said.get("torque_unit"):
        return str(said["torque_unit"]), True, f"in {said['torque_unit']}, as you say"
    told = told_unit(column, "torque", axis)
    if told is not None:
        return told, True, f"in {told}, as the file says"
    inside = column.unit.strip() or (re.findall(r"[\[(]\s*([^\[\]()]+?)\s*[\])]", column.name) or [""])[-1]
    relative = _RELATIVE.get(inside.lower())
    if relative is not None:
        return (
            None,
            False,
            f"in {inside} of the rated torque, which has to be said: --torque-unit {relative}=RATED",
        )
    if inside.lower() in _AMPERES or sounds_like(column.name, CURRENT_WORDS):
        return "A", False, "a current: it stays one (unit A), unless you say --torque-unit A=N·m per ampere"
    unit = "N·m" if axis == "rotary" else "N"
    return None, False, f"nothing says its unit: taken in {unit}"


def _curves(given: Prepared, joint: Joint) -> Curves:
    torque = joint.torques[0]
    slope = given.slope[:, joint.position]
    acceleration = given.differentiated(slope)
    kept = slice(given.edge, -given.edge)
    speed = None if joint.speed is None or not joint.ratio else given.slow[kept, joint.speed] / joint.ratio
    time = np.arange(given.slow.shape[0]) / given.rate_hz
    stamps = given.time.column.values * given.time.factor if given.time.column is not None else None
    steps = np.diff(stamps[np.isfinite(stamps)]) if stamps is not None else np.array([])
    return Curves(
        time_s=time[kept], slope=slope[kept], speed=speed, torque=given.slow[kept, torque.column], fitted=torque.fitted,
        acceleration=acceleration[kept], gathering=torque.gathering, inertia=torque.inertia, steps_s=steps,
        start_s=0.0 if given.clock is None else given.clock.start_s,
    )  # fmt: skip
