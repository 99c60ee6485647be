"""The driver's kernel producer on the real broadcast manager: a bench in another process, setpoints from a ring."""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import can
import numpy as np
import pytest

from schwung.commissioning.ways import comes_unevenly
from schwung.errors import DriveError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import BusOptions, CanopenDrive, open_bus
from schwung.fieldbus.canopen.exchange import SYNC_ID
from schwung.fieldbus.canopen.kernel import GUARD_S
from schwung.fieldbus.drive import Acquisition, ParameterValue, Recording, Setpoints, Sine
from schwung.fieldbus.profile import load_profile

pytestmark = pytest.mark.vcan

RATE_HZ = 200.0
#: How often a motion in real time is tried on a computer that gives it none.
GOES = 3
RPDO = 0x205
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


def _plays_more_than_the_ring_holds(bench_channel: str, sync: str, measured: Measured) -> None:
    """What comes in real time is the computer's to give: a go in which it did not, by the tool's own times, and so does
    not keep the rate, is told and repeated."""
    for _ in range(GOES):
        with enabled(bench_channel, RATE_HZ, sync) as drive:
            setpoints = stroke(600, RATE_HZ)
            recording = drive.play(setpoints)
        measured(f"motion at {RATE_HZ:g} Hz, SYNC {sync}", figures(recording))
        assert recording.timing.producer == "kernel"
        assert recording.position_rad.size == 600
        if recording.timing.period_s == pytest.approx(1 / RATE_HZ, rel=0.02):
            break
        assert comes_unevenly(recording.timing)
        assert any("SYNC came at" in note for note in recording.notes)
    else:
        pytest.skip(f"{GOES} times this computer was too uneven for {RATE_HZ:g} Hz")
    assert recording.lost.size <= 6
    assert recording.position_demand_rad == pytest.approx(setpoints.position_rad, abs=0.01)
    good = np.isfinite(recording.position_rad)
    assert np.max(np.abs((recording.position_rad - recording.position_demand_rad)[good])) < 0.02


@ON_THE_WALL
def test_a_motion_longer_than_the_ring_is_played_by_the_kernel(
    bench_channel: str, measured: Measured
) -> None:
    _plays_more_than_the_ring_holds(bench_channel, "auto", measured)


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


FAST_HZ = 250.0  # the most for which one processor of user-mode-linux has time to spare
LONG = 1000  # setpoints, of which it is stopped at some hundredth rad
STAY_IN_QUICK_STOP = 6  # of 605A: an enabling controlword would lead straight back to Operation enabled


def _play_for_long(channel: str, told: Connection) -> None:
    """The tool, in a process of its own, which will be stopped while it plays; tells what it ended with."""
    acquisition = Acquisition("csp", FAST_HZ, heartbeat_s=1.0)  # the drive waits for three
    try:
        with enabled(channel, FAST_HZ, "auto", acquisition) as drive:
            # setting up makes it 2
            drive.write([ParameterValue(drive.parameter(0x605A), STAY_IN_QUICK_STOP)])
            way, here_rad = stroke(LONG, FAST_HZ), drive.state().position_rad
            drive.play(dataclasses.replace(way, position_rad=here_rad + way.position_rad))
        told.send("its motion is over")
    except DriveError as error:
        told.send(str(error))
    os._exit(0)


def _set_option(channel: str, value: int) -> float:
    """605A; returns the position's resolution (rad)."""
    bus = open_bus(BusOptions("socketcan", channel))
    with contextlib.closing(CanopenDrive(bus, 5, load_profile("schwung-bench"), sdo_timeout_s=2.0)) as drive:
        drive.write([ParameterValue(drive.parameter(0x605A), value)])
        resolution_rad = drive.resolution().position_rad
    bus.shutdown()
    return resolution_rad


class Heard:
    """All that goes over the bus, from one tool's start on: what is lost here looks like what nobody sent."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.frames: list[can.Message] = []

    @property
    def sent(self) -> list[can.Message]:
        """RPDOs."""
        return [m for m in self.frames if m.arbitration_id == RPDO]

    def until(
        self, wanted: Callable[[can.Message], bool], for_s: float, of: Connection | None = None
    ) -> bool:
        """Listens until such a frame comes; not beyond `for_s`, nor beyond what a tool says at its end."""
        end = time.monotonic() + for_s
        while time.monotonic() < end and not (of and of.poll()):
            message = self._bus.recv(0.05)
            if message is not None:
                self.frames.append(message)
                if wanted(message):
                    return True
        return False


def _hangs_while_it_plays(channel: str, heard: Heard, way: int) -> tuple[float, float, bool] | str:
    """When the tool hung, `way` counts after it began, and was back (s), and whether it switched the drive off then;
    else what it ended with before it could be made to hang."""
    context = multiprocessing.get_context("spawn")  # its own pages, as a tool has: none copied while it plays
    told, telling = context.Pipe(duplex=False)
    tool = context.Process(target=_play_for_long, args=(channel, telling))
    tool.start()
    assert tool.pid is not None
    try:
        if not heard.until(
            lambda m: m.arbitration_id == RPDO and _target(m) - _target(heard.sent[0]) > way, 60, told
        ):
            return str(told.recv()) if told.poll() else "nothing moved within 60 s"
        os.kill(tool.pid, signal.SIGSTOP)
        hung_s = time.time()
        heard.until(lambda _m: False, 1.0)
        back_s = time.time()
        os.kill(tool.pid, signal.SIGCONT)
        switched_off = heard.until(lambda m: m.arbitration_id == RPDO and _word(m) == 0, 20)
        tool.join(20)
        # What it told to stop itself goes out at once, and without end: the guard comes later, then silence.
        stopped = any(_word(m) == cia402.QUICK_STOP for m in heard.sent if m.timestamp < hung_s + GUARD_S)
        return (
            (str(told.recv()) if told.poll(1) else "it told nothing")
            if stopped
            else (hung_s, back_s, switched_off)
        )
    finally:
        tool.kill()
        tool.join()


@ON_THE_WALL
def test_a_program_that_hangs_for_a_second_leaves_a_drive_that_stays_stopped(
    bench_channel: str, open_bus_on: Callable[[str], can.BusABC], measured: Measured
) -> None:
    """Two operations that slid, and a ring that went round: that one enabled the drive anew, half a turn back.

    A computer that is busy may stop the program before it hangs, as it should: that is told, and tried again, from
    where the axis stands."""
    for _ in range(GOES):
        resolution_rad = _set_option(bench_channel, STAY_IN_QUICK_STOP)
        heard = Heard(open_bus_on(bench_channel))
        went = _hangs_while_it_plays(bench_channel, heard, round(0.01 / resolution_rad))
        if not isinstance(went, str):
            break
        measured("a program that ended before it hung", went)
        assert "this program was held up" in went  # that is the computer's to avoid, all else is ours
    else:
        pytest.skip(f"{GOES} times it had ended before it could be made to hang, the last time since: {went}")
    hung_s, back_s, switched_off = went
    frames, sent = heard.frames, heard.sent
    _set_option(bench_channel, 2)
    stop = next(i for i, m in enumerate(sent) if _word(m) == cia402.QUICK_STOP)
    assert [m for m in sent[stop:] if _word(m) & 0x0F == 0x0F] == [], "a stop was undone"
    targets = np.array([_target(m) for m in sent[:stop]])
    went_by = targets[np.argmax(targets - targets[0] > 0.001 / resolution_rad) :]
    due = targets[0] + np.rint(stroke(LONG, FAST_HZ).position_rad / resolution_rad)
    first = np.argmin(np.abs(due[: LONG // 2] - went_by[0]))
    off = due[first : first + went_by.size] - went_by
    # The axis may stand a count beside what was held.
    assert np.ptp(off) <= 1, "a stretch was repeated, or left out"
    assert _target(sent[stop]) == targets[-1]
    silent = [m for m in frames if sent[stop].timestamp + 0.05 < m.timestamp < back_s]
    assert [m for m in silent if m.arbitration_id in (RPDO, SYNC_ID)] == []
    states = [
        cia402.decode(int.from_bytes(m.data[:2], "little"))
        for m in frames
        if m.arbitration_id == 0x185 and m.timestamp > sent[stop].timestamp + 0.01
    ]
    assert cia402.State.QUICK_STOP_ACTIVE in states
    assert cia402.State.OPERATION_ENABLED not in states
    assert switched_off, "once it was back, it did not switch the drive off"
    measured("a program that hung", f"quick stop {sent[stop].timestamp - hung_s:.3f} s later, then silence")


def _word(message: can.Message) -> int:
    return int.from_bytes(message.data[:2], "little")


def _target(message: can.Message) -> int:
    return int.from_bytes(message.data[2:6], "little", signed=True)


@BY_SYNC
def test_a_drive_whose_time_is_sync_is_played_to_by_the_kernel_just_as_well(
    bench_channel: str, measured: Measured
) -> None:
    _plays_more_than_the_ring_holds(bench_channel, "kernel", measured)


@BY_SYNC
def test_lockstep_over_the_kernels_bus_loses_nothing(bench_channel: str, measured: Measured) -> None:
    with enabled(bench_channel, 1000.0, "auto") as drive:
        recording = drive.play(stroke(1000, 1000.0))
    measured("motion at 1 kHz, lockstep", figures(recording))
    assert recording.timing.producer == "lockstep"
    assert recording.lost.size == 0
    assert np.max(np.abs(recording.position_rad - recording.position_demand_rad)) < 0.02
