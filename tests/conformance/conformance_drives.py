"""Every drive that the suite runs over: each family in device_profiles, on each of its buses, with its own EDS and with
its vendor's where that is on this computer. A new family is in it as soon as it has a folder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np

from schwung.fieldbus.profile import CanopenProfile, DeviceProfile, ModbusProfile, list_profiles, load_profile

VARIABLE = "SCHWUNG_REAL_EDS"
#: what a user of the bench's machine would give where neither drive nor profile tell a unit
USER_SCALES: Mapping[str, float] = {
    "position": 2 * np.pi / 2**20, "speed": 2 * np.pi / 60, "torque": 0.07, "torque_added": 0.07,
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One drive: a family, whose EDS it shows, on which bus."""

    family: str
    eds: Path | None = None  # None: the profile's own
    bus: str = "canopen"

    @property
    def id(self) -> str:
        own = "" if self.eds is None else f"+{self.eds.suffix[1:].lower()}"
        return self.family + own + ("" if self.bus == "canopen" else f"-{self.bus}")


def real_eds_files() -> list[Path]:
    """Vendors' own files; none where they are not on this computer."""
    named = os.environ.get(VARIABLE)
    places = [Path(named)] if named else [parent / "shared" / "eds" for parent in Path(__file__).parents]
    found = next((place for place in places if (place / "elmo-gold").is_dir()), None)
    return (
        [] if found is None else sorted(p for p in found.glob("*/*") if p.suffix.lower() in (".eds", ".dcf"))
    )


def _family_of(eds: Path, families: list[str]) -> str | None:
    """The family whose name has the most in common with the file's folder, and at least its vendor."""

    def shared(family: str) -> int:
        return sum(
            1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(family, eds.parent.name, strict=False))
        )

    best = max(families, key=shared)
    return best if shared(best) > len(best.split("-", maxsplit=1)[0]) else None


def canopen_cases() -> list[Case]:
    """Every CANopen family with its own EDS, then those with a vendor's."""
    families = [profile.family for profile in list_profiles() if isinstance(profile, CanopenProfile)]
    real = [(eds, _family_of(eds, families)) for eds in real_eds_files()]
    return [*map(Case, families), *(Case(family, eds) for eds, family in real if family is not None)]


def modbus_cases() -> list[Case]:
    """Every Modbus family, on TCP and on a serial line as far as it knows them."""
    families = [profile for profile in list_profiles() if isinstance(profile, ModbusProfile)]
    return [Case(p.family, bus=f"modbus-{transport}") for p in families for transport in p.modbus.transports]


def completed_profile(case: Case, folder: Path) -> Path:
    """A profile that extends the family's by what a user has to give."""
    profile: DeviceProfile = load_profile(case.family)
    lines = [f'extends = "{case.family}"']
    for name in type(profile.quantities).model_fields:
        quantity = getattr(profile.quantities, name)
        if quantity is not None and quantity.unit == "user":
            lines += [f"[quantities.{name}]", 'unit = "literal"', f"scale = {USER_SCALES[name]!r}"]
    file = folder / case.id / "profile.toml"
    file.parent.mkdir()
    file.write_text("\n".join(lines) + "\n")
    return file
