"""What the drive shall keep for a plan, and what is said where it cannot."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from commissioning_drive import DeskDrive, believed_machine

from schwung.commissioning import LimitWishes, Plan
from schwung.commissioning.checks import Check, meaning_checks, ready_checks
from schwung.commissioning.guarding import guard_checks, hardest_stop
from schwung.commissioning.limits import limits_of
from schwung.commissioning.plan import make_plan
from schwung.commissioning.preflight import preflight
from schwung.commissioning.survey import survey
from schwung.drivetrain import FeedForward
from schwung.fieldbus.drive import DriveLimits, DriveState, Guard

MACHINE = believed_machine()
HELD = DriveLimits(-0.5, 4.0, 60.0, 233.0, 70.0, 0.5, 0.1, stop_deceleration_rad_s2=50.0)
HARDEST = 233.0 / 0.122


def _plan(**changes: Any) -> Plan:
    arguments: dict[str, Any] = {
        "start_position_rad": 0.0,
        "distance_rad": np.pi,
        "duration_s": 0.25,
        **changes,
    }
    return make_plan(MACHINE, limits_of(LimitWishes(), DeskDrive(MACHINE).limits(), MACHINE), **arguments)


def _guard(plan: Plan) -> Guard:
    assert plan.acquisition.guard is not None
    return plan.acquisition.guard


def _told(guard: Guard, **limits: Any) -> dict[str, Check]:
    return {c.name: c for c in guard_checks(guard, replace(HELD, **limits), MACHINE, HARDEST)}


def test_the_drive_may_be_half_as_fast_again_as_the_motion_with_its_injection_and_no_more() -> None:
    plan = _plan()
    guard = _guard(plan)
    assert guard.speed_max_rad_s is not None
    flight = preflight(
        plan, MACHINE, survey(DeskDrive(MACHINE), plan), FeedForward(speed_share=1.0), estimates=False
    )
    peak = max(flight.reference.peak_speed_rad_s, flight.excited.peak_speed_rad_s)
    assert peak < guard.speed_max_rad_s < 1.7 * peak
    assert _guard(_plan(also_s=(0.5,))).speed_max_rad_s == pytest.approx(guard.speed_max_rad_s)


def test_a_quick_stop_has_the_way_from_the_strokes_end_to_the_windows() -> None:
    guard = _guard(_plan())
    assert guard.travel_rad == (0.0, pytest.approx(np.pi))
    assert guard.speed_max_rad_s is not None
    assert guard.stop_deceleration_rad_s2 == pytest.approx(guard.speed_max_rad_s**2 / (2 * 0.5))
    assert _told(guard)["quick stop"].severity == "ok"


def test_where_the_torque_is_not_enough_for_that_a_warning_says_so() -> None:
    """0.02 rad behind the stroke: no torque limit stops the axis in that."""
    limits = replace(
        limits_of(LimitWishes(), DeskDrive(MACHINE).limits(), MACHINE), position_max_rad=np.pi + 0.02
    )
    guard = _guard(make_plan(MACHINE, limits, start_position_rad=0.0, distance_rad=np.pi, duration_s=0.25))
    assert guard.stop_deceleration_rad_s2 == pytest.approx(hardest_stop(MACHINE, limits, 0.11))
    told = _told(guard)["quick stop"]
    assert told.severity == "warning"
    assert "torque limit" in told.text


def test_a_drive_that_does_not_tell_how_it_brakes_is_not_believed_to() -> None:
    assert _told(_guard(_plan()), stop_deceleration_rad_s2=None)["quick stop"].severity == "note"


def test_positions_that_wrap_within_the_motion_stop_it() -> None:
    guard = _guard(_plan())
    assert "position range" not in _told(guard, range_rad=(-0.1, 3.2))
    wrapping = _told(guard, range_rad=(-1.0, 3.0))["position range"]
    assert wrapping.severity == "stop"
    assert "607B" in wrapping.text


@pytest.mark.parametrize(
    ("rated", "stated", "severity"),
    [(70.0, None, None), (70.0, 75.0, None), (0.07, 70.0, "stop"), (140.0, 70.0, "stop"), (7000.0, None, "warning"),
     (0.07, None, "warning")],
)  # fmt: skip
def test_a_rated_torque_that_cannot_be_this_motors_is_told(
    rated: float, stated: float | None, severity: str | None
) -> None:
    motor = MACHINE.motor.model_copy(update={"rated_torque_nm": stated})
    machine = MACHINE.model_copy(update={"motor": motor})
    limits = replace(HELD, rated_torque_nm=rated)
    told = {c.name: c.severity for c in guard_checks(_guard(_plan()), limits, machine, HARDEST)}
    assert told.get("rated torque") == severity


def test_what_a_drive_lacks_is_named_with_what_is_relied_upon_instead() -> None:
    checks = list(
        guard_checks(_guard(_plan()), replace(HELD, lacking=("6066", "6080 and 607F")), MACHINE, HARDEST)
    )
    told = [c.text for c in checks if c.name == "guard"]
    assert {c.severity for c in checks if c.name == "guard"} == {"note"}
    assert "6066" in told[0]
    assert "setpoints and the following error alone" in told[1]


@pytest.mark.parametrize(
    ("limits", "name", "severity"),
    [
        ({"quick_stop_option": 0}, "quick stop", "stop"),
        ({"brake_closed": True}, "brake", "stop"),
        ({"polarity": 0x80}, "polarity", "warning"),
        ({"polarity": 0xC0}, "polarity", "warning"),
        ({"home_offset_rad": 0.1}, "home offset", "note"),
        ({"range_rad": (-3.0, 3.0)}, "position range", "note"),
    ],
)
def test_what_changes_the_meaning_of_limits_is_named(
    limits: dict[str, Any], name: str, severity: str
) -> None:
    (check,) = meaning_checks(replace(HELD, **limits))
    assert (check.name, check.severity) == (name, severity)
    assert not list(meaning_checks(HELD))


@pytest.mark.parametrize(
    ("state", "name", "severity"),
    [
        ({"others": "SYNC"}, "other master", "stop"),
        ({"voltage": False}, "supply", "stop"),
        ({"remote": False, "nmt": "OPERATIONAL"}, "remote", "stop"),
        ({"remote": False}, "remote", "warning"),
        ({"inputs": 0b10}, "limit switches", "stop"),
        ({"inputs": 0b1000}, "interlock", "stop"),
    ],
)
def test_what_keeps_a_drive_from_being_commissioned(state: dict[str, Any], name: str, severity: str) -> None:
    well = DriveState("PRE-OPERATIONAL", "Switch on disabled", 0.0, voltage=True, remote=True, inputs=0b100)
    assert not list(ready_checks(well))
    (check,) = ready_checks(replace(well, **state))
    assert (check.name, check.severity) == (name, severity)
