"""PDOs: the layout of a frame, what the drive's PDO objects must hold, and the order in which they can be written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schwung.errors import InputError, SdoError
from schwung.fieldbus import eds
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung.fieldbus.profile import CanopenProfile, ObjectRef, Pdo

INVALID = 0x80000000  # bit 31 of a COB-ID entry: the PDO does not exist
ON_EVERY_SYNC = 1  # transmission type
PREDEFINED = 4  # PDOs that have an identifier in the predefined connection set

Lookup = Callable[[int, int], Parameter | None]
ReadInteger = Callable[[Parameter], int]
Write = Callable[[ParameterValue], None]


@dataclass(frozen=True, eq=False)
class Layout:
    """One PDO: identifier, mapped objects, and the frame as a packed numpy record with fields like "6064:00"."""

    pdo: Pdo
    can_id: int
    entries: tuple[Parameter, ...]
    dtype: np.dtype[Any]

    @property
    def size(self) -> int:
        """Data bytes."""
        return int(self.dtype.itemsize)

    def carries(self, ref: ObjectRef | str) -> bool:
        """True where the object is mapped here."""
        return str(ref) in (self.dtype.names or ())

    def offset(self, ref: ObjectRef | str) -> int:
        """First byte of an object in the frame."""
        return int(self.dtype.fields[str(ref)][1])  # type: ignore[index]  # named dtypes have fields

    def place(self, ref: ObjectRef | str) -> slice:
        """The bytes of an object in the frame."""
        first = self.offset(ref)
        return slice(first, first + int(self.dtype[str(ref)].itemsize))

    def pack(self, columns: Mapping[str, Any], count: int) -> bytes:
        """`count` frames one after another; columns are integers or arrays (count,), absent ones 0."""
        frames = np.zeros(count, self.dtype)
        for name, values in columns.items():
            frames[name] = values
        return frames.tobytes()

    def unpack(self, frames: Iterable[bytes | bytearray]) -> NDArray[Any]:
        """Records of frames, (n,); a short frame counts its missing bytes as 0."""
        size = self.size
        return np.frombuffer(b"".join(bytes(f[:size]).ljust(size, b"\0") for f in frames), self.dtype)


@dataclass(frozen=True)
class Layouts:
    """The cyclic exchange: one RPDO, and the TPDOs by number."""

    rpdo: Layout
    tpdos: tuple[Layout, ...]


def layouts(profile: CanopenProfile, lookup: Lookup, node_id: int) -> Layouts:
    """Lay out the profile's PDOs. Raises InputError where the EDS lacks an object or a frame exceeds 8 bytes."""
    return Layouts(
        _layout(profile, profile.rpdos[0], lookup, node_id),
        tuple(_layout(profile, pdo, lookup, node_id) for pdo in profile.tpdos),
    )


def _layout(profile: CanopenProfile, pdo: Pdo, lookup: Lookup, node_id: int) -> Layout:
    place = f"profile {profile.family}, {pdo.direction} {pdo.number}"
    if pdo.number > PREDEFINED:
        raise InputError(place, "has no predefined identifier", f"Use PDO numbers 1 to {PREDEFINED}.")
    entries, fields = [], []
    for ref in pdo.entries:
        parameter = lookup(ref.index, ref.subindex)
        if parameter is None:
            raise InputError(place, f"{ref} is not in {profile.eds}", "Use the EDS of this drive family.")
        size = eds.byte_size(parameter.type)
        if size not in (1, 2, 4, 8):
            raise InputError(place, f"{ref} is {parameter.type}", "Map integers of 8, 16, 32 or 64 bits.")
        kind = (
            "f" if parameter.type.startswith("REAL") else "i" if parameter.type.startswith("INTEGER") else "u"
        )
        entries.append(parameter)
        fields.append((str(ref), f"<{kind}{size}"))
    dtype = np.dtype(fields)
    if dtype.itemsize > 8:
        raise InputError(
            place, f"maps {dtype.itemsize} bytes", "A frame holds 8: use another PDO for the rest."
        )
    base = 0x200 if pdo.direction == "rpdo" else 0x180
    return Layout(pdo, base + 0x100 * (pdo.number - 1) + node_id, tuple(entries), dtype)


def communication_index(pdo: Pdo) -> int:
    """Index of the PDO communication parameter."""
    return (0x1400 if pdo.direction == "rpdo" else 0x1800) + pdo.number - 1


def wanted(layout: Layout, present_cob_id: int) -> list[tuple[int, int, int]]:
    """(index, sub-index, value) of all that makes a drive exchange this PDO on every SYNC.

    Of the present COB-ID entry, bits 30 (no remote request) and 29 are kept.
    """
    communication = communication_index(layout.pdo)
    mapping = communication + 0x200
    cob_id = (present_cob_id & 0x40000000) | layout.can_id
    values = [(communication, 1, cob_id), (communication, 2, ON_EVERY_SYNC)]
    for number, entry in enumerate(layout.entries, start=1):
        bits = 8 * (eds.byte_size(entry.type) or 0)
        values.append((mapping, number, entry.index << 16 | entry.subindex << 8 | bits))
    return [*values, (mapping, 0, len(layout.entries))]


def is_pdo_object(parameter: Parameter) -> bool:
    """True for communication and mapping parameters of PDOs."""
    return 0x1400 <= parameter.index <= 0x1BFF


def write_pdos(values: Sequence[ParameterValue], lookup: Lookup, read: ReadInteger, write: Write) -> None:
    """Write PDO parameters in the order of CiA 301 7.5.2.36: disable, count 0, entries, the rest, count, enable.

    Values may be any subset of a PDO's objects (that is what a backup holds): what is not given stays as the drive
    has it. Entries above the final count mean nothing; that a drive refuses them does not matter.
    """
    numbers = sorted({(v.parameter.index & 0xFDFF) for v in values})
    for communication in numbers:
        own = [v for v in values if v.parameter.index == communication]
        mapped = {v.parameter.subindex: v for v in values if v.parameter.index == communication + 0x200}
        cob_parameter = _need(lookup, communication, 1)
        present = read(cob_parameter)
        final = next((int(v.raw) for v in own if v.parameter.subindex == 1), present)
        if not present & INVALID:
            write(ParameterValue(cob_parameter, present | INVALID))
        if mapped:
            count_parameter = _need(lookup, communication + 0x200, 0)
            count = int(mapped[0].raw) if 0 in mapped else read(count_parameter)
            write(ParameterValue(count_parameter, 0))
            for subindex in sorted(set(mapped) - {0}):
                try:
                    write(mapped[subindex])
                except SdoError:
                    if subindex <= count:
                        raise
        for value in own:
            if value.parameter.subindex > 1:
                write(value)
        if mapped:
            write(ParameterValue(count_parameter, count))
        if final != present | INVALID:
            write(ParameterValue(cob_parameter, final))


def _need(lookup: Lookup, index: int, subindex: int) -> Parameter:
    found = lookup(index, subindex)
    if found is None:
        raise InputError(
            f"0x{index:04X}:{subindex:02X}",
            "the EDS lacks it, but its PDO is used",
            "Use the EDS of this drive.",
        )
    return found
