"""What is asked of a trace buffer, and what its rows become."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from schwung.errors import InputError
from schwung.fieldbus.drive import Move, Setpoints, Sine, SyncTiming
from schwung.fieldbus.profile import Trace
from schwung.fieldbus.tracing import (
    TraceRequest,
    column_scale,
    motion_index,
    recording_of,
    sine_torque,
    trace_request,
)
from schwung.fieldbus.units import Scales

TIMING = SyncTiming("lockstep", 1e-3, 0.0, 0.0, 0.0)
SCALES = Scales(2.0, 3.0, 5.0, float("nan"), 7.0, None)


def a_trace(**changes: Any) -> Trace:
    return Trace.model_validate({
        "base_rate_hz": 8000, "divider": "2200:01", "length": "2200:02", "max_samples": 4000,
        "control": {"object": "2200:03", "arm": 1}, "status": {"object": "2200:03", "full": 3},
        "trigger": "motion_start", "data": "2200:04", "columns": [{"quantity": "position", "type": "INTEGER32"}],
    } | changes)  # fmt: skip


@pytest.mark.parametrize(
    ("duration_s", "wanted_hz", "rate_hz", "rows"),
    [
        (0.4, None, 8000.0, 3201),
        (0.499875, None, 8000.0, 4000),  # the buffer is full to the last row
        (0.5, None, 4000.0, 2001),
        (2.0, None, 8000 / 5, 3201),
        (0.4, 1000.0, 1000.0, 401),
        (0.4, 8000 / 3, 8000 / 3, 1067),
    ],
)
def test_the_trace_is_as_fast_as_it_holds_the_motion_or_as_was_asked(
    duration_s: float, wanted_hz: float | None, rate_hz: float, rows: int
) -> None:
    found = trace_request(a_trace(), duration_s, wanted_hz)
    assert found.rate_hz == pytest.approx(rate_hz)
    assert found.divider == round(8000 / rate_hz)
    assert found.rows == rows <= 4000


def test_a_rate_that_cannot_be_is_refused_with_those_that_can() -> None:
    with pytest.raises(InputError, match=r"3000 Hz .* 8000 Hz.*2666\.67, 4000"):
        trace_request(a_trace(), 0.1, 3000.0)
    with pytest.raises(InputError, match=r"Take 8000 Hz"):
        trace_request(a_trace(divider=None), 0.1, 4000.0)


def test_a_motion_that_the_buffer_does_not_hold_is_refused() -> None:
    with pytest.raises(InputError, match=r"4000 samples, 0\.5 s of 1 s.*--trace-rate"):
        trace_request(a_trace(), 1.0, 8000.0)
    with pytest.raises(InputError, match="shorter motion"):
        trace_request(a_trace(divider=None), 1.0)


def test_the_motion_starts_where_the_demand_leaves_rest_or_with_the_first_move() -> None:
    still = np.zeros(6)
    setpoints = Setpoints(1000.0, still, still)
    assert motion_index(np.array([7, 7, 7, 8, 9, 9]), setpoints) == 2
    moves = (Move(4, 1.0, 1.0, 1.0), Move(5, 0.0, 1.0, 1.0))
    assert motion_index(np.array([7, 7, 8, 8, 8, 8]), Setpoints(1000.0, still, still, moves)) == 4
    with pytest.raises(InputError, match="do not move"):
        motion_index(np.full(6, 7), setpoints)


def test_rows_that_did_not_come_are_lost_and_not_bridged() -> None:
    columns = {"position": np.arange(3.0), "torque": np.arange(4.0)}
    found = recording_of(columns, TraceRequest(8000.0, 1, 5), 0.1, TIMING, notes=("before",))  # type: ignore[arg-type]
    assert found.lost.tolist() == [3, 4]
    assert np.array_equal(np.isnan(found.position_rad), [False, False, False, True, True])
    assert np.array_equal(np.isnan(found.torque_nm), [False, False, False, True, True])
    assert np.all(np.isnan(found.speed_rad_s))  # no such column
    assert np.all(np.isnan(found.torque_added_nm))  # nobody knows
    assert (found.sampling, found.start_s, found.sample_rate_hz) == ("trace", 0.1, 8000.0)
    assert found.notes == ("before", "the trace holds 3 of 5 samples")


def test_what_is_known_to_be_injected_goes_before_what_the_trace_says() -> None:
    columns = {"position": np.zeros(3), "torque_added": np.full(3, 9.0)}
    request = TraceRequest(8000.0, 1, 3)
    traced = recording_of(columns, request, 0.0, TIMING)  # type: ignore[arg-type]
    known = recording_of(columns, request, 0.0, TIMING, np.array([1.0, 2.0, 3.0]))  # type: ignore[arg-type]
    assert traced.torque_added_nm.tolist() == [9.0, 9.0, 9.0]
    assert known.torque_added_nm.tolist() == [1.0, 2.0, 3.0]


def test_an_added_torque_that_is_not_exchanged_counts_as_the_torque_does() -> None:
    names = ("position", "position_demand", "speed", "torque", "torque_added")
    assert [column_scale(name, SCALES) for name in names] == [2.0, 2.0, 3.0, 5.0, 5.0]  # type: ignore[arg-type]


def test_the_generators_sine_begins_at_its_phase() -> None:
    sine = Sine(50.0, 2.0, np.pi / 2)
    assert sine_torque(sine, np.array([0.0, 0.005, 0.01])) == pytest.approx([2.0, 0.0, -2.0], abs=1e-12)
