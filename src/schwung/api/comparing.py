"""Two configurations side by side, files or the drive itself: read, compared, told."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schwung.api.drives import Connection
from schwung.commissioning.backup import read_snapshot
from schwung.commissioning.compare import Comparison, Configuration, Difference, compare, from_drive, key_of
from schwung.commissioning.configuration_files import fitting_dictionary
from schwung.errors import InputError
from schwung.fieldbus.canopen.scan import fitting_profiles
from schwung.fieldbus.configuration import Selection, select
from schwung.fieldbus.drive import DriveIdentity, RawValue
from schwung.fieldbus.eds import EdsFile, read_eds
from schwung.fieldbus.profile import CanopenProfile, load_canopen_profile
from schwung.fieldbus.si import SiScales, si_scales

__all__ = [
    "Comparison",
    "Configuration",
    "Difference",
    "HeldByDrive",
    "compared",
    "comparison_document",
    "dictionary_of",
    "for_json",
    "held_by_drive",
    "known_profile",
    "scales_of",
]


@dataclass(frozen=True)
class HeldByDrive:
    """What a drive holds of what another configuration has; family and dictionary where they are known."""

    configuration: Configuration
    family: CanopenProfile | None
    dictionary: EdsFile | None


def held_by_drive(
    connection: Connection,
    other: Configuration,
    eds: Path | None,
    node: int,
    phase: Callable[[str], None],
    progress: Callable[[int, int], None],
) -> HeldByDrive:
    """Read of a drive what `other` has. A Modbus drive has no dictionary: all of it is asked for. Changes nothing.

    Raises InputError where no EDS fits, DriveError where the drive fails.
    """
    family, dictionary = None, None
    if isinstance(connection.profile, CanopenProfile):
        family = connection.profile
        dictionary = fitting_dictionary(other, eds, family, connection.drive.identity, node)
        known = select(dictionary, family).wanted
    else:
        known = tuple(v.parameter for v in other.values if v.parameter.space == "register")
    asked = {key_of(value.parameter) for value in other.values}
    wanted = tuple(parameter for parameter in known if key_of(parameter) in asked)
    phase(f"Reading {len(wanted)} parameters of node {node}")
    snapshot = read_snapshot(connection.drive.read, Selection(wanted, (), 0, 0), progress)
    name = connection.drive.identity.name or "drive"
    return HeldByDrive(from_drive(f"node {node}: {name}", snapshot.values, node), family, dictionary)


def compared(
    sides: tuple[Configuration, Configuration],
    family: CanopenProfile | None,
    dictionary: EdsFile | None,
    node: int,
) -> Comparison:
    """Both sides held against each other, with SI where it is known what a count is worth.

    family, dictionary: None: by what the sides say of themselves. Raises InputError where nothing is in common.
    """
    family = family or known_profile(None, (dict(side.identity) for side in sides))
    dictionary = dictionary or dictionary_of(None, family, node)
    found = compare(*sides, scales_of(family, sides, dictionary))
    if not found.equal and not found.differences:
        raise InputError(
            f"{sides[0].source}, {sides[1].source}", "have no parameter in common that can be compared",
            "Are they of the same kind of drive?",
        )  # fmt: skip
    return found


def comparison_document(sides: tuple[Configuration, Configuration], found: Comparison) -> dict[str, Any]:
    """A comparison for programs: what differs, raw and in SI; what only one of them has; how many are equal."""

    def entries(rows: Sequence[Difference]) -> list[dict[str, Any]]:
        return [
            {
                "index": f"0x{d.parameter.index:04X}", "subindex": d.parameter.subindex, "name": d.parameter.name,
                "type": d.parameter.type, "a": for_json(d.first), "b": for_json(d.second),
                "a_si": d.first_si and d.first_si.value, "b_si": d.second_si and d.second_si.value,
                "unit": (d.first_si and d.first_si.unit) or (d.second_si and d.second_si.unit),
            }
            for d in rows
        ]  # fmt: skip

    return {
        "a": {"source": sides[0].source, "kind": sides[0].kind},
        "b": {"source": sides[1].source, "kind": sides[1].kind},
        "different": entries(found.differences),
        "equal": found.equal,
        "only_in_a": entries(found.only_first),
        "only_in_b": entries(found.only_second),
    }


def known_profile(name: str | None, identities: Iterable[dict[str, int]]) -> CanopenProfile | None:
    """The profile as named, else the one that fits an identity; None where nobody knows. Raises InputError."""
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
    path = eds or (profile.eds_path if profile is not None else None)
    return None if path is None else read_eds(path, node_id)


def for_json(raw: RawValue | None) -> Any:
    """A raw value in JSON, bytes as in a backup file."""
    return {"hex": raw.hex()} if isinstance(raw, bytes) else raw
