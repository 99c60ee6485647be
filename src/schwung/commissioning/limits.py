"""Within which limits the machine may move: the tighter of what the user allows and what the drive enforces."""

from __future__ import annotations

import math
from dataclasses import dataclass

from schwung.drivetrain import Machine
from schwung.errors import InputError
from schwung.fieldbus.drive import DriveLimits


@dataclass(frozen=True)
class Limits:
    """What the machine may be asked to do; drive coordinates, SI. All of them must be known before anything moves."""

    position_min_rad: float
    position_max_rad: float
    speed_max_rad_s: float
    torque_max_nm: float
    following_error_rad: float

    def __post_init__(self) -> None:
        if not self.position_min_rad < self.position_max_rad:
            raise InputError(
                "position window",
                f"runs from {self.position_min_rad:g} to {self.position_max_rad:g} rad",
                "Give the lower end first.",
            )
        for name in ("speed_max_rad_s", "torque_max_nm", "following_error_rad"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(name, f"is {value:g}", "Give a positive number.")


@dataclass(frozen=True)
class LimitWishes:
    """Limits as the user gave them; None: take what the drive enforces. The tighter of both holds.

    Attributes, numbers without a shape, motor side: `position_min_rad` and `position_max_rad` (rad, absolute),
    `speed_max_rad_s` (rad/s), `torque_max_nm` (N·m), `following_error_rad` (rad). Raises nothing itself: `plan` raises
    InputError where a limit is known to nobody.

    >>> schwung.LimitWishes(position_min_rad=-0.1, position_max_rad=3.3, torque_max_nm=40.0).speed_max_rad_s is None
    True
    """

    position_min_rad: float | None = None
    position_max_rad: float | None = None
    speed_max_rad_s: float | None = None
    torque_max_nm: float | None = None
    following_error_rad: float | None = None


def tighter(one: LimitWishes, other: LimitWishes) -> LimitWishes:
    """What both allow."""

    def least(a: float | None, b: float | None) -> float | None:
        return min(_known(a, b), default=None)

    return LimitWishes(
        max(_known(one.position_min_rad, other.position_min_rad), default=None),
        least(one.position_max_rad, other.position_max_rad),
        least(one.speed_max_rad_s, other.speed_max_rad_s),
        least(one.torque_max_nm, other.torque_max_nm),
        least(one.following_error_rad, other.following_error_rad),
    )


def limits_of(wishes: LimitWishes, drive: DriveLimits, machine: Machine) -> Limits:
    """The tighter of what the user allows, what the drive enforces and what the motor can.

    Raises InputError naming every limit that nobody knows: nothing moves before all are known.
    """
    low = max(_known(wishes.position_min_rad, drive.position_min_rad), default=None)
    high = min(_known(wishes.position_max_rad, drive.position_max_rad), default=None)
    speed = min(_known(wishes.speed_max_rad_s, drive.speed_max_rad_s), default=None)
    torque = min(
        _known(wishes.torque_max_nm, drive.torque_max_nm, machine.motor.peak_torque_nm), default=None
    )
    following = min(_known(wishes.following_error_rad, drive.following_error_rad), default=None)
    missing = [
        option
        for option, value in {
            "--min-position": low,
            "--max-position": high,
            "--max-speed": speed,
            "--max-torque": torque,
            "--following-error": following,
        }.items()
        if value is None
    ]
    if low is None or high is None or speed is None or torque is None or following is None:
        raise InputError(
            "limits",
            "neither you nor the drive say how far, how fast or how hard this machine may move",
            f"Give {', '.join(missing)}.",
        )
    return Limits(low, high, speed, torque, following)


def _known(*values: float | None) -> list[float]:
    return [value for value in values if value is not None]
