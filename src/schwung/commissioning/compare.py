"""Two configurations side by side: of a DCF, an EDS (its defaults), a concise DCF, a backup, or the drive itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from schwung.commissioning.journal import first_values, read_backup
from schwung.errors import InputError
from schwung.fieldbus.concise import ConciseEntry, read_concise, untyped_parameter
from schwung.fieldbus.drive import Parameter, ParameterValue, RawValue
from schwung.fieldbus.eds import EdsFile, decode, encode, read_eds
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


def load_configuration(path: Path, node_id: int | None, dictionary: EdsFile | None = None) -> Configuration:
    """Read a DCF, EDS, concise DCF or *.backup.json, told by its content.

    node_id: for $NODEID; None: the DCF's own, else 1. A concise DCF has no types: `dictionary` gives them where it is
    known. A DCF is its ParameterValues; one without any is its defaults, like an EDS.
    Raises InputError naming the place.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            str(path), f"cannot be read ({error.strerror})", "Give a DCF, EDS, concise DCF or *.backup.json."
        ) from error
    if content.lstrip()[:1] == b"{":
        return _backup(path)
    if _is_concise(content):
        return _concise(path, content, dictionary)
    file = read_eds(path, node_id or 1)
    own = file.description.node_id
    if node_id is None and own not in (None, file.node_id):
        file = read_eds(path, own or 1)
    return _eds(file)


def from_drive(source: str, values: Iterable[ParameterValue], node_id: int) -> Configuration:
    """What was read of a drive."""
    return Configuration(source, "drive", tuple(values), node_id)


def compare(first: Configuration, second: Configuration, scales: SiScales) -> Comparison:
    """Compare by what goes over the bus: a value that is typed on one side only is equal when its bytes are."""
    one, two = first.by_key(), second.by_key()
    differences, equal = [], 0
    for key in sorted(one.keys() & two.keys()):
        a, b = _same_type(one[key], two[key])
        if _equal(a, b):
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


def _same_type(a: ParameterValue, b: ParameterValue) -> tuple[ParameterValue, ParameterValue]:
    """The side without a type (concise DCF: no name) takes that of the other."""
    if a.parameter.name and not b.parameter.name:
        return a, _retyped(b, a.parameter)
    if b.parameter.name and not a.parameter.name:
        return _retyped(a, b.parameter), b
    return a, b


def _retyped(value: ParameterValue, parameter: Parameter) -> ParameterValue:
    try:
        return ParameterValue(parameter, decode(parameter, encode(value.parameter, value.raw)))
    except InputError:
        return value


def _named(a: ParameterValue, b: ParameterValue) -> Parameter:
    return a.parameter if a.parameter.name else b.parameter


def _is_concise(content: bytes) -> bool:
    try:
        return bool(read_concise(content, ""))
    except InputError:
        return False


def _backup(path: Path) -> Configuration:
    backup = read_backup(path)
    values = sorted(first_values(backup.changes), key=lambda v: key_of(v.parameter))
    identity = backup.drive.get("identity") or {}
    told = {k: int(identity[k]) for k in ("vendor_id", "product_code", "serial") if k in identity}
    node = identity.get("node_id")
    return Configuration(str(path), "backup", tuple(values), int(node) if node else None, told)


def _concise(path: Path, content: bytes, dictionary: EdsFile | None) -> Configuration:
    last: dict[tuple[int, int], ConciseEntry] = {}
    for entry in read_concise(content, str(path)):
        last[entry.index, entry.subindex] = entry
    values = []
    for key in sorted(last):
        entry = last[key]
        parameter = dictionary.find(*key) if dictionary is not None else None
        raw = untyped_parameter(entry)
        value = ParameterValue(raw, decode(raw, entry.data))
        values.append(value if parameter is None else _retyped(value, parameter))
    return Configuration(str(path), "concise", tuple(values))


def _eds(file: EdsFile) -> Configuration:
    variables = list(file.description.variables())
    configured = any(v.configured is not None for v in variables)
    values = []
    identity = {}
    names = {1: "vendor_id", 2: "product_code", 4: "serial"}
    for variable in variables:
        held = variable.configured if configured else variable.default
        if held is None:
            continue
        if variable.index == 0x1018 and variable.subindex in names and configured:
            identity[names[variable.subindex]] = int(held.raw) if isinstance(held.raw, int) else 0
        values.append(ParameterValue(file.parameter_of(variable), held.raw))
    return Configuration(
        str(file.path), "dcf" if configured else "eds", tuple(values), file.description.node_id, identity
    )
