"""What commissioning can and cannot do with a drive, and why: profile, dictionary and the drive's own word."""

from __future__ import annotations

import functools
from collections.abc import Callable

from schwung.fieldbus.drive import Capability, OperatingMode, Parameter
from schwung.fieldbus.profile import CAPABILITIES, CanopenProfile, CapabilityName

#: Modes that we use, by the capability that each gives, and their bits of 6502 (CiA 402-2).
_MODES: dict[CapabilityName, tuple[OperatingMode, int]] = {
    "profile position": ("pp", 0),
    "cyclic position": ("csp", 7),
}
#: Objects of the standard that a capability needs, what is said where they are there, and where not.
_STANDARD: dict[CapabilityName, tuple[str, str, str]] = {
    "sampling by SYNC": ("1800:02", "TPDOs on every SYNC", "the drive has no TPDO 1 (1800)"),
    "stop by heartbeat": (
        "1016:01", "consumer heartbeat 1016", "the drive has no consumer heartbeat (1016): it will not notice our death"
    ),
    "store": ("1010:01", "1010:01", "no 1010: parameters are lost at power-off"),
}  # fmt: skip
#: Places in the profile whose objects a capability needs, and what is said of the first of them.
_PLACES: dict[CapabilityName, tuple[tuple[str, ...], str]] = {
    "speed": (("quantities.speed.object",), "{}"),
    "torque": (("quantities.torque.object",), "{}"),
    "torque injection": (("quantities.torque_added.object",), "{} by PDO"),
    "generator": (("generator.control.object", "generator.amplitude.object"), "its own sine, by {}"),
    "trace buffer": (("trace.control.object", "trace.status.object"), "armed by {}"),
    "disturbance buffer": (("disturbance_buffer.control.object",), "played by {}"),
    "table feed-forward": (("export.table.values", "export.table.start"), "table at {}"),
    "scalar feed-forward": (("export.scalar.object",), "{}"),
    "harmonic feed-forward": (("export.harmonics.offset.object",), "offset at {}"),
    "host-played feed-forward": (("export.host_played.object",), "{} at every SYNC"),
    "control gains": (("control.",), "from {} on"),
}

ReadInteger = Callable[[int, int], int | None]
Lookup = Callable[[int, int], Parameter | None]


def assess(profile: CanopenProfile, lookup: Lookup, read: ReadInteger) -> tuple[Capability, ...]:
    """Every capability (profile.CAPABILITIES) by name, available or not, with the reason. Reads only.

    What the profile does not offer comes with the profile's own reason, "this profile can't do that, because …";
    what it does is looked for in the drive.
    """

    @functools.cache
    def present(index: int, subindex: int) -> bool:
        return lookup(index, subindex) is not None and read(index, subindex) is not None

    def assessed(name: CapabilityName) -> Capability:
        if name == "lockstep":
            return _lockstep(profile, read)
        if not profile.offers(name):
            return Capability(name, False, profile.reason(name))
        if name in _MODES:
            return _mode(name, profile, read(0x6502, 0))
        if name in _STANDARD:
            place, yes, no = _STANDARD[name]
            index, subindex = (int(part, 16) for part in place.split(":"))
            there = present(index, subindex)
            return Capability(name, there, yes if there else no)
        places, told = _PLACES[name]
        refs = [ref for place, ref in profile.refs() if place.startswith(places)]
        missing = [str(ref) for ref in refs if not present(ref.index, ref.subindex)]
        if missing:
            return Capability(name, False, f"the drive does not have {', '.join(missing)}")
        return Capability(name, True, told.format(refs[0]))

    return tuple(map(assessed, CAPABILITIES))


def _mode(name: CapabilityName, profile: CanopenProfile, supported: int | None) -> Capability:
    mode, bit = _MODES[name]
    if supported is not None and not supported >> bit & 1:
        return Capability(name, False, f"6502 does not list it (0x{supported:08X})")
    return Capability(name, True, f"mode {profile.modes[mode]}")


def _lockstep(profile: CanopenProfile, read: ReadInteger) -> Capability:
    clock = profile.sync.clocked_by_sync
    clocked = clock is not None and read(clock.index, clock.subindex) == 1
    return Capability(
        "lockstep", clocked, "its time is SYNC itself" if clocked else "its time is its own clock"
    )
