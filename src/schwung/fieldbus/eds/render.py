"""A description as text: a plain file of CiA 306, with nothing odd left in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from schwung.fieldbus.eds.device import LISTS, list_of
from schwung.fieldbus.eds.model import DOMAIN, VAR, Description, Object, Variable
from schwung.fieldbus.eds.notation import Value, write_value
from schwung.fieldbus.eds.types import TYPE_CODES

Write = Callable[[Value, str], str | None]


def decimal_reals(value: Value, type_name: str) -> str | None:
    """As `write_value`, but REAL values as canopen reads them."""
    if type_name.startswith("REAL") and isinstance(value.raw, int | float):
        return repr(float(value.raw))
    return write_value(value, type_name)


def render(
    description: Description,
    *,
    configured: bool,
    node_id: int | None = None,
    serial: int | None = None,
    write: Write = write_value,
) -> str:
    """The file's text, objects in their order. `configured`: a DCF, with ParameterValue and [DeviceComissioning]."""
    blocks = [
        _section("FileInfo", description.file_info),
        _section("DeviceInfo", description.device_info),
        _section("DummyUsage", {f"Dummy{n:04d}": int(n in description.dummies) for n in range(1, 8)}),
        _section("Comments", {
            "Lines": len(description.comments),
            **{f"Line{n}": text for n, text in enumerate(description.comments, start=1)}}),
    ]  # fmt: skip
    if configured:
        rate = description.bit_rate
        blocks.append(_section("DeviceComissioning", {
            **({"NodeID": node_id} if node_id else {}), **({"Baudrate": rate // 1000} if rate else {}),
            **({"LSS_SerialNumber": serial} if serial is not None else {})}))  # fmt: skip
    for name, proper in LISTS.items():
        held = [index for index in sorted(description.objects) if list_of(index) == name]
        numbered = {str(n): f"0x{index:04X}" for n, index in enumerate(held, start=1)}
        blocks.append(_section(proper, {"SupportedObjects": len(held), **numbered}))
        for index in held:
            blocks += _object(description.objects[index], configured, write)
    return "\n".join(blocks)


def _section(name: str, entries: Mapping[str, object]) -> str:
    return "".join([f"[{name}]\n", *(f"{key}={_plain(value)}\n" for key, value in entries.items())])


def _plain(value: object) -> str:
    """One line that no reader takes for a comment."""
    text = "".join(c if c.isprintable() else " " for c in str(value).strip())
    return text.replace(" ;", ";").replace(" #", "#").lstrip(";#")


def _object(held: Object, configured: bool, write: Write) -> Iterable[str]:
    name = f"{held.index:04X}"
    if held.kind in (VAR, DOMAIN):
        return [_section(name, _entries(held.variables[0], held.kind, configured, write))]
    variables = [held.variables[subindex] for subindex in sorted(held.variables)]
    return [
        _section(
            name, {"ParameterName": held.name, "ObjectType": f"0x{held.kind:X}", "SubNumber": len(variables)}
        ),
        *(_section(f"{name}sub{v.subindex:X}", _entries(v, VAR, configured, write)) for v in variables),
    ]


def _entries(variable: Variable, kind: int, configured: bool, write: Write) -> dict[str, object]:
    entries: dict[str, object] = {
        "ParameterName": variable.name,
        "ObjectType": f"0x{kind:X}",
        "DataType": f"0x{TYPE_CODES[variable.type]:04X}",
        "AccessType": variable.access,
        "PDOMapping": int(variable.mappable),
    }
    for key, limit in (("LowLimit", variable.low), ("HighLimit", variable.high)):
        if limit is not None:
            entries[key] = limit
    values = [("DefaultValue", variable.default)]
    if configured:
        values.append(("ParameterValue", variable.configured))
    for key, value in values:
        text = None if value is None else write(value, variable.type)
        if text is not None:
            entries[key] = text
    if variable.flags:
        entries["ObjFlags"] = variable.flags
    return entries | ({} if configured else dict(variable.extra))
