"""How EDS files spell values: numbers in several notations, sums with $NODEID, strings of hexadecimal bytes.

Source: CiA 306-1 4.3. REAL values are the bits as a hexadecimal number there (as dcf-tools reads them); files with
plain decimals exist, and are read as such.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass

from schwung.fieldbus.drive import RawValue
from schwung.fieldbus.eds.types import byte_size, integer_range

_TEXTS = ("VISIBLE_STRING", "UNICODE_STRING")
_LONGEST = 40  # characters of an integer; more is no value of any type
_NODE = r"\$?\{?\$?\s*NODE_?\s?ID\s*\}?\$?"
_HAS_NODE = re.compile(_NODE, re.IGNORECASE)
_USUAL = re.compile(r"\$NODEID\+(0x[0-9A-Fa-f]+|[1-9]\d*|0)")
_TOKEN = re.compile(rf"\s*(?:({_NODE})|(0[xX][0-9A-Fa-f]+|[0-9A-Fa-f]+[hH]\b|\d+)|([-+*|()]))", re.IGNORECASE)


@dataclass(frozen=True)
class Value:
    """A value of an object: raw, for the node it was read for; `offset` where it is node id plus a number."""

    raw: RawValue
    offset: int | None = None


@dataclass(frozen=True)
class Spelled:
    """A text and what it means. `value` None: it means nothing of this type; `problem` says what is odd."""

    value: Value | None
    problem: str = ""
    remedy: str = ""


def parse_integer(text: str) -> int | None:
    """An integer in decimal, 0x, 0X or trailing-h notation; None for anything else (also for 1_000 and 1e3)."""
    text = text.strip()
    if len(text) > _LONGEST:
        return None
    if re.fullmatch(r"[-+]?0[xX][0-9A-Fa-f]+", text):
        return int(text, 16)
    if re.fullmatch(r"[-+]?[0-9]+", text):
        return int(text, 10)
    if re.fullmatch(r"[0-9][0-9A-Fa-f]*[hH]", text):
        return int(text[:-1], 16)
    return None


def shorten(text: str) -> str:
    """A text as it can stand in a sentence: one line, printable, not too long."""
    plain = "".join(c if c.isprintable() else "?" for c in text)
    return plain if len(plain) <= _LONGEST else plain[: _LONGEST - 1] + "…"


def read_value(text: str, type_name: str, node_id: int) -> Spelled:
    """What a DefaultValue or ParameterValue means. An empty text means nothing, and is nothing to complain about."""
    text = text.strip()
    if type_name not in _TEXTS:
        text = text.partition(";")[0].strip().strip('"').strip()
    if not text or (text.upper() == "NULL" and type_name not in _TEXTS):
        return Spelled(None, '"NULL" is no value' if text else "", "Leave the value empty." if text else "")
    if integer_range(type_name) is not None:
        return _integer(text, type_name, node_id)
    if type_name.startswith("REAL"):
        return _real(text, type_name)
    if type_name in _TEXTS:
        return Spelled(Value(text))
    return _octets(text)


def write_value(value: Value, type_name: str) -> str | None:
    """A value as CiA 306 spells it, in ASCII; None where no spelling gives it back."""
    raw = value.raw
    if value.offset is not None:
        return f"$NODEID+0x{value.offset:X}"
    if isinstance(raw, bytes):
        return raw.hex()
    if isinstance(raw, str):
        held = (
            raw.isascii() and raw.isprintable() and raw == raw.strip() and not re.search(r"(^|\s)[;#]", raw)
        )
        return raw if held else None
    if type_name.startswith("REAL"):
        size = byte_size(type_name)
        bits = struct.pack(">f" if size == 4 else ">d", raw)
        return f"0x{bits.hex().upper()}"
    return str(int(raw))


def _integer(text: str, type_name: str, node_id: int) -> Spelled:
    if _HAS_NODE.search(text):
        return _relative(text, type_name, node_id)
    number = parse_integer(text)
    problem = ""
    if number is None:
        known = {"true": 1, "false": 0, "yes": 1, "no": 0}.get(text.lower())
        if known is None and re.fullmatch(r"[-+]?\d{1,20}[.,]0*", text):
            known = int(re.split(r"[.,]", text)[0])
        if known is None:
            known = _evaluate(text, node_id)
        if known is None:
            problem = f'"{shorten(text)}" is no {type_name}'
            return Spelled(None, problem, "Write a decimal number, or a hexadecimal one with 0x.")
        number, problem = known, f'"{shorten(text)}" is read as {known}'
    elif re.match(r"[-+]?0\d", text) and number > 7:
        problem = f'"{text}" is read as decimal {number}: the leading 0 could also mean octal'
    return _fitted(number, text, type_name, problem)


def _fitted(number: int, text: str, type_name: str, problem: str) -> Spelled:
    """Within the type's range; two's complement in hexadecimal is how many write negative numbers."""
    low, high = integer_range(type_name) or (0, 0)
    remedy = f"Write {number}." if problem else ""
    if low <= number <= high:
        return Spelled(Value(number), problem, remedy)
    span = high - low + 1
    if type_name.startswith("INTEGER") and high < number < span and "x" in text.lower():
        return Spelled(Value(number - span), problem, remedy)
    if type_name.startswith("UNSIGNED") and -(span // 2) <= number < 0:
        return Spelled(
            Value(number + span),
            f"{number} is negative, the type is {type_name}",
            f"Write 0x{number + span:X}.",
        )
    return Spelled(
        None,
        f'"{shorten(text)}" does not fit {type_name}',
        f"Give a value from {low} to {high}, or another type.",
    )


def _relative(text: str, type_name: str, node_id: int) -> Spelled:
    usual = _USUAL.fullmatch(text)
    if usual and len(text) <= _LONGEST:
        offset = int(usual[1], 0)
        return _fitted_relative(offset, text, type_name, node_id, "")
    results = [_evaluate(text, node) for node in range(1, 128)]
    if results[0] is None:
        return Spelled(None, f'"{shorten(text)}" cannot be worked out', "Write $NODEID+0x180, for instance.")
    offsets = {None if result is None else result - node for node, result in enumerate(results, start=1)}
    offset_of = offsets.pop() if len(offsets) == 1 else None
    if offset_of is not None and offset_of >= 0:
        spelled = f"$NODEID+0x{offset_of:X}"
        odd = text.replace(" ", "").upper() != spelled.upper()
        return _fitted_relative(offset_of, text, type_name, node_id, spelled if odd else "")
    number = _evaluate(text, node_id)
    if number is None:
        return Spelled(None, f'"{shorten(text)}" cannot be worked out', "Write $NODEID+0x180, for instance.")
    problem = f'"{shorten(text)}" is more than node id plus a number: {number} for node {node_id}'
    fitted = _fitted(number, text, type_name, "")
    return Spelled(fitted.value, problem, "Write $NODEID+0x180, for instance.")


def _fitted_relative(offset: int, text: str, type_name: str, node_id: int, spelled: str) -> Spelled:
    fitted = _fitted(offset + node_id, text, type_name, "")
    if fitted.value is None:
        return fitted
    problem = f'"{shorten(text)}" is spelt in an unusual way' if spelled else ""
    return Spelled(Value(offset + node_id, offset), problem, f"Write {spelled}." if spelled else "")


def _evaluate(text: str, node_id: int) -> int | None:
    """A sum, difference, product or bitwise or of numbers and $NODEID, with parentheses; None where it is none."""
    tokens: list[int | str] = []
    at = 0
    text = text.strip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None or len(tokens) > _LONGEST:
            return None
        if match[1]:
            tokens.append(node_id)
        elif match[2]:
            number = parse_integer(match[2])
            if number is None:
                return None
            tokens.append(number)
        else:
            tokens.append(match[3])
        at = match.end()
    try:
        value, rest = _either(tokens)
    except (IndexError, TypeError):
        return None
    return value if not rest else None


def _either(tokens: list[int | str]) -> tuple[int, list[int | str]]:
    value, rest = _sum(tokens)
    while rest and rest[0] == "|":
        other, rest = _sum(rest[1:])
        value |= other
    return value, rest


def _sum(tokens: list[int | str]) -> tuple[int, list[int | str]]:
    value, rest = _product(tokens)
    while rest and rest[0] in ("+", "-"):
        other, after = _product(rest[1:])
        value, rest = (value + other if rest[0] == "+" else value - other), after
    return value, rest


def _product(tokens: list[int | str]) -> tuple[int, list[int | str]]:
    value, rest = _factor(tokens)
    while rest and rest[0] == "*":
        other, rest = _factor(rest[1:])
        value *= other
    return value, rest


def _factor(tokens: list[int | str]) -> tuple[int, list[int | str]]:
    first, rest = tokens[0], tokens[1:]
    if first == "(":
        value, rest = _either(rest)
        if rest[0] != ")":
            raise TypeError("an opening parenthesis is not closed")
        return value, rest[1:]
    if first in ("+", "-"):
        value, rest = _factor(rest)
        return (value if first == "+" else -value), rest
    if isinstance(first, str):
        raise TypeError(f"{first} is not expected here")
    return first, rest


def _real(text: str, type_name: str) -> Spelled:
    size = byte_size(type_name) or 4
    bits = parse_integer(text) if text.lower().startswith("0x") else None
    if bits is not None and bits < 1 << 8 * size:
        return Spelled(
            Value(float(struct.unpack(">f" if size == 4 else ">d", bits.to_bytes(size, "big"))[0]))
        )
    number = re.fullmatch(r"[-+]?(\d{1,40}[.,]?\d{0,40}|[.,]\d{1,40})([eE][-+]?\d{1,4})?", text)
    if number is None or bits is not None:
        return Spelled(None, f'"{shorten(text)}" is no {type_name}', "Write its bits as 0x3F800000.")
    value = float(text.replace(",", "."))
    if not math.isfinite(value) or (size == 4 and abs(value) > 3.4028234663852886e38):
        return Spelled(None, f'"{shorten(text)}" does not fit {type_name}', "Give a smaller number.")
    return Spelled(Value(value))


def _octets(text: str) -> Spelled:
    plain = re.sub(r"^0[xX]", "", text)
    try:
        return Spelled(Value(bytes.fromhex(plain)))
    except ValueError:
        return Spelled(
            None, f'"{shorten(text)}" is no sequence of hexadecimal bytes', "Write for instance 01a1053c."
        )
