"""What counts in a log are worth: as the user says, else as the profile and the objects seen in the log say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from schwung.errors import InputError
from schwung.fieldbus.canlog.decoding import Key
from schwung.fieldbus.canlog.observed import ObservedObjects
from schwung.fieldbus.canopen.scan import fitting_profiles
from schwung.fieldbus.drive import DriveIdentity
from schwung.fieldbus.eds import EdsFile
from schwung.fieldbus.profile import CanopenProfile, Quantity, load_canopen_profile
from schwung.fieldbus.units import ReadInteger, Scales, read_scales
from schwung.session.model import Axis

STANDARD = "generic-cia402"
#: What to give where the log does not tell what a count is worth.
_FLAGS = {
    "position": "Say how many counts make a turn of the motor: --position-unit counts=4096.",
    "speed": "Say what a count is: --speed-unit rpm, or --speed-unit counts/s=4096.",
    "torque": "Say the motor's rated torque in N·m: --torque-unit permille=3.2.",
}
#: The same of a linear axis, whose feed no log tells.
_LINEAR_FLAGS = {
    "position": "Say how far a count is: --position-unit um, or --position-unit counts=1000000 per metre.",
    "speed": "Say what a count is: --speed-unit um/s, or --speed-unit counts/s=1000000 per metre.",
    "torque": "Say the motor's rated force in N: --torque-unit permille=250.",
}
_QUANTITIES = ("position", "speed", "torque")


@dataclass(frozen=True)
class LoggedDrive:
    """The drive as the log shows it: who it is, what its counts are worth, by which profile."""

    identity: DriveIdentity | None
    profile: CanopenProfile
    scales: Scales
    notes: tuple[str, ...]


def integer_reader(objects: ObservedObjects, file: EdsFile) -> ReadInteger:
    """Reads an object from the log, else from a DCF's configured values. An EDS's defaults are those of no motor."""

    def read(index: int, subindex: int) -> int | None:
        seen = objects.latest(index, subindex)
        if seen is not None:
            found = file.find(index, subindex)
            return int.from_bytes(
                seen, "little", signed=found is not None and found.type.startswith("INTEGER")
            )
        variable = file.variable(index, subindex)
        value = None if variable is None else variable.configured
        return value.raw if value is not None and isinstance(value.raw, int) else None

    return read


def identity_of(objects: ObservedObjects) -> DriveIdentity | None:
    """Object 1018 and 1008 as seen in the log; None where nobody asked for it."""
    parts = [objects.latest(0x1018, subindex) for subindex in range(1, 5)]
    if parts[0] is None or parts[1] is None:
        return None
    numbers = [int.from_bytes(part or b"", "little") for part in parts]
    name = objects.latest(0x1008, 0) or b""
    return DriveIdentity(
        node_id=objects.node_id,
        vendor_id=numbers[0],
        product_code=numbers[1],
        revision=numbers[2],
        serial=numbers[3],
        name=name.decode("ascii", errors="replace").strip("\0 "),
    )


def logged_drive(
    objects: ObservedObjects,
    file: EdsFile,
    family: str | None,
    said: Mapping[str, float],
    mapped: frozenset[Key],
    axis: Axis = "rotary",
) -> LoggedDrive:
    """Who it is and what its counts are worth. `family`: a profile by name; else that of the drive's identity, else
    CiA 402's own objects. `said`: SI per count by quantity, from the user, which comes first.

    Raises InputError naming the object that nobody read and the option that says it instead.
    """
    notes: list[str] = []
    identity = identity_of(objects)
    if family is not None:
        profile = load_canopen_profile(family)
    else:
        fitting = fitting_profiles(identity) if identity is not None else []
        profile = fitting[0] if fitting else load_canopen_profile(STANDARD)
        why = (
            "by the identity in the log"
            if fitting
            else "no profile knows the drive, or nobody asked who it is"
        )
        notes.append(f"units by profile {profile.family}: {why}")
    read = integer_reader(objects, file)
    if axis == "linear":
        _require_said(profile, said, mapped, objects.node_id)
    scales = read_scales(_told(profile, read, said, mapped, objects.node_id), read)
    return LoggedDrive(identity, profile, scales, tuple(notes))


def _require_said(
    profile: CanopenProfile, said: Mapping[str, float], mapped: frozenset[Key], node_id: int
) -> None:
    for name in _QUANTITIES:
        quantity: Quantity | None = getattr(profile.quantities, name)
        if quantity is None or name in said:
            continue
        if name == "speed" and (quantity.object.index, quantity.object.subindex) not in mapped:
            continue
        raise InputError(
            f"{name} of node {node_id}",
            "is that of a linear axis, whose feed is not in the log",
            _LINEAR_FLAGS[name],
        )


def _told(
    profile: CanopenProfile,
    read: ReadInteger,
    said: Mapping[str, float],
    mapped: frozenset[Key],
    node_id: int,
) -> CanopenProfile:
    """The profile with what the user said, without what is not in the log; each quantity tried by itself, so that the
    error names the right option."""
    quantities = profile.quantities
    changes: dict[str, Quantity | None] = {}
    for name in (*_QUANTITIES, "torque_added"):
        quantity: Quantity | None = getattr(quantities, name)
        if quantity is None:
            continue
        kind = "torque" if name == "torque_added" else name
        if kind in said:
            changes[name] = quantity.model_copy(
                update={"unit": "literal", "scale": said[kind], "resolution": None}
            )
        elif name != "position" and (quantity.object.index, quantity.object.subindex) not in mapped:
            changes[name] = None
    told = profile.model_copy(update={"quantities": quantities.model_copy(update=changes)})
    for name in _QUANTITIES:
        quantity = getattr(told.quantities, name)
        if quantity is None or quantity.unit == "literal":
            continue
        alone: dict[str, Quantity | None] = dict.fromkeys(("speed", "torque", "torque_added", "acceleration"))
        if name != "position":
            literal = {"unit": "literal", "scale": 1.0, "resolution": None}
            alone |= {"position": told.quantities.position.model_copy(update=literal), name: quantity}
        try:
            read_scales(
                told.model_copy(update={"quantities": told.quantities.model_copy(update=alone)}), read
            )
        except InputError as error:
            raise InputError(
                f"{name} of node {node_id}", f"{error.problem}: nobody read it in this log", _FLAGS[name]
            ) from None
        if quantity.unit == "user":
            raise InputError(
                f"{name} of node {node_id}", f"its unit is the user's ({quantity.hint})", _FLAGS[name]
            )
    return told
