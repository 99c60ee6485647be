"""What backup, restore and diff share: rows of values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from schwung.api.configurations import ParameterValue, SiScales, Skipped
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
