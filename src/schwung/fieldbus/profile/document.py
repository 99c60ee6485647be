"""The fields of a profile as Markdown, from the models themselves: docs/profiles.md holds what this writes.

`python -m schwung.fieldbus.profile.document docs/profiles.md` brings the page up to date.
"""

from __future__ import annotations

import ast
import inspect
import sys
import types
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from textwrap import dedent
from typing import Annotated, Any, Literal, Union, cast, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from schwung.fieldbus.profile.model import CanopenProfile, DeviceProfile, ModbusProfile
from schwung.fieldbus.profile.parts import ObjectRef, Part, Quantity

BEGIN, END = "<!-- fields: begin -->", "<!-- fields: end -->"
_PLAIN = {int: "integer", float: "number", str: "text", bool: "true, false"}
_UNWRITTEN = ("folder",)  # set by the loader


def fields_markdown() -> str:
    """Every field of every part, one table per part, in the order of the models. Raises ValueError for a field without
    a description."""
    lines: list[str] = []
    for title, model, own in _parts():
        lines += [f"### {title}", "", (model.__doc__ or "").strip().split("\n\n")[0].replace("\n", " "), ""]
        lines += ["| key | value | meaning |", "|---|---|---|"]
        described = meanings(model)
        for name, info in own.items():
            if name not in described:
                raise ValueError(
                    f"{model.__name__}.{name} has no description: write a docstring below the field"
                )
            meaning = " ".join(described[name].split()).replace("|", "\\|")
            lines.append(f"| `{name}` | {_value(info)} | {meaning} |")
        lines.append("")
    return "\n".join(lines)


def write_page(page: Path) -> bool:
    """Put the fields between the page's marks; True where that changed it."""
    text = page.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    new = f"{before}{BEGIN}\n\n{fields_markdown()}\n{END}{after}"
    page.write_text(new, encoding="utf-8")
    return new != text


def meanings(model: type[BaseModel]) -> dict[str, str]:
    """The docstrings below the fields of a model, its own and those that it inherits."""
    found: dict[str, str] = {}
    for owner in reversed(model.__mro__):
        if not issubclass(owner, Part):
            continue
        body = cast(ast.ClassDef, ast.parse(dedent(inspect.getsource(owner))).body[0]).body
        for field, below in pairwise(body):
            match field, below:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(text))),
                ):
                    found[name] = text
    return found


def _parts() -> Iterator[tuple[str, type[BaseModel], dict[str, FieldInfo]]]:
    """(title, model, fields of its own) of every part, each model once, under the first table that uses it."""
    seen: set[type[BaseModel]] = set()
    common = DeviceProfile.model_fields
    tops: list[tuple[str, type[BaseModel]]] = [
        ("At the top, for every protocol", DeviceProfile),
        ("At the top, for CANopen", CanopenProfile),
        ("At the top, for Modbus", ModbusProfile),
    ]
    for title, model in tops:
        own = {
            name: info
            for name, info in model.model_fields.items()
            if name not in _UNWRITTEN and (model is DeviceProfile or name not in common)
        }
        yield title, model, own
        for name, info in own.items():
            yield from _below(name, info.annotation, seen)


def _below(
    path: str, annotation: Any, seen: set[type[BaseModel]]
) -> Iterator[tuple[str, type[BaseModel], dict[str, FieldInfo]]]:
    for model, many in _models(annotation):
        base = model.__mro__[1]
        kinds = [model] if base is Part else [base, model]
        for kind in kinds:
            if kind in seen or not issubclass(kind, BaseModel):
                continue
            seen.add(kind)
            inherited = kind.__mro__[1]
            more = {} if inherited is Part else getattr(inherited, "model_fields", {})
            own = {name: info for name, info in kind.model_fields.items() if name not in more}
            title = "Every quantity" if kind is Quantity else f"`[[{path}]]`" if many else f"`[{path}]`"
            yield title + (", besides" if more else ""), kind, own
            for name, info in own.items():
                yield from _below(f"{path}.{name}", info.annotation, seen)


def _models(annotation: Any, many: bool = False) -> Iterator[tuple[type[BaseModel], bool]]:
    """Models within a type, and whether there may be several of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if annotation is not ObjectRef:
            yield annotation, many
        return
    for argument in get_args(annotation):
        yield from _models(argument, many or get_origin(annotation) is tuple)


def _value(info: FieldInfo) -> str:
    """Type and default of a field."""
    text = _type(info.annotation)
    limits = [
        f"{sign} {_number(getattr(rule, name))}"
        for rule in info.metadata
        for name, sign in (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))
        if hasattr(rule, name)
    ]
    if limits:
        text += f", {' and '.join(limits)}"
    if info.is_required():
        return f"{text}; **required**"
    shown = info.get_default(call_default_factory=True)
    if isinstance(shown, bool):
        return f"{text}; default {str(shown).lower()}"
    plain = isinstance(shown, int | float) or (isinstance(shown, str) and shown)
    return f"{text}; default {_number(shown) if isinstance(shown, int) else shown}" if plain else text


def _number(number: float) -> str:
    return f"0x{number:X}" if isinstance(number, int) and number > 0xFFFF else f"{number:g}"


def _type(annotation: Any) -> str:
    """A type as people write it in TOML."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (Union, types.UnionType):
        return " or ".join(_type(a) for a in arguments if a is not type(None))
    if origin is Literal:
        return ", ".join(f'"{a}"' if isinstance(a, str) else str(a) for a in arguments)
    inner = {Annotated: ("", 0), tuple: ("list of ", 0), dict: ("table of ", 1)}.get(origin)
    if inner is not None:
        return inner[0] + _type(arguments[inner[1]])
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "object" if annotation is ObjectRef else "table"
    return _PLAIN.get(annotation, getattr(annotation, "__name__", str(annotation)))


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        write_page(Path(argument))
