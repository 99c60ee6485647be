"""A side that stalls, is interrupted or killed, while everybody else on its clock goes on."""

from __future__ import annotations

import can
import pytest

from schwung.clock import SteppedClock, Wire, clock_of
from schwung_sim.campaign.draw import Incident
from schwung_sim.campaign.points import Points
from schwung_sim.campaign.side import Killed, Overdue, Side, SideBus


def frame(number: int) -> can.Message:
    return can.Message(arbitration_id=0x100 + number, is_extended_id=False)


def test_a_side_is_the_clock_of_its_bus() -> None:
    clock = SteppedClock()
    side = Side(clock)
    with SideBus(Wire(clock).bus(), side) as bus:
        assert clock_of(bus) is side


def test_what_a_side_asked_for_is_put_off_in_order_while_it_stalls_and_others_go_on() -> None:
    clock = SteppedClock()
    side, others, own = Side(clock), list[float](), list[str]()
    wire = Wire(clock)
    with SideBus(wire.bus(), side) as bus, wire.bus() as other:
        side.read(
            bus, lambda m: own.append(f"frame {m.arbitration_id - 0x100} {clock.now():.3f}"), pytest.fail
        )
        side.later(0.015, lambda: own.append(f"timer {clock.now():.3f}"))
        clock.every(0.010, lambda: others.append(clock.now()))
        clock.later(0.005, lambda: side.stall(0.1))
        for number in (1, 2, 3):
            clock.later(0.010 * number, lambda number=number: other.send(frame(number)))
        side.sleep(0.02)
        assert clock.now() == pytest.approx(0.105)
    assert own == ["frame 1 0.105", "timer 0.105", "frame 2 0.105", "frame 3 0.105"]
    assert len(others) == 11


def test_who_was_held_up_may_hear_first_what_came_meanwhile() -> None:
    clock = SteppedClock()
    side, own = Side(clock), list[str]()
    wire = Wire(clock)
    with SideBus(wire.bus(), side) as bus, wire.bus() as other:
        reader = side.read(bus, lambda m: own.append(f"frame {m.arbitration_id - 0x100}"), pytest.fail)

        def beat() -> None:
            own.append("late")
            reader.catch_up()
            own.append("beat")

        side.later(0.015, beat)
        clock.later(0.005, lambda: side.stall(0.1))
        for number in (1, 2, 3):
            clock.later(0.010 * number, lambda number=number: other.send(frame(number)))
        clock.later(0.12, lambda: other.send(frame(4)))
        side.sleep(0.2)
    assert own == ["frame 1", "late", "frame 2", "frame 3", "beat", "frame 4"]


def test_a_beat_that_stalled_is_caught_up_with_by_half_a_period_each_time() -> None:
    clock = SteppedClock()
    side, beats = Side(clock), list[float]()
    side.every(0.01, lambda: beats.append(round(clock.now(), 6)))
    clock.later(0.015, lambda: side.stall(0.03))
    side.sleep(0.085)
    assert beats == [0.0, 0.01, 0.045, 0.05, 0.06, 0.07, 0.08]


def test_sending_takes_as_long_as_the_stall_that_comes_with_it() -> None:
    clock = SteppedClock()
    side = Side(clock)
    with SideBus(Wire(clock).bus(), side) as bus:
        side.stall(0.2)
        bus.send(frame(0))
    assert clock.now() == pytest.approx(0.2)


def test_an_interrupt_reaches_the_main_flow_and_nothing_that_is_called_back() -> None:
    clock = SteppedClock()
    side, reached = Side(clock), list[str]()

    def called_back() -> None:
        side.interrupt()
        side.sleep(0.01)  # as another thread would, which no signal disturbs
        reached.append("called back")

    side.later(0.01, called_back)
    with pytest.raises(KeyboardInterrupt):
        side.sleep(1.0)
    assert reached == ["called back"]
    assert clock.now() == pytest.approx(0.02)


def test_nothing_of_a_killed_side_runs_and_no_cleaning_up_helps() -> None:
    clock = SteppedClock()
    side, own = Side(clock), list[float]()
    with SideBus(Wire(clock).bus(), side) as bus:
        side.every(0.01, lambda: own.append(clock.now()))
        clock.later(0.025, side.kill)
        with pytest.raises(Killed):
            side.sleep(1.0)
        with pytest.raises(Killed):
            bus.send(frame(0))
        clock.sleep(1.0)
    assert own == [0.0, 0.01, 0.02]


def test_a_side_that_waits_for_ever_is_found_out() -> None:
    side = Side(SteppedClock(), overdue_s=5.0)
    side.sleep(4.0)
    with pytest.raises(Overdue):
        side.sleep(2.0)


def test_an_adapter_that_is_bus_off_or_full() -> None:
    clock = SteppedClock()
    wire = Wire(clock)
    with SideBus(wire.bus(), Side(clock)) as bus, wire.bus() as other:
        bus.buffer_full = True
        with pytest.raises(can.CanOperationError, match="buffer"):
            bus.send(frame(0))
        bus.buffer_full, bus.bus_off = False, True
        with pytest.raises(can.CanOperationError, match="bus-off"):
            bus.send(frame(0))
        bus.bus_off = False
        bus.send(frame(1))
        clock.sleep(0.01)
        assert [m.arbitration_id for m in other.waiting] == [0x101]


@pytest.mark.parametrize(("calm_s", "befallen"), [(0.25, ["kill"]), (2.0, ["kill", "sdo-abort"])])
def test_what_follows_an_incident_does_not_befall_whoever_clears_up(
    calm_s: float, befallen: list[str]
) -> None:
    """Campaign seed 705485: the drive refused a restore what it was to refuse the tool that had been killed."""
    clock, happened = SteppedClock(), list[str]()
    kill = Incident("kill", "enable", 0.5, "frames", None, 0.1, 0.5, 0)
    later = Incident("sdo-abort", "enable", 0.0, "waits", 0.86, 0.8, 0.5, 0)
    usual = {"enable": {"frames": 2.0}}
    points = Points(clock, [kill, later], usual, lambda incident: happened.append(incident.kind))
    points.enter("enable")
    points.count("frames")
    points.count("frames")
    clock.sleep(calm_s)
    points.calm()
    clock.sleep(3.0)
    assert happened == befallen
