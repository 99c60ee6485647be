"""Is this session fit to be explained? It is held against itself and against the belief before anything is.

Unit mistakes, reversed signs, wrapped positions, one run only, no rest, constant speed, repeats that were not
triggered together, clipped torque, coarse speed: each becomes a `Doubt` that says where, what, what to do, and what
can still be said. Corrections are proposed as data and never applied here; `corrected` does it for whoever agrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from schwung.drivetrain.machine import Machine
from schwung.explain.plausibility.inertia_factor import low_pass
from schwung.explain.plausibility.units import speed_doubts, torque_doubts
from schwung.explain.plausibility.values import (
    Correction,
    Doubt,
    Plausibility,
    Severity,
    corrected,
)
from schwung.motion import Array
from schwung.session.imports.motions import repeats
from schwung.session.imports.signals import derive_speed, white_noise
from schwung.session.model import Run, Session

_ORDER: dict[Severity, int] = {"stop": 0, "warning": 1, "note": 2}
#: Angles are wrapped at these; a jump that is none of them is named by its size.
_WRAPS = (2 * np.pi, 360.0, 1.0)
_JUMP_SHARE, _JUMP_TIMES = 0.6, 20.0  # of the travel; of the usual largest step
#: The axis rests below this share of its highest speed; at constant speed it varies by less than the second.
_RESTS, _CONSTANT = 0.02, 0.05
_REST_SHARE = 0.01  # of the samples
#: Clipped: so many samples in a row at exactly the highest value, in so many places or for such a share.
_PLATEAU_SAMPLES, _PLATEAU_SHARE = 5, 0.002
_AT_PEAK = 0.98
#: Repeats are late where it is at least this, and putting it right reduces their difference so much.
_LATE_SAMPLES, _LATE_GAIN = 2, 3.0
#: A speed's step above this share of the highest speed is coarse.
_COARSE = 0.005


def examine(session: Session, machine: Machine) -> Plausibility:
    """Everything to doubt about a session under a belief, the worst first. Takes well under a second."""
    if not session.runs:
        doubt = Doubt("no_runs", "session", "holds no run", "Record or import one", "stop",
                      still="Nothing can be said")  # fmt: skip
        return Plausibility((doubt,))
    wrapped = _wrapped(session)
    doubts = [doubt for doubt, _ in wrapped]
    straight = corrected(session, (correction for _, correction in wrapped))
    units = speed_doubts(straight, machine)
    doubts += units
    if not {"no_motion", "speed_unrelated"} & {doubt.kind for doubt in units}:
        straight = corrected(straight, (each for doubt in units for each in doubt.corrections))
        doubts += torque_doubts(straight, machine)
    doubts += [*_motion_doubts(straight), *_clipped(straight, machine), *_coarse(straight)]
    doubts += _repeat_doubts(straight)
    return Plausibility(tuple(sorted(doubts, key=lambda doubt: _ORDER[doubt.severity])))


def _named(indices: Sequence[int], runs: int) -> str:
    if len(indices) == runs:
        return "all runs" if runs > 1 else "the run"
    return f"run{'s' * (len(indices) > 1)} {', '.join(map(str, indices))}"


def _wrapped(session: Session) -> list[tuple[Doubt, Correction]]:
    """Positions that jump by a whole turn, by the size of the turn."""
    found: dict[float, list[int]] = {}
    for index, run in enumerate(session.runs):
        period = wrap_period(run.position_rad)
        if period is not None:
            found.setdefault(period, []).append(index)
    result = []
    for period, indices in found.items():
        size = "a whole turn" if period == _WRAPS[0] else f"{period:.5g}"
        correction = Correction("position", "unwrap", period, tuple(indices))
        doubt = Doubt(
            "position_wraps", f"{_named(indices, len(session.runs))}/position",
            f"jumps by {size} between samples", "Import again with --unwrap, or unwrap it", "stop", (correction,),
            "With the jumps undone everything can be looked at",
        )  # fmt: skip
        result.append((doubt, correction))
    return result


def wrap_period(position: Array) -> float | None:
    """The size of the jumps of a position (n,) that wraps around, None where it does not."""
    step = np.abs(np.diff(position))
    travel = float(np.ptp(position))
    if travel <= 0 or step.size < 8:
        return None
    jumps = np.flatnonzero(step > _JUMP_SHARE * travel)
    if not jumps.size or jumps.size > 0.1 * step.size:
        return None
    usual = float(np.percentile(np.delete(step, jumps), 99.9))
    size = float(np.median(step[jumps]))
    if size < _JUMP_TIMES * usual:
        return None
    for period in _WRAPS:
        if abs(size - period) <= max(2 * usual, 0.01 * period) and travel <= 1.01 * period:
            return period
    return size + usual


def _motion_doubts(session: Session) -> list[Doubt]:
    """What the motions cannot show: one run, no rest, no acceleration, no repeats."""
    runs = session.runs
    doubts = []
    speeds = [
        low_pass(np.gradient(run.position_rad, 1 / run.sample_rate_hz), run.sample_rate_hz) for run in runs
    ]
    peak = max(float(np.max(np.abs(speed))) for speed in speeds)
    rests = any(float(np.mean(np.abs(speed) < _RESTS * peak)) > _REST_SHARE for speed in speeds)
    means = [float(np.mean(speed)) for speed in speeds]
    constant = all(
        float(np.std(speed[len(speed) // 20 : -len(speed) // 20])) < _CONSTANT * abs(mean)
        for speed, mean in zip(speeds, means, strict=True)
    )
    if constant and peak > 0:
        inertia = "inertia" if session.axis == "rotary" else "mass"
        doubts.append(
            Doubt(
                "constant_speed", _named(range(len(runs)), len(runs)), "move at constant speed only",
                "Record motions that accelerate, from rest to rest", "warning",
                still=f"Friction at that speed, and ripple over angle or time, can be named; {inertia}, coupling and "
                "delays cannot",
            )
        )  # fmt: skip
    elif not rests:
        doubts.append(
            Doubt(
                "no_rest", _named(range(len(runs)), len(runs)), "never come to rest",
                "Record from rest to rest", "note",
                still="Breakaway near standstill and the motion's start cannot be told; the rest can",
            )
        )  # fmt: skip
    rates = sorted({run.sample_rate_hz for run in runs})
    if len(rates) > 1:
        listed = ", ".join(f"{rate:g}" for rate in rates)
        doubts.append(
            Doubt("rates_differ", "all runs/time", f"are sampled at different rates ({listed} Hz)",
                  "Import again with --resample --rate HZ", "stop", still="Each rate by itself can be looked at")
        )  # fmt: skip
    return doubts


def _clipped(session: Session, machine: Machine) -> list[Doubt]:
    """Torque that stays at exactly its highest value: the drive's limit, or the recording's."""
    levels: dict[int, float] = {}
    for index, run in enumerate(session.runs):
        level = plateau(run.torque_nm)
        if level is not None:
            levels[index] = level
    if not levels:
        return []
    unit = "N·m" if session.axis == "rotary" else "N"
    peak, level = machine.motor.peak_torque_nm, max(levels.values())
    place = f"{_named(list(levels), len(session.runs))}/torque"
    if level >= _AT_PEAK * peak:
        text = f"is clipped at {level:.4g} {unit}, the stated peak"
    else:
        text = f"is clipped at {level:.4g} {unit}, below the stated peak of {peak:.4g} {unit}"
    return [
        Doubt(
            "torque_clipped", place, text, "Record slower motions as well, which need less", "warning",
            still="Samples at the limit say less; the others say what they would",
        )
    ]  # fmt: skip


def plateau(torque: Array) -> float | None:
    """The level (unsigned) at which a torque (n,) is clipped, None where it is not.

    Clipped torque repeats its extreme value exactly, sample after sample, while it changes elsewhere, and it runs
    into it: a smooth top that is merely counted in steps is reached step by step. Noise added behind the limit hides
    all this; then it is left to the explanation.
    """
    highest = float(np.max(np.abs(torque)))
    if highest == 0:
        return None
    same = np.diff(torque) == 0
    at_level = np.abs(torque) >= highest * (1 - 1e-9)
    held = same & at_level[1:]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], held.astype(np.int8), [0]))))
    longest = int(np.max(edges[1::2] - edges[::2])) + 1 if edges.size else 0
    if longest < _PLATEAU_SAMPLES or np.mean(at_level) < _PLATEAU_SHARE:
        return None
    if _arrives_by_counts(torque, edges):
        return None
    elsewhere = float(np.mean(same[~held])) if np.any(~held) else 1.0
    return (
        highest if elsewhere < 0.5 else None
    )  # a torque that mostly stands still is held or commanded, not clipped


def _arrives_by_counts(torque: Array, edges: NDArray[np.int64]) -> bool:
    """Whether plateaus, given by the edges of their equal steps, are entered and left by single steps of counting."""
    steps = np.abs(np.diff(torque))
    count = float(steps[steps > 0].min())
    outside = [steps[at] for at in (*(edges[::2] - 1), *edges[1::2]) if 0 <= at < steps.size]
    return bool(outside) and max(outside) < 2.5 * count


def _coarse(session: Session) -> list[Doubt]:
    """A reported speed whose steps are much larger than what position gives."""
    coarse = []
    worst = 0.0
    for index, run in enumerate(session.runs):
        if "speed_origin" in run.extra:
            continue
        peak = float(np.max(np.abs(run.speed_rad_s)))
        step = speed_step(run)
        if peak > 0 and step > _COARSE * peak and _gains_by_deriving(run):
            coarse.append(index)
            worst = max(worst, step)
    if not coarse:
        return []
    unit = "rad/s" if session.axis == "rotary" else "m/s"
    return [
        Doubt(
            "speed_coarse", f"{_named(coarse, len(session.runs))}/speed",
            f"changes in steps of {worst:.3g} {unit}; position gives it finer",
            "Import again without --speed, or derive it from position", "warning",
            (Correction("speed", "derive", 1.0, tuple(coarse)),), "What is compared in torque uses position as well",
        )
    ]  # fmt: skip


def speed_step(run: Run) -> float:
    """The smallest step of a reported speed that is quantised, 0 where it is not."""
    values = np.sort(run.speed_rad_s)
    steps = np.diff(values)
    peak = float(np.max(np.abs(values))) or 1.0
    steps = steps[steps > 1e-9 * peak]
    if not steps.size or steps.size > 0.2 * values.size:  # nearly every value is its own: no steps
        return 0.0
    return float(np.median(steps))


def _gains_by_deriving(run: Run) -> bool:
    """Whether speed from position is less noisy than the reported one."""
    derived = derive_speed(run.position_rad, run.sample_rate_hz).speed
    reported = max(white_noise(run.speed_rad_s), speed_step(run) / 12**0.5)
    return white_noise(derived) < 0.5 * reported


def _repeat_doubts(session: Session) -> list[Doubt]:
    """One run only, no repeats, and repeats that were not triggered together."""
    runs = session.runs
    if len(runs) == 1:
        return [
            Doubt(
                "one_run", "session", "holds one run only", "Record the same motion several times, and other motions",
                "warning",
                still="Something may be named, but not proved on another run, and the noise floor is an estimate",
            )
        ]  # fmt: skip
    groups = [group for group in repeats(session) if len(group) > 1]
    if not groups:
        return [
            Doubt(
                "no_repeats", "session", "no run repeats another's motion", "Record each motion twice or more", "note",
                still="The noise floor is estimated from the signals instead of measured",
            )
        ]  # fmt: skip
    late = [each for group in groups for each in _lateness_of(session, group)]
    if not late:
        return []
    corrections = tuple(Correction("time", "shift", each.late_s, (each.run,)) for each in late)
    worst = max(late, key=lambda each: each.late_s)
    return [
        Doubt(
            "unsynchronised", f"{_named([each.run for each in late], len(runs))}/time",
            f"repeats were not triggered together: run {worst.run} is {worst.late_s * 1e3:.3g} ms late",
            "Shift them, or record with the start trigger", "warning", corrections,
            "Everything but what depends on the time in the motion",
        )
    ]  # fmt: skip


@dataclass(frozen=True)
class _Late:
    run: int
    late_s: float


def _lateness_of(session: Session, group: Sequence[int]) -> list[_Late]:
    """By how much the runs of a group are behind the earliest of them, where that matters."""
    model = session.runs[group[0]]
    shifts = [0, *(lateness(model, session.runs[index]) for index in group[1:])]
    earliest = min(shifts)
    return [
        _Late(index, (shift - earliest) / model.sample_rate_hz)
        for index, shift in zip(group, shifts, strict=True)
        if shift - earliest >= _LATE_SAMPLES
    ]


def lateness(model: Run, other: Run) -> int:
    """By how many samples one run lags its repeat, 0 where shifting them does not bring them together."""
    size = min(len(model), len(other))
    first, second = model.position_rad[:size], other.position_rad[:size]
    spectra = [np.fft.rfft(np.gradient(each), 2 * size) for each in (first, second)]
    likeness = np.fft.irfft(spectra[1] * np.conj(spectra[0]))
    most = size // 3
    shift = int(np.argmax(np.concatenate((likeness[-most:], likeness[: most + 1])))) - most
    if shift == 0:
        return 0
    here = slice(max(0, -shift), size - max(0, shift))
    there = slice(max(0, shift), size + min(0, shift))
    before = float(np.sqrt(np.mean((second - first) ** 2)))
    after = float(np.sqrt(np.mean((second[there] - first[here]) ** 2)))
    return shift if before > _LATE_GAIN * after else 0
