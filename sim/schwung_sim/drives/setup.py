"""The dictionary of a drive that somebody has set up: what its EDS declares, with values that let an axis move.

A drive fresh from its factory does not move: no motor is entered, limits are 0. Where the EDS has no value, the drive
holds the standard's own default (STANDARD). Where it has none, or one that would hold the axis still (0, no encoder),
it holds what suits the bench's machine (`_machine`): the motor's data, generous limits, a period of 1 ms. Gains that
its profile names are always those of the bench's machine. Every other default is the EDS's. What the logic needs and
the EDS lacks gets the same values, and is not shown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from schwung_sim.drives.axis import AxisSettings
from schwung_sim.drives.dictionary import ObjectDictionary, incomplete
from schwung_sim.drives.eds import Entry, Value, key, read_entries
from schwung_sim.drives.roles import Roles
from schwung_sim.drives.units import ENCODER_COUNTS, RATED_TORQUE_NM, RPM, read_units
from schwung_sim.errors import BenchError

NOT_VALID = 1 << 31
PREDEFINED = 4  # PDOs of each direction that have an identifier in the predefined connection set

#: without these it is no CiA 402 drive
_INDISPENSABLE = (key(0x6040), key(0x6041))

#: (CiA 301 7.5.2; CiA 402-2: the options' default values)
STANDARD: Mapping[int, int] = {
    key(0x1005): 0x80, key(0x1006): 0, key(0x1017): 0, key(0x1019): 0, key(0x1029, 1): 0,
    key(0x6007): 1, key(0x603F): 0, key(0x6040): 0, key(0x605A): 2, key(0x605B): 0, key(0x605C): 1,
    key(0x605D): 1, key(0x605E): 2, key(0x6060): 0, key(0x6066): 0, key(0x6068): 0, key(0x607A): 0,
    key(0x607B, 1): 0, key(0x607B, 2): 0, key(0x607C): 0, key(0x607D, 1): 0, key(0x607D, 2): 0, key(0x607E): 0,
    key(0x608F, 2): 1, key(0x6091, 1): 1, key(0x6091, 2): 1,
    key(0x6092, 1): 0, key(0x6092, 2): 1, key(0x60AA): 0, key(0x60B2): 0, key(0x60C2, 2): -3,
}  # fmt: skip

#: The bench's machine in SI: what the bench drive's own EDS has, too.
FOLLOWING_ERROR_RAD, POSITION_WINDOW_RAD = 0.6, 0.012
PEAK_TORQUE_NM = 233.0
TOP_SPEED_RAD_S, PROFILE_SPEED_RAD_S = 6000 * RPM, 100 * RPM
ACCELERATION_RAD_S2, QUICK_STOP_RAD_S2 = 2000 * RPM, 10000 * RPM
SLOWEST_RAD_S2 = 1.0  # on a slower ramp an axis neither moves nor stops while somebody waits

_MODE_BITS = {"pp": 0, "csp": 7}
_ALWAYS = 1 << 40
#: setting of the axis for each gain that a profile can name
GAINS = {
    "position_gain": "position_gain_1_s",
    "speed_gain": "speed_gain_nms_rad",
    "speed_integral_time": "speed_integral_time_s",
    "speed_feed_forward": "speed_feed_forward",
}


def open_dictionary(eds: Path, node_id: int, roles: Roles) -> ObjectDictionary:
    """The dictionary of a drive with this EDS. Raises BenchError where it is no CiA 402 drive's."""
    entries = {entry.key: entry for entry in read_entries(eds, node_id)}
    for k in _INDISPENSABLE:
        if k not in entries:
            raise incomplete(k)
        if entries[k].size != 2:
            raise BenchError(
                f"{eds}, 0x{k >> 8:04X}", "has not the 16 bits of a CiA 402 drive", "Mend its DataType."
            )
    values: dict[int, Value] = {**STANDARD, **_pdo_values(entries, node_id), key(0x1014): 0x80 + node_id}
    values |= {key(0x6502): _supported_modes(roles)}
    values |= {key(0x1018, n): 0 for n in range(1, 5)}
    values |= {k: e.default for k, e in entries.items() if e.default is not None}
    values |= {k: _blank(e) for k, e in entries.items() if k not in values}
    for k, minimum, value in _scales(roles):
        _put(values, entries, k, minimum, value)
    if key(0x6092, 1) in entries:  # without a feed constant a turn has the encoder's counts
        _put(values, entries, key(0x6092, 1), 2, float(values[key(0x608F, 1)]))
    for k, minimum, value in _machine(roles, values):
        _put(values, entries, k, minimum, value)
    return ObjectDictionary(
        [replace(entry, default=values[k]) for k, entry in entries.items()],
        values,
    )


def _put(values: dict[int, Value], entries: Mapping[int, Entry], k: int, minimum: int, value: float) -> None:
    held = values.get(k)
    if held is None or isinstance(held, bytes) or held < minimum:
        values[k] = entries[k].fit(value) if k in entries else round(value)


def _blank(entry: Entry) -> Value:
    if entry.size is None:
        return b""
    return 0.0 if math.isinf(entry.span[1]) else 0


def _supported_modes(roles: Roles) -> int:
    return sum(1 << _MODE_BITS[name] for name in roles.modes if name in _MODE_BITS)


def _pdo_values(entries: Mapping[int, Entry], node_id: int) -> dict[int, Value]:
    """What every PDO record holds where the EDS leaves it out: the predefined identifiers (CiA 301 7.3.5), no entry."""
    values: dict[int, Value] = {}
    indices = {k >> 8 for k in entries}
    for base, can_id in ((0x1400, 0x200), (0x1800, 0x180)):
        for index in (i for i in indices if base <= i < base + 0x200):
            values |= {key(index, n): 0 for n in (3, 5, 6)}
            number = index - base
            cob_id = can_id + 0x100 * number + node_id if number < PREDEFINED else NOT_VALID
            values |= {key(index, 1): cob_id, key(index, 2): 255, key(index + 0x200, 0): 0}
    return values


def _scales(roles: Roles) -> list[tuple[int, int, float]]:
    """(object, least value that makes sense, value of the bench's machine): what units are made of."""
    torques = [q for q in (roles.torque, roles.torque_added) if q is not None and q.unit == "rated_torque"]
    found = [(key(0x6076), 1, RATED_TORQUE_NM / 1e-3)] if not torques else []
    found += [(q.rated, 1, RATED_TORQUE_NM / q.rated_torque_scale) for q in torques]
    if (
        roles.scalar is not None and roles.scalar.per is not None
    ):  # a motor constant: a count shall be 1e-6 kg·m²
        found.append((roles.scalar.per, 1, 1e-6 / roles.scalar.scale_kgm2))
    if roles.position.resolution is not None:
        found.append((roles.position.resolution, 2, ENCODER_COUNTS / roles.position.resolution_factor))
    found += [(key(index, 2), 1, 1) for index in (0x608F, 0x6091, 0x6092)]
    return [*found, (key(0x6091, 1), 1, 1), (key(0x608F, 1), 2, ENCODER_COUNTS), (key(0x60A9), 1, 0xFDB44700)]


def _machine(roles: Roles, values: Mapping[int, Value]) -> list[tuple[int, int, float]]:
    """(object, least value that makes sense, value of the bench's machine) in the units that now hold."""

    def number(k: int) -> int:
        value = values.get(k, 0)
        return 0 if isinstance(value, bytes) else int(value)

    units = read_units(roles, number)
    position, speed, rate = abs(units.position_rad), abs(units.speed_rad_s), units.acceleration_rad_s2
    slow = math.ceil(SLOWEST_RAD_S2 / rate)
    found = [
        (key(0x6065), 1, FOLLOWING_ERROR_RAD / position),
        (key(0x6067), 1, POSITION_WINDOW_RAD / position),
        (key(0x6072), 1, 1000 * PEAK_TORQUE_NM / units.rated_torque_nm),
        (key(0x607F), 1, TOP_SPEED_RAD_S / speed),
        (key(0x6080), 1, TOP_SPEED_RAD_S / RPM),
        (key(0x6081), 1, PROFILE_SPEED_RAD_S / speed),
        (key(0x6083), slow, ACCELERATION_RAD_S2 / rate),
        (key(0x6084), slow, ACCELERATION_RAD_S2 / rate),
        (key(0x6085), slow, QUICK_STOP_RAD_S2 / rate),
    ]
    machine = AxisSettings()
    found += [  # a controller that somebody has tuned for this machine
        (part.object, _ALWAYS, float(getattr(machine, GAINS[name])) / part.scale)
        for name, part in roles.gains.items()
        if name in GAINS
    ]
    if number(key(0x60C2, 1)) == 0:
        found += [(key(0x60C2, 1), 1, 1), (key(0x60C2, 2), 1, -3)]
    return found
