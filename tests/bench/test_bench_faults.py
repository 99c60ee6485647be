"""Faults on demand, seen over the bus by a master that knows nothing of them."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager

import can
import pytest
from bench_peer import NODE, Master

from schwung.clock import clock_of
from schwung_sim.bench import Bench
from schwung_sim.faults import Fault, FaultyBus, parse_faults


@contextmanager
def moving(faults: str, seed: int = 0) -> Iterator[tuple[Bench, Master]]:
    """A bench with faults, and a master in lockstep that has the drive in operation: cycles are counted."""
    with (
        Bench(channel=f"faults {faults} {seed}", faults=faults, seed=seed, clock="sync") as bench,
        Master(**bench.tool_options) as master,
    ):
        master.prepare()
        master.enable()
        yield bench, master


def cycles_until(master: Master, done: int, most: int = 400) -> int:
    """Cycles of a steady motion until the state (statusword & 0x6F) is `done`."""
    for n in range(most):
        answer = master.cycle(0x0F, 200 * n)
        if answer is not None and answer[0] & 0x4F == done & 0x4F:
            return n
    raise AssertionError("never came")


def emergencies(master: Master) -> list[int]:
    return [struct.unpack_from("<H", m.data)[0] for m in master.seen if m.arbitration_id == 0x80 + NODE]


def test_syntax() -> None:
    assert parse_faults("drop=0.01, reset@0.5,emcy=0x3210@on+0.2,sdo-abort=0x6065:0x08000020") == (
        Fault("drop", 0.01, 0x08000000, None, False),
        Fault("reset", 0, 0x08000000, 0.5, False),
        Fault("emcy", 0x3210, 0x08000000, 0.2, True),
        Fault("sdo-abort", 0x6065, 0x08000020, None, False),
    )
    assert parse_faults("") == ()


def test_emergency_on_time() -> None:
    """0.1 s after power-on; the cycle that powers it is the first, so the fault shows in the 100th after that."""
    with moving("emcy=0x4310@on+0.1") as (_, master):
        assert cycles_until(master, 0x0F) in (98, 99, 100)
        assert emergencies(master) == [0x4310]
        assert master.read(0x603F) == 0x4310


def test_following_error() -> None:
    with moving("following-error@on+0.05") as (_, master):
        master.write(0x6065, 0, 2000, 4)
        cycles_until(master, 0x0F)
        assert emergencies(master) == [0x8611]


def test_reset_shows_as_boot_up_and_silence() -> None:
    with moving("reset@on+0.02") as (bench, master):
        answers = [master.cycle(0x0F, 0, timeout_s=0.05) for _ in range(30)]
        assert answers[10] is not None
        assert answers[-1] is None
        assert any(m.arbitration_id == 0x700 + NODE and bytes(m.data) == b"\0" for m in master.seen)
        assert not bench.axis.energised


def test_heartbeat_stops_but_the_rest_goes_on() -> None:
    with moving("heartbeat-stop@on+0.05") as (_, master):
        master.write(0x1017, 0, 10, 2)
        assert master.wait_for(0x700 + NODE, timeout_s=0.5)
        for n in range(100):
            assert master.cycle(0x0F, n) is not None
        master.wait_for(0x700 + NODE, timeout_s=0.05)  # one may have been under way
        assert not master.wait_for(0x700 + NODE, timeout_s=0.1)


def test_sdo_abort_and_time_out() -> None:
    faults = "sdo-abort=0x6065:0x08000021,sdo-timeout=0x6066"
    with Bench(channel="sdo", faults=faults) as bench, Master(**bench.tool_options) as master:
        with pytest.raises(PermissionError, match="0x08000021"):
            master.read(0x6065)
        with pytest.raises(TimeoutError):
            master.read(0x6066, timeout_s=0.1)
        assert master.read(0x6067) == 2000


def test_bus_off_of_the_drive_is_silence_and_a_stop() -> None:
    with moving("bus-off@on+0.03") as (bench, master):
        answers = [master.cycle(0x0F, 200 * n, timeout_s=0.05) for n in range(60)]
        assert answers[20] is not None
        assert answers[-1] is None
        master.wait_for(timeout_s=0.1)
        assert bench.servo.power.state.name in ("FAULT", "FAULT_REACTION_ACTIVE")  # 6007 is 1 by default


def test_second_master_takes_the_drive_out_of_operation() -> None:
    with moving("second-master=0x06@on+0.03") as (_, master):
        assert cycles_until(master, 0x21) in range(25, 35)
        requests = [bytes(m.data) for m in master.seen if m.arbitration_id == 0x600 + NODE]
        assert requests[0] == bytes.fromhex("2b40600006000000")  # everyone can see who it was


def test_dropped_frames_are_repeatable_and_as_many_as_asked() -> None:
    def arrived(seed: int) -> list[int]:
        with can.Bus(interface="stepped", channel="drop") as far:
            bus = FaultyBus(can.Bus(interface="stepped", channel="drop"), drop=0.02, seed=seed)
            try:
                for n in range(2000):
                    bus.send(can.Message(arbitration_id=n, is_extended_id=False))
                there = [n.arbitration_id for n in iter(lambda: far.recv(1.0), None)]
                for n in there:
                    far.send(can.Message(arbitration_id=n, is_extended_id=False))
                clock_of(far).sleep(1.0)
                return [m.arbitration_id for m in (bus.recv(0) for _ in there) if m is not None]
            finally:
                bus.shutdown()

    first = arrived(1)
    assert 1880 < len(first) < 1960  # two in a hundred lost on the way there, two on the way back
    assert arrived(1) == first
    assert arrived(2) != first


def test_dropped_frames_leave_gaps_that_a_master_can_see() -> None:
    with moving("drop=0.1@on+0.01", seed=1) as (_, master):
        answers = [master.cycle(0x0F, 0, timeout_s=0.02) for _ in range(100)]
        assert None in answers
        assert sum(answer is not None for answer in answers) > 50


def test_late_sync_is_still_one_period() -> None:
    with moving("jitter=0.002") as (bench, master):
        clock = clock_of(master.bus)
        started, at = clock.now(), bench.axis.time_s
        for n in range(50):
            assert master.cycle(0x0F, 0) is not None, n
        assert bench.axis.time_s - at == pytest.approx(0.05)
        assert clock.now() - started > 0.025  # 50 delays of 1 ms on the average


def test_bus_off_of_a_tool() -> None:
    with can.Bus(interface="stepped", channel="tool") as inner:
        bus = FaultyBus(inner, bus_off_after=3)
        message = can.Message(arbitration_id=0x80, is_extended_id=False)
        for _ in range(3):
            bus.send(message)
        with pytest.raises(can.CanOperationError, match="bus-off"):
            bus.send(message)
        with pytest.raises(can.CanOperationError, match="bus-off"):
            bus.recv(0.01)
        bus.shutdown()


def test_killed_master_leaves_a_drive_that_stops_by_itself() -> None:
    with Bench(channel="killed") as bench:
        with Master(**bench.tool_options) as master:
            master.write(0x6007, 0, 3, 2)
            master.write(0x605A, 0, 6, 2)
            master.write(0x1016, 1, 0x007F0096, 4)  # node 127, 150 ms
            master.prepare()
            master.send(0x77F, b"\x05")
            master.enable()
            for n in range(100):
                assert master.cycle(0x0F, 1500 * n) is not None
            assert abs(bench.axis.speed_rad_s) > 5
        assert bench.servo.settle(5.0)
        assert bench.servo.power.state.name == "QUICK_STOP_ACTIVE"
        assert abs(bench.axis.speed_rad_s) < 0.5
