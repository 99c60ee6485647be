"""Which SYNC a frame answers: losses, lateness, and what cannot be told."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schwung.fieldbus.canopen.recorder import Recorder, arrange, attribute, measure_timing


def test_one_answer_per_window_is_taken_as_it_is() -> None:
    owners = attribute([0, 1, 2, 3], 4)
    assert owners.frame_of_window.tolist() == [0, 1, 2, 3]
    assert owners.late == 0


def test_an_empty_window_lost_its_answer_and_shifts_nobody() -> None:
    assert attribute([0, 2, 3], 4).frame_of_window.tolist() == [0, -1, 1, 2]


def test_an_answer_after_the_next_sync_goes_back_where_it_belongs() -> None:
    owners = attribute([0, 2, 2, 3], 4)
    assert owners.frame_of_window.tolist() == [0, 1, 2, 3]
    assert owners.late == 1


def test_a_run_of_late_answers_ends_with_the_window_that_has_two() -> None:
    owners = attribute([0, 2, 3, 4, 4], 5)  # 1 late until 4 caught up
    assert owners.frame_of_window.tolist() == [0, 1, 2, 3, 4]
    assert owners.late == 3


def test_a_true_loss_before_a_late_answer_stays_lost() -> None:
    owners = attribute([1, 2, 4, 4], 5)  # 0 lost; 3 came in 4
    assert owners.frame_of_window.tolist() == [-1, 0, 1, 2, 3]


def test_more_answers_than_questions_are_not_trusted() -> None:
    assert attribute([0, 1, 1, 2], 3).frame_of_window.tolist() == [0, -1, 3]


def test_frames_before_the_first_sync_belong_to_nobody() -> None:
    assert attribute([-1, 0, 1], 2).frame_of_window.tolist() == [1, 2]


@given(st.lists(st.booleans(), min_size=1, max_size=60))
def test_losses_alone_are_found_exactly(arrived: list[bool]) -> None:
    windows = [i for i, came in enumerate(arrived) if came]
    owner = attribute(windows, len(arrived)).frame_of_window
    assert np.array_equal(owner >= 0, arrived)
    assert [windows[i] for i in owner[owner >= 0]] == windows


@given(st.lists(st.integers(0, 3), min_size=1, max_size=60))
def test_lateness_alone_loses_nothing(delays: list[int]) -> None:
    """Every answer comes, in order, some windows late; the log goes on until all are in."""
    delays = [*delays, 0, 0, 0, 0]  # SYNC goes on after the motion, and is answered
    windows = np.maximum.accumulate(np.arange(len(delays)) + delays)
    owner = attribute(windows.tolist(), len(delays)).frame_of_window
    assert owner[: len(delays)].tolist() == list(range(len(delays)))


def record(setpoints: list[int], frames: list[tuple[int, bytes]]) -> Recorder:
    recorder = Recorder(1)
    came = list(frames)
    for window, setpoint in enumerate(setpoints):
        recorder.sync(10.0 + window * 1e-3, 100 + window, setpoint)
        while came and came[0][0] == window:
            recorder.frames[0].append((recorder.window, 10.0 + window * 1e-3 + 2e-4, came.pop(0)[1]))
    return recorder


def test_rows_begin_with_the_first_setpoint_and_keep_their_sync_count() -> None:
    recorder = record([-1, -1, 0, 1, 2, -1], [(w, bytes([w])) for w in range(6)])
    samples = arrange(recorder, 3)
    assert samples.sync_count.tolist() == [102, 103, 104]
    assert samples.frames == ((b"\x02", b"\x03", b"\x04"),)
    assert samples.receive_time_s == pytest.approx([10.0022, 10.0032, 10.0042])
    assert samples.lost.size == 0


def test_a_motion_that_breaks_off_has_the_rows_that_were_played() -> None:
    recorder = record([-1, 0, 1], [(w, bytes([w])) for w in range(3)])
    assert arrange(recorder, 100).setpoint.tolist() == [0, 1]
    assert recorder.played == 2


def test_a_lost_row_has_no_time_and_is_listed() -> None:
    samples = arrange(record([0, 1, 2], [(0, b"a"), (2, b"c")]), 3)
    assert samples.lost.tolist() == [1]
    assert np.isnan(samples.receive_time_s[1])
    assert samples.frames == ((b"a", None, b"c"),)


def test_timing_is_the_deviation_of_intervals_from_their_mean() -> None:
    even = measure_timing("kernel", 1e-3, 5.0 + 1.01e-3 * np.arange(1000))
    assert even.period_s == pytest.approx(1.01e-3)
    assert even.max_s < 1e-9
    alternating = measure_timing("thread", 1e-3, np.cumsum(np.where(np.arange(1001) % 2, 0.9e-3, 1.1e-3)))
    assert alternating.rms_s == pytest.approx(1e-4, rel=1e-2)
