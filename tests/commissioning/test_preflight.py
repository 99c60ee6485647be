"""Preflight: every danger is found before the power stage is on, and named with its remedy."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from commissioning_drive import DeskDrive, believed_machine

from schwung.commissioning import LimitWishes, Plan, Preflight, Survey
from schwung.commissioning.checks import worst
from schwung.commissioning.limits import limits_of
from schwung.commissioning.plan import make_plan
from schwung.commissioning.preflight import preflight
from schwung.commissioning.survey import drive_checks, survey
from schwung.drivetrain import FeedForward
from schwung.drivetrain.gains import with_control
from schwung.errors import InputError, RefusedError
from schwung.fieldbus.drive import BusLoad, Capability, DriveState, Resolution
from schwung.fieldbus.profile import load_profile

MACHINE = believed_machine()


def _plan(wishes: LimitWishes | None = None, **changes: Any) -> Plan:
    drive = DeskDrive(MACHINE)
    arguments: dict[str, Any] = {
        "start_position_rad": 0.0,
        "distance_rad": np.pi,
        "duration_s": 0.25,
        **changes,
    }
    return make_plan(MACHINE, limits_of(wishes or LimitWishes(), drive.limits(), MACHINE), **arguments)


def _survey(plan: Plan) -> Survey:
    return survey(DeskDrive(MACHINE), plan)


def _flight(plan: Plan, seen: Survey | None = None, *, estimates: bool = False) -> Preflight:
    """`estimates`: also from the simulated recording, which takes most of the time."""
    return preflight(plan, MACHINE, seen or _survey(plan), FeedForward(speed_share=1.0), estimates=estimates)


def _severity(found: Preflight, name: str) -> str:
    return worst([check for check in found.checks if check.name == name])


def test_a_sound_plan_passes_and_says_what_to_expect() -> None:
    found = _flight(_plan(), estimates=True)
    found.require()
    assert found.predicted is not None
    assert np.median(found.predicted.table.inertia_kgm2) == pytest.approx(0.11, rel=0.03)
    assert _severity(found, "torque") == "ok"
    assert _severity(found, "room to move") == "ok"


def test_where_nothing_is_going_to_be_estimated_all_else_is_checked_alike() -> None:
    plan = _plan()
    whole, lean = _flight(plan, estimates=True), _flight(plan)
    assert whole.predicted is not None
    assert lean.predicted is None
    assert lean.checks == tuple(
        check for check in whole.checks if check.name not in ("linearity", "predicted trust")
    )


@pytest.mark.parametrize(
    "way",
    [
        {"sampling": "trace", "injecting": "setpoints"},
        {"sampling": "trace", "injecting": "generator", "mode": "pp", "sample_rate_hz": 100.0},
    ],
    ids=["trace", "by itself, SYNC at 100 Hz"],
)
def test_what_a_trace_will_tell_is_foretold_too(way: dict[str, Any]) -> None:
    """On a grid of its own where SYNC is slow, and from the motion's start on, as the trace records."""
    profile = load_profile("schwung-bench")
    plan = _plan(trace=profile.trace, generator=profile.generator, **way)
    found = _flight(plan, estimates=True)
    found.require()
    assert found.predicted is not None
    assert np.median(found.predicted.table.inertia_kgm2) == pytest.approx(0.11, rel=0.03)
    assert found.predicted.traces[0].time_s[0] < 0.05
    by_sync = _flight(_plan())
    assert found.excited.peak_torque_nm == pytest.approx(by_sync.excited.peak_torque_nm, rel=0.05)


def test_only_what_the_way_needs_stops_it() -> None:
    profile = load_profile("schwung-bench")
    plan = _plan(
        trace=profile.trace, generator=profile.generator, mode="pp", sampling="trace", injecting="generator"
    )
    lacking = ("cyclic position", "sampling by SYNC", "torque injection", "disturbance buffer", "lockstep")

    def told(*names: str) -> dict[str, str]:
        seen = replace(_survey(plan), capabilities=tuple(Capability(name, False, "no") for name in names))
        return {check.name: check.severity for check in drive_checks(seen, plan.acquisition)}

    assert told(*lacking) == {
        "identity": "ok",
        "drive state": "ok",
        "cyclic position": "note",
    }  # other ways: no news
    for needed in ("trace buffer", "generator", "torque", "profile position"):
        assert told(needed)[needed] == "stop"


def test_a_drive_that_has_not_told_its_nmt_state_is_not_called_unknown() -> None:
    plan = _plan()
    for nmt, text in (("UNKNOWN", "switch on disabled"), ("OPERATIONAL", "operational, switch on disabled")):
        state = replace(_survey(plan).state, nmt=nmt, cia402="SWITCH ON DISABLED")
        found = _flight(plan, replace(_survey(plan), state=state))
        assert [check.text for check in found.checks if check.name == "drive state"] == [text]


def test_a_motion_out_of_the_window_is_stopped() -> None:
    found = _flight(_plan(LimitWishes(position_max_rad=3.0)))
    assert _severity(found, "room to move") == "stop"
    with pytest.raises(RefusedError, match=r"room to move.*window"):
        found.require()


def test_the_window_holds_for_overshoot_too() -> None:
    """The demand ends at 3.1416; the simulated axis overshoots it."""
    assert _severity(_flight(_plan(LimitWishes(position_max_rad=3.142))), "room to move") == "stop"


def test_too_much_torque_speed_or_following_error_is_stopped() -> None:
    assert _severity(_flight(_plan(LimitWishes(torque_max_nm=50.0), amplitude_nm=30.0)), "torque") == "stop"
    assert _severity(_flight(_plan(LimitWishes(speed_max_rad_s=15.0))), "speed") == "stop"
    assert _severity(_flight(_plan(LimitWishes(following_error_rad=0.005))), "following error") == "stop"


def test_a_full_bus_is_stopped_and_a_busy_one_warned_of() -> None:
    plan = _plan()
    for load, severity in ((0.5, "ok"), (0.85, "warning"), (0.91, "stop")):
        assert (
            _severity(_flight(plan, replace(_survey(plan), bus_load=BusLoad(load, "500 kbit/s"))), "bus load")
            == severity
        )


def test_a_drive_in_fault_energised_or_without_injection_is_stopped() -> None:
    plan = _plan()
    fault = replace(_survey(plan), state=DriveState("OPERATIONAL", "Fault", 0.0, "0x8611 following error"))
    with pytest.raises(RefusedError, match="0x8611"):
        _flight(plan, fault).require()
    held = replace(_survey(plan), state=DriveState("OPERATIONAL", "Quick stop active", 0.0))
    with pytest.raises(RefusedError, match="energised already"):
        _flight(plan, held).require()
    lacking = replace(_survey(plan), capabilities=(Capability("torque injection", False, "60B2 is missing"),))
    with pytest.raises(RefusedError, match="60B2"):
        _flight(plan, lacking).require()


def test_a_speed_that_is_too_coarse_is_derived_from_position() -> None:
    plan = _plan(torque_held=False)
    coarse = replace(
        _survey(plan), resolution=Resolution(6e-6, 2 * np.pi / 60, 0.07, 0.07)
    )  # 1 rpm per count
    found = _flight(plan, coarse)
    assert found.speed_source == "position"
    assert _severity(found, "speed resolution") == "note"
    assert _flight(plan).speed_source == "drive"


def test_a_held_injection_wants_the_speed_of_the_position_where_that_is_fine_enough() -> None:
    assert _flight(_plan()).speed_source == "position"
    plan = _plan()
    coarse = replace(_survey(plan), resolution=Resolution(2 * np.pi / 4096, 1e-4, 0.07, 0.07))
    assert _flight(plan, coarse).speed_source == "drive"


def test_where_neither_speed_is_fine_enough_a_warning_says_so() -> None:
    plan = _plan()
    coarse = replace(_survey(plan), resolution=Resolution(2 * np.pi / 4096, 2 * np.pi / 60, 0.07, 0.07))
    assert _severity(_flight(plan, coarse), "speed resolution") == "warning"


def test_a_coarse_torque_is_warned_of() -> None:
    plan = _plan()
    coarse = replace(_survey(plan), resolution=Resolution(6e-6, 1e-4, 5.0, 5.0))
    assert _severity(_flight(plan, coarse), "torque resolution") == "warning"


def test_a_torque_without_a_unit_is_stopped() -> None:
    plan = _plan()
    seen = _survey(plan)
    untold = replace(seen, resolution=replace(seen.resolution, torque_nm=math.nan))
    assert _severity(_flight(plan, untold), "torque resolution") == "stop"


def test_gains_come_from_the_drive_where_the_file_has_none() -> None:
    bare = MACHINE.model_copy(update={"control": None})
    gains = {"position_gain": 60.0, "speed_gain": 7.0, "speed_integral_time": 0.008}
    control = with_control(bare, gains).control
    assert control is not None
    assert control.speed_gain_nms == 7.0
    with pytest.raises(InputError, match="control"):
        with_control(bare, {})
    assert with_control(MACHINE, gains).control == MACHINE.control


@pytest.mark.parametrize(("mode", "severity"), [("csp", "stop"), ("pp", "note")])
def test_a_drive_without_cyclic_position_serves_in_profile_position(mode: str, severity: str) -> None:
    plan = _plan(mode=mode)  # by name
    seen = replace(
        _survey(plan), capabilities=(Capability("cyclic position", False, "6502 does not list it"),)
    )
    assert _severity(_flight(plan, seen), "cyclic position") == severity


def test_the_way_back_of_a_one_way_motion_is_simulated_too() -> None:
    """There the window ends far behind the start, back the axis overshoots it: by the time it starts, it must fit."""
    wishes = LimitWishes(position_min_rad=-1e-4)
    assert _severity(_flight(_plan(wishes, returns=False)), "room to move") == "stop"
    assert (
        _severity(_flight(_plan(LimitWishes(position_min_rad=-0.1), returns=False)), "room to move") == "ok"
    )


def test_the_bit_rate_behind_the_bus_load_is_told() -> None:
    (check,) = (c for c in _flight(_plan()).checks if c.name == "bus load")
    assert "1000 kbit/s" in check.text
