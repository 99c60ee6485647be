"""The driver's kernel producer on the real broadcast manager: a bench in another process, setpoints from a ring."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from schwung.fieldbus.canopen import BusOptions, CanopenDrive, open_bus
from schwung.fieldbus.drive import Acquisition, Recording, Setpoints, Sine
from schwung.fieldbus.profile import load_profile

pytestmark = pytest.mark.vcan

RATE_HZ = 200.0
Measured = Callable[[str, str], None]

#: By the bench's clock; one bench for all tests of the same.
ON_THE_WALL = pytest.mark.parametrize("bench_channel", ["wall"], indirect=True)
BY_SYNC = pytest.mark.parametrize("bench_channel", ["sync"], indirect=True)


@contextmanager
def enabled(
    channel: str, rate_hz: float, sync: str, acquisition: Acquisition | None = None
) -> Iterator[CanopenDrive]:
    bus = open_bus(BusOptions("socketcan", channel))
    profile = load_profile("schwung-bench")
    drive = CanopenDrive(bus, 5, profile, sync=sync, sdo_timeout_s=2.0)  # type: ignore[arg-type]  # a literal
    try:
        acquisition = acquisition or Acquisition("csp", rate_hz, heartbeat_s=0.5)
        drive.write(drive.setup(acquisition))
        drive.start(acquisition)
        drive.enable()
        yield drive
        drive.disable()
    finally:
        drive.close()
        bus.shutdown()


def stroke(count: int, rate_hz: float) -> Setpoints:
    phase = 2 * np.pi * np.arange(count) / (count - 1)
    return Setpoints(rate_hz, 0.5 * (1 - np.cos(phase)) / 2, np.zeros(count))


def figures(recording: Recording) -> str:
    t = recording.timing
    jitter = ", ".join(
        f"{name} {x * 1e6:.0f} µs" for name, x in (("rms", t.rms_s), ("p99", t.p99_s), ("max", t.max_s))
    )
    count, lost = recording.position_rad.size, recording.lost.size
    return f"{t.producer}: {count} samples, {lost} lost, period {t.period_s * 1e3:.4f} ms, {jitter}; {recording.notes}"


@pytest.mark.parametrize(
    ("bench_channel", "sync"), [("wall", "auto"), ("sync", "kernel")], indirect=["bench_channel"]
)
def test_a_motion_longer_than_the_ring_is_played_by_the_kernel(
    bench_channel: str, sync: str, measured: Measured
) -> None:
    with enabled(bench_channel, RATE_HZ, sync) as drive:
        setpoints = stroke(600, RATE_HZ)
        recording = drive.play(setpoints)
    measured(f"motion at {RATE_HZ:g} Hz, SYNC {sync}", figures(recording))
    assert recording.timing.producer == "kernel"
    assert recording.position_rad.size == 600
    assert recording.lost.size <= 6
    assert recording.timing.period_s == pytest.approx(1 / RATE_HZ, rel=0.02)
    assert recording.position_demand_rad == pytest.approx(setpoints.position_rad, abs=0.01)
    good = np.isfinite(recording.position_rad)
    assert np.max(np.abs((recording.position_rad - recording.position_demand_rad)[good])) < 0.02


@BY_SYNC
def test_lockstep_over_the_kernels_bus_loses_nothing(bench_channel: str, measured: Measured) -> None:
    with enabled(bench_channel, 1000.0, "auto") as drive:
        recording = drive.play(stroke(1000, 1000.0))
    measured("motion at 1 kHz, lockstep", figures(recording))
    assert recording.timing.producer == "lockstep"
    assert recording.lost.size == 0
    assert np.max(np.abs(recording.position_rad - recording.position_demand_rad)) < 0.02


@pytest.mark.timeout(240)
@ON_THE_WALL
def test_the_drives_trace_starts_with_the_motion_that_the_kernel_plays(
    bench_channel: str, measured: Measured
) -> None:
    """In real time: the trace's row 0 is the motion's start on the drive's clock, whenever our frames came."""
    way = Acquisition(
        "csp",
        RATE_HZ,
        heartbeat_s=0.5,
        sampling="trace",
        injecting="generator",
        trace_rate_hz=1000.0,
        trace_s=1.0,
    )
    rest = np.zeros(40)
    path = np.concatenate([rest, stroke(200, RATE_HZ).position_rad])
    with enabled(bench_channel, RATE_HZ, "kernel", way) as drive:
        recording = drive.play(Setpoints(RATE_HZ, path, np.zeros(path.size), generator=Sine(50.0, 20.0)))
        assert drive.read(drive.parameter(0x2100, 4)).raw == 0
    assert recording.sampling == "trace"
    assert recording.lost.size == 0
    due = np.arange(path.size) / RATE_HZ
    worst = recording.timing.max_s  # as unevenly as SYNC came, so do setpoints
    time = recording.start_s + np.arange(recording.position_rad.size) / 1000.0
    off = recording.position_demand_rad - np.interp(time, due, path)
    first = time < recording.start_s + 0.05
    measured(
        "trace over vcan", f"{recording.position_rad.size} rows, demand off by {np.max(np.abs(off)):.1e} rad"
    )
    assert (
        np.max(np.abs(off[first])) < 2e-3 + 0.5 * worst
    )  # at up to 0.5 rad/s: a setpoint's time off would be more
    assert np.ptp(recording.torque_added_nm) == pytest.approx(40.0, rel=0.05)
