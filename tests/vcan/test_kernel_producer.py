"""The driver's kernel producer on the real broadcast manager: a bench in another process, setpoints from a ring."""

from __future__ import annotations

import subprocess
import sys
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


@contextmanager
def bench_process(channel: str, clock: str) -> Iterator[None]:
    script = f"""
from schwung_sim.bench import Bench
Bench("two-mass", interface="socketcan", channel="{channel}", clock="{clock}", node_id=5).run_forever(120)
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert "bench ready" in line, line
            yield
        finally:
            process.terminate()


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
    ("clock", "rate_hz", "sync"), [("wall", RATE_HZ, "auto"), ("sync", RATE_HZ, "kernel")]
)
def test_a_motion_longer_than_the_ring_is_played_by_the_kernel(
    clock: str, rate_hz: float, sync: str, vcan_channel: str, measured: Measured
) -> None:
    with bench_process(vcan_channel, clock), enabled(vcan_channel, rate_hz, sync) as drive:
        setpoints = stroke(600, rate_hz)
        recording = drive.play(setpoints)
    measured(f"motion at {rate_hz:g} Hz, {clock} clock", figures(recording))
    assert recording.timing.producer == "kernel"
    assert recording.position_rad.size == 600
    assert recording.lost.size <= 6
    assert recording.timing.period_s == pytest.approx(1 / rate_hz, rel=0.02)
    assert recording.position_demand_rad == pytest.approx(setpoints.position_rad, abs=0.01)
    good = np.isfinite(recording.position_rad)
    assert np.max(np.abs((recording.position_rad - recording.position_demand_rad)[good])) < 0.02


def test_lockstep_over_the_kernels_bus_loses_nothing(vcan_channel: str, measured: Measured) -> None:
    with bench_process(vcan_channel, "sync"), enabled(vcan_channel, 1000.0, "auto") as drive:
        recording = drive.play(stroke(1000, 1000.0))
    measured("motion at 1 kHz, lockstep", figures(recording))
    assert recording.timing.producer == "lockstep"
    assert recording.lost.size == 0
    assert np.max(np.abs(recording.position_rad - recording.position_demand_rad)) < 0.02


@pytest.mark.timeout(240)
def test_the_drives_trace_starts_with_the_motion_that_the_kernel_plays(
    vcan_channel: str, measured: Measured
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
    with bench_process(vcan_channel, "wall"), enabled(vcan_channel, RATE_HZ, "kernel", way) as drive:
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
