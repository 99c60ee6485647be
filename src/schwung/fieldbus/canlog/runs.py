"""Motions in rows of a log: where the drive was enabled and moved, and what was commanded while it did."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schwung.fieldbus import cia402
from schwung.fieldbus.canlog.injection import Injection, recognise_injection, recognise_motion, strongest_hz
from schwung.motion import Array, Excitation, Motion
from schwung.session import Run
from schwung.session.imports.motions import Piece, moving_sections, returning, stretches

_FEWEST_ROWS = 32
_REST_S = (
    0.03  # a demand that stands still for less is within a motion (motions.py has the same for positions)
)
_QUIET_S = 0.05  # an injection of no frequency is over when it was 0 for so long; else for half a period
_WAIT_S = 1.0  # so much rest is kept before and after a motion at most
_FEWEST_STEPS = 8  # a demand that changes in fewer steps is a target, not a path
#: A motion of less than this share of the longest is an approach or a trial, not the motion that was measured.
_SMALL_SHARE = 0.25
_TOLD_S = 0.3  # a drive sets off so long after it was given a target, at the latest
#: There and back are one motion where both take as long, within this share, and the rest between them is no longer.
_AS_LONG = 0.05


@dataclass(frozen=True, eq=False)
class Signals:
    """What was commanded and what came of it, in SI, (n,) each; NaN where it is not known. `demand_counts` and
    `added_counts` are what stood in the frames; None where there was no such object."""

    time_s: Array
    rate_hz: float
    piece: NDArray[np.int64]
    position: Array
    torque: Array
    speed: Array | None
    demand: Array | None
    added: Array | None
    demand_counts: Array | None
    added_counts: Array | None
    statusword: Array | None
    count_rad: float
    count_nm: float


@dataclass(frozen=True)
class Found:
    """The runs of a log, and what is to be said about how they were found."""

    runs: tuple[Run, ...]
    notes: tuple[str, ...]


@dataclass
class _Section:
    """One motion on its way: rows of the motion, of the stretch around it, and its injection."""

    moves: Piece
    bounds: Piece
    injection: Injection | None = None
    begin: int = 0
    end: int = 0
    motion: Motion | None = None
    kind: int = 0


def find_runs(signals: Signals, extra: dict[str, Any]) -> Found:
    """All motions of a log as runs, (n,) each, time 0 where the injection begins; all that make one motion begin and
    end likewise. Nothing is bridged: a run holds no row that is missing."""
    notes: list[str] = []
    sections: list[_Section] = []
    enabled = _enabled(signals)
    whole = enabled & np.isfinite(signals.position) & np.isfinite(signals.torque)
    if signals.speed is not None:
        whole &= np.isfinite(signals.speed)
    edges = np.flatnonzero(np.diff(signals.piece)) + 1
    cuts = np.zeros(whole.size, dtype=bool)
    cuts[edges - 1] = True  # the row before a gap has no answer of its own
    for start, stop in stretches(whole & ~cuts):
        if stop - start >= _FEWEST_ROWS:
            sections += _sections(signals, Piece(start, stop))
    lost = int(np.count_nonzero(enabled & ~whole))
    if lost:
        notes.append(f"{lost} rows in which frames are missing: nothing is bridged")
    if not sections:
        return Found((), tuple(notes))
    far = max(_stroke(signals, each) for each in sections)
    kept = [each for each in sections if _stroke(signals, each) >= _SMALL_SHARE * far]
    if len(kept) < len(sections):
        notes.append(f"{len(sections) - len(kept)} small motions (an approach, a trial) are left out")
    kept, odd = _injected(signals, kept)
    if odd:
        notes.append(f"{odd} motions are left out: what was added to their torque is no sine")
    _extents(signals, kept)
    runs = [_run(signals, each, extra) for each in kept]
    return Found(_numbered(runs), tuple(notes))


def _enabled(signals: Signals) -> NDArray[np.bool_]:
    if signals.statusword is None:
        return np.ones(signals.position.size, dtype=bool)
    there = np.isfinite(signals.statusword)  # a word that is missing is as the last one was
    last = np.maximum.accumulate(np.where(there, np.arange(there.size), 0))
    words = np.nan_to_num(signals.statusword[last]).astype(np.int64)
    known = {
        int(word): cia402.decode(int(word)) is cia402.State.OPERATION_ENABLED for word in np.unique(words)
    }
    return np.array([known[int(word)] for word in words], dtype=bool)


def _sections(signals: Signals, bounds: Piece) -> list[_Section]:
    """Motions within a stretch of whole rows, there and back together."""
    span = slice(bounds.start, bounds.stop)
    path, found = signals.position[span], list[Piece]()
    if signals.demand_counts is not None and np.all(np.isfinite(signals.demand_counts[span])):
        counts = signals.demand_counts[span]
        found = _commanded(counts, signals.rate_hz)
        path = counts * signals.count_rad if found else path
    if not found:
        path = _without_ripple(path, _period(signals, bounds))
        found = list(moving_sections(path, signals.rate_hz))
    shift = bounds.start
    sections = [
        _Section(Piece(group[0].start + shift, group[-1].stop + shift), bounds)
        for group in _mirrored(returning(path, found))
    ]
    for section in sections:
        told = _told_before(signals, section)
        if told is not None:
            section.moves = Piece(told, section.moves.stop)
    return sections


def _told_before(signals: Signals, section: _Section) -> int | None:
    """When a target was given that the axis went to on its own profile, the row before; None where a path was."""
    counts = signals.demand_counts
    if counts is None:
        return None
    first = max(section.bounds.start, section.moves.start - round(_TOLD_S * signals.rate_hz))
    steps = first + np.flatnonzero(np.diff(counts[first : section.moves.start + 1]))
    jumps = np.count_nonzero(np.diff(counts[section.moves.start : section.moves.stop])) < _FEWEST_STEPS
    return int(steps[-1]) if steps.size and jumps else None


def _mirrored(groups: Sequence[tuple[Piece, ...]]) -> Iterator[tuple[Piece, ...]]:
    """Strokes there and back as one where they mirror each other; a way home at another speed is another motion."""
    for group in groups:
        there, back = group[0], group[-1]
        alike = abs(len(there) - len(back)) <= max(3, _AS_LONG * len(there))
        if alike and back.start - there.stop <= len(there):
            yield group
        else:
            yield from ((each,) for each in group)


def _period(signals: Signals, bounds: Piece) -> int:
    """The period (rows) of what is injected in a stretch; 0 where nothing is."""
    if signals.added_counts is None:
        return 0
    own = np.nan_to_num(signals.added_counts[bounds.start : bounds.stop])
    on = np.flatnonzero(own)
    if on.size < _FEWEST_STEPS:
        return 0
    frequency = strongest_hz(own[on[0] : on[-1] + 1], signals.rate_hz)
    return 0 if not frequency else round(signals.rate_hz / frequency)


def _without_ripple(path: Array, period: int) -> Array:
    """A path (n,), averaged over a period of what is injected into it."""
    if period < 2 or path.size < 2 * period:
        return path
    padded = np.concatenate(
        (np.full(period // 2, path[0]), path, np.full(period - 1 - period // 2, path[-1]))
    )
    return np.asarray(np.convolve(padded, np.ones(period) / period, "valid"))


def _commanded(counts: Array, rate_hz: float) -> list[Piece]:
    """Where a demanded position moves; empty where it only ever jumps, as a target does."""
    changes = np.concatenate((np.diff(counts) != 0, [False]))
    rest = max(2, round(_REST_S * rate_hz))
    joined: list[Piece] = []
    for start, stop in stretches(changes):
        if joined and start - joined[-1].stop < rest:
            joined[-1] = Piece(joined[-1].start, stop)
        else:
            joined.append(Piece(start, stop))
    return [each for each in joined if np.count_nonzero(changes[each.start : each.stop]) >= _FEWEST_STEPS]


def _stroke(signals: Signals, section: _Section) -> float:
    return float(np.ptp(signals.position[section.moves.start : section.moves.stop + 1]))


def _injected(signals: Signals, sections: Sequence[_Section]) -> tuple[list[_Section], int]:
    """Sections with the sine that was added during each; how many are left out because it was none."""
    counts = signals.added_counts
    if counts is None:
        return list(sections), 0
    kept, odd = [], 0
    for section in sections:
        half = _period(signals, section.bounds) // 2
        quiet = half + 1 if half else max(2, round(_QUIET_S * signals.rate_hz))
        own = np.where(np.isfinite(counts), counts, 0.0)
        own[: section.bounds.start] = own[section.bounds.stop :] = 0.0
        spans: list[Piece] = []
        for start, stop in stretches(own != 0):
            if spans and start - spans[-1].stop < quiet:
                spans[-1] = Piece(spans[-1].start, stop)
            else:
                spans.append(Piece(start, stop))
        mine = [each for each in spans if each.start < section.moves.stop and each.stop > section.moves.start]
        if mine:
            only = np.zeros_like(own)
            only[mine[0].start : mine[-1].stop] = own[mine[0].start : mine[-1].stop]
            section.injection = recognise_injection(only, signals.rate_hz, signals.count_nm)
            if section.injection is None:
                odd += 1
                continue
        kept.append(section)
    return kept, odd


def _extents(signals: Signals, sections: Sequence[_Section]) -> None:
    """Begin and end of each run: motions that were commanded alike begin and end alike, with the injection where one of
    them has one."""
    most = round(_WAIT_S * signals.rate_hz)
    for k, section in enumerate(sections):
        before = section.bounds.start
        after = section.bounds.stop
        if k and sections[k - 1].bounds == section.bounds:
            before = (sections[k - 1].moves.stop + section.moves.start) // 2
        if k + 1 < len(sections) and sections[k + 1].bounds == section.bounds:
            after = (section.moves.stop + sections[k + 1].moves.start) // 2
        section.begin = max(before, section.moves.start - most)
        section.end = min(after, section.moves.stop + most)
    for number, alike in enumerate(_alike(signals, sections)):
        lead = min(each.moves.start - each.begin for each in alike)
        tail = min(each.end - each.moves.start for each in alike)
        injections = [each for each in alike if each.injection is not None]
        for each in injections:
            assert each.injection is not None
            lead = min(lead, each.moves.start - each.injection.start)
            tail = min(tail, max(each.injection.stop, each.moves.stop + 1) - each.moves.start)
        for each in alike:
            each.begin, each.end = each.moves.start - lead, each.moves.start + tail
            each.kind = number
        _recognise(signals, alike)


def _alike(signals: Signals, sections: Sequence[_Section]) -> list[list[_Section]]:
    """Sections by what was commanded: the same counts; where no path was commanded, each by itself."""
    groups: dict[bytes, list[_Section]] = {}
    for k, section in enumerate(sections):
        key = str(k).encode()
        if signals.demand_counts is not None:
            own = signals.demand_counts[section.moves.start : section.moves.stop + 1]
            steps = np.flatnonzero(np.diff(own))
            if np.all(np.isfinite(own)) and steps.size >= _FEWEST_STEPS:
                key = own.tobytes()
            elif np.all(np.isfinite(own)) and steps.size:  # targets, and when
                key = repr([(int(step), float(own[step + 1])) for step in steps]).encode()
        groups.setdefault(key, []).append(section)
    return list(groups.values())


def _recognise(signals: Signals, alike: Sequence[_Section]) -> None:
    """The motion that all of these were commanded, on the clock of their runs."""
    first = alike[0]
    if signals.demand_counts is None:
        return
    counts = signals.demand_counts[first.begin : first.end]
    if counts.size > _FEWEST_STEPS and np.all(np.isfinite(counts)):
        motion = recognise_motion(counts, signals.rate_hz, signals.count_rad)
        for each in alike:
            each.motion = motion


def _run(signals: Signals, section: _Section, extra: dict[str, Any]) -> Run:
    span = slice(section.begin, section.end)
    injection = section.injection
    excitation = None
    if injection is not None:
        excitation = _on_clock(injection.excitation, (section.begin - injection.start) / signals.rate_hz)
    size = section.end - section.begin
    position, speed = signals.position[span], signals.speed
    return Run(
        role="reference" if excitation is None else "excited",
        repeat=0,
        sample_rate_hz=signals.rate_hz,
        time_s=np.arange(size) / signals.rate_hz,
        position_rad=np.ascontiguousarray(position),
        speed_rad_s=np.gradient(position, 1 / signals.rate_hz) if speed is None else speed[span].copy(),
        torque_nm=signals.torque[span].copy(),
        position_demand_rad=_whole(signals.demand, span) if _is_path(signals.demand_counts, span) else None,
        torque_added_nm=_whole(signals.added, span),
        motion=section.motion,
        excitation=excitation,
        extra=extra | {"source_start_s": float(signals.time_s[section.begin])},
    )


def _is_path(counts: Array | None, span: slice) -> bool:
    """Whether a demand is a path, or a target that is given at once."""
    return counts is not None and int(np.count_nonzero(np.diff(counts[span]))) >= _FEWEST_STEPS


def _whole(values: Array | None, span: slice) -> Array | None:
    """A signal's part where it is finite throughout."""
    return values[span].copy() if values is not None and np.all(np.isfinite(values[span])) else None


def _on_clock(excitation: Excitation, later_s: float) -> Excitation:
    """The injection on a run's clock that begins so much later; what lies before is gone with its fade-in."""
    if later_s == 0:
        return excitation
    phase = excitation.phase_rad + 2 * np.pi * excitation.frequency_hz * later_s
    return excitation.model_copy(
        update={"phase_rad": float(phase % (2 * np.pi)), "ramp_s": None, "end_s": None}
    )


def _numbered(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs with `repeat` counted among those of which the same was commanded, whose injections are made one."""
    seen: list[Run] = []
    counts: list[int] = []
    numbered: list[Run] = []
    for run in runs:
        k = next((k for k, other in enumerate(seen) if _same(run, other)), None)
        if k is None:
            k = len(seen)
            seen.append(run)
            counts.append(0)
        numbered.append(replace(run, repeat=counts[k], excitation=seen[k].excitation, motion=seen[k].motion))
        counts[k] += 1
    return tuple(numbered)


def _same(first: Run, second: Run) -> bool:
    if first.role != second.role or len(first) != len(second):
        return False
    for one, other in (
        (first.position_demand_rad, second.position_demand_rad), (first.torque_added_nm, second.torque_added_nm)
    ):  # fmt: skip
        if one is None or other is None or not np.array_equal(one, other):
            return False
    return True
