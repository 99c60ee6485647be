"""Long recordings: rest and motion, there and back, cycles without rest, and which runs repeat one motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schwung.motion import Array, Motion
from schwung.session import Run, Session
from schwung.session.imports import motion_identity, repeats
from schwung.session.imports.motions import compare, cut, cycle, moving_sections, with_repeats

RATE = 1000.0


def stroke(distance: float, duration_s: float, rest_s: float) -> Array:
    motion = Motion(
        distance_rad=distance, duration_s=duration_s, start_time_s=rest_s, returns=False, dwell_s=rest_s
    )
    return motion.demand(motion.time(RATE)).position_rad


def joined(*strokes: Array) -> Array:
    parts, level = [], 0.0
    for each in strokes:
        parts.append(each + level)
        level += float(each[-1])
    return np.concatenate(parts)


def noisy(position: Array, seed: int = 0, counts: float = 1e-4) -> Array:
    jitter = np.random.default_rng(seed).normal(0, counts, position.size)
    return np.rint((position + jitter) / counts) * counts


def run_of(position: Array, torque: Array | None = None) -> Run:
    time = np.arange(position.size) / RATE
    speed = np.gradient(position, 1 / RATE)
    torque = np.gradient(speed, 1 / RATE) if torque is None else torque
    return Run("reference", 0, RATE, time, position, speed, torque)


def test_sections_begin_and_end_with_the_motion() -> None:
    position = noisy(joined(stroke(2.0, 0.4, 0.2), stroke(-2.0, 0.4, 0.2)))
    sections = moving_sections(position, RATE)
    assert [(each.start, each.stop) for each in sections] == [
        (pytest.approx(200, abs=25), pytest.approx(600, abs=25)),
        (pytest.approx(1001, abs=25), pytest.approx(1401, abs=25)),
    ]


def test_a_reversal_without_rest_is_one_motion() -> None:
    time = np.arange(1000) / RATE
    swing = np.where(time < 0.8, np.sin(2 * np.pi * time / 0.8) ** 3, 0.0)
    assert len(moving_sections(noisy(swing), RATE)) == 1


def test_there_and_back_are_one_run_and_repeats_are_cut_alike() -> None:
    there, back = stroke(2.0, 0.4, 0.25), stroke(-2.0, 0.4, 0.3)
    position = noisy(joined(*[there, back] * 3))
    pieces = cut(position, RATE, "auto").pieces
    assert len(pieces) == 3
    assert len({len(piece) for piece in pieces}) == 1
    first = position[pieces[0].start : pieces[0].stop]
    for piece in pieces[1:]:
        other = position[piece.start : piece.stop]
        assert np.sqrt(np.mean((other - first) ** 2)) < 2e-3  # within a sample: a shift of one would be 7e-3
    assert len(cut(position, RATE, "rest").pieces) == 6
    assert len(cut(position, RATE, "none").pieces) == 1
    assert [len(piece) for piece in cut(position, RATE, "auto", 1.0).pieces[:3]] == [1000, 1000, 1000]


def test_a_cycle_without_rest_is_found_to_the_sample() -> None:
    time = np.arange(5310) / RATE  # 1.327 s, four times and 2 samples
    phase = 2 * np.pi * time / 1.327
    position = np.sin(phase) + 0.4 * np.sin(3 * phase + 1)
    assert cycle(position) == 1327
    assert [len(piece) for piece in cut(noisy(position), RATE, "auto").pieces] == [1327] * 4


def swings(targets: list[float], durations_s: list[float]) -> Array:
    """Half cosines from one target to the next: it is at rest nowhere, and reverses everywhere."""
    parts, level = [], 0.0
    for target, duration in zip(targets, durations_s, strict=True):
        share = np.arange(round(duration * RATE)) / round(duration * RATE)
        parts.append(level + (target - level) * (1 - np.cos(np.pi * share)) / 2)
        level = target
    return np.concatenate(parts)


def test_strokes_without_rest_are_cut_where_they_reverse() -> None:
    durations = [0.5, 0.4, 0.5, 0.4, 0.3, 0.45, 0.5, 0.4]
    path = swings([2.0, 0.0, 2.0, 0.0, 1.2, 0.0, 2.0, 0.0], durations)
    pieces = cut(noisy(path), RATE, "reverse")
    ends = np.rint(np.cumsum(durations) * RATE)
    assert [piece.stop for piece in pieces.pieces] == pytest.approx(ends, abs=5)
    assert pieces.how == "8 strokes between reversals"
    smooth = np.gradient(np.gradient(path, 1 / RATE), 1 / RATE)
    runs = with_repeats(
        [
            run_of(noisy(path)[each.start : each.stop], smooth[each.start : each.stop])
            for each in pieces.pieces
        ]
    )
    motions = [run.extra["same_motion"] for run in runs]
    assert motions[2] == motions[0] == motions[6] != motions[1] == motions[3] == motions[7]
    assert motions.count(motions[4]) == motions.count(motions[5]) == 1
    assert "8 strokes that `--split reverse`" in cut(noisy(path), RATE, "auto").how


def test_neither_tremor_nor_noise_nor_standstill_is_a_reversal() -> None:
    time = np.arange(2000) / RATE
    tremor = 2 * time + 0.005 * np.sin(2 * np.pi * 30 * time)
    for never in (3 * time, noisy(tremor), noisy(1e-6 * time), np.zeros(2000)):
        assert len(cut(never, RATE, "reverse").pieces) == 1
    rested = cut(noisy(joined(stroke(2.0, 0.4, 0.2), stroke(-2.0, 0.4, 0.2))), RATE, "reverse")
    assert rested.pieces[0].stop == pytest.approx(800, abs=25)  # amid the rest


def test_a_motion_that_never_repeats_has_no_cycle() -> None:
    time = np.arange(4000) / RATE
    assert cycle(np.sin(2 * np.pi * 0.6 * time**1.7)) is None
    assert cycle(3 * time) is None


def test_repeats_are_counted_and_other_motions_kept_apart() -> None:
    slow, fast = stroke(2.0, 0.5, 0.2), stroke(2.0, 0.4, 0.2)
    torques = {id(path): run_of(path).torque_nm for path in (slow, fast)}
    order = [slow, fast, slow, fast, slow]
    runs = with_repeats(
        [run_of(noisy(path, k), noisy(torques[id(path)], k, 0.5)) for k, path in enumerate(order)]
    )
    assert [run.repeat for run in runs] == [0, 0, 1, 1, 2]
    assert [run.extra["same_motion"] for run in runs] == [0, 1, 0, 1, 0]
    assert [run.extra["returns"] for run in runs] == [0] * 5


def test_a_disturbed_run_is_no_repeat() -> None:
    path = stroke(2.0, 0.5, 0.2)
    torque = np.gradient(np.gradient(path, 1 / RATE), 1 / RATE)
    disturbed = torque.copy()
    disturbed[300:380] += torque.max()
    runs = with_repeats([run_of(path, torque), run_of(path, disturbed)])
    assert [run.repeat for run in runs] == [0, 0]
    assert runs[1].extra["same_path"] == 0
    assert runs[1].extra["same_motion"] == 1


def test_lateness_is_measured() -> None:
    path = stroke(2.0, 0.5, 0.2)
    late = np.concatenate((np.full(37, path[0]), path[:-37]))
    like = compare(run_of(path), run_of(late))
    assert like.same_path
    assert like.shift_samples == 37


def test_identity_is_what_was_commanded_where_that_is_known() -> None:
    path = stroke(2.0, 0.5, 0.2)
    motion = Motion(distance_rad=2.0, duration_s=0.5)
    told = replace(run_of(path), motion=motion)
    assert motion_identity(told) == motion_identity(replace(told, repeat=1))
    session = Session((told, replace(told, repeat=1), run_of(path)), "2024-01-01", "test")
    assert repeats(session) == ((0, 1, 2),)
    found = Session(with_repeats([run_of(path), run_of(path)]), "2024-01-01", "test")
    assert repeats(found) == ((0, 1),)
