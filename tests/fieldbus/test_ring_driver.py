"""The whole driver on the kernel's ring in simulated time, with the bench's drive: what it plays, and how it stops."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count

import can
import numpy as np
import pytest
from stepped_broadcast import Seen, SteppedBroadcast

from schwung.clock import clock_of
from schwung.errors import StateError
from schwung.fieldbus import cia402
from schwung.fieldbus.canopen import CanopenDrive, cyclic
from schwung.fieldbus.canopen.kernel import KernelProducer
from schwung.fieldbus.drive import Acquisition, ParameterValue, Setpoints
from schwung.fieldbus.profile import load_profile
from schwung_sim.bench import Bench
from schwung_sim.drives.power import Power

NODE, RATE_HZ, LATENCY_S = 5, 1000.0, 23e-6
STAY_IN_QUICK_STOP = 6  # of 605A: one enabling frame would lead straight back to Operation enabled
_channels = count()


@contextmanager
def enabled(monkeypatch: pytest.MonkeyPatch, clock: str) -> Iterator[tuple[Bench, CanopenDrive, Seen]]:
    """Bench, driver in Operation enabled, and a third end of the wire that listens."""
    buses: list[can.BusABC] = []

    def bus(channel: str) -> can.BusABC:
        buses.append(can.Bus(interface="stepped", channel=channel))
        return buses[-1]

    def opened(channel: str) -> SteppedBroadcast:
        kernel = bus(channel)
        return SteppedBroadcast(clock_of(kernel), kernel, LATENCY_S)  # type: ignore[arg-type]  # it is stepped

    monkeypatch.setattr(cyclic, "KernelProducer", partial(KernelProducer, open_broadcast=opened))
    with Bench("two-mass", channel=f"ring-{next(_channels)}", node_id=NODE, clock=clock) as bench:  # type: ignore[arg-type]
        ear = bus(bench.channel)
        seen = Seen(clock_of(ear), ear, 0x200 + NODE, {})  # type: ignore[arg-type]
        drive = CanopenDrive(bus(bench.channel), NODE, load_profile("schwung-bench"), sync="kernel")
        try:
            acquisition = Acquisition("csp", RATE_HZ)
            drive.write(drive.setup(acquisition))
            drive.start(acquisition)
            drive.enable()
            yield bench, drive, seen
        finally:
            drive.close()
            for each in buses:
                each.shutdown()


def stroke(length: int) -> Setpoints:
    """There and back over 1 rad, with a torque that is known when it comes back."""
    phase = 2 * np.pi * np.arange(length) / (length - 1)
    torque = 5 * np.sin(20 * phase)
    return Setpoints(RATE_HZ, (1 - np.cos(phase)) / 2, torque)


BENCHES = pytest.mark.parametrize("clock", ["wall", "sync"])


@BENCHES
def test_a_motion_of_many_rings_is_recorded_with_the_setpoints_that_held(
    monkeypatch: pytest.MonkeyPatch, clock: str
) -> None:
    setpoints = stroke(800)
    with enabled(monkeypatch, clock) as (_, drive, seen):
        recording = drive.play(setpoints)
        resolution = drive.resolution()
        drive.disable()
        drive.stop()
    assert recording.timing.producer == "kernel"
    assert recording.lost.size == 0
    assert recording.notes == ()
    assert recording.timing.period_s == pytest.approx(1 / RATE_HZ, rel=1e-3)
    assert recording.position_demand_rad == pytest.approx(setpoints.position_rad, abs=resolution.position_rad)
    assert recording.torque_added_nm == pytest.approx(setpoints.torque_added_nm, abs=0.2)
    assert np.max(np.abs(recording.position_rad - recording.position_demand_rad)) < 0.02
    assert np.ptp(np.diff(seen.sync_s)) < 1e-3, "SYNC had a gap"
    assert set(np.diff([counter[0] for counter in seen.counters])) == {1, -127}


@BENCHES
def test_a_halt_is_the_last_frame_that_went_out_and_nothing_undoes_it(
    monkeypatch: pytest.MonkeyPatch, clock: str
) -> None:
    with enabled(monkeypatch, clock) as (bench, drive, seen):
        drive.write([ParameterValue(drive.parameter(0x605A), STAY_IN_QUICK_STOP)])
        drive.clock.later(0.3, drive.halt)
        with pytest.raises(StateError, match="stopped on request"):
            drive.play(stroke(1000))
        drive.clock.sleep(0.5)
        assert bench.servo.power.state is Power.QUICK_STOP_ACTIVE
        for again in (drive.enable, lambda: drive.play(stroke(100))):
            with pytest.raises(StateError, match="stopped on request"):
                again()
        words = [int.from_bytes(frame[:2], "little") for frame in seen.rpdos]
        stop = words.index(cia402.QUICK_STOP)
        assert not any(cia402.enables_operation(word) for word in words[stop:])
        assert {frame[2:6] for frame in seen.rpdos[stop:]} == {seen.rpdos[stop - 1][2:6]}
        drive.disable()
        assert bench.servo.power.state is Power.SWITCH_ON_DISABLED


@pytest.mark.parametrize("after_s", np.arange(0.3, 0.302, 0.0001).round(4))
def test_the_frame_that_waits_in_the_drive_for_its_sync_does_not_undo_a_stop(
    monkeypatch: pytest.MonkeyPatch, after_s: float
) -> None:
    """The ring's next frame is then a SYNC, half a period after the quick stop by SDO."""
    with enabled(monkeypatch, "wall") as (bench, drive, _):
        drive.write([ParameterValue(drive.parameter(0x605A), STAY_IN_QUICK_STOP)])
        power, states = bench.servo.power, [bench.servo.power.state]
        control = power.control

        def controlled(word: int) -> None:
            control(word)
            if power.state is not states[-1]:
                states.append(power.state)

        monkeypatch.setattr(power, "control", controlled)
        drive.clock.later(after_s, drive.halt)
        with pytest.raises(StateError, match="stopped on request"):
            drive.play(stroke(1000))
        assert states == [Power.OPERATION_ENABLED, Power.QUICK_STOP_ACTIVE]
