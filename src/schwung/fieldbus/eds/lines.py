"""From bytes to sections: encodings, line ends, comments, keys. Nothing here knows what an object is."""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field

from schwung.fieldbus.eds.notation import shorten


@dataclass(frozen=True)
class EdsWarning:
    """Something odd in a file that was read in spite of it. Lines count from 1; 0: the file as a whole."""

    line: int
    section: str
    problem: str
    remedy: str

    def __str__(self) -> str:
        place = ", ".join(
            part
            for part in (
                f"line {self.line}" if self.line else "",
                f"[{self.section}]" if self.section else "",
            )
            if part
        )
        return f"{place or 'file'}: {self.problem}. {self.remedy}"


@dataclass(frozen=True)
class Entry:
    """One line `key=value`."""

    key: str
    value: str
    line: int


@dataclass
class Section:
    """A section as it stands in the file; entries by lower-case key, the first of a name counts."""

    name: str
    line: int
    entries: dict[str, Entry] = field(default_factory=dict)
    contradictions: dict[str, Entry] = field(
        default_factory=dict
    )  # by key: the first that says something else

    def text(self, key: str) -> str:
        """The value of a key in whatever case, without comment; empty where it is not there."""
        entry = self.entries.get(key.lower())
        return entry.value if entry else ""

    def line_of(self, key: str) -> int:
        """Line of a key, else of the section."""
        entry = self.entries.get(key.lower())
        return entry.line if entry else self.line


_BOMS = (
    (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"), (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"),
)  # fmt: skip
#: Keys whose value is one word or number: a semicolon ends it, with or without a blank before.
_WORDS = {
    "datatype", "objecttype", "accesstype", "pdomapping", "objflags", "subnumber", "compactsubobj", "lowlimit",
    "highlimit", "supportedobjects", "nrofentries",
}  # fmt: skip
_COLON = re.compile(r"\s*\w+\s*:(?!=)")
_ASCII = "Save the file as plain ASCII text."


def decode_text(content: bytes, warnings: list[EdsWarning]) -> str:
    """The file's text: UTF-8, UTF-16 or UTF-32 by their marks, else ASCII, else Windows-1252."""
    for mark, name in _BOMS:
        if content.startswith(mark):
            text = content.decode(name, errors="replace")
            break
    else:
        text = _unmarked(content, warnings)
    if "\0" in text:
        line = 1 + _line_ends(text[: text.index("\0")])
        warnings.append(EdsWarning(line, "", "holds NUL characters, which are left out", _ASCII))
        text = text.replace("\0", "")
    return text.rstrip("\x1a")


def _unmarked(content: bytes, warnings: list[EdsWarning]) -> str:
    head = content[:400]
    for name, nul, other in (("utf-16-le", head[1::2], head[::2]), ("utf-16-be", head[::2], head[1::2])):
        if len(nul) > 3 and nul.count(0) > 0.9 * len(nul) and other.count(0) < 0.1 * len(other):
            warnings.append(EdsWarning(1, "", f"is {name.upper()} without a byte order mark", _ASCII))
            return content.decode(name, errors="replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = 1 + _line_ends(content[: error.start].decode("latin-1"))
        warnings.append(
            EdsWarning(line, "", f"byte 0x{content[error.start]:02X} is read as Windows-1252", _ASCII)
        )
        return content.decode("cp1252", errors="replace")  # what vendors' Windows tools write


def _line_ends(text: str) -> int:
    return len(re.findall(r"\r\n|\n|\r", text))


def split_sections(text: str, warnings: list[EdsWarning]) -> list[Section]:
    """Sections in the order of the file; those of one name (case and outer spaces aside) are one."""
    found: dict[str, Section] = {}
    current: Section | None = None
    garbage: list[int] = []
    for number, raw in enumerate(re.split(r"\r\n|\n|\r", text), start=1):
        line = raw.strip()
        if not line or line[0] in ";#":
            continue
        if line.startswith("["):
            current = _open(line, number, found, warnings)
            continue
        key, equals, value = line.partition("=")
        if not equals and _COLON.match(line):
            key, equals, value = line.partition(":")
        if not equals or not key.strip():
            garbage.append(number)
            continue
        if current is None:
            warnings.append(EdsWarning(
                number, "", f'"{shorten(line)}" stands before any section',
                "Put it below its section's name."))  # fmt: skip
            continue
        _add(current, Entry(key.strip(), _value(key.strip().lower(), value), number), warnings)
    if garbage:
        more = f" (and {len(garbage) - 1} more such lines)" if len(garbage) > 1 else ""
        warnings.append(EdsWarning(
            garbage[0], "", f"is neither a section nor key=value{more}, and is left out",
            "Delete the line, or begin it with a semicolon."))  # fmt: skip
    return list(found.values())


def _value(key: str, text: str) -> str:
    """Without comment, and a single word without quotes."""
    if key in _WORDS or key.isdecimal():
        return text.partition(";")[0].strip().strip('"').strip()
    return re.split(r"\s;", " " + text)[0].strip()


def _open(line: str, number: int, found: dict[str, Section], warnings: list[EdsWarning]) -> Section:
    name, bracket, behind = line[1:].partition("]")
    if not bracket:
        name = re.split(r"\s[;#]", name)[0]
        warnings.append(
            EdsWarning(number, shorten(name.strip()), "has no closing bracket", "Add ] to the name.")
        )
    elif behind.strip() and behind.strip()[0] not in ";#":
        warnings.append(EdsWarning(
            number, shorten(name.strip()), f'"{shorten(behind.strip())}" stands behind the bracket, and is left out',
            "Put it on a line of its own."))  # fmt: skip
    name = name.strip()
    key = re.sub(r"\s+", "", name).lower()
    if key in found:
        warnings.append(EdsWarning(
            number, shorten(name), f"occurs again, after line {found[key].line}: what is new in it is added",
            "Delete one of the two."))  # fmt: skip
        return found[key]
    found[key] = Section(name, number)
    return found[key]


def _add(section: Section, entry: Entry, warnings: list[EdsWarning]) -> None:
    first = section.entries.setdefault(entry.key.lower(), entry)
    if first is entry:
        return
    if first.value.lower() == entry.value.lower():
        problem = f"{entry.key} is said again, as at line {first.line}"
    else:
        former, present = shorten(first.value), shorten(entry.value)
        problem = f'{entry.key} is "{former}" at line {first.line} and "{present}" here; the first counts'
        section.contradictions.setdefault(entry.key.lower(), entry)
    warnings.append(EdsWarning(entry.line, shorten(section.name), problem, "Delete the wrong one."))
