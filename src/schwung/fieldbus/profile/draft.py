"""A first profile from an EDS: what the file bears out is written down, what it leaves open is said."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from schwung.errors import InputError
from schwung.fieldbus.eds import EdsFile, byte_size, integer_range
from schwung.fieldbus.eds.model import Variable

_FRAME_BYTES = 8
_POSITION, _DEMAND, _SPEED, _TORQUE, _CURRENT, _ADDED = 0x6064, 0x607A, 0x606C, 0x6077, 0x6078, 0x60B2
_FIRST_VENDOR, _PAST_VENDOR = 0x2000, 0x6000
#: Words in the names of manufacturers' objects that hint at a capability.
_HINTS = {
    "trace buffer": r"record|trace|scope|logging",
    "generator": r"generator|sine|excitation",
    "disturbance buffer": r"disturbance",
    "scalar feed-forward": r"inertia|feed.?forward|\bff\b",
    "control gains": r"\bgain|\bkp\b|\bki\b|controller p|[_ ][pi]\b",
}
#: Reasons for what no standard object gives.
_NOT_STANDARD = {
    "trace buffer": "recorder",
    "generator": "sine generator",
    "disturbance buffer": "buffer of torque values",
    "table feed-forward": "table of inertia over angle",
    "scalar feed-forward": "inertia",
    "harmonic feed-forward": "harmonics of inertia",
    "control gains": "controller gains with a unit",
}
_STOPS = (
    ("quick_stop_option", 0x605A, 2, "on the quick-stop ramp, then off: when we die nothing stays energised"),
    ("connection_lost", 0x6007, 3, "quick stop"),
    ("fault_reaction", 0x605E, 2, "on the quick-stop ramp"),
)


@dataclass(frozen=True)
class Draft:
    """A profile as text, and what could not be found in the EDS, one sentence each."""

    text: str
    missing: tuple[str, ...]


@dataclass
class _Writer:
    """Lines, and what is missing, as they come."""

    eds: EdsFile
    lines: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    cannot: dict[str, str] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    modes: dict[str, int] = field(default_factory=dict)

    def line(self, text: str = "", comment: str = "") -> None:
        self.lines.append(f"{text:<39} # {comment}" if comment else text)

    def has(self, index: int, subindex: int = 0) -> bool:
        return self.eds.find(index, subindex) is not None

    def sends(self, index: int) -> bool:
        """True where a TPDO can carry the object, as a number."""
        variable = self.eds.variable(index)
        return variable is not None and variable.mappable and variable.readable and _is_number(variable)

    def takes(self, index: int) -> bool:
        """True where an RPDO can carry the object, as a number."""
        variable = self.eds.variable(index)
        return variable is not None and variable.mappable and variable.writable and _is_number(variable)

    def accepts(self, index: int, value: int) -> bool:
        """True where the value can be written there."""
        variable = self.eds.variable(index)
        if variable is None or not variable.writable or not _is_number(variable):
            return False
        low, high = integer_range(variable.type) or (0, 0)
        low = low if variable.low is None else max(low, variable.low)
        high = high if variable.high is None else min(high, variable.high)
        return low <= value <= high

    def maps(self, direction: str, number: int, entries: int) -> bool:
        """True where that many objects can be mapped into this PDO."""
        mapping = (0x1600 if direction == "rpdo" else 0x1A00) + number - 1
        held = [self.eds.variable(mapping, subindex) for subindex in range(entries + 1)]
        there = mapping - 0x200 in self.eds.description.objects
        return there and all(variable is not None and variable.writable for variable in held)

    def lacks(self, capability: str, reason: str) -> None:
        self.cannot.setdefault(capability, reason)
        self.missing.append(f"{capability}: {reason}")


def draft_profile(eds: EdsFile, folder: Path, family: str | None = None) -> Draft:
    """Draft a profile that lies in `folder` (which the path of the EDS is relative to).

    Raises InputError where the path of the EDS cannot be written down in TOML, or the family be no family's name.
    """
    path = Path(os.path.relpath(eds.path.resolve(), folder.resolve())).as_posix()
    if not path.isprintable():
        raise InputError(ascii(path), "is a path that no profile can hold", "Rename the EDS or its folder.")
    if family is not None and family != _slug(family):
        raise InputError(
            f'family "{family}"',
            "holds more than small letters, digits and hyphens",
            f'Write "{_slug(family)}".',
        )
    w = _Writer(eds)
    info = eds.dictionary.device_information
    name = (
        " ".join(str(part).strip() for part in (info.vendor_name, info.product_name) if part) or eds.path.stem
    )
    _head(w, family or _slug(name), name, path)
    _identity(w)
    _modes(w)
    frames = _quantities(w)
    _pdos(w, frames)
    _stop(w)
    if _ADDED in frames[0]:
        w.line("[export.host_played]", "the host plays the table at SYNC rate")
        w.line(f'object = "{_ADDED:04X}:00"')
        _torque_unit(w, "torque offset")
        w.line()
    else:
        w.cannot.setdefault("host-played feed-forward", "its torque offset cannot be written by PDO")
    _noted(w)
    _tables(w)
    return Draft("\n".join(w.lines) + "\n", tuple(dict.fromkeys(w.missing)))


def _slug(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "drive"


def _head(w: _Writer, family: str, name: str, path: str) -> None:
    w.line(
        f"# Drafted from {w.eds.path.name}. Go through it with the manufacturer's manual; docs/profiles.md explains it."
    )
    w.line("version = 1")
    w.line(f"family = {_text(family)}")
    w.line(f"name = {_text(name)}")
    w.line('verified = "bench"')
    w.line(f"eds = {_text(path)}")
    w.line(f"source = {_text(f'EDS: {w.eds.path.name}')}")
    w.line()


def _identity(w: _Writer) -> None:
    info = w.eds.dictionary.device_information
    if not info.vendor_number:
        w.missing.append(
            "identity: the EDS tells no vendor: the profile accepts any drive, and is not found by itself"
        )
        return
    w.line("[identity]", "object 1018; a drive that answers otherwise is refused")
    w.line(f"vendor_id = 0x{info.vendor_number:08X}")
    if info.product_number:
        w.line(f"product_code = 0x{info.product_number:08X}")
    w.line()
    w.sources["identity"] = "EDS: VendorNumber, ProductNumber"


def _modes(w: _Writer) -> None:
    """Modes that 6502 lists, where the EDS tells it; both where it does not."""
    told = _value(w.eds.variable(0x6502))
    for key, mode, bit, capability in (("csp", 8, 7, "cyclic position"), ("pp", 1, 0, "profile position")):
        if not (w.takes(_DEMAND) and w.takes(0x6040) and w.maps("rpdo", 1, 2)):
            w.lacks(capability, "its target (607A) or its controlword (6040) cannot be mapped into a PDO")
        elif not (w.sends(_POSITION) and w.sends(0x6041) and w.maps("tpdo", 1, 2)):
            w.lacks(capability, "its position (6064) or its statusword (6041) cannot be mapped into a PDO")
        elif not w.accepts(0x6060, mode) or not w.has(0x6061):
            w.lacks(capability, "its mode cannot be chosen (6060, 6061)")
        elif told is not None and not told >> bit & 1:
            w.lacks(capability, f"6502 does not list it (0x{told:08X})")
        else:
            w.modes[key] = mode
    if w.modes:
        w.line("[modes]")
        for key, mode in w.modes.items():
            w.line(
                f"{key} = {mode}", "" if told is not None else "6502 has no default in the EDS: ask the drive"
            )
        w.line()
        w.sources["modes"] = "EDS: 6502" if told is not None else "CiA 402-2; the EDS does not tell 6502"


def _quantities(w: _Writer) -> list[list[int]]:
    """The tables of quantities; returns what each TPDO shall carry, and, first, the RPDO."""
    sent, frames = [0x6040, _DEMAND], [[0x6041, _POSITION]]
    w.line("[quantities.position]")
    w.line(f'object = "{_POSITION:04X}:00"')
    w.line(f'demand = "{_DEMAND:04X}:00"')
    if w.has(0x608F, 1) or w.has(0x6092, 1):
        w.line('unit = "encoder"', "608F, 6091, 6092")
    else:
        _user(
            w,
            "position",
            "neither 608F nor 6092 is there: give scale = rad per count (2π over counts per turn)",
        )
    w.line()
    torque = next((index for index in (_TORQUE, _CURRENT) if w.sends(index)), None)
    if torque is None or not _placed(w, torque, frames):
        w.lacks("torque", "neither its torque (6077) nor its current (6078) can be mapped into a PDO")
    else:
        w.line("[quantities.torque]")
        w.line(f'object = "{torque:04X}:00"')
        _torque_unit(w, "torque" if torque == _TORQUE else "current")
        w.line()
    if w.sends(_SPEED) and _placed(w, _SPEED, frames):
        w.line("[quantities.speed]")
        w.line(f'object = "{_SPEED:04X}:00"')
        if w.has(0x60A9):
            w.line('unit = "si_unit_velocity"', "60A9")
        else:
            _user(w, "speed", "there is no unit object (60A9): give scale = rad/s per count")
        w.line()
    else:
        w.lacks("speed", "its speed (606C) cannot be mapped into a PDO")
    if w.takes(_ADDED) and w.modes and w.maps("rpdo", 1, 3) and _bytes(w, [*sent, _ADDED]) <= _FRAME_BYTES:
        sent.append(_ADDED)
        w.line("[quantities.torque_added]")
        w.line(f'object = "{_ADDED:04X}:00"')
        _torque_unit(w, "torque offset")
        w.line()
    else:
        there = w.has(_ADDED)
        w.lacks(
            "torque injection",
            f"its torque offset (60B2) {'cannot be mapped into a PDO' if there else 'is missing'}",
        )
    return [sent, *frames]


def _placed(w: _Writer, index: int, frames: list[list[int]]) -> bool:
    """Put an object into the first TPDO that has room for it; False where none has."""
    if not w.modes:
        return False
    for number, frame in enumerate(frames, start=1):
        if _bytes(w, [*frame, index]) <= _FRAME_BYTES and w.maps("tpdo", number, len(frame) + 1):
            frame.append(index)
            return True
    if not w.maps("tpdo", len(frames) + 1, 1):
        return False
    frames.append([index])
    return True


def _torque_unit(w: _Writer, what: str) -> None:
    if what != "current" and w.has(0x6076):
        w.line('unit = "rated_torque"', "per mille of 6076")
        w.line("rated_torque_scale = 0.001", "mN·m by CiA 402-2; look it up")
        w.missing.append(
            "unit of rated torque: 6076 is taken to be in mN·m, as CiA 402-2 has it; drives that hold µN·m there "
            "would inject a thousandth and read a thousandfold: look it up"
        )
        return
    wanted = "torque constant in N·m/A divided by counts per ampere" if what == "current" else "N·m per count"
    _user(w, what, f"there is no rated torque (6076) for its {what}: give scale = {wanted}")


def _user(w: _Writer, what: str, hint: str) -> None:
    w.line('unit = "user"')
    w.line(f"hint = {_text(hint)}")
    w.missing.append(f"unit of {what}: {hint}")


def _pdos(w: _Writer, frames: Sequence[Sequence[int]]) -> None:
    """The RPDO with all that a motion needs, and the TPDOs; where nothing moves, the first two as they are."""
    if not w.modes:
        for direction, index in (("rpdo", 0x1600), ("tpdo", 0x1A00)):
            mapped = [f"{raw >> 16:04X}:{raw >> 8 & 0xFF:02X}" for raw in _mapped(w, index)]
            _pdo(w, direction, 1, mapped or ["6040:00" if direction == "rpdo" else "6041:00"], fixed=True)
        w.cannot.setdefault("sampling by SYNC", "its position (6064) cannot be mapped into a PDO")
        w.sources["pdo"] = "EDS: 1600, 1A00"
        return
    sent, *answered = frames
    _pdo(w, "rpdo", 1, [f"{index:04X}:00" for index in sent])
    for number, frame in enumerate(answered, start=1):
        _pdo(w, "tpdo", number, [f"{index:04X}:00" for index in frame])


def _pdo(w: _Writer, direction: str, number: int, entries: Sequence[str], fixed: bool = False) -> None:
    w.line("[[pdo]]")
    w.line(f'direction = "{direction}"')
    w.line(f"number = {number}")
    w.line(f"entries = {json.dumps(list(entries))}")
    if fixed:
        w.line("fixed = true")
    w.line()


def _bytes(w: _Writer, indices: Sequence[int]) -> int:
    found = (w.eds.find(index) for index in indices)
    return sum(byte_size(parameter.type) or 0 for parameter in found if parameter is not None)


def _mapped(w: _Writer, index: int) -> list[int]:
    count = _value(w.eds.variable(index, 0)) or 0
    values = (_value(w.eds.variable(index, number)) for number in range(1, count + 1))
    return [value for value in values if value]


def _stop(w: _Writer) -> None:
    there = [stop for stop in _STOPS if w.accepts(stop[1], stop[2])]
    if there:
        w.line("[stop]")
        for key, index, value, comment in there:
            w.line(f'{key} = {{ object = "{index:04X}:00", value = {value} }}', comment)
        w.line()
        w.sources["stop"] = "CiA 402-2; look up which values this drive takes"
    for key, index, *_ in _STOPS:
        if not any(stop[1] == index for stop in there):
            w.missing.append(f"stop.{key}: {index:04X} cannot be set: the drive's own reaction stays")
    for capability, index in (("stop by heartbeat", 0x1016), ("store", 0x1010)):
        if not w.has(index, 1):
            w.lacks(capability, f"{index:04X} is not in the EDS")


def _noted(w: _Writer) -> None:
    """Manufacturer's objects whose names promise something."""
    noted: dict[str, list[str]] = {}
    for variable in w.eds.description.variables():
        if not _FIRST_VENDOR <= variable.index < _PAST_VENDOR:
            continue
        words = f"{w.eds.description.objects[variable.index].name} {variable.name}"
        for capability, pattern in _HINTS.items():
            plain = variable.subindex > 0 or len(w.eds.description.objects[variable.index].variables) == 1
            if plain and re.search(pattern, words, re.IGNORECASE):
                noted.setdefault(capability, []).append(f"{variable.index:04X}:{variable.subindex:02X}")
                break
    for capability, what in _NOT_STANDARD.items():
        found = noted.get(capability)
        if found:
            reason = f"objects such as {found[0]} sound like it, and what they mean is not in the EDS"
            w.lacks(capability, reason)
        else:
            w.lacks(capability, f"its EDS names no {what}")
    if noted:
        w.line(
            "[noted]", "objects whose names promise something: read the manual, and use them or delete them"
        )
        for capability, refs in noted.items():
            w.line(f"{_text(capability)} = {json.dumps(refs)}")
            w.sources[f"noted.{capability}"] = "EDS, by their names"
        w.line()


def _tables(w: _Writer) -> None:
    w.line("[cannot]", "shown as: this profile can't do that, because …")
    for capability, reason in w.cannot.items():
        w.line(f"{_text(capability)} = {_text(reason)}")
    w.line()
    w.line("[sources]")
    for place, source in w.sources.items():
        w.line(f"{_text(place)} = {_text(source)}")


def _is_number(variable: Variable) -> bool:
    return integer_range(variable.type) is not None


def _value(variable: Variable | None) -> int | None:
    held = None if variable is None else variable.configured or variable.default
    return held.raw if held is not None and isinstance(held.raw, int) else None


def _text(text: str) -> str:
    """As TOML writes it: JSON's escapes are a subset of TOML's."""
    return json.dumps(text, ensure_ascii=False)
