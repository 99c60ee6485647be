"""Who moves, samples and injects where nobody said, and why."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from commissioning_drive import DeskDrive, believed_machine

from schwung.commissioning import Wishes
from schwung.commissioning.commission import way_of
from schwung.commissioning.ways import Way, choose_way, comes_unevenly, require_phases
from schwung.errors import InputError
from schwung.fieldbus.drive import Capability, SyncTiming
from schwung.fieldbus.profile import DeviceProfile, load_profile

BENCH = load_profile("schwung-bench")
PLAIN = load_profile("generic-cia402")  # neither generator nor trace


def _lacking(*names: str) -> list[Capability]:
    return [Capability(name, False, f"no {name} here") for name in names]


def _choose(profile: DeviceProfile, *lacking: str, **asked: Any) -> Way:
    return choose_way(profile, _lacking(*lacking), **asked)


def _parts(way: Way) -> tuple[str, str, str, float]:
    return way.mode, way.sampling, way.injecting, way.sync_rate_hz


def test_a_drive_that_can_everything_on_a_bus_with_room_is_led_by_sync() -> None:
    way = _choose(BENCH)
    assert _parts(way) == ("csp", "sync", "setpoints", 1000.0)
    assert way.reasons == ()


@pytest.mark.parametrize(
    ("lacking", "expected"),
    [
        (["cyclic position"], ("pp", "sync", "setpoints", 1000.0)),
        (["torque injection"], ("csp", "sync", "generator", 1000.0)),
        (["sampling by SYNC"], ("csp", "trace", "generator", 1000.0)),
        (["cyclic position", "sampling by SYNC", "torque injection"], ("pp", "trace", "generator", 1000.0)),
    ],
)
def test_what_a_drive_lacks_it_does_by_itself_and_the_reason_is_told(
    lacking: list[str], expected: tuple[str, str, str, float]
) -> None:
    way = _choose(BENCH, *lacking)
    assert _parts(way) == expected
    for name in lacking:
        assert any(f"no {name} here" in reason for reason in way.reasons)


def test_where_neither_way_can_be_had_the_usual_one_stays_for_preflight_to_refuse() -> None:
    lacking = ("cyclic position", "profile position", "sampling by SYNC", "torque injection")
    assert _parts(_choose(PLAIN, *lacking)) == ("csp", "sync", "setpoints", 1000.0)


def test_a_full_bus_leaves_the_fast_part_to_the_drive() -> None:
    way = _choose(BENCH, bus_is_full=True)
    assert _parts(way) == ("pp", "trace", "generator", 100.0)
    assert "overload this bus" in way.reasons[0]
    assert _parts(_choose(PLAIN, bus_is_full=True)) == ("csp", "sync", "setpoints", 1000.0)
    assert _parts(_choose(BENCH, "generator", bus_is_full=True)) == ("csp", "sync", "setpoints", 1000.0)


@pytest.mark.parametrize("asked", [{"mode": "csp"}, {"sampling": "sync"}, {"injecting": "setpoints"}])
def test_what_was_asked_for_is_not_overruled_by_a_full_bus(asked: dict[str, Any]) -> None:
    way = _choose(BENCH, bus_is_full=True, **asked)
    assert way.sync_rate_hz == 1000.0
    assert all(getattr(way, name) == value for name, value in asked.items())


def test_a_trace_goes_with_the_generator_but_not_where_its_phase_cannot_be_set() -> None:
    assert _choose(BENCH, sampling="trace").injecting == "generator"
    assert _choose(PLAIN, sampling="trace").injecting == "setpoints"
    assert BENCH.generator is not None
    always_zero = BENCH.model_copy(update={"generator": BENCH.generator.model_copy(update={"phase": None})})
    assert _choose(always_zero, sampling="trace", phases=4).injecting == "setpoints"
    assert _choose(always_zero, sampling="trace", phases=1).injecting == "generator"
    insisted = _choose(always_zero, injecting="generator", phases=4)
    with pytest.raises(InputError, match=r"--phases: is 4, but the generator of schwung-bench"):
        require_phases(always_zero, insisted, 4)
    require_phases(BENCH, insisted, 4)


def test_a_trace_without_torque_or_of_its_own_time_is_no_way_to_sample() -> None:
    assert BENCH.trace is not None
    columns = tuple(column for column in BENCH.trace.columns if column.quantity != "torque")
    blind = BENCH.model_copy(update={"trace": BENCH.trace.model_copy(update={"columns": columns})})
    early = BENCH.model_copy(update={"trace": BENCH.trace.model_copy(update={"trigger": "immediate"})})
    for useless in (blind, early):
        assert _choose(useless, "sampling by SYNC").sampling == "sync"  # which preflight then refuses
        assert _parts(_choose(useless, bus_is_full=True))[:2] == ("csp", "sync")


def _timing(p99_s: float, producer: str = "thread") -> SyncTiming:
    return SyncTiming(producer, 1e-3, p99_s / 2, p99_s, 3 * p99_s)


def test_an_adapter_that_sends_sync_unevenly_leaves_the_fast_part_to_the_drive() -> None:
    way = _choose(BENCH, timing=_timing(0.4e-3))
    assert _parts(way) == ("pp", "trace", "generator", 100.0)
    assert "0.4 ms of a 1 ms period" in way.reasons[0]
    assert _parts(_choose(BENCH, timing=_timing(0.05e-3))) == ("csp", "sync", "setpoints", 1000.0)
    assert _parts(_choose(BENCH, timing=_timing(0.4e-3), max_jitter_share=0.5))[0] == "csp"
    assert _parts(_choose(BENCH, timing=_timing(0.4e-3, "lockstep")))[0] == "csp"
    assert _parts(_choose(BENCH, timing=_timing(0.4e-3, "kernel")))[0] == "pp"


def test_a_drive_that_can_but_move_by_itself_does_and_who_insists_gets_setpoints() -> None:
    way = _choose(PLAIN, timing=_timing(0.4e-3))
    assert _parts(way) == ("pp", "sync", "setpoints", 1000.0)
    assert "period on this adapter" in way.reasons[0]
    assert _parts(_choose(BENCH, timing=_timing(0.4e-3), mode="csp"))[0] == "csp"
    assert _parts(_choose(PLAIN, "profile position", timing=_timing(0.4e-3)))[0] == "csp"


@pytest.mark.parametrize(("share", "uneven"), [(0.09, False), (0.11, True)])
def test_a_tenth_of_the_period_is_even_enough(share: float, uneven: bool) -> None:
    assert comes_unevenly(_timing(share * 1e-3)) is uneven


@pytest.mark.parametrize(("p99_s", "mode"), [(20e-6, "csp"), (0.4e-3, "pp")])
def test_what_is_measured_on_the_bus_decides_before_anything_moves(p99_s: float, mode: str) -> None:
    drive = DeskDrive(believed_machine())
    drive.sync_timing = SyncTiming("thread", 1e-3, p99_s / 2, p99_s, 2 * p99_s)
    wishes = Wishes(distance_rad=1.0, duration_s=0.25)
    assert way_of(drive, load_profile("schwung-bench"), wishes).mode == mode
    fixed = replace(wishes, mode="csp")
    assert way_of(drive, load_profile("schwung-bench"), fixed).mode == "csp"  # who says so gets it
