"""A long recording -> its motions: rest and motion found from the samples, repeats of one motion recognised."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from schwung.motion import Array
from schwung.session.imports.signals import derive_speed, white_noise
from schwung.session.model import Run, Session

#: Below this share of the highest speed the axis may rest; a motion reaches the second share.
_REST_SHARE, _MOTION_SHARE = 0.005, 0.02
_REST_S = 0.03  # a shorter standstill is a reversal within a motion
_REST_SAMPLES = 10
_STILL_SHARE = 0.3  # of the threshold: at a reversal the speed passes through, and its median is half of it
_WAIT_S = 1.0  # so much rest is kept before and after a motion at most
#: Positions agree within this share of the stroke, lengths within that of the length: one motion, repeated.
_SAME_PATH, _SAME_LENGTH = 0.01, 0.1
#: Torques of repeats differ, beyond their noise, by less than this share of their spread (a disturbed run does not).
_SAME_TORQUE = 0.2
_SMOOTHED_SHARE = 0.002  # of a run's length: torques are averaged over it before they are compared
_MOST_SHIFT = 0.2  # of a run's length: repeats may have been triggered so far apart
#: A motion without rests is cyclic where the path repeats itself within this share of its spread (in power: squared).
_SAME_CYCLE = 0.005
_WHOLE_CYCLE, _PART_CYCLE = (
    0.9,
    0.25,
)  # of a cycle: what is left at the end counts as one; is a run of its own
_STILL = "no motion found, kept as one run"
_THERE_AND_BACK = 2  # strokes of one motion
_NOISES = 6  # times its white noise a position seldom is off


@dataclass(frozen=True)
class Piece:
    """A part of a recording that becomes one run: samples start…stop."""

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True)
class Pieces:
    """What a recording was cut into, and in which words."""

    pieces: tuple[Piece, ...]
    how: str


def moving_sections(position: Array, sample_rate_hz: float) -> tuple[Piece, ...]:
    """Rest-to-rest sections of a recording, (n,) position: each from the first to the last sample that moves.

    A section reaches 2 % of the highest speed and is bounded by at least 30 ms below 0.5 %, or by the recording's
    ends. The thresholds rise above the noise of the position where that is coarse.
    """
    speed = np.abs(derive_speed(position, sample_rate_hz).speed)
    peak = float(np.percentile(speed, 99.5))
    noise = 6 * white_noise(position) * sample_rate_hz / 5
    if peak <= 0:
        return ()
    slow = max(_REST_SHARE * peak, min(noise, 0.1 * peak))
    shortest = max(_REST_SAMPLES, round(_REST_S * sample_rate_hz))
    moves = np.ones(position.size, dtype=bool)
    for start, stop in stretches(speed <= slow):
        rests = float(np.median(speed[start:stop])) <= _STILL_SHARE * slow
        if (rests and stop - start >= shortest) or start == 0 or stop == position.size:
            moves[start:stop] = False
    least = max(_MOTION_SHARE * peak, min(2 * noise, 0.2 * peak))
    return tuple(Piece(a, b) for a, b in stretches(moves) if speed[a:b].max() >= least)


def stretches(flags: Array | np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Where flags are set without a break: (start, stop)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.asarray(flags, dtype=np.int8), [0]))))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def cut(position: Array, sample_rate_hz: float, split: str, piece_s: float | None = None) -> Pieces:
    """Cut a recording, (n,) position, into runs.

    `rest`: each rest-to-rest motion. `auto`: likewise, a motion and the one that brings it back together; where
    there is no rest but the path repeats itself, its cycles. `reverse`: each stroke from one reversal to the next,
    whether it rests there or not. `none`: one. With `piece_s`, pieces of that length.
    """
    whole = Piece(0, position.size)
    if piece_s is not None:
        return _cycles(position.size, max(2, round(piece_s * sample_rate_hz)), f"pieces of {piece_s:g} s")
    if split == "none":
        return Pieces((whole,), "kept as one run")
    sections = moving_sections(position, sample_rate_hz)
    groups: list[tuple[Piece, ...]]
    if split == "reverse":
        groups = [(each,) for each in strokes(position, sections)]
        how = f"{len(groups)} strokes between reversals"
    else:
        groups = returning(position, sections) if split == "auto" else [(each,) for each in sections]
        how = f"{len(groups)} motions between rests"
    if len(groups) > 1:
        return Pieces(_with_rests(groups, position, sample_rate_hz), how)
    if split == "auto" and len(sections) == 1:
        return _without_rest(position, sections[0], sample_rate_hz)
    return Pieces((whole,), f"one {'stroke' if split == 'reverse' else 'motion'}" if groups else _STILL)


def _without_rest(position: Array, section: Piece, sample_rate_hz: float) -> Pieces:
    """A path without rests: its cycles, where it repeats itself."""
    period = cycle(position[section.start : section.stop])
    if period:
        found = _cycles(len(section), period, f"cycles of {period / sample_rate_hz:.6g} s, no rest between")
        first = section.start
        return Pieces(tuple(Piece(p.start + first, p.stop + first) for p in found.pieces), found.how)
    count = len(strokes(position, [section]))
    runs = f" without rest, of {count} strokes that `--split reverse` makes runs of"
    return Pieces((Piece(0, position.size),), f"one motion{runs if count > _THERE_AND_BACK else ''}")


def strokes(position: Array, sections: Sequence[Piece]) -> tuple[Piece, ...]:
    """From one reversal of a path, (n,) position, to the next, within its moving sections.

    It reverses where it turns back by 2 % of its range, and beyond its noise: a tremor is none. Where it rests, it does
    so in the middle of the rest. The first and the last may have begun before the recording, or end after it.
    """
    if not sections:
        return ()
    start, stop = sections[0].start, sections[-1].stop
    path = position[start:stop]
    noise = _NOISES * white_noise(path)
    turns = _reversals(path, max(_MOTION_SHARE * float(np.ptp(path)), 2 * noise))
    bounds = [start]
    for turn in turns:
        away = np.abs(path - path[turn]) > noise
        before, after = np.flatnonzero(away[:turn]), np.flatnonzero(away[turn:])
        low = int(before[-1]) + 1 if before.size else 0
        high = turn + int(after[0]) - 1 if after.size else path.size - 1
        bounds.append(start + (low + high) // 2)
    return tuple(Piece(a, b) for a, b in pairwise([*bounds, stop]))


def _reversals(path: Array, least: float) -> list[int]:
    """Samples at which a path (n,) is furthest before it turns back by at least so much."""
    slope = np.sign(np.diff(path))
    moving = np.flatnonzero(slope)
    extremes = moving[np.flatnonzero(np.diff(slope[moving]))] + 1
    found: list[int] = []
    top = bottom = way = (
        0  # where it was highest and lowest since the last turn; way 1: it rises, −1: it falls
    )
    for at in (*extremes.tolist(), path.size - 1):
        top = at if path[at] > path[top] else top
        bottom = at if path[at] < path[bottom] else bottom
        if way >= 0 and path[top] - path[at] >= least:
            found += [top] if way else []
            way, top, bottom = -1, at, at
        elif way <= 0 and path[at] - path[bottom] >= least:
            found += [bottom] if way else []
            way, top, bottom = 1, at, at
    return found


def returning(position: Array, sections: Sequence[Piece]) -> list[tuple[Piece, ...]]:
    """Sections of a path, (n,) position, each together with the next where that goes back to where the first began."""
    near = _SAME_PATH * float(np.ptp(position))
    groups: list[tuple[Piece, ...]] = []
    k = 0
    while k < len(sections):
        here = sections[k]
        begin, end = position[here.start], position[here.stop - 1]
        back = sections[k + 1] if k + 1 < len(sections) else None
        if back is not None and abs(end - begin) > near and abs(position[back.stop - 1] - begin) <= near:
            groups.append((here, back))
            k += 2
        else:
            groups.append((here,))
            k += 1
    return groups


def _with_rests(
    groups: Sequence[tuple[Piece, ...]], position: Array, sample_rate_hz: float
) -> tuple[Piece, ...]:
    """Runs with rest before and after; the same amount, and the same length, for all repeats of one motion."""
    most = round(_WAIT_S * sample_rate_hz)
    spans = [Piece(group[0].start, group[-1].stop) for group in groups]
    bounds = [
        0,
        *((a.stop + b.start) // 2 for a, b in pairwise(spans)),
        position.size,
    ]
    before = [min(most, span.start - bound) for span, bound in zip(spans, bounds[:-1], strict=True)]
    after = [min(most, bound - span.stop) for span, bound in zip(spans, bounds[1:], strict=True)]
    kinds: list[list[int]] = []
    shifts = [0] * len(spans)
    for k, span in enumerate(spans):
        for kind in kinds:
            shift = _shift_between(position, spans[kind[0]], span)
            if shift is not None:
                shifts[k] = shift
                kind.append(k)
                break
        else:
            kinds.append([k])
    pieces = [Piece(0, 0)] * len(spans)
    for kind in kinds:
        starts = [spans[k].start + shifts[k] for k in kind]
        lead = max(0, min(before[k] + shifts[k] for k in kind))
        length = min(spans[k].stop + after[k] - start for k, start in zip(kind, starts, strict=True))
        for k, start in zip(kind, starts, strict=True):
            pieces[k] = Piece(start - lead, start + length)
    return tuple(pieces)


def _shift_between(position: Array, model: Piece, other: Piece) -> int | None:
    """By how many samples the other section begins late, where it repeats the model; None where it does not."""
    length = min(len(model), len(other))
    if abs(len(model) - len(other)) > max(2, _SAME_LENGTH * max(len(model), len(other))):
        return None
    path = position[model.start : model.start + length]
    spread = float(np.ptp(path))
    reach = max(5, length // 50)
    best: tuple[float, int] | None = None
    for shift in range(-reach, reach + 1):
        start = other.start + shift
        if start < 0 or start + length > position.size:
            continue
        miss = float(np.sqrt(np.mean((position[start : start + length] - path) ** 2)))
        best = (miss, shift) if best is None or miss < best[0] else best
    return best[1] if best is not None and best[0] <= _SAME_PATH * spread else None


def cycle(position: Array) -> int | None:
    """The period (samples) in which a path (n,) repeats itself at least twice, None where it does not.

    Mean squared difference between the path and itself later, over all lags at once (by FFT); the first lag where it
    is a minimum below 0.5 % of the path's spread (rms) is the period.
    """
    size = position.size
    path = position - position.mean()
    spread = float(np.mean(path**2))
    if size < 4 * _REST_SAMPLES or spread <= 0:
        return None
    spectrum = np.fft.rfft(path, 2 * size)
    product = np.fft.irfft(np.abs(spectrum) ** 2)[:size]
    squares = np.concatenate(([0.0], np.cumsum(path**2)))
    lags = np.arange(size)
    overlap = size - lags
    power = squares[size - lags] + (squares[size] - squares[lags])
    miss = (power - 2 * product) / overlap
    last = int(size / (1 + _WHOLE_CYCLE))  # nearly two whole cycles at the least
    apart = np.flatnonzero(miss[:last] > 0.5 * spread)
    if not apart.size:
        return None
    search = miss[apart[0] : last]
    good = np.flatnonzero(search < _SAME_CYCLE**2 * spread * 4)
    if not good.size:
        return None
    first = good[0]
    run = good[(good - first) == np.arange(good.size)]  # the first dip, not the ones after it
    return int(apart[0] + run[np.argmin(search[run])])


def _cycles(size: int, period: int, how: str) -> Pieces:
    starts = range(0, size, period)
    pieces = [Piece(start, min(start + period, size)) for start in starts]
    left = len(pieces[-1])
    if len(pieces) > 1 and left < _PART_CYCLE * period:
        pieces.pop()
        how += f", the last {left} samples left out"
    elif len(pieces) > 1 and left < _WHOLE_CYCLE * period:
        how += f", the last one unfinished ({left} of {period} samples)"
    return Pieces(tuple(pieces), how)


@dataclass(frozen=True)
class Likeness:
    """How one run compares with another: by how many samples it is late, and what differs."""

    shift_samples: int
    same_path: bool
    same_torque: bool


def compare(model: Run, other: Run) -> Likeness:
    """Whether another run repeats a run's motion, whenever it was triggered; by demands where both have one."""
    none = Likeness(0, False, False)
    if model.role != other.role or model.excitation != other.excitation:
        return none
    length = min(len(model), len(other))
    longest = max(len(model), len(other))
    if longest - length > max(2, _SAME_LENGTH * longest) or model.sample_rate_hz != other.sample_rate_hz:
        return none
    first, second = model.position_rad[:length], other.position_rad[:length]
    if model.position_demand_rad is not None and other.position_demand_rad is not None:
        first, second = model.position_demand_rad[:length], other.position_demand_rad[:length]
    spread = max(float(np.ptp(first)), float(np.ptp(second)))
    if spread <= 0:
        return none
    shift = _lateness(first, second)
    here, there = _overlap(shift, length)
    miss = float(np.sqrt(np.mean((second[there] - first[here]) ** 2)))
    if miss > _SAME_PATH * spread:
        return none
    width = max(1, round(_SMOOTHED_SHARE * length))
    smooth = [np.convolve(run.torque_nm[:length], np.ones(width) / width, "same") for run in (model, other)]
    noise = sum(white_noise(run.torque_nm[:length]) ** 2 for run in (model, other)) / width
    excess = max(0.0, float(np.mean((smooth[1][there] - smooth[0][here]) ** 2)) - noise)
    return Likeness(shift, True, np.sqrt(excess) <= _SAME_TORQUE * float(np.std(smooth[0])))


def _lateness(first: Array, second: Array) -> int:
    """By how many samples the second signal (n,) lags the first, from the correlation of their slopes."""
    size = first.size
    spectra = [np.fft.rfft(np.gradient(each), 2 * size) for each in (first, second)]
    likeness = np.fft.irfft(spectra[1] * np.conj(spectra[0]))
    most = max(1, int(_MOST_SHIFT * size))
    window = np.concatenate((likeness[-most:], likeness[: most + 1]))
    return int(np.argmax(window)) - most


def _overlap(shift: int, length: int) -> tuple[slice, slice]:
    """The parts of two signals that belong together where the second is late by `shift` samples."""
    return slice(max(0, -shift), length - max(0, shift)), slice(max(0, shift), length + min(0, shift))


def with_repeats(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Runs that know which of them repeat one motion: `repeat` counts, `same_motion` (extra) names the motion.

    A run whose path is that of another while its torque is not (a disturbance, another load) is no repeat of it;
    `same_path` names the motion whose path it has.
    """
    models: list[Run] = []
    counts: list[int] = []
    numbered: list[Run] = []
    for run in runs:
        extra = dict(run.extra)
        likenesses = [compare(model, run) for model in models]
        same = next((k for k, like in enumerate(likenesses) if like.same_path and like.same_torque), None)
        path = next((k for k, like in enumerate(likenesses) if like.same_path), None)
        if same is None:
            same = len(models)
            models.append(run)
            counts.append(0)
            if path is not None:
                extra["same_path"] = path
        near = _SAME_PATH * float(np.ptp(run.position_rad))
        extra["same_motion"] = same
        extra["returns"] = int(abs(run.position_rad[-1] - run.position_rad[0]) <= near)
        numbered.append(replace(run, repeat=counts[same], extra=extra))
        counts[same] += 1
    return tuple(numbered)


def motion_identity(run: Run) -> Hashable:
    """What repeats of one motion have in common: the commanded motion and injection, or what the import found."""
    if run.motion is not None:
        excitation = None if run.excitation is None else run.excitation.model_dump_json()
        return run.role, run.motion.model_dump_json(), excitation
    return run.role, run.extra.get("same_motion")


def repeats(session: Session) -> tuple[tuple[int, ...], ...]:
    """Indices of the runs that repeat one motion, a group for each motion (of one run where it is not repeated).

    Imports without `same_motion` (another program wrote the file) are compared by their samples.
    """
    runs = session.runs
    if any(run.motion is None and "same_motion" not in run.extra for run in runs):
        runs = with_repeats([replace(run, motion=None, extra=dict(run.extra)) for run in runs])
    groups: dict[Hashable, list[int]] = {}
    for index, run in enumerate(runs):
        groups.setdefault(motion_identity(run), []).append(index)
    return tuple(tuple(group) for group in groups.values())
