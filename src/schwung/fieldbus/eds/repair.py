"""From sections to a description of the device: what is odd is mended where the meaning is clear, and told.

Nothing is guessed that could be wrong: an object whose type cannot be known is left out, and named as missing when
somebody needs it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from schwung.fieldbus.eds.lines import EdsWarning, Section
from schwung.fieldbus.eds.model import ARRAY, DOMAIN, RECORD, VAR, Object, Variable
from schwung.fieldbus.eds.notation import Value, parse_integer, read_value, shorten
from schwung.fieldbus.eds.standard import standard_type
from schwung.fieldbus.eds.types import TYPE_CODES, TYPE_NAMES, integer_range

_INDEX = re.compile(r"(?:0x)?([0-9a-f]{4})", re.IGNORECASE)
_SUB = re.compile(r"(?:0x)?([0-9a-f]{4})[\s_]*sub[\s_]*(?:0x)?([0-9a-f]{1,3})", re.IGNORECASE)
_COMPACT = re.compile(r"(?:0x)?([0-9a-f]{4})\s*(name|value|denotation|objectlinks)", re.IGNORECASE)
_LOOKS_LIKE_OBJECT = re.compile(r"(0x)?[0-9a-f]{3,}", re.IGNORECASE)
_ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
_ACCESS_WORDS = {
    "r": "ro", "w": "wo", "r/w": "rw", "wr": "rw", "read": "ro", "write": "wo", "readonly": "ro", "writeonly": "wo",
    "readwrite": "rw", "read/write": "rw", "constant": "const", "c": "const", "rwo": "rw", "rwrw": "rw",
}  # fmt: skip
_HIGHEST_SUB = 0xFE
_KEPT = {"factor": "Factor", "unit": "Unit", "description": "Description"}


class Repair:
    """One pass over the sections of a file; `warnings` and `unusable` fill on the way.

    `unusable` names objects that are in the file but cannot be used, with the reason, by index and sub-index.
    """

    def __init__(self, sections: Iterable[Section], node_id: int, warnings: list[EdsWarning]) -> None:
        self._node_id, self._warnings = node_id, warnings
        self.unusable: dict[tuple[int, int], EdsWarning] = {}
        self._plain: dict[str, Section] = {}
        self._tops: dict[int, Section] = {}
        self._subs: dict[int, dict[int, Section]] = {}
        self._compact: dict[tuple[int, str], Section] = {}
        for section in sections:
            self._sort(section)

    def objects(self) -> dict[int, Object]:
        """All objects that can be used."""
        found = {}
        for index in sorted({*self._tops, *self._subs}):
            if index < 0x1000:
                continue  # data types; what they mean is looked up where a variable uses one
            built = self._object(index)
            if built is not None and built.variables:
                found[index] = built
        return found

    def plain(self, *names: str) -> Section | None:
        """A section that is no object, under the first of these names (lower case, no spaces) that it has."""
        return next((self._plain[name] for name in names if name in self._plain), None)

    def mentions(self, index: int) -> bool:
        """True where the file has a section for the object, used or not."""
        return index in self._tops or index in self._subs

    def warn(self, line: int, section: Section | str, problem: str, remedy: str) -> EdsWarning:
        """Note something odd that was read in spite of it."""
        name = section if isinstance(section, str) else section.name
        told = EdsWarning(line, shorten(name), problem, remedy)
        self._warnings.append(told)
        return told

    # ── within ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _sort(self, section: Section) -> None:
        name = section.name
        if match := _INDEX.fullmatch(name):
            self._keep(section, self._tops, int(match[1], 16))
        elif match := _SUB.fullmatch(name):
            subindex = int(match[2], 16)
            if subindex > 0xFF:
                self.warn(
                    section.line, section, "has a sub-index above FF, and is left out", "Correct the name."
                )
                return
            if re.search(r"[\s_]", name):
                proper = f"[{match[1]}sub{subindex:X}]"
                self.warn(section.line, section, f"is read as {proper}", f"Write {proper}.")
            self._keep(section, self._subs.setdefault(int(match[1], 16), {}), subindex)
        elif match := _COMPACT.fullmatch(name):
            self._compact[int(match[1], 16), match[2].lower()] = section
        elif _LOOKS_LIKE_OBJECT.match(name) and section.text("ParameterName"):
            self.warn(
                section.line,
                section,
                "is no index, and is left out",
                "Write four hexadecimal digits, as in [6041].",
            )
        else:
            key = re.sub(r"[\s_]+", "", name).lower()
            if key != name.lower():
                self.warn(section.line, section, f"is read as [{key}]", "Take the blanks out of the name.")
            self._plain.setdefault(key, section)

    def _keep(self, section: Section, among: dict[int, Section], number: int) -> None:
        """The same object under two spellings of its name is one; what is new in the second is added."""
        first = among.setdefault(number, section)
        if first is section:
            return
        self.warn(section.line, section, f"occurs again, after line {first.line}", "Delete one of the two.")
        for key, entry in section.entries.items():
            held = first.entries.setdefault(key, entry)
            if held.value.lower() != entry.value.lower():
                first.contradictions.setdefault(key, entry)

    def _object(self, index: int) -> Object | None:
        top, subs = self._tops.get(index), self._subs.get(index, {})
        if top is None:
            first = min(subs.values(), key=lambda section: section.line)
            self.warn(
                first.line, first, f"belongs to [{index:04X}], which is not there; a record is assumed",
                f"Add [{index:04X}] with ParameterName, ObjectType=0x9 and SubNumber.",
            )  # fmt: skip
            top = Section(f"{index:04X}", first.line)
        name = self._name(top, index)
        kind = self._kind(top, subs)
        if kind in (VAR, DOMAIN):
            variable = self._variable(top, index, 0, "DOMAIN" if kind == DOMAIN else None)
            return Object(index, name, kind, {} if variable is None else {0: variable}, top.line)
        if kind not in (ARRAY, RECORD):
            return None  # NULL, DEFTYPE, DEFSTRUCT: nothing to read or write
        compact = top.text("CompactSubObj")
        count = parse_integer(compact) if compact else 0
        if count is None or not 0 <= count <= _HIGHEST_SUB:
            self.warn(
                top.line_of("CompactSubObj"), top, f'CompactSubObj is "{shorten(compact)}", and is left out',
                f"Give a number from 1 to {_HIGHEST_SUB}.",
            )  # fmt: skip
            count = 0
        variables = self._compact_variables(top, index, name, count) if count else {}
        siblings = [section.text("DataType") for number, section in subs.items() if number > 0]
        common = self._type_of(siblings[0]) if kind == ARRAY and any(siblings) and siblings[0] else None
        for subindex, section in sorted(subs.items()):
            variable = self._variable(section, index, subindex, common if subindex else "UNSIGNED8")
            if variable is not None:
                variables[subindex] = variable
        self._complete(top, index, variables)
        return Object(index, name, kind, variables, top.line)

    def _name(self, section: Section, index: int) -> str:
        name = section.text("ParameterName")
        if not name and section.entries:
            self.warn(section.line, section, "has no ParameterName", "Add one.")
        return name or f"0x{index:04X}"

    def _kind(self, top: Section, subs: dict[int, Section]) -> int:
        told = top.text("ObjectType")
        kind = parse_integer(told) if told else (RECORD if subs else VAR)
        if told and kind is None:
            words = {
                "var": VAR,
                "array": ARRAY,
                "arr": ARRAY,
                "record": RECORD,
                "rec": RECORD,
                "domain": DOMAIN,
            }
            kind = words.get(told.lower(), RECORD if subs else VAR)
            self.warn(
                top.line_of("ObjectType"), top, f'ObjectType "{shorten(told)}" is read as 0x{kind:X}',
                "Write 0x7 for a variable, 0x8 for an array, 0x9 for a record.",
            )  # fmt: skip
        real = {number for number in subs if number > 0}
        if kind in (VAR, DOMAIN) and real:
            self.warn(
                top.line_of("ObjectType"), top,
                "is a variable by its ObjectType, but has sub-indices: a record is assumed", "Write ObjectType=0x9.",
            )  # fmt: skip
            return RECORD
        if kind in (ARRAY, RECORD) and not subs and not top.text("CompactSubObj"):
            if top.text("DataType"):
                self.warn(
                    top.line_of("ObjectType"), top, "has no sub-indices, but a DataType: a variable is assumed",
                    "Write ObjectType=0x7, or add the sub-indices.",
                )  # fmt: skip
                return VAR
            self.warn(top.line, top, "has no sub-indices, and is left out", "Add them.")
        if kind not in (0x00, DOMAIN, 0x05, 0x06, VAR, ARRAY, RECORD):
            assumed = RECORD if subs else VAR
            self.warn(
                top.line_of("ObjectType"), top, f'ObjectType "{shorten(told)}" is unknown: 0x{assumed:X} is assumed',
                "Write 0x7 for a variable, 0x8 for an array, 0x9 for a record.",
            )  # fmt: skip
            return assumed
        return int(kind or 0)

    def _variable(self, section: Section, index: int, subindex: int, assumed: str | None) -> Variable | None:
        type_name = self._type(section, index, subindex, assumed)
        if type_name is None:
            return None
        name = section.text("ParameterName")
        if not name:
            name = self._name(section, index)
        low, high = self._limit(section, "LowLimit", type_name), self._limit(section, "HighLimit", type_name)
        if low is not None and high is not None and low > high:
            self.warn(
                section.line_of("LowLimit"), section, f"LowLimit {low} is above HighLimit {high}: both are left out",
                "Correct them.",
            )  # fmt: skip
            low = high = None
        variable = Variable(
            index, subindex, name, type_name, self._access(section), self._flag(section, "PDOMapping"), low, high,
            default=self._value(section, "DefaultValue", type_name),
            configured=self._value(section, "ParameterValue", type_name),
            flags=self._flags(section), line=section.line,
            extra={proper: section.text(key) for key, proper in _KEPT.items() if section.text(key)},
        )  # fmt: skip
        is_cob_id = subindex == 1 and (0x1400 <= index < 0x1600 or 0x1800 <= index < 0x1A00)
        if is_cob_id and "defaultvalue" in section.entries and not section.text("DefaultValue"):
            self.warn(
                section.line_of("DefaultValue"), section, "leaves the COB-ID empty: only the drive itself tells it",
                f"Write $NODEID+0x{(0x200 if index < 0x1800 else 0x180) + 0x100 * (index & 3):X}, or 0x80000000.",
            )  # fmt: skip
        return self._within_limits(section, variable)

    def _type(self, section: Section, index: int, subindex: int, assumed: str | None) -> str | None:
        """The type's name; None where it cannot be known, which is remembered for who needs the object."""
        if not any(section.text(key) for key in ("ParameterName", "DataType", "AccessType")):
            self.unusable[index, subindex] = self.warn(
                section.line, section, "says nothing of its object, and is left out",
                "Add ParameterName, DataType and AccessType.",
            )  # fmt: skip
            return None
        standard = standard_type(index, subindex)
        told = section.text("DataType")
        line, again = section.line_of("DataType"), section.contradictions.get("datatype")
        if again is not None and self._type_of(again.value) != self._type_of(told):
            self.unusable[index, subindex] = self.warn(
                line, section,
                f"has two data types, {shorten(told)} here and {shorten(again.value)} at line {again.line}",
                "Delete the wrong one.",
            )  # fmt: skip
            return None
        if not told and assumed == "DOMAIN":
            return assumed
        known = self._type_of(told) if told else None
        if known is None:
            known = standard or assumed
            problem = f'DataType "{shorten(told)}" is unknown' if told else "has no DataType"
            if known is None:
                self.unusable[index, subindex] = self.warn(
                    line,
                    section,
                    f"{problem}, and is left out",
                    "Add DataType, as the drive's manual has it.",
                )
                return None
            origin = "the standard" if standard else "its neighbours"
            self.warn(
                line,
                section,
                f"{problem}: {known} is taken from {origin}",
                f"Write DataType=0x{TYPE_CODES[known]:04X}.",
            )
        elif told and parse_integer(told) is None:
            self.warn(
                line, section, f'DataType "{shorten(told)}" is a name', f"Write 0x{TYPE_CODES[known]:04X}."
            )
        elif standard is not None and standard != known:
            self.warn(
                line, section, f"is {known}, by the standard it would be {standard}; the file is believed",
                "Compare with the drive's manual.",
            )  # fmt: skip
        return known

    def _type_of(self, told: str) -> str | None:
        """Type name of a code or a name; a custom type (CANFestival) says in its sub-index 1 what it is."""
        code = parse_integer(told)
        if code is None:
            name = told.strip().upper()
            return name if name in TYPE_CODES else None
        if code > 0x1B and code in self._subs:
            held = self._subs[code].get(1)
            code = parse_integer(held.text("DefaultValue")) if held is not None else None
        return None if code is None else TYPE_NAMES.get(code)

    def _access(self, section: Section) -> str:
        told = section.text("AccessType").lower()
        if told in _ACCESS:
            return told
        meant = _ACCESS_WORDS.get(re.sub(r"[\s_-]", "", told), "rw")
        problem = f'AccessType "{shorten(told)}" is unknown' if told else "has no AccessType"
        self.warn(
            section.line_of("AccessType"), section, f"{problem}: {meant} is assumed",
            f"Write AccessType={meant}, or what the drive's manual has.",
        )  # fmt: skip
        return meant

    def _flag(self, section: Section, key: str) -> bool:
        told = section.text(key)
        number = {"": 0, "true": 1, "yes": 1, "false": 0, "no": 0}.get(told.lower(), parse_integer(told))
        if number is None:
            self.warn(section.line_of(key), section, f'{key} "{shorten(told)}" is read as 0', "Write 0 or 1.")
        return bool(number)

    def _flags(self, section: Section) -> int:
        number = parse_integer(section.text("ObjFlags"))
        return number if number is not None and 0 <= number <= 0xFFFFFFFF else 0

    def _limit(self, section: Section, key: str, type_name: str) -> int | None:
        if integer_range(type_name) is None:
            return None
        value = self._value(section, key, type_name)
        return int(value.raw) if value is not None and not isinstance(value.raw, str | bytes) else None

    def _value(self, section: Section, key: str, type_name: str) -> Value | None:
        spelled = read_value(section.text(key), type_name, self._node_id)
        if spelled.problem:
            left = "" if spelled.value is not None else "; it is left out"
            self.warn(section.line_of(key), section, f"{key} {spelled.problem}{left}", spelled.remedy)
        return spelled.value

    def _within_limits(self, section: Section, variable: Variable) -> Variable:
        """Limits that exclude what the file itself gives as value are wrong: they go."""
        for key, value in (("DefaultValue", variable.default), ("ParameterValue", variable.configured)):
            low, high = variable.low, variable.high
            if value is None or isinstance(value.raw, str | bytes):
                continue
            if (low is not None and value.raw < low) or (high is not None and value.raw > high):
                self.warn(
                    section.line_of(key), section, f"{key} {value.raw} lies outside the limits, which are left out",
                    "Correct the value or the limits.",
                )  # fmt: skip
                variable = replace(variable, low=None, high=None)
        return variable

    def _compact_variables(self, top: Section, index: int, name: str, count: int) -> dict[int, Variable]:
        """The sub-indices that CompactSubObj stands for (CiA 306-1 4.6.3.5), written out."""
        template = self._variable(top, index, 1, None)
        if template is None:
            return {}
        zero = Variable(
            index,
            0,
            "Number of entries",
            "UNSIGNED8",
            "ro",
            default=Value(count),
            line=top.line_of("CompactSubObj"),
        )
        names, values = self._compact.get((index, "name")), self._compact.get((index, "value"))
        variables = {0: zero}
        for number in range(1, count + 1):
            own = names.text(str(number)) if names else ""
            configured = self._value(values, str(number), template.type) if values else None
            variables[number] = replace(
                template,
                subindex=number,
                name=own or f"{name}{number}",
                configured=configured or template.configured,
            )
        return variables

    def _complete(self, top: Section, index: int, variables: dict[int, Variable]) -> None:
        """Sub-index 0 has to be there (CiA 301 7.4.3), and SubNumber has to count right."""
        if variables and 0 not in variables:
            self.warn(
                top.line,
                top,
                "has no sub-index 0: it is added",
                f"Add [{index:04X}sub0], UNSIGNED8, with the count.",
            )
            variables[0] = Variable(
                index, 0, "Number of entries", "UNSIGNED8", "ro", default=Value(max(variables)), line=top.line
            )
        told = top.text("SubNumber")
        usable = len(variables) + sum(1 for key in self.unusable if key[0] == index)
        if told and not top.text("CompactSubObj") and parse_integer(told) != usable:
            self.warn(
                top.line_of("SubNumber"), top, f'SubNumber is "{shorten(told)}", but there are {usable}',
                f"Write SubNumber={usable}.",
            )  # fmt: skip
