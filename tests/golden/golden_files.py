"""The manufacturers' own files, read by ten lines that are none of the tool's; skipped where they are not there."""

from __future__ import annotations

import configparser
import os
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

NODE = 1
FOLDERS = {
    "maxon-epos4": "maxon-epos4-50-15",
    "maxon-epos2": "maxon-epos2-50-5",
    "elmo-gold": "elmo-gold",
    "schunk-erb": "schunk-0_63",
    "zeroerr-erob": "zeroerr-erob",
    "trinamic-tmcm1636": "trinamic-tmcm1636",
    "wittenstein-simco": "wittenstein-simco",
    "faulhaber-cc": "faulhaber-cc-3150-51v",
}
_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 1, 6: 2, 7: 4}  # of CiA 301's data types, by number
_SIGNED = (2, 3, 4)


@dataclass(frozen=True)
class Entry:
    """What a file says of one variable; None where it says nothing."""

    size: int
    default: int | None
    configured: int | None


def told_by_the_file(family: str) -> dict[tuple[int, int], Entry]:
    """Variables by index and sub-index; skips the test where there is no such file."""
    named = os.environ.get("SCHWUNG_REAL_EDS")
    places = [Path(named)] if named else [p / "shared" / "eds" for p in Path(__file__).parents]
    files = [f for place in places for f in (place / FOLDERS[family]).glob("*.[ed][dc][sf]")]
    if not files:
        pytest.skip(
            "the manufacturer's file is not here: set SCHWUNG_REAL_EDS to the folder that holds elmo-gold/"
        )
    parser = configparser.RawConfigParser(strict=False)
    parser.read_string(files[0].read_text(encoding="cp1252"))
    found = {}
    for name in parser.sections():
        place = re.fullmatch(r"([0-9A-Fa-f]{4})(?:sub([0-9A-Fa-f]{1,2}))?", name)
        section = parser[name]
        if place is None or not section.get("DataType"):
            continue
        kind = int(section["DataType"], 0)
        if kind in _BYTES:
            default, configured = (
                _number(section.get(k, ""), kind) for k in ("DefaultValue", "ParameterValue")
            )
            found[int(place[1], 16), int(place[2] or "0", 16)] = Entry(_BYTES[kind], default, configured)
    return found


def _number(text: str, kind: int) -> int | None:
    """A number, or a sum with the node's own; a negative one may be written as its bit pattern."""
    parts = text.upper().replace("$NODEID", str(NODE)).split("+")
    try:
        value = sum(int(part.strip(), 0) for part in parts)
    except ValueError:
        return None
    bits = 8 * _BYTES[kind]
    return value - (1 << bits) if kind in _SIGNED and value >= 1 << bits - 1 else value
