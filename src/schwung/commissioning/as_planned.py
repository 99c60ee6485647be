"""Still as planned? A plan may be looked at for long before it is carried out: drive and axis are asked again then."""

from __future__ import annotations

from dataclasses import replace

from schwung.commissioning.commission import Prepared, prepare
from schwung.commissioning.plan import Plan
from schwung.commissioning.preflight import preflight
from schwung.commissioning.survey import Survey, survey
from schwung.errors import RefusedError
from schwung.fieldbus.drive import Drive
from schwung.fieldbus.profile import DeviceProfile

#: An axis that is off comes to rest within this (s, of the bus), looked at so often; it stands still below this speed.
RESTS_WITHIN_S, _LOOK_S, _RESTING_RAD_S = 10.0, 0.05, 0.01


def renewed(drive: Drive, profile: DeviceProfile, prepared: Prepared, *, estimates: bool = True) -> Prepared:
    """The same where axis and drive are as they were; else planned anew, from where the axis stands. Changes nothing.

    Between planning and moving may lie as long as somebody looks at the plan. Raises RefusedError where the axis has
    been moved further than its following error allows: what was looked at is another motion then. `estimates`: see
    `preflight`.
    """
    seen = require_there(drive, prepared.plan, prepared.survey)
    moved = abs(seen.state.position_rad - prepared.plan.start_position_rad)
    if moved == 0 and seen.limits == prepared.survey.limits:
        return prepared  # the drive's state is looked at again before it is switched on
    return prepare(drive, profile, prepared.machine, prepared.wishes, estimates=estimates)


def rechecked(drive: Drive, prepared: Prepared) -> Prepared:
    """The very same plan, with checks for the drive as it is now: for what was confirmed by its digest. Raises
    RefusedError as `renewed`."""
    seen = require_there(drive, prepared.plan, prepared.survey)
    checked = preflight(prepared.plan, prepared.machine, seen, prepared.feed_forward)
    return replace(prepared, survey=seen, preflight=checked)


def require_there(drive: Drive, plan: Plan, before: Survey) -> Survey:
    """What the drive says now. Raises RefusedError where it is another drive than `before`, or the axis stands further
    from where the plan starts than its following error allows."""
    seen = survey(drive, plan)
    if not abs(seen.state.position_rad - plan.start_position_rad) <= plan.limits.following_error_rad:
        raise RefusedError(
            "plan",
            f"starts at {plan.start_position_rad:.4g} rad, the axis stands at {seen.state.position_rad:.4g}",
            "Plan anew, and look at that.",
        )
    if seen.identity != before.identity:
        raise RefusedError("plan", "was made for another drive", "Plan anew with this one.")
    return seen


def await_rest(drive: Drive) -> None:
    """Wait until an axis that is off stands still: without a brake, gravity or cogging may turn it on for a while.

    Raises RefusedError where it does not come to rest.
    """
    until_s, before = drive.clock.now() + RESTS_WITHIN_S, drive.state().position_rad
    while True:
        drive.clock.sleep(_LOOK_S)
        now = drive.state().position_rad
        speed, before = abs(now - before) / _LOOK_S, now
        if speed <= _RESTING_RAD_S:
            return
        if drive.clock.now() >= until_s:
            raise RefusedError(
                "axis",
                f"turns by itself while it is off, at {speed:.2g} rad/s at least",
                "Hold it with a brake, or wait until it stands.",
            )
