"""Doubts about a session: what is said, and what could be done, as data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.imports.signals import derive_speed, unwrap
from schwung.session.model import Run, Session

Severity = Literal["note", "warning", "stop"]
Action = Literal["scale", "unwrap", "derive", "shift"]
Signal = Literal["position", "speed", "torque", "time"]


@dataclass(frozen=True)
class Correction:
    """What would put a signal right; nobody applies it unasked.

    scale: multiply by `value`. unwrap: undo jumps of `value`. derive: speed from position. shift: `value` seconds
    later than the other repeats, so many are cut off at the start. `runs` empty: all.
    """

    signal: Signal
    action: Action
    value: float = 1.0
    runs: tuple[int, ...] = ()


@dataclass(frozen=True)
class Doubt:
    """One thing that does not fit: where, what, what to do about it, and what can be said all the same.

    stop: an explanation would name the mistake as physics. warning: it may be wrong or blind somewhere. note: good to
    know.
    """

    kind: str
    place: str
    text: str
    remedy: str
    severity: Severity
    corrections: tuple[Correction, ...] = ()
    still: str = ""

    @property
    def sentence(self) -> str:
        """Everything for people, in one line."""
        parts = [f"{self.place}: {self.text}", self.remedy, self.still]
        return ". ".join(part.rstrip(".") for part in parts if part) + "."


@dataclass(frozen=True)
class Plausibility:
    """What to doubt about a session, the worst first."""

    doubts: tuple[Doubt, ...]

    @property
    def stops(self) -> tuple[Doubt, ...]:
        """Doubts with which explaining would name nonsense."""
        return tuple(doubt for doubt in self.doubts if doubt.severity == "stop")

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence per doubt."""
        return tuple(doubt.sentence for doubt in self.doubts)

    def kinds(self) -> tuple[str, ...]:
        """The kinds of all doubts."""
        return tuple(doubt.kind for doubt in self.doubts)

    @property
    def steady(self) -> bool:
        """Whether hardly anything accelerates, so that no inertia can be told."""
        return "inertia_undetermined" in self.kinds()

    def require(self, place: str) -> None:
        """Raise InputError for the first doubt with which explaining would name nonsense."""
        for doubt in self.stops:
            raise InputError(f"{place}: {doubt.place}", doubt.text, doubt.remedy)


def corrected(session: Session, corrections: Iterable[Correction]) -> Session:
    """The session with corrections applied, for whoever accepted them; the given one stays as it is."""
    runs = list(session.runs)
    for correction in corrections:
        for index in correction.runs or range(len(runs)):
            runs[index] = _corrected(runs[index], correction)
    return replace(session, runs=tuple(runs))


def _corrected(run: Run, correction: Correction) -> Run:
    if correction.action == "derive":
        return replace(run, speed_rad_s=derive_speed(run.position_rad, run.sample_rate_hz).speed)
    if correction.action == "shift":
        return _shifted(run, round(correction.value * run.sample_rate_hz))

    def changed(values: Array) -> Array:
        if correction.action == "unwrap":
            return unwrap(values, correction.value).position
        return np.asarray(values * correction.value)

    def optional(values: Array | None) -> Array | None:
        return None if values is None else changed(values)

    if correction.signal == "position":
        demand = optional(run.position_demand_rad)
        return replace(run, position_rad=changed(run.position_rad), position_demand_rad=demand)
    if correction.signal == "speed":
        return replace(run, speed_rad_s=changed(run.speed_rad_s))
    added = optional(run.torque_added_nm)
    return replace(run, torque_nm=changed(run.torque_nm), torque_added_nm=added)


def _shifted(run: Run, samples: int) -> Run:
    """A run without its first samples, its time from 0 again."""
    if samples <= 0:
        return run

    def cut(values: Array | None) -> Array | None:
        return None if values is None else values[samples:]

    return replace(
        run,
        time_s=run.time_s[: run.time_s.size - samples],
        position_rad=run.position_rad[samples:],
        speed_rad_s=run.speed_rad_s[samples:],
        torque_nm=run.torque_nm[samples:],
        position_demand_rad=cut(run.position_demand_rad),
        torque_added_nm=cut(run.torque_added_nm),
    )
