"""Does an EDS bear out what a profile says? Each finding has its place in the profile, and a remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel

from schwung.fieldbus.eds import EdsFile, byte_size, integer_range
from schwung.fieldbus.eds.model import Variable
from schwung.fieldbus.eds.standard import standard_type
from schwung.fieldbus.profile.model import CAPABILITIES, CanopenProfile, DeviceProfile, Pdo
from schwung.fieldbus.profile.parts import ObjectRef, Quantity, Setting

_FRAME_BYTES = 8
#: Bits of 6502 (CiA 402-2) by mode of operation.
_MODE_BIT = {1: 0, 2: 1, 3: 2, 4: 3, 6: 5, 7: 6, 8: 7, 9: 8, 10: 9}
#: Fields in which an object is written; all others are read.
_WRITTEN = (
    "demand",
    "torque_added",
    "host_played",
    "generator",
    "divider",
    "period",
    "length",
    "selector",
    "cursor",
)
_WRITTEN_PARTS = ("stop.", "export.", "trace.control.", "disturbance_buffer.")
#: Fields that hold bulk data rather than a number.
_DATA = (".data",)
#: Fields that name an array as a whole.
_ARRAYS = (".values", ".amplitudes", ".phases")


@dataclass(frozen=True)
class Finding:
    """Something that does not fit. An error makes the profile useless with such a drive, a warning only poorer."""

    severity: Literal["error", "warning"]
    place: str  # in the profile: "quantities.torque.object", "pdo[1]"
    problem: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.place}: {self.problem}. {self.remedy}"


def check_profile(profile: DeviceProfile, eds: EdsFile | None = None) -> tuple[Finding, ...]:
    """All that a profile leaves unsaid, and, for CANopen, all in which the EDS contradicts it; errors first."""
    found = [*_unsaid(profile)]
    if isinstance(profile, CanopenProfile) and eds is not None:
        found += [*_identity(profile, eds), *_objects(profile, eds), *_units(profile, eds)]
        found += [*_pdos(profile, eds), *_modes(profile, eds)]
    return tuple(sorted(dict.fromkeys(found), key=lambda finding: finding.severity))


def unsourced(profile: DeviceProfile) -> list[str]:
    """Places that hold a fact of the manufacturer's and that no key of [sources] covers."""
    places = [
        place for place, ref in profile.refs() if ref.space == "register" or 0x2000 <= ref.index < 0x6000
    ]
    places += [place for place, number in _scales("", profile) if number is not None]
    if getattr(profile, "identity", None):
        places.append("identity")
    return [place for place in dict.fromkeys(places) if not _covered(place, profile.sources)]


def _covered(place: str, sources: Iterable[str]) -> bool:
    return any(place == key or place.startswith((f"{key}.", f"{key}[")) for key in sources)


def _scales(place: str, part: Any) -> Iterator[tuple[str, float | None]]:
    """Literal scales, and scales of the rated torque that are not the standard's mN·m."""
    if isinstance(part, Quantity):
        unusual = part.unit == "rated_torque" and part.rated_torque_scale != 1e-3
        yield place, part.rated_torque_scale if unusual else part.scale
    elif isinstance(part, BaseModel):
        for name in type(part).model_fields:
            yield from _scales(f"{place}.{name}".lstrip("."), getattr(part, name))


def _unsaid(profile: DeviceProfile) -> Iterator[Finding]:
    parts: dict[str, list[str]] = {}
    for place in unsourced(profile):
        parts.setdefault(re.split(r"[.\[]", place)[0], []).append(place)
    for part, places in parts.items():
        more = f" and {len(places) - 1} more" if len(places) > 1 else ""
        yield Finding(
            "warning", "sources", f"{places[0]}{more} has no source", f"Say where it is from: {part} = …"
        )
    for name in CAPABILITIES:
        silent = profile.reason(name).endswith("it says nothing of it")
        if silent and not profile.offers(name):
            yield Finding("warning", f'cannot."{name}"', "is missing", "Say why the family cannot do that.")


def _identity(profile: CanopenProfile, eds: EdsFile) -> Iterator[Finding]:
    want, info = profile.identity, eds.dictionary.device_information
    if want is None:
        return
    for name, wanted, told in (
        ("vendor_id", want.vendor_id, info.vendor_number),
        ("product_code", want.product_code, info.product_number),
    ):
        if wanted is not None and told and wanted != told:
            yield Finding(
                "error", f"identity.{name}", f"is 0x{wanted:08X}, the EDS is of 0x{told:08X}",
                "Take the EDS of this family, or another profile.",
            )  # fmt: skip


def _objects(profile: CanopenProfile, eds: EdsFile) -> Iterator[Finding]:
    """Every object is there, of a type and an access that the profile can use."""
    standard = [("statusword", "6041"), ("controlword", "6040")]
    needed = [*standard, ("mode", "6060"), ("mode", "6061")] if profile.modes else standard
    for what, index in needed:
        if eds.variable(int(index, 16)) is None:
            yield Finding("error", what, f"{index}:00 is not in the EDS", "No CiA 402 drive goes without it.")
    for place, ref in profile.refs():
        noted = place.startswith("noted.")
        variable = _variable_of(ref, place, eds)
        if variable is None:
            yield Finding(
                "warning" if noted else "error", place, f"{ref} is not in the EDS",
                "Take the EDS of this drive and firmware, or leave the part out and say why in [cannot].",
            )  # fmt: skip
        elif not noted and not place.startswith("pdo["):  # of PDOs, `_entries` says more
            yield from _usable(place, variable)
    for place, setting in _settings("", profile):
        variable = eds.variable(setting.object.index, setting.object.subindex)
        if variable is not None:
            yield from _value(place, variable, setting.value)


def _variable_of(ref: ObjectRef, place: str, eds: EdsFile) -> Variable | None:
    """The object; of an array that is named as a whole, its first element."""
    element = eds.variable(ref.index, 1) if ref.subindex == 0 and place.endswith(_ARRAYS) else None
    return element or eds.variable(ref.index, ref.subindex)


def _usable(place: str, variable: Variable) -> Iterator[Finding]:
    """One object's type and access."""
    usual = standard_type(variable.index, variable.subindex)
    if usual is not None and usual != variable.type:
        yield Finding(
            "warning", place, f"{_label(variable)} is {variable.type} in the EDS, {usual} by the standard",
            "Ask the drive which it is before trusting the EDS.",
        )  # fmt: skip
    bulk = place.endswith(_DATA)
    if not bulk and integer_range(variable.type) is None:
        yield Finding(
            "error",
            place,
            f"{_label(variable)} is {variable.type}, and counts are wanted",
            "Name an integer object.",
        )
    written = place.startswith(_WRITTEN_PARTS) or any(word in place for word in _WRITTEN)
    if place.endswith(".per"):
        written = False
    if written and not variable.writable:
        yield Finding(
            "error", place, f"{_label(variable)} cannot be written ({variable.access})", "Name another."
        )
    if not written and not variable.readable:
        yield Finding(
            "error", place, f"{_label(variable)} cannot be read ({variable.access})", "Name another."
        )


def _settings(place: str, part: Any) -> Iterator[tuple[str, Setting]]:
    if isinstance(part, Setting):
        yield place, part
    elif isinstance(part, BaseModel):
        for name in type(part).model_fields:
            yield from _settings(f"{place}.{name}".lstrip("."), getattr(part, name))


def _value(place: str, variable: Variable, value: int) -> Iterator[Finding]:
    """A value that is to be written fits the object's type and limits."""
    low, high = integer_range(variable.type) or (value, value)
    low = low if variable.low is None else max(low, variable.low)
    high = high if variable.high is None else min(high, variable.high)
    if low <= high and not low <= value <= high:
        yield Finding(
            "error", place, f"{value} is outside {low} … {high} of {_label(variable)}", "Write another value."
        )


def _units(profile: CanopenProfile, eds: EdsFile) -> Iterator[Finding]:
    """The objects that tell the units are there."""
    q = profile.quantities
    for name in type(q).model_fields:
        quantity: Quantity | None = getattr(q, name)
        if quantity is None:
            continue
        wanted = {
            "encoder": (0x608F, 0x6092),
            "si_unit_velocity": (0x60A9,),
            "rated_torque": (0x6076,) if quantity.rated is None else (),
        }.get(quantity.unit, ())
        if wanted and not any(index in eds.description.objects for index in wanted):
            names = " nor ".join(f"{index:04X}" for index in wanted)
            yield Finding(
                "error", f"quantities.{name}.unit",
                f'"{quantity.unit}" needs what is not in the EDS: {"neither " if len(wanted) > 1 else ""}{names}',
                'Take unit = "literal" with a scale, or unit = "user" with a hint.',
            )  # fmt: skip


def _pdos(profile: CanopenProfile, eds: EdsFile) -> Iterator[Finding]:
    played = profile.export.host_played
    if played is not None and played.object not in profile.rpdos[0].entries:
        yield Finding(
            "error",
            "export.host_played.object",
            f"no rpdo carries {played.object}",
            "Map it, or leave the part out.",
        )
    for number, pdo in enumerate(profile.pdo, start=1):
        place = f"pdo[{number}] ({pdo.direction} {pdo.number})"
        communication = (0x1400 if pdo.direction == "rpdo" else 0x1800) + pdo.number - 1
        if communication not in eds.description.objects:
            there = sum(1 for index in range(communication & 0xFE00, (communication & 0xFE00) + 512)
                        if index in eds.description.objects)  # fmt: skip
            yield Finding(
                "error", place, f"the drive has {there} {pdo.direction}s: {communication:04X} is not in the EDS",
                "Put the objects into fewer PDOs.",
            )  # fmt: skip
            continue
        yield from _mapping(place, pdo, communication + 0x200, eds)
        yield from _entries(place, pdo, eds)


def _mapping(place: str, pdo: Pdo, index: int, eds: EdsFile) -> Iterator[Finding]:
    """The mapping parameter takes these entries, or holds them already."""
    count = eds.variable(index, 0)
    if count is None:
        yield Finding("error", place, f"{index:04X} is not in the EDS", "Take the EDS of this drive.")
        return
    held = [eds.variable(index, number) for number in range(1, len(pdo.entries) + 1)]
    if any(entry is None for entry in held):
        yield Finding(
            "error",
            place,
            f"{index:04X} takes fewer than {len(pdo.entries)} objects",
            "Map fewer, or use another PDO.",
        )
    elif pdo.fixed:
        wanted = [ref.index << 16 | ref.subindex << 8 for ref in pdo.entries]
        told = [raw for entry in held if entry is not None and (raw := _number(entry)) is not None]
        if [raw & 0xFFFFFF00 for raw in told] != wanted:
            shown = ", ".join(f"{entry:08X}" for entry in told) or "nothing"
            yield Finding("error", place, f"the EDS has {shown} mapped in {index:04X}", "Say what is mapped.")
    elif not count.writable or not all(entry is None or entry.writable for entry in held):
        yield Finding(
            "error",
            place,
            f"{index:04X} cannot be written: the mapping is fixed",
            "Say fixed = true and what is mapped.",
        )


def _entries(place: str, pdo: Pdo, eds: EdsFile) -> Iterator[Finding]:
    """Every object can be mapped in that direction, and a frame holds them all."""
    size = 0
    for ref in pdo.entries:
        variable = eds.variable(ref.index, ref.subindex)
        if variable is None:
            continue  # told already
        size += byte_size(variable.type) or 0
        if not variable.mappable:
            yield Finding(
                "error", place, f"{_label(variable)} cannot be mapped (PDOMapping=0)",
                "Leave it out, and say in [cannot] what is lost.",
            )  # fmt: skip
        if pdo.direction == "rpdo" and not variable.writable:
            yield Finding("error", place, f"{_label(variable)} cannot be written", "Put it into a tpdo.")
    if size > _FRAME_BYTES:
        yield Finding("error", place, f"maps {size} bytes", "A frame holds 8: use another PDO for the rest.")


def _modes(profile: CanopenProfile, eds: EdsFile) -> Iterator[Finding]:
    supported, chosen = eds.variable(0x6502), eds.variable(0x6060)
    told = None if supported is None else _number(supported)
    for name, mode in profile.modes.items():
        bit = _MODE_BIT.get(mode)
        if told is not None and bit is not None and not told >> bit & 1:
            yield Finding(
                "error",
                f"modes.{name}",
                f"6502 of the EDS does not list it (0x{told:08X})",
                "Leave the mode out.",
            )
        if chosen is not None:
            yield from _value(f"modes.{name}", chosen, mode)


def _number(variable: Variable) -> int | None:
    """The value that the file gives: the configured one (DCF), else the default; None where it gives no integer."""
    held = variable.configured or variable.default
    return held.raw if held is not None and isinstance(held.raw, int) else None


def _label(variable: Variable) -> str:
    return f"{variable.index:04X}:{variable.subindex:02X} ({variable.name})"
