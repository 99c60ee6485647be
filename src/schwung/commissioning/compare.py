"""Two configurations side by side: of a DCF, an EDS (its defaults), a concise DCF, a backup, or the drive itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from schwung.errors import InputError
from schwung.fieldbus.drive import Parameter, ParameterValue, RawValue
from schwung.fieldbus.eds import EdsFile, decode, encode
from schwung.fieldbus.si import Si, SiScales

Kind = Literal["dcf", "eds", "concise", "backup", "drive"]
Key = tuple[str, int, int]

_WORDS: dict[Kind, str] = {
    "dcf": "values of a DCF", "eds": "defaults of an EDS", "concise": "concise DCF", "backup": "backup",
    "drive": "drive",
}  # fmt: skip


@dataclass(frozen=True)
class Configuration:
    """Parameters and their values, and where they are from."""

    source: str
    kind: Kind
    values: tuple[ParameterValue, ...]
    node_id: int | None = None
    identity: Mapping[str, int] = field(default_factory=dict)  # vendor_id, product_code, serial where known
    dictionary: EdsFile | None = None  # of a DCF or EDS: the file describes its objects itself

    @property
    def words(self) -> str:
        """The source in words."""
        return f"{self.source} ({_WORDS[self.kind]}, {len(self.values)} parameters)"

    def by_key(self) -> dict[Key, ParameterValue]:
        """Values by space, index and sub-index."""
        return {key_of(value.parameter): value for value in self.values}


@dataclass(frozen=True)
class Difference:
    """One parameter that differs; a side that does not have it is None."""

    parameter: Parameter
    first: RawValue | None
    second: RawValue | None
    first_si: Si | None = None
    second_si: Si | None = None


@dataclass(frozen=True)
class Comparison:
    """What differs where both sides have a value, and what only one of them has."""

    differences: tuple[Difference, ...]
    only_first: tuple[Difference, ...]
    only_second: tuple[Difference, ...]
    equal: int


def key_of(parameter: Parameter) -> Key:
    """What makes a parameter the same on both sides."""
    return parameter.space, parameter.index, parameter.subindex


def from_drive(source: str, values: Iterable[ParameterValue], node_id: int) -> Configuration:
    """What was read of a drive."""
    return Configuration(source, "drive", tuple(values), node_id)


def compare(first: Configuration, second: Configuration, scales: SiScales) -> Comparison:
    """Compare by what goes over the bus: a value that is typed on one side only is equal when its bytes are.

    Identifiers of two nodes are equal when they differ as the node ids do: 0x183 of node 3 and 0x184 of node 4.
    """
    apart = (second.node_id or 0) - (first.node_id or 0) if first.node_id and second.node_id else 0
    one, two = first.by_key(), second.by_key()
    differences, equal = [], 0
    for key in sorted(one.keys() & two.keys()):
        a, b = _same_type(one[key], two[key])
        if _equal(a, b) or (apart and _same_identifier(a, b, apart)):
            equal += 1
        else:
            differences.append(Difference(_named(a, b), a.raw, b.raw, scales.si(a), scales.si(b)))
    return Comparison(
        tuple(differences),
        tuple(
            Difference(one[k].parameter, one[k].raw, None, scales.si(one[k]))
            for k in sorted(one.keys() - two.keys())
        ),
        tuple(
            Difference(two[k].parameter, None, two[k].raw, None, scales.si(two[k]))
            for k in sorted(two.keys() - one.keys())
        ),
        equal,
    )


def _equal(a: ParameterValue, b: ParameterValue) -> bool:
    if a.raw == b.raw:
        return True
    try:
        return encode(a.parameter, a.raw) == encode(b.parameter, b.raw)
    except InputError:
        return False


def _same_identifier(a: ParameterValue, b: ParameterValue, apart: int) -> bool:
    index, subindex = a.parameter.index, a.parameter.subindex
    communication = (0x1400 <= index < 0x1600 or 0x1800 <= index < 0x1A00) and subindex == 1
    holds_identifier = index == 0x1014 or communication
    return holds_identifier and isinstance(a.raw, int) and isinstance(b.raw, int) and b.raw - a.raw == apart


def _same_type(a: ParameterValue, b: ParameterValue) -> tuple[ParameterValue, ParameterValue]:
    """The side without a type (concise DCF: no name) takes that of the other."""
    if a.parameter.name and not b.parameter.name:
        return a, retyped(b, a.parameter)
    if b.parameter.name and not a.parameter.name:
        return retyped(a, b.parameter), b
    return a, b


def retyped(value: ParameterValue, parameter: Parameter) -> ParameterValue:
    """The same bytes as another type has them; as it was where they do not fit."""
    try:
        return ParameterValue(parameter, decode(parameter, encode(value.parameter, value.raw)))
    except InputError:
        return value


def _named(a: ParameterValue, b: ParameterValue) -> Parameter:
    return a.parameter if a.parameter.name else b.parameter
