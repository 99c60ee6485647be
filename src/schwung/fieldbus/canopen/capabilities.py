"""What commissioning can and cannot do with a drive, and why: profile, dictionary and the drive's own word."""

from __future__ import annotations

from collections.abc import Callable

from schwung.fieldbus.drive import Capability, Parameter
from schwung.fieldbus.profile import CanopenProfile, Ref

#: Bits of 6502 for the modes that we use (CiA 402-2).
_MODE_BITS = {"pp": 0, "csp": 7}

ReadInteger = Callable[[int, int], int | None]
Lookup = Callable[[int, int], Parameter | None]


def assess(profile: CanopenProfile, lookup: Lookup, read: ReadInteger) -> tuple[Capability, ...]:
    """Every capability by name, available or not, with the reason. Reads only.

    Names: "cyclic position", "profile position", "sampling by SYNC", "speed", "torque injection",
    "lockstep", "stop by heartbeat", "table feed-forward", "scalar feed-forward", "control gains", "store".
    """

    def reads(ref: Ref) -> bool:
        return lookup(ref.index, ref.subindex) is not None and read(ref.index, ref.subindex) is not None

    def capability(name: str, available: bool, yes: str, no: str) -> Capability:
        return Capability(name, available, yes if available else no)

    supported = read(0x6502, 0)
    found = [
        _mode("cyclic position", "csp", profile, supported),
        _mode("profile position", "pp", profile, supported),
    ]
    q, export = profile.quantities, profile.export
    added = q.torque_added
    clock = profile.sync.clocked_by_sync
    gains = profile.control
    named = [g for g in (gains.position_gain, gains.speed_gain, gains.speed_integral_time) if g is not None]
    can_watch = lookup(0x1016, 1) is not None and read(0x1016, 1) is not None
    found += [
        capability("sampling by SYNC", read(0x1800, 2) is not None, "TPDOs on every SYNC", "no TPDO 1 (1800)"),
        capability("speed", q.speed is not None and reads(q.speed.object), f"{q.speed and q.speed.object}",
                   "no speed object: it is derived from position"),
        capability("torque injection", added is not None and reads(added.object),
                   f"{added and added.object} by PDO", "no torque offset that a PDO can carry"),
        capability("lockstep", clock is not None and read(clock.index, clock.subindex) == 1,
                   "its time is SYNC itself", "its time is its own clock"),
        capability("stop by heartbeat", can_watch, "consumer heartbeat 1016", "no 1016: it will not notice our death"),
        capability("table feed-forward", export.table is not None and reads(export.table.start),
                   f"{export.table and export.table.points} points at {export.table and export.table.values}",
                   "no inertia table in the profile or in the drive"),
        capability("scalar feed-forward", export.scalar is not None and reads(export.scalar.object),
                   f"{export.scalar and export.scalar.object}", "no scalar inertia in the profile or in the drive"),
        capability("control gains", bool(named) and all(reads(g.object) for g in named),
                   "gains can be read", "no gains in the profile: give them in machine.toml"),
        capability("store", lookup(0x1010, 1) is not None and read(0x1010, 1) is not None, "1010:01",
                   "no 1010: parameters are lost at power-off"),
    ]  # fmt: skip
    return tuple(found)


def _mode(name: str, mode: str, profile: CanopenProfile, supported: int | None) -> Capability:
    if mode not in profile.modes:
        return Capability(name, False, "not in the profile")
    if supported is not None and not supported >> _MODE_BITS[mode] & 1:
        return Capability(name, False, f"6502 does not list it (0x{supported:08X})")
    return Capability(name, True, f"mode {profile.modes[mode]}")
