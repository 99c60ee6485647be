"""What backup, restore and diff share: rows of values, and what a count is worth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from schwung.api.configurations import Configuration, EdsFile, ParameterValue, RawValue, SiScales, Skipped
    from schwung.api.profiles import CanopenProfile, DeviceProfile

_SHOWN = 6


def canopen_profile(profile: DeviceProfile, command: str) -> CanopenProfile:
    """The profile of a CANopen drive. Raises InputError for another one."""
    from schwung.api.profiles import CanopenProfile
    from schwung.errors import InputError

    if not isinstance(profile, CanopenProfile):
        raise InputError(
            f"schwung {command}",
            f"nobody tells which registers of {profile.family} are settings",
            "This is for CANopen drives, whose EDS tells it.",
        )
    return profile


def known_profile(name: str | None, identities: Iterable[dict[str, int]]) -> CanopenProfile | None:
    """The profile as named, else the one that fits an identity; None where nobody knows. Raises InputError."""
    from schwung.api.configurations import DriveIdentity, fitting_profiles
    from schwung.api.profiles import CanopenProfile, load_canopen_profile

    if name is not None:
        return load_canopen_profile(name)
    for told in identities:
        if "vendor_id" in told and "product_code" in told:
            identity = DriveIdentity(0, told["vendor_id"], told["product_code"], 0, 0)
            for profile in fitting_profiles(identity):
                if isinstance(profile, CanopenProfile):
                    return profile
    return None


def scales_of(
    profile: CanopenProfile | None, sides: Iterable[Configuration], dictionary: EdsFile | None
) -> SiScales:
    """What a count is worth, by what the configurations hold, and the defaults of the EDS where they are silent."""
    from schwung.api.configurations import si_scales

    held = [side.by_key() for side in sides]

    def read(index: int, subindex: int) -> int | None:
        for values in held:
            value = values.get(("object", index, subindex))
            if value is not None and isinstance(value.raw, int):
                return value.raw
        variable = dictionary.variable(index, subindex) if dictionary is not None else None
        raw = variable.default.raw if variable is not None and variable.default is not None else None
        return raw if isinstance(raw, int) else None

    return si_scales(profile, read)


def dictionary_of(eds: Path | None, profile: CanopenProfile | None, node_id: int) -> EdsFile | None:
    """The EDS as given, else the profile's."""
    from schwung.api.configurations import read_eds

    path = eds or (profile.eds_path if profile is not None else None)
    return None if path is None else read_eds(path, node_id)


def shown(value: ParameterValue | None) -> str:
    """A raw value as people read it: identifiers and mappings in hexadecimal, as bytes; nothing as a dash."""
    from schwung.api.configurations import byte_size

    if value is None:
        return "–"
    raw, size = value.raw, byte_size(value.parameter.type)
    if isinstance(raw, bytes):
        return raw.hex(" ")
    if (
        isinstance(raw, int)
        and size == 4
        and value.parameter.space == "object"
        and value.parameter.index < 0x2000
    ):
        return f"0x{raw:08X}"
    return str(raw)


def cells(value: ParameterValue | None, scales: SiScales) -> tuple[str, str]:
    """A value for two columns: raw, and in SI where it is known."""
    return shown(value), "" if value is None else str(scales.si(value) or "")


def for_json(raw: RawValue | None) -> Any:
    """A raw value in JSON, bytes as in a backup file."""
    return {"hex": raw.hex()} if isinstance(raw, bytes) else raw


def reasons(skipped: Iterable[Skipped]) -> list[tuple[str, int, str]]:
    """What was left out, by reason: how many, and the first of them."""
    found = list(skipped)
    counts = Counter(item.reason for item in found)
    rows = []
    for reason, count in counts.most_common():
        labels = [f"{s.parameter.index:04X}:{s.parameter.subindex:02X}" for s in found if s.reason == reason]
        more = ", …" if count > _SHOWN else ""
        rows.append((reason, count, ", ".join(labels[:_SHOWN]) + more))
    return rows
