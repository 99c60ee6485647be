"""What a repaired file describes: objects, their variables, and the little that is said about the device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from schwung.fieldbus.eds.notation import Value

#: Object codes of CiA 301 table 42 that stand for something that can be read or written.
DOMAIN, VAR, ARRAY, RECORD = 0x02, 0x07, 0x08, 0x09


@dataclass(frozen=True)
class Variable:
    """One readable or writable thing: an object, or a sub-index of one."""

    index: int
    subindex: int
    name: str
    type: str
    access: str  # ro, wo, rw, rwr, rww, const
    mappable: bool = False
    low: int | None = None
    high: int | None = None
    default: Value | None = None
    configured: Value | None = None  # ParameterValue, in a DCF
    flags: int = 0  # ObjFlags, CiA 306-1 4.6.3.2; bit 0: refuse write on download, bit 1: refuse read on scan
    line: int = 0
    extra: Mapping[str, str] = field(default_factory=dict)  # Factor, Unit, Description, which canopen reads

    @property
    def readable(self) -> bool:
        """True where the file allows reading."""
        return self.access != "wo"

    @property
    def writable(self) -> bool:
        """True where the file allows writing."""
        return "w" in self.access

    @property
    def refuses_write(self) -> bool:
        """True where the file asks not to write it when a configuration is put back."""
        return bool(self.flags & 1)

    @property
    def refuses_read(self) -> bool:
        """True where the file asks not to read it when everything is read."""
        return bool(self.flags & 2)


@dataclass(frozen=True)
class Object:
    """An object with its variables by sub-index; a VAR has the one at 0."""

    index: int
    name: str
    kind: int  # VAR, DOMAIN, ARRAY, RECORD
    variables: Mapping[int, Variable]
    line: int = 0


@dataclass(frozen=True)
class Description:
    """A whole file, repaired."""

    objects: Mapping[int, Object]
    file_info: Mapping[str, str] = field(default_factory=dict)
    device_info: Mapping[str, str] = field(default_factory=dict)
    dummies: frozenset[int] = frozenset()
    comments: tuple[str, ...] = ()
    node_id: int | None = None  # [DeviceComissioning], in a DCF
    bit_rate: int | None = None  # bit/s, likewise

    def variables(self) -> Iterator[Variable]:
        """All variables by index and sub-index."""
        for index in sorted(self.objects):
            held = self.objects[index].variables
            yield from (held[subindex] for subindex in sorted(held))
