"""An EDS or DCF file, repaired and handed to canopen."""

from __future__ import annotations

import functools
import io
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schwung.errors import InputError
from schwung.fieldbus.drive import Parameter
from schwung.fieldbus.eds.device import describe
from schwung.fieldbus.eds.lines import EdsWarning, decode_text, split_sections
from schwung.fieldbus.eds.model import ARRAY, RECORD, Description, Variable
from schwung.fieldbus.eds.render import decimal_reals, render
from schwung.fieldbus.eds.repair import Repair
from schwung.fieldbus.eds.types import TYPE_NAMES

if TYPE_CHECKING:
    import canopen

logging.getLogger("canopen").addHandler(logging.NullHandler())  # our errors say it better, and once

_MOST_BYTES = 32 << 20


@dataclass(frozen=True, eq=False)
class EdsFile:
    """A file as read: the description of all that it holds, canopen's dictionary (not to be changed), what was odd."""

    path: Path
    node_id: int
    description: Description
    warnings: tuple[EdsWarning, ...]
    unusable: Mapping[tuple[int, int], EdsWarning]

    @functools.cached_property
    def dictionary(self) -> canopen.ObjectDictionary:
        """canopen's, made from the description when it is first asked for: that takes as long as reading the file."""
        from canopen.objectdictionary.eds import import_eds  # noqa: PLC0415  (seldom needed)

        text = render(self.description, configured=True, node_id=self.node_id, write=decimal_reals)
        return import_eds(io.StringIO(text), self.node_id)

    def device_number(self, name: str) -> int | None:
        """A number of the section DeviceInfo, as "VendorNumber"; None where the file does not say it."""
        text = self.description.device_info.get(name)
        return None if text is None else int(text, 0)

    def variable(self, index: int, subindex: int = 0) -> Variable | None:
        """All that the file says about an object; None where it has none that can be used."""
        held = self.description.objects.get(index)
        return None if held is None else held.variables.get(subindex)

    def find(self, index: int, subindex: int = 0) -> Parameter | None:
        """The parameter with its type and name; None where the file has none that can be used."""
        variable = self.variable(index, subindex)
        return None if variable is None else self.parameter_of(variable)

    def parameter(self, index: int, subindex: int = 0) -> Parameter:
        """The same, for who cannot do without. Raises InputError naming file, line and remedy."""
        found = self.find(index, subindex)
        if found is not None:
            return found
        trouble = self.unusable.get((index, subindex))
        if trouble is not None:
            raise InputError(
                f"{self.path}:{trouble.line}, [{trouble.section}]", trouble.problem, trouble.remedy
            )
        raise InputError(
            str(self.path), f"has no object 0x{index:04X}:{subindex:02X}",
            "Take the EDS of this drive and of its firmware.",
        )  # fmt: skip

    def parameter_of(self, variable: Variable) -> Parameter:
        """A variable of this file as a parameter of a drive."""
        held = self.description.objects[variable.index]
        name = f"{held.name}: {variable.name}" if held.kind in (ARRAY, RECORD) else variable.name
        return Parameter(variable.index, variable.subindex, variable.type, name)


def read_eds(path: Path, node_id: int) -> EdsFile:
    """Read an EDS or DCF file for the given node ($NODEID is put in), whatever is odd in it.

    Raises InputError naming file, line and remedy where it describes no object that could be used.
    """
    return _read(_content(path), path, node_id)


@functools.lru_cache(maxsize=64)  # a drive's file is read by scan, driver and commands in turn
def _read(content: bytes, path: Path, node_id: int) -> EdsFile:
    warnings: list[EdsWarning] = []
    sections = split_sections(decode_text(content, warnings), warnings)
    repair = Repair(sections, node_id, warnings)
    description = describe(repair)
    if not description.objects:
        trouble = next(iter(repair.unusable.values()), warnings[0] if warnings else None)
        place = f"{path}:{trouble.line}" if trouble is not None and trouble.line else f"{path}:1"
        raise InputError(place, "describes no object that can be used", "Give the drive's EDS file.")
    ordered = tuple(sorted(warnings, key=lambda warning: warning.line))
    return EdsFile(path, node_id, description, ordered, repair.unusable)


def load_dictionary(path: Path, node_id: int) -> canopen.ObjectDictionary:
    """canopen's dictionary of an EDS or DCF file; see `read_eds`."""
    return read_eds(path, node_id).dictionary


def find_parameter(dictionary: canopen.ObjectDictionary, index: int, subindex: int) -> Parameter | None:
    """The parameter at index and sub-index with its type and name; None where the dictionary lacks it."""
    entry: Any = dictionary.indices.get(index)
    held: Mapping[int, Any] = getattr(entry, "subindices", {0: entry})
    variable: Any = held.get(subindex)
    type_name = None if variable is None else TYPE_NAMES.get(variable.data_type)
    if type_name is None:
        return None
    name = variable.name if variable is entry else f"{entry.name}: {variable.name}"
    return Parameter(index, subindex, type_name, name)


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be read ({error.strerror})", "Give an existing EDS file."
        ) from error
    if len(content) > _MOST_BYTES:
        raise InputError(str(path), f"is larger than {_MOST_BYTES >> 20} MB", "Give the drive's EDS file.")
    if not content.strip():
        raise InputError(str(path), "is empty", "Give the drive's EDS file.")
    return content
