"""What commissioning can and cannot do with a Modbus drive, and why: the profile's word, and the drive's."""

from __future__ import annotations

from schwung.errors import DriveError
from schwung.fieldbus.drive import Capability
from schwung.fieldbus.modbus.registers import Registers
from schwung.fieldbus.profile import (
    CAPABILITIES,
    CapabilityName,
    ModbusProfile,
    ObjectRef,
    Quantity,
    ScalarExport,
    ScaledObject,
    Setting,
)


def assess(profile: ModbusProfile, registers: Registers) -> tuple[Capability, ...]:
    """Every capability by name, available or not, with the reason. Reads only, one register for each."""
    return tuple(_one(name, profile, registers) for name in CAPABILITIES)


def _one(name: CapabilityName, profile: ModbusProfile, registers: Registers) -> Capability:
    ref = _proof(name, profile)
    if ref is None:
        return Capability(name, False, profile.reason(name))
    try:
        registers.integer(ref)
    except DriveError as error:
        return Capability(name, False, f"the drive does not show it ({error.place}: {error.problem})")
    return Capability(name, True, _words(name, profile, ref))


def _proof(name: CapabilityName, profile: ModbusProfile) -> ObjectRef | None:
    """The register that a capability cannot do without; None where the profile does not offer it."""
    q, export = profile.quantities, profile.export
    gains = [g for g in (profile.control.position_gain, profile.control.speed_gain) if g is not None]
    generator, trace = profile.generator, profile.trace
    refs: dict[CapabilityName, ObjectRef | None] = {
        "profile position": q.position.demand if "pp" in profile.modes else None,
        "trace buffer": trace.status.object if trace is not None else None,
        "generator": generator.control.object if generator is not None else None,
        "speed": _object(q.speed),
        "torque": _object(q.torque),
        "stop by heartbeat": _object(profile.watchdog),
        "table feed-forward": export.table.start if export.table is not None else None,
        "scalar feed-forward": _object(export.scalar),
        "control gains": gains[0].object if len(gains) == 2 else None,
        "store": _object(profile.store),
    }
    return refs.get(name)


def _object(part: Quantity | ScaledObject | ScalarExport | Setting | None) -> ObjectRef | None:
    return None if part is None else part.object


def _words(name: CapabilityName, profile: ModbusProfile, ref: ObjectRef) -> str:
    trace, table = profile.trace, profile.export.table
    if name == "trace buffer" and trace is not None:
        return f"{trace.base_rate_hz:g} Hz, {trace.max_samples} samples"
    if name == "profile position":
        return f"mode {profile.modes['pp']}"
    if name == "stop by heartbeat":
        return f"watchdog, register {ref.index}"
    if name == "table feed-forward" and table is not None:
        return f"{table.points} points at register {table.values.index}"
    return f"register {ref.index}"
