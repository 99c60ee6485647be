"""Configurations in files: DCF, EDS, concise DCF and *.backup.json, read by their content and written by a format."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from schwung.clock import Clock
from schwung.commissioning.compare import Configuration, key_of, retyped
from schwung.commissioning.journal import first_values, read_backup, write_backup
from schwung.errors import InputError, RefusedError
from schwung.fieldbus.concise import ConciseEntry, read_concise, untyped_parameter, write_concise
from schwung.fieldbus.configuration import Skipped, dictionary_of, mapped_live, select
from schwung.fieldbus.dcf import dcf_text
from schwung.fieldbus.drive import DriveIdentity, Parameter, ParameterValue
from schwung.fieldbus.eds import EdsFile, decode, read_eds
from schwung.fieldbus.profile import CanopenProfile
from schwung.files import replace_file

_REMEDY = "Give a DCF, an EDS, a concise DCF or a *.backup.json (JSON)."

_IDENTITY = 0x1018  # says which drive it is, and is no parameter of it

Format = Literal["dcf", "concise", "backup"]


def save_configuration(
    path: Path,
    form: Format,
    dictionary: EdsFile,
    values: Sequence[ParameterValue],
    identity: DriveIdentity,
    drive_record: Mapping[str, Any],
    clock: Clock,
) -> tuple[ParameterValue, ...]:
    """Write values of a drive to a file; returns those that the format cannot hold.

    Raises InputError where the file cannot be written.
    """
    if form == "backup":
        write_backup(path, drive_record, values, clock)
        return ()
    if form == "concise":
        replace_file(path, write_concise(values, dictionary.find))
        return ()
    rate = (drive_record.get("bus") or {}).get("bit_rate")
    known = (drive_record.get("bus") or {}).get("bit_rate_known")
    made = dcf_text(dictionary, values, path.name, identity=identity, bit_rate=rate if known else None)
    replace_file(path, made.text)
    return made.left_out


def load_configuration(path: Path, node_id: int | None, dictionary: EdsFile | None = None) -> Configuration:
    """Read a DCF, EDS, concise DCF or *.backup.json, told by its content.

    node_id: for $NODEID; None: the DCF's own, else 1. A concise DCF has no types: `dictionary` gives them where it is
    known. A DCF is its ParameterValues; one without any is its defaults, like an EDS.
    Raises InputError naming the place.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        missing = isinstance(error, FileNotFoundError)
        problem = "does not exist" if missing else f"cannot be read ({error.strerror})"
        raise InputError(str(path), problem, _REMEDY) from error
    if content.lstrip()[:1] == b"{":
        return _backup(path)
    if _is_concise(content):
        return _concise(path, content, dictionary)
    try:
        file = read_eds(path, node_id or 1)
    except InputError as error:
        if path.suffix.lower() in (".dcf", ".eds"):
            raise
        raise InputError(str(path), "is none of the files that hold a configuration", _REMEDY) from error
    own = file.description.node_id
    if node_id is None and own not in (None, file.node_id):
        file = read_eds(path, own or 1)
    return _eds(file)


def load_both(
    paths: Sequence[Path], node_id: int | None, dictionary: EdsFile | None = None
) -> list[Configuration]:
    """Read files that are to be compared: one that names no node is read for that of the other."""
    loaded = [load_configuration(path, node_id, dictionary) for path in paths]
    told = next((one.node_id for one in loaded if one.node_id is not None), None)
    if node_id is not None or told is None:
        return loaded
    return [
        load_configuration(path, told, dictionary) if one.node_id is None else one
        for path, one in zip(paths, loaded, strict=True)
    ]


def _is_concise(content: bytes) -> bool:
    try:
        return bool(read_concise(content, ""))
    except InputError:
        return False


def _backup(path: Path) -> Configuration:
    backup = read_backup(path)
    values = sorted(first_values(backup.changes), key=lambda v: key_of(v.parameter))
    identity = backup.drive.get("identity")
    told = (
        {key: value for key, value in identity.items() if isinstance(value, int)}
        if isinstance(identity, dict)
        else {}
    )
    return Configuration(str(path), "backup", tuple(values), told.get("node_id"), told)


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
        values.append(value if parameter is None else retyped(value, parameter))
    return Configuration(str(path), "concise", tuple(values))


def _eds(file: EdsFile) -> Configuration:
    variables = list(file.description.variables())
    configured = any(v.configured is not None for v in variables)
    held = [(v, v.configured if configured else v.default) for v in variables]
    told = [ParameterValue(file.parameter_of(v), value.raw) for v, value in held if value is not None]
    values = [value for value in told if value.parameter.index != _IDENTITY]
    return Configuration(
        str(file.path), "dcf" if configured else "eds", tuple(values), file.description.node_id,
        _identity(file, told if configured else []), file,
    )  # fmt: skip


def _identity(file: EdsFile, values: Iterable[ParameterValue]) -> dict[str, int]:
    """Vendor and product by [DeviceInfo]; where 1018 is configured, by that, and the serial number."""
    told = file.description.device_info
    named = {"vendor_id": told.get("VendorNumber"), "product_code": told.get("ProductNumber")}
    identity = {key: int(text, 0) for key, text in named.items() if text}
    names = {1: "vendor_id", 2: "product_code", 4: "serial"}
    for value in values:
        key = names.get(value.parameter.subindex)
        if value.parameter.index == _IDENTITY and key and isinstance(value.raw, int):
            identity[key] = value.raw
    return identity


def fitting_dictionary(
    wanted: Configuration, eds: Path | None, profile: CanopenProfile, identity: DriveIdentity, node_id: int
) -> EdsFile:
    """The EDS as given; else the file's own objects, so that all is compared that was kept; else the profile's EDS.

    The objects of another kind of drive say nothing about this one. Raises InputError for the EDS of another
    manufacturer.
    """
    if eds is None and wanted.dictionary is not None and not list(_foreign(wanted, identity)):
        return wanted.dictionary
    return dictionary_of(eds, profile, identity, node_id)


def _foreign(wanted: Configuration, identity: DriveIdentity) -> Iterator[tuple[str, int, int]]:
    """In what the file is of another kind of drive: name, number in the file, number of the drive."""
    for name in ("vendor_id", "product_code"):
        was, now = wanted.identity.get(name), getattr(identity, name)
        if was not in (None, 0, now):
            yield name, was, now


@dataclass(frozen=True)
class Fitted:
    """The part of a configuration that can be written to a drive, and the rest with reasons."""

    values: tuple[ParameterValue, ...]
    skipped: tuple[Skipped, ...]


def for_this_drive(
    wanted: Configuration, dictionary: EdsFile, profile: CanopenProfile, identity: DriveIdentity, force: bool
) -> Fitted:
    """What of a configuration can be written to this drive, typed by its dictionary.

    Raises RefusedError where it is of another drive or another node id, unless forced, and InputError where it holds
    defaults only.
    """
    if wanted.kind == "eds":
        raise InputError(
            wanted.source, "holds defaults only, no ParameterValue", "Give a DCF of `schwung backup`."
        )
    for name, was, now in () if force else _foreign(wanted, identity):
        raise RefusedError(
            wanted.source, f"is of a drive with {name} {was:#x}, this one has {now:#x}",
            "Connect the right drive, or insist with --force.",
        )  # fmt: skip
    if wanted.node_id not in (None, identity.node_id) and not force:
        raise RefusedError(
            wanted.source,
            f"is of node {wanted.node_id}, and this is node {identity.node_id}: identifiers would collide",
            "Insist with --force where that is wanted.",
        )  # fmt: skip
    selection = select(dictionary, profile)
    allowed = {key_of(parameter): parameter for parameter in selection.wanted}
    reasons = {key_of(item.parameter): item.reason for item in selection.skipped}
    live = mapped_live(wanted.values)
    values, skipped = [], []
    for value in wanted.values:
        key = key_of(value.parameter)
        parameter = allowed.get(key)
        reason = reasons.get(key) or live.get(key[1:])
        if parameter is None or reason:
            skipped.append(Skipped(value.parameter, reason or _why_not(dictionary, value.parameter)))
        else:
            same = parameter.type == value.parameter.type
            values.append(ParameterValue(parameter, value.raw) if same else retyped(value, parameter))
    return Fitted(tuple(values), tuple(skipped))


def _why_not(dictionary: EdsFile, parameter: Parameter) -> str:
    known = dictionary.variable(parameter.index, parameter.subindex)
    if known is None:
        return f"not in the EDS ({dictionary.path.name}); give the vendor's with --eds"
    return f"not to be written ({known.access})"
