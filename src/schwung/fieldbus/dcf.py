"""Device configuration files (DCF, CiA 306): parameter values on paper, for tools that load them into drives."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

from schwung.errors import InputError
from schwung.fieldbus.drive import DriveIdentity, Parameter, ParameterValue
from schwung.fieldbus.eds import EdsFile, read_eds
from schwung.fieldbus.eds.model import Description, Object, Variable
from schwung.fieldbus.eds.notation import Value, write_value
from schwung.fieldbus.eds.render import render
from schwung.files import replace_file


@dataclass(frozen=True)
class DcfText:
    """A DCF's text, and the values that it cannot hold: no spelling of the format gives them back."""

    text: str
    left_out: tuple[ParameterValue, ...]


def dictionary_lookup(eds_path: Path, node_id: int) -> Callable[[int, int], Parameter]:
    """Look parameters up in an EDS, without a drive. Raises InputError where the EDS lacks one."""
    return read_eds(eds_path, node_id).parameter


def write_dcf(eds_path: Path, node_id: int, values: Sequence[ParameterValue], path: Path) -> None:
    """Write the EDS's dictionary as a DCF in which these parameters carry a ParameterValue.

    Raises InputError where the EDS lacks a parameter or the file cannot be written.
    """
    made = dcf_text(read_eds(eds_path, node_id), values, path.name)
    if made.left_out:
        raise InputError(
            made.left_out[0].parameter.label,
            "has a value that a DCF cannot hold",
            "Leave this parameter out.",
        )
    replace_file(path, made.text)


def dcf_text(
    file: EdsFile,
    values: Iterable[ParameterValue],
    name: str,
    *,
    identity: DriveIdentity | None = None,
    bit_rate: int | None = None,
) -> DcfText:
    """A DCF made of an EDS, repaired where it was odd, and these values; others that the file held are gone.

    `identity` is that of the drive: it goes into [DeviceInfo], [DeviceComissioning] and object 1018.
    Raises InputError where the EDS lacks a parameter.
    """
    given = [*values, *(_identity_values(file, identity) if identity is not None else ())]
    chosen: dict[tuple[int, int], Value] = {}
    left_out = []
    for value in given:
        variable = file.variable(value.parameter.index, value.parameter.subindex)
        if variable is None:
            raise InputError(
                str(file.path), f"has no object {value.parameter.label}", "Take the EDS of this drive."
            )
        spelled = Value(value.raw)
        if write_value(spelled, variable.type) is None:
            left_out.append(value)
        else:
            chosen[variable.index, variable.subindex] = spelled
    objects = {index: _configured(held, chosen) for index, held in file.description.objects.items()}
    description = _headed(file, objects, name, identity, bit_rate)
    serial = identity.serial if identity is not None else None
    text = render(description, configured=True, node_id=file.node_id, serial=serial)
    return DcfText(text.encode("ascii", errors="replace").decode("ascii"), tuple(left_out))


def _identity_values(file: EdsFile, identity: DriveIdentity) -> list[ParameterValue]:
    told = (identity.vendor_id, identity.product_code, identity.revision, identity.serial)
    found = (file.find(0x1018, subindex) for subindex in range(1, 5))
    return [ParameterValue(p, raw) for p, raw in zip(found, told, strict=True) if p is not None]


def _configured(held: Object, chosen: dict[tuple[int, int], Value]) -> Object:
    """The object with these values. What lies outside the limits of the file shows that they are wrong: they go."""

    def configure(variable: Variable) -> Variable:
        value = chosen.get((variable.index, variable.subindex))
        if value is None or isinstance(value.raw, str | bytes):
            return replace(variable, configured=value)
        low, high = variable.low, variable.high
        outside = (low is not None and value.raw < low) or (high is not None and value.raw > high)
        return replace(
            variable, configured=value, low=None if outside else low, high=None if outside else high
        )

    return replace(held, variables={number: configure(v) for number, v in held.variables.items()})


def _headed(
    file: EdsFile, objects: dict[int, Object], name: str, identity: DriveIdentity | None, bit_rate: int | None
) -> Description:
    now = datetime.now()
    date, time = now.strftime("%m-%d-%Y"), now.strftime("%I:%M%p")  # as CiA 306-1 4.4 writes them
    info = dict(file.description.file_info)
    info |= {"FileName": name, "ModificationTime": time, "ModificationDate": date, "ModifiedBy": "schwung"}
    info.setdefault("EDSVersion", "4.0")
    info["LastEDS"] = file.path.name
    device = dict(file.description.device_info)
    if identity is not None:
        device |= {
            "VendorNumber": f"0x{identity.vendor_id:08X}",
            "ProductNumber": f"0x{identity.product_code:08X}",
            "RevisionNumber": f"0x{identity.revision:08X}",
        }
    return replace(
        file.description, objects=objects, file_info=info, device_info=device,
        bit_rate=bit_rate or file.description.bit_rate,
    )  # fmt: skip
