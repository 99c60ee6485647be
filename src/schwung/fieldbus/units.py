"""From counts to SI: the objects in which a CiA 402 drive tells its units.

Source: CiA 402-2 (608F, 6091, 6092, 6076), CiA 303-2 for the notation of 60A9 and 60AA.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from schwung.errors import InputError
from schwung.fieldbus.drive import Resolution
from schwung.fieldbus.profile import DeviceProfile, Quantity

#: SI value of the unit codes that occur as numerator; increments are asked for.
_NUMERATORS = {0x10: 1.0, 0x41: math.pi / 180, 0xB4: 2 * math.pi, 0xC0: 2 * math.pi / 60}
_INCREMENTS = 0xB5
#: Seconds of the unit codes that occur as denominator; 0x57 is s².
_DENOMINATORS = {0x03: 1.0, 0x47: 60.0, 0x48: 3600.0, 0x57: 1.0, 0x00: 1.0}

#: Position units per motor turn below which 608F, 6091 and 6092 cannot have been set.
_FEWEST_COUNTS = 4.0

#: Reads an integer object; None where the drive does not have it.
ReadInteger = Callable[[int, int], int | None]


def decode_si_unit(raw: int, increment_rad: float) -> float | None:
    """SI value of one count by an SI unit object: prefix, numerator, denominator, reserved (high byte first).

    0xFDB44700 is 10⁻³ revolutions per minute. None where the object says nothing or something unknown.
    """
    prefix, numerator, denominator = (raw >> 24) & 0xFF, (raw >> 16) & 0xFF, (raw >> 8) & 0xFF
    exponent = prefix - 256 if prefix > 127 else prefix
    top = increment_rad if numerator == _INCREMENTS else _NUMERATORS.get(numerator)
    bottom = _DENOMINATORS.get(denominator)
    if top is None or bottom is None or denominator == 0:
        return None
    return float(10.0**exponent * top / bottom)


@dataclass(frozen=True)
class Scales:
    """SI per count, motor side; NaN where the quantity is not exchanged."""

    position_rad: float
    speed_rad_s: float
    torque_nm: float
    torque_added_nm: float
    acceleration_rad_s2: float
    rated_torque_nm: float | None

    @property
    def resolution(self) -> Resolution:
        """The part that the Drive protocol shows."""
        return Resolution(
            *(abs(x) for x in (self.position_rad, self.speed_rad_s, self.torque_nm, self.torque_added_nm))
        )


def read_scales(profile: DeviceProfile, read: ReadInteger) -> Scales:
    """Work the units out of the drive's objects, the profile's literals first.

    What the profile leaves out, or leaves to the user, is NaN. Raises InputError naming the object that is missing.
    """
    quantities = profile.quantities
    position = _position(quantities.position, profile, read)
    torque, added = quantities.torque, quantities.torque_added
    speed = _speed(quantities.speed, position, profile, read) if quantities.speed else math.nan
    return Scales(
        position_rad=position,
        speed_rad_s=speed,
        torque_nm=torque_scale(torque, profile, read),
        torque_added_nm=torque_scale(added, profile, read),
        acceleration_rad_s2=_acceleration(quantities.acceleration, position, speed, profile, read),
        rated_torque_nm=_rated(torque or added, read),
    )


def torque_scale(quantity: Quantity | None, profile: DeviceProfile, read: ReadInteger) -> float:
    """N·m per count of a torque; NaN where it is absent or left to the user. Raises InputError without rated torque."""
    if quantity is None or quantity.unit == "user":
        return math.nan
    if quantity.scale is not None:
        return quantity.scale
    rated = _rated(quantity, read)
    if rated is None:
        raise InputError(
            f"profile {profile.family}, quantities.torque",
            f"the drive does not tell its rated torque ({quantity.rated or '6076'})",
            'Set unit = "literal" and scale = N·m per count.',
        )
    return rated / 1000.0


def _rated(quantity: Quantity | None, read: ReadInteger) -> float | None:
    """Rated torque in N·m; None where the drive does not tell it."""
    if quantity is None:
        return None
    ref = quantity.rated
    if ref is None and quantity.object.space == "register":
        return None
    counts = read(ref.index, ref.subindex) if ref is not None else read(0x6076, 0)
    return counts * quantity.rated_torque_scale if counts else None


def _ratio(read: ReadInteger, index: int) -> float | None:
    top, bottom = read(index, 1), read(index, 2)
    return top / bottom if top and bottom else None


def _position(quantity: Quantity, profile: DeviceProfile, read: ReadInteger) -> float:
    if quantity.scale is not None:
        return quantity.scale
    if quantity.unit == "user":
        return math.nan
    if quantity.resolution is not None:
        increments = read(quantity.resolution.index, quantity.resolution.subindex)
        if increments:
            return 2 * math.pi / (increments * quantity.resolution_factor)
        missing = str(quantity.resolution)
    else:
        resolution = _ratio(read, 0x608F)
        # without a feed constant, one shaft revolution counts increments
        feed = _ratio(read, 0x6092) or resolution
        if feed is not None:
            gear = _ratio(read, 0x6091) or 1.0
            if feed / gear < _FEWEST_COUNTS:
                raise InputError(
                    f"profile {profile.family}, quantities.position",
                    f"the drive tells {feed / gear:g} count a turn (608F, 6091, 6092), as delivered",
                    'Set these objects, or unit = "literal" and scale = rad per count.',
                )
            return 2 * math.pi * gear / feed
        missing = "608F"
    raise InputError(
        f"profile {profile.family}, quantities.position",
        f"the drive does not tell its encoder resolution ({missing})",
        'Set unit = "literal" and scale = rad per count.',
    )


def _speed(quantity: Quantity, position: float, profile: DeviceProfile, read: ReadInteger) -> float:
    if quantity.scale is not None:
        return quantity.scale
    if quantity.unit == "user":
        return math.nan
    if quantity.unit == "position_per_second":
        return position
    scale = decode_si_unit(read(0x60A9, 0) or 0, abs(position))
    if scale is None:
        raise InputError(
            f"profile {profile.family}, quantities.speed",
            "the drive does not tell its speed unit (60A9)",
            'Set unit = "literal" and scale = rad/s per count.',
        )
    return scale


def _acceleration(
    quantity: Quantity | None, position: float, speed: float, profile: DeviceProfile, read: ReadInteger
) -> float:
    if quantity is not None and quantity.scale is not None:
        return quantity.scale
    by_objects = profile.quantities.position.object.space == "object"
    told = decode_si_unit(read(0x60AA, 0) or 0, abs(position)) if by_objects else None
    return told if told is not None else speed  # speed units per second, as many drives take them
