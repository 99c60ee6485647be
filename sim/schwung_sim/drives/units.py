"""What one count is worth on this drive's bus (CiA 402-2: 607E, 608F, 6091, 6092, 60A9, 60AA, 6076; CiA 303-2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from schwung_sim.drives.eds import key
from schwung_sim.drives.roles import Quantity, Roles

RPM = 2 * math.pi / 60
#: What the bench's machine is: its encoder and its motor's rated torque.
ENCODER_COUNTS = 2**20
RATED_TORQUE_NM = 70.0
#: Where neither drive nor profile has a unit for it: the bench drive's own.
OWN_SPEED_RAD_S = 1e-3 * RPM

_ANGLES = {0x10: 1.0, 0x41: math.pi / 180, 0xB4: 2 * math.pi, 0xC0: RPM}
_SECONDS = {0x03: 1.0, 0x47: 60.0, 0x48: 3600.0, 0x57: 1.0}
_INCREMENT = 0xB5

#: Bits of 607E.
POSITION_POLARITY, SPEED_POLARITY = 1 << 7, 1 << 6

#: Value of an object by its key; 0 where it has none.
Number = Callable[[int], int]


@dataclass(frozen=True)
class Units:
    """SI per count; what turns the direction is negative."""

    position_rad: float
    demand_rad: float  # of a demanded position: another sign only where 607E turns demands alone
    speed_rad_s: float
    acceleration_rad_s2: float
    torque_nm: float
    torque_added_nm: float
    rated_torque_nm: float
    zero: int = 0  # position counts of the motor at which the bus has 0: 607C
    direction: int = 1  # −1 where 607E turns positions

    @property
    def counts_per_turn(self) -> float:
        """Position counts in one revolution of the motor."""
        return 2 * math.pi / abs(self.position_rad)


def read_units(roles: Roles, number: Number) -> Units:
    """The units that the profile and the dictionary give now; the bench's own where they say nothing."""
    position = _position(roles.position, number)
    speed = _speed(roles.speed, position, number)
    rated = rated_torque(roles, number)
    return Units(
        position_rad=position,
        demand_rad=position,
        speed_rad_s=speed,
        acceleration_rad_s2=_acceleration(roles.acceleration, position, speed, number),
        torque_nm=torque_unit(roles.torque, number),
        torque_added_nm=torque_unit(roles.torque_added, number),
        rated_torque_nm=rated,
    )


def turned(units: Units, polarity: int, torque_bit: int = 0, demand_only: bool = False) -> Units:
    """The units as object 607E turns them.

    CiA 402-2, polarity: with bit 7 position demand and actual values are multiplied by −1, with bit 6 those of the
    velocity. No bit is there for the torque, whose sign (6077, 60B2) stays that of the motor; drives have their own:
    `torque_bit` is the one that turns it. `demand_only`: in some drives actual positions keep the motor's sign.
    """
    position = -1 if polarity & POSITION_POLARITY else 1
    speed = -1 if polarity & SPEED_POLARITY else 1
    torque = -1 if polarity & torque_bit else 1
    return replace(
        units,
        position_rad=units.position_rad * (1 if demand_only else position),
        demand_rad=units.demand_rad * position,
        speed_rad_s=units.speed_rad_s * (1 if demand_only else speed),
        torque_nm=units.torque_nm * torque,
        torque_added_nm=units.torque_added_nm * torque,
        direction=position,
    )


def rated_torque(roles: Roles, number: Number) -> float:
    """Rated torque (N·m): 6076, or where the profile has it; the bench's motor's where the drive has none."""
    told = next((q for q in (roles.torque, roles.torque_added) if q is not None), None)
    if told is None or told.unit != "rated_torque":
        return number(key(0x6076)) * 1e-3 or RATED_TORQUE_NM
    return number(told.rated) * told.rated_torque_scale or RATED_TORQUE_NM


def torque_unit(quantity: Quantity | None, number: Number) -> float:
    """N·m per count of a torque."""
    if quantity is not None and quantity.scale is not None:
        return quantity.scale
    if quantity is None or quantity.unit != "rated_torque":
        return RATED_TORQUE_NM / 1000
    return (number(quantity.rated) * quantity.rated_torque_scale or RATED_TORQUE_NM) / 1000


def si_unit(raw: int, increment_rad: float) -> float | None:
    """SI value of one count by the notation of 60A9 and 60AA: prefix, numerator, denominator, reserved."""
    prefix, top, bottom, _ = (raw & 0xFFFFFFFF).to_bytes(4, "big")
    angle = abs(increment_rad) if top == _INCREMENT else _ANGLES.get(top)
    if angle is None or bottom not in _SECONDS:
        return None
    return float(10.0 ** (prefix - 256 if prefix > 127 else prefix) * angle / _SECONDS[bottom])


def _ratio(index: int, number: Number) -> float:
    top, bottom = number(key(index, 1)), number(key(index, 2))
    return top / bottom if bottom else 0.0


def _position(quantity: Quantity, number: Number) -> float:
    if quantity.scale is not None:
        return quantity.scale
    turn = 0.0
    if quantity.unit == "increments" and quantity.resolution is not None:
        turn = number(quantity.resolution) * quantity.resolution_factor
    elif quantity.unit == "encoder":
        turn = (_ratio(0x6092, number) or _ratio(0x608F, number)) / (_ratio(0x6091, number) or 1.0)
    return 2 * math.pi / (turn or ENCODER_COUNTS)


def _speed(quantity: Quantity | None, position: float, number: Number) -> float:
    if quantity is not None and quantity.scale is not None:
        return quantity.scale
    if quantity is not None and quantity.unit == "position_per_second":
        return position
    return si_unit(number(key(0x60A9)), position) or OWN_SPEED_RAD_S


def _acceleration(quantity: Quantity | None, position: float, speed: float, number: Number) -> float:
    if quantity is not None and quantity.scale is not None:
        return quantity.scale
    return si_unit(number(key(0x60AA)), position) or abs(speed)
