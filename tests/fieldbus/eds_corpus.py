"""Broken EDS files: each variant is one edit of our own EDS, and what must become of it.

A row reads: name, edit, what is expected. `quiet`: loads without a word. `warns(text at the line, words)`: loads, and a
warning stands at the line that holds the text. `lacks(object, …)`: loads, but who needs that object is refused with
that line. `refused(…)`: is not read at all. Every row that loads may say what the edited object must mean.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

OWN_EDS = Path(__file__).parents[2] / "device_profiles/schwung-bench/schwung-bench.eds"
_KEPT = (
    0x1000,
    0x1001,
    0x1008,
    0x1017,
    0x1018,
    0x1800,
    0x1A00,
    0x2200,
    0x2400,
    0x6041,
    0x6060,
    0x6065,
    0x607D,
)

Edit = Callable[[str], str | bytes]


@dataclass(frozen=True)
class Expected:
    """What must become of a variant."""

    kind: Literal["quiet", "warns", "lacks", "refused"]
    at: str = ""  # text of the line that is named; the last line that holds it
    words: str = ""  # part of what is said
    needed: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class Variant:
    """One broken file."""

    name: str
    edit: Edit
    expected: Expected
    means: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)


def own_text() -> str:
    """Our own EDS with some of its objects and lists that fit."""
    blocks = ["[" + part for part in OWN_EDS.read_text().split("\n[")[1:]]
    kept = [b for b in blocks if b[1:5].upper() in {f"{i:04X}" for i in _KEPT}]
    heads = [b for b in blocks if b.startswith(("[FileInfo", "[DeviceInfo", "[DummyUsage"))]
    lists = [
        ("MandatoryObjects", [i for i in _KEPT if i in (0x1000, 0x1001, 0x1018)]),
        ("OptionalObjects", [i for i in _KEPT if i not in (0x1000, 0x1001, 0x1018) and not 0x2000 <= i < 0x6000]),
        ("ManufacturerObjects", [i for i in _KEPT if 0x2000 <= i < 0x6000]),
    ]  # fmt: skip
    for name, indices in lists:
        numbered = "".join(f"{n}=0x{index:04X}\n" for n, index in enumerate(indices, start=1))
        heads.append(f"[{name}]\nSupportedObjects={len(indices)}\n{numbered}")
    return "\n".join([*heads, *kept])


# ── edits ────────────────────────────────────────────────────────────────────────────────────────────────────────


def within(section: str, old: str, new: str) -> Edit:
    """Replace text once, within a section."""

    def edit(text: str) -> str:
        start = text.index(f"[{section}]")
        at = text.index(old, start)
        assert "\n[" not in text[start + 1 : at].rstrip("["), f"{old} is not in [{section}]"
        return text[:at] + new + text[at + len(old) :]

    return edit


def default(section: str, value: str) -> Edit:
    """Give a section another DefaultValue."""

    def edit(text: str) -> str:
        start = text.index(f"[{section}]")
        at = text.index("DefaultValue=", start)
        return text[:at] + f"DefaultValue={value}" + text[text.index("\n", at) :]

    return edit


def replaced(old: str, new: str) -> Edit:
    """Replace text once, anywhere."""

    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new, 1)

    return edit


def without(section: str) -> Edit:
    """Drop a section."""

    def edit(text: str) -> str:
        start = text.index(f"[{section}]")
        end = text.find("\n[", start)
        return text[:start] + text[end + 1 if end >= 0 else len(text) :]

    return edit


def moved_to_front(section: str) -> Edit:
    """Put a section before all others."""

    def edit(text: str) -> str:
        start = text.index(f"[{section}]")
        end = text.index("\n[", start) + 1
        return text[start:end] + text[:start] + text[end:]

    return edit


def added(block: str) -> Edit:
    """Add lines at the end."""
    return lambda text: f"{text}\n{block}\n"


def both(*edits: Edit) -> Edit:
    """One edit after the other; only the last may give bytes."""

    def edit(text: str) -> str | bytes:
        result: str | bytes = text
        for one in edits:
            assert isinstance(result, str)
            result = one(result)
        return result

    return edit


def cut_at(section: str, behind: str = "") -> Edit:
    """Cut the file short within a section, behind a text."""

    def edit(text: str) -> str:
        at = text.index(f"[{section}]")
        return text[: text.index(behind, at) + len(behind)]

    return edit


# ── expectations ─────────────────────────────────────────────────────────────────────────────────────────────────

quiet = Expected("quiet")


def warns(at: str, words: str) -> Expected:
    """A warning at the line with that text."""
    return Expected("warns", at, words)


def lacks(index: int, subindex: int, at: str, words: str) -> Expected:
    """Loads; who needs the object is told that line."""
    return Expected("lacks", at, words, (index, subindex))


def refused(at: str, words: str) -> Expected:
    """Is no EDS."""
    return Expected("refused", at, words)


COMPACT = """\
[3000]
ParameterName=Gains
ObjectType=0x8
DataType=0x0007
AccessType=rw
DefaultValue=5
PDOMapping=0
CompactSubObj=3
"""

RANGED = """\
[A0]
ParameterName=a range, as CANFestival's editor declares it
ObjectType=0x9

[00A0sub1]
ParameterName=type
DataType=0x5
DefaultValue=0x06
"""

STATUSWORD = """\
ParameterName=Statusword
ObjectType=0x7
DataType=0x0006
AccessType=ro
DefaultValue=0
PDOMapping=1
"""

# ── the table ────────────────────────────────────────────────────────────────────────────────────────────────────

ENCODINGS = [
    Variant("as it is", lambda t: t, quiet),
    Variant("UTF-8 mark", lambda t: t.encode("utf-8-sig"), quiet),
    Variant("UTF-16 with mark", lambda t: t.encode("utf-16"), quiet),
    Variant("UTF-16 big-endian with mark", lambda t: b"\xfe\xff" + t.encode("utf-16-be"), quiet),
    Variant("UTF-32 with mark", lambda t: t.encode("utf-32"), quiet),
    Variant("UTF-16 without mark", lambda t: t.encode("utf-16-le"), warns("[FileInfo]", "UTF-16-LE")),
    Variant("UTF-16 big-endian without mark", lambda t: t.encode("utf-16-be"), warns("[FileInfo]", "UTF-16-BE")),
    Variant("cp1252 byte in a name", lambda t: t.replace("Statusword", "Status \x94 word").encode("latin-1"),
            warns("ParameterName=Status ", "0x94 is read as Windows-1252"),
            {(0x6041, 0): {"name": "Status ” word"}}),
    Variant("cp1252 byte that means nothing", lambda t: t.replace("Statusword", "Status\x81").encode("latin-1"),
            warns("ParameterName=Status", "0x81")),
    Variant("UTF-8 letters in a name", replaced("Statusword", "Žustand µ"), quiet,
            {(0x6041, 0): {"name": "Žustand µ"}}),
    Variant("CRLF", lambda t: t.replace("\n", "\r\n").encode(), quiet),
    Variant("CR alone", lambda t: t.replace("\n", "\r").encode(), quiet),
    Variant("CR CR LF", lambda t: t.replace("\n", "\r\r\n").encode(), quiet),
    Variant("NUL bytes", replaced("Statusword", "Status\0word"), warns("ParameterName=Status", "NUL")),
    Variant("NUL bytes at the end", lambda t: t + "\0" * 512, warns("", "NUL")),
    Variant("Ctrl-Z at the end", lambda t: t + "\x1a", quiet),
    Variant("no line end at the end", lambda t: t.rstrip(), quiet),
    Variant("vertical tab in a name", replaced("Statusword", "Status\x0bword"), quiet),
]  # fmt: skip

SYNTAX = [
    Variant("all lower case", lambda t: t.lower(), quiet, {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("all upper case", lambda t: t.upper(), quiet, {(0x1018, 1): {"default": 0x53574E47}}),
    Variant("0X", lambda t: t.replace("0x", "0X"), quiet, {(0x1018, 1): {"default": 0x53574E47}}),
    Variant("SUB in upper case", lambda t: t.replace("sub", "SUB"), quiet, {(0x607D, 1): {"type": "INTEGER32"}}),
    Variant("blanks around everything", lambda t: t.replace("=", "  =  ").replace("[", "  [ ").replace("]", " ]  "),
            quiet),
    Variant("tabs before keys", lambda t: t.replace("\nDataType", "\n\tDataType"), quiet,
            {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("comment lines", lambda t: "; first\n" + t.replace("\n[", "\n; more [6041]\n# and more\n["), quiet),
    Variant("comments behind values", lambda t: t.replace("AccessType=ro", "AccessType=ro ; never written"), quiet,
            {(0x6041, 0): {"access": "ro"}}),
    Variant("comments right behind values", lambda t: t.replace("AccessType=ro", "AccessType=ro;x"), quiet,
            {(0x6041, 0): {"access": "ro"}}),
    Variant("comment right behind a number", default("6065", "7;counts"), quiet, {(0x6065, 0): {"default": 7}}),
    Variant("numbers in quotes", lambda t: t.replace("DataType=0x0006", 'DataType="0x0006"'), quiet,
            {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("colons for equals signs", lambda t: t.replace("DataType=", "DataType: "), quiet,
            {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("comment behind a section", replaced("[6041]", "[6041] ; Statusword"), quiet),
    Variant("text behind a section", replaced("[6041]", "[6041] Statusword"),
            warns("[6041]", "behind the bracket")),
    Variant("bracket left open", replaced("[6041]", "[6041"), warns("[6041", "no closing bracket"),
            {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("garbage line", within("6041", "ObjectType", "<<<<<<< HEAD\nObjectType"), warns("<<<<<<<", "neither")),
    Variant("html in front", lambda t: "<!DOCTYPE html>\n" + t, warns("<!DOCTYPE", "neither")),
    Variant("key before any section", lambda t: "FileName=x.eds\n" + t,
            warns("FileName=x.eds", "before any section")),
    Variant("line without a key", within("6041", "ObjectType", "=0x7\nObjectType"), warns("=0x7\nObj", "neither")),
    Variant("duplicate key, equal", within("6041", "AccessType=ro", "AccessType=ro\nAccessType=RO"),
            warns("AccessType=RO", "said again")),
    Variant("duplicate key, other value", within("6041", "AccessType=ro", "AccessType=ro\nAccessType=wo"),
            warns("AccessType=wo", "the first counts"), {(0x6041, 0): {"access": "ro"}}),
    Variant("duplicate key, other type", within("6041", "DataType=0x0006", "DataType=0x0006\nDataType=0x0007"),
            lacks(0x6041, 0, "DataType=0x0006\nDataType", "two data types")),
    Variant("duplicate section", added("[6041]\nParameterName=Status\nDataType=6\nAccessType=ro"),
            warns("[6041]", "occurs again"), {(0x6041, 0): {"name": "Statusword"}}),
    Variant("duplicate section in other case", added("[607dSUB1]\nParameterName=Low\nDataType=0x4\nAccessType=rw"),
            warns("[607dSUB1]", "occurs again")),
    Variant("duplicate section, other type", added("[6041]\nDataType=0x0004"),
            lacks(0x6041, 0, "DataType=0x0006\nAccessType=ro\nDefaultValue=0\n", "two data types")),
    Variant("same sub-index spelt twice", added("[607Dsub01]\nParameterName=Low\nDataType=0x4\nAccessType=rw"),
            warns("[607Dsub01]", "occurs again")),
    Variant("blank in a section name", replaced("[OptionalObjects]", "[Optional Objects]"),
            warns("[Optional Ob", "Take the blanks")),
    Variant("blank in an object's name", replaced("[607Dsub1]", "[607D sub 1]"),
            warns("[607D sub 1]", "[607Dsub1]"), {(0x607D, 1): {"type": "INTEGER32"}}),
    Variant("0x in an object's name", replaced("[6041]", "[0x6041]"), quiet, {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("index of five digits", replaced("[6041]", "[60411]"), warns("[60411]", "no index")),
    Variant("sub-index of three digits", replaced("[607Dsub2]", "[607Dsub200]"), warns("[607Dsub200]", "above FF")),
    Variant("sections of the vendor", added("[ToolInfos]\nToolVersion=1\n\n[PreDefines]\ncsp=8"), quiet),
]  # fmt: skip

OBJECTS = [
    Variant("type missing, standard object", within("6041", "DataType=0x0006\n", ""),
            warns("[6041]", "UNSIGNED16 is taken"), {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("type empty", within("6041", "DataType=0x0006", "DataType="), warns("DataType=\n", "has no DataType"),
            {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("type missing, vendor's object", within("2400sub1", "DataType=0x0007\n", ""),
            lacks(0x2400, 1, "[2400sub1]", "has no DataType")),
    Variant("type unknown, vendor's object", within("2400sub1", "DataType=0x0007", "DataType=0x0099"),
            lacks(0x2400, 1, "DataType=0x0099", "unknown")),
    Variant("type unknown, standard object", within("6041", "DataType=0x0006", "DataType=0x0099"),
            warns("DataType=0x0099", "UNSIGNED16 is taken")),
    Variant("type missing in an array", within("607Dsub2", "DataType=0x0004\n", ""),
            warns("[607Dsub2]", "INTEGER32"), {(0x607D, 2): {"type": "INTEGER32"}}),
    Variant("type by name", within("6041", "DataType=0x0006", "DataType=UNSIGNED16"),
            warns("DataType=UNSIGNED16", "is a name"), {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("type other than the standard's", within("6065", "DataType=0x0007", "DataType=0x0004"),
            warns("DataType=0x0004\nAccessType=rw\nDefaultValue=100000", "the file is believed"),
            {(0x6065, 0): {"type": "INTEGER32"}}),
    Variant("type of its own, told in A0",
            both(within("2400sub1", "DataType=0x0007", "DataType=0x00A0"), added(RANGED)),
            quiet, {(0x2400, 1): {"type": "UNSIGNED16"}}),
    Variant("access missing", within("6041", "AccessType=ro\n", ""), warns("[6041]", "rw is assumed")),
    Variant("access in words", within("6041", "AccessType=ro", "AccessType=read only"),
            warns("AccessType=read only", "ro is assumed"), {(0x6041, 0): {"access": "ro"}}),
    Variant("access unknown", within("6041", "AccessType=ro", "AccessType=perhaps"),
            warns("AccessType=perhaps", "rw is assumed")),
    Variant("name missing", within("6041", "ParameterName=Statusword\n", ""), warns("[6041]", "no ParameterName"),
            {(0x6041, 0): {"name": "0x6041"}}),
    Variant("object type missing", within("6041", "ObjectType=0x7\n", ""), quiet,
            {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("object type in words", within("607D", "ObjectType=0x8", "ObjectType=ARRAY"),
            warns("ObjectType=ARRAY", "0x8")),
    Variant("object type unknown", within("6041", "ObjectType=0x7", "ObjectType=0x33"),
            warns("ObjectType=0x33", "0x7 is assumed"), {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("variable with sub-indices", within("607D", "ObjectType=0x8", "ObjectType=0x7"),
            warns("ObjectType=0x7\nSubNumber=3", "a record is assumed"), {(0x607D, 2): {"type": "INTEGER32"}}),
    Variant("array without sub-indices", within("6041", "ObjectType=0x7", "ObjectType=0x8"),
            warns("ObjectType=0x8\nDataType=0x0006", "a variable is assumed"),
            {(0x6041, 0): {"type": "UNSIGNED16"}}),
    Variant("record without anything", added("[3000]\nParameterName=Nothing\nObjectType=0x9\nSubNumber=0"),
            warns("[3000]", "no sub-indices")),
    Variant("sub-index before its object", moved_to_front("607Dsub1"), quiet, {(0x607D, 1): {"type": "INTEGER32"}}),
    Variant("sub-index without its object", without("607D"), warns("[607Dsub0]", "a record is assumed"),
            {(0x607D, 1): {"type": "INTEGER32"}}),
    Variant("sub-index 0 missing", without("607Dsub0"), warns("[607D]", "no sub-index 0"),
            {(0x607D, 0): {"default": 2}}),
    Variant("sub-indices counted wrong", within("607D", "SubNumber=3", "SubNumber=30"),
            warns("SubNumber=30", "there are 3")),
    Variant("sub-indices counted in words", within("607D", "SubNumber=3", "SubNumber=three"),
            warns("SubNumber=three", "there are 3")),
    Variant("section that says nothing",
            within("6041", STATUSWORD, ""),
            lacks(0x6041, 0, "[6041]", "says nothing")),
    Variant("compact array", added(COMPACT), warns("[3000]", "not listed"),
            {(0x3000, 3): {"type": "UNSIGNED32", "default": 5, "name": "Gains3"}, (0x3000, 0): {"default": 3}}),
    Variant("compact array with names and values",
            added(f"{COMPACT}\n[3000Name]\nNrOfEntries=1\n2=Speed\n\n[3000Value]\nNrOfEntries=1\n2=9"),
            warns("[3000]", "not listed"),
            {(0x3000, 2): {"name": "Speed", "configured": 9}, (0x3000, 3): {"name": "Gains3"}}),
    Variant("compact array, huge", added(COMPACT.replace("=3", "=99999999999")),
            warns("CompactSubObj=9", "left out")),
]  # fmt: skip

VALUES = [
    Variant("NULL default", within("2200sub4", "ObjectType=0x2", "DefaultValue=NULL\nObjectType=0x2"),
            warns("DefaultValue=NULL", "no value"), {(0x2200, 4): {"default": None}}),
    Variant("empty default", default("6065", ""), quiet, {(0x6065, 0): {"default": None}}),
    Variant("empty COB-ID", default("1800sub1", ""), warns("DefaultValue=\n", "COB-ID empty")),
    Variant("huge default", default("6065", "9" * 60), warns("DefaultValue=999", "left out"),
            {(0x6065, 0): {"default": None}}),
    Variant("thousands of digits", default("6065", "9" * 9000), warns("DefaultValue=999", "left out")),
    Variant("default beyond its type", default("6060", "300"), warns("DefaultValue=300", "does not fit INTEGER8")),
    Variant("negative default, unsigned", default("6065", "-1"), warns("DefaultValue=-1", "0xFFFFFFFF"),
            {(0x6065, 0): {"default": 0xFFFFFFFF}}),
    Variant("two's complement", default("607Dsub1", "0xFFE00000"), quiet, {(0x607D, 1): {"default": -2097152}}),
    Variant("default with a fraction", default("6065", "100.0"), warns("DefaultValue=100.0", "read as 100"),
            {(0x6065, 0): {"default": 100}}),
    Variant("default in words", default("6065", "one hundred"), warns("DefaultValue=one", "no UNSIGNED32")),
    Variant("default with trailing h", default("6065", "10h"), quiet, {(0x6065, 0): {"default": 16}}),
    Variant("default with a leading 0", default("6065", "0100"), warns("DefaultValue=0100", "octal"),
            {(0x6065, 0): {"default": 100}}),
    Variant("default as Python writes it", default("6065", "100_000"), warns("DefaultValue=100_", "no UNSIGNED32")),
    Variant("limits the wrong way round", default("6065", "5\nLowLimit=9\nHighLimit=1"),
            warns("LowLimit=9", "above HighLimit"), {(0x6065, 0): {"low": None}}),
    Variant("default outside its limits", default("6065", "5\nLowLimit=10\nHighLimit=20"),
            warns("DefaultValue=5\nLow", "outside the limits"), {(0x6065, 0): {"high": None, "default": 5}}),
    Variant("limit that is none", default("6065", "5\nLowLimit=low"), warns("LowLimit=low", "left out")),
    Variant("mapping in words", within("6041", "PDOMapping=1", "PDOMapping=TRUE"), quiet,
            {(0x6041, 0): {"mappable": True}}),
    Variant("mapping that is none", within("6041", "PDOMapping=1", "PDOMapping=maybe"),
            warns("PDOMapping=maybe", "read as 0")),
    Variant("flags that are none", within("6041", "PDOMapping=1", "PDOMapping=1\nObjFlags=none"), quiet),
    Variant("node id in mixed case, blanks", default("1800sub1", "$NodeID + 0x180"), quiet,
            {(0x1800, 1): {"default": 0x185}}),
    Variant("node id behind", default("1800sub1", "0x180+$NODEID"), warns("0x180+$NODEID", "unusual"),
            {(0x1800, 1): {"default": 0x185, "offset": 0x180}}),
    Variant("node id alone", default("1800sub1", "$NODEID"), warns("=$NODEID\n", "unusual"),
            {(0x1800, 1): {"default": 5, "offset": 0}}),
    Variant("node id without $", default("1800sub1", "NODEID+384"), warns("=NODEID+384", "unusual"),
            {(0x1800, 1): {"default": 0x185}}),
    Variant("node id in a sum", default("1800sub1", "($NODEID + 0x100) + 0x80 * 1"), warns("($NODEID", "unusual"),
            {(0x1800, 1): {"default": 0x185, "offset": 0x180}}),
    Variant("node id by bitwise or", default("1800sub1", "0x180|$NODEID"), warns("0x180|", "unusual"),
            {(0x1800, 1): {"default": 0x185, "offset": 0x180}}),
    Variant("node id doubled", default("1800sub1", "2*$NODEID"), warns("2*$NODEID", "more than node id"),
            {(0x1800, 1): {"default": 10, "offset": None}}),
    Variant("node id in nonsense", default("1800sub1", "$NODEID+)("), warns("$NODEID+)(", "worked out"),
            {(0x1800, 1): {"default": None}}),
    Variant("string with a semicolon", default("1008", "a;b"), quiet, {(0x1008, 0): {"default": "a;b"}}),
    Variant("device numbers in words", replaced("VendorNumber=0x53574E47", "VendorNumber=Schwung"),
            warns("VendorNumber=Sch", "no such number")),
    Variant("dummies in words", replaced("Dummy0002=1", "Dummy0002=x"), warns("Dummy0002=x", "no such number")),
]  # fmt: skip

FILES = [
    Variant("commissioning, one m", added("[DeviceComissioning]\nNodeID=7\nBaudrate=500"), quiet),
    Variant("commissioning, two m", added("[DeviceCommissioning]\nNodeID=0x7\nBaudrate=500"), quiet),
    Variant("commissioning, no node id", added("[DeviceComissioning]\nNodeID=seven"),
            warns("NodeID=seven", "no such number")),
    Variant("ParameterValue", within("6065", "AccessType", "ParameterValue=77\nAccessType"), quiet,
            {(0x6065, 0): {"configured": 77}}),
    Variant("comments counted wrong", added("[Comments]\nLines=9\nLine1=x"), quiet),
    Variant("comments that are endless", added("[Comments]\nLines=4000000000"), quiet),
    Variant("no list of mandatory objects", without("MandatoryObjects"),
            warns("", "[MandatoryObjects]: is missing")),
    Variant("no lists at all",
            both(without("MandatoryObjects"), without("OptionalObjects"), without("ManufacturerObjects")),
            warns("", "is missing")),
    Variant("list counted wrong", replaced("SupportedObjects=3", "SupportedObjects=33"),
            warns("SupportedObjects=33", "3 are listed")),
    Variant("list not counted", replaced("SupportedObjects=3\n", ""), warns("[MandatoryObjects]", "3 are listed")),
    Variant("list with something else", replaced("1=0x1000", "1=device type"), warns("1=device type", "no index")),
    Variant("object listed, but not there", without("6060"), warns("=0x6060", "not described")),
    Variant("object there, but not listed", added("[3000]\nParameterName=x\nDataType=5\nAccessType=rw"),
            warns("[3000]", "not listed")),
    Variant("no device info", without("DeviceInfo"), quiet),
    Variant("no file info", without("FileInfo"), quiet),
    Variant("cut short between objects", cut_at("6041", "PDOMapping=1\n"), warns("=0x6060", "cut short")),
    Variant("cut short within an object", cut_at("6065", "DataType="), warns("DataType=", "UNSIGNED32 is taken")),
    Variant("cut short within a name", cut_at("6065", "[606"), warns("=0x6065", "cut short")),
    Variant("cut short before any object", cut_at("OptionalObjects"), refused("", "describes no object")),
    Variant("empty", lambda t: "", refused("", "is empty")),
    Variant("blanks alone", lambda t: " \n\t\r\n", refused("", "is empty")),
    Variant("comments alone", lambda t: "; nothing\n" * 9, refused("", "describes no object")),
    Variant("a picture", lambda t: b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8,
            refused("", "describes no object")),
    Variant("a PDF", lambda t: b"%PDF-1.4\n%\xe2\xe3\n1 0 obj\n<< /Type /Catalog >>\n",
            refused("", "describes no object")),
    Variant("a zip", lambda t: b"PK\3\4" + bytes(200), refused("", "describes no object")),
    Variant("an XDD", lambda t: '<?xml version="1.0"?>\n<ISO15745ProfileContainer/>\n',
            refused("", "describes no object")),
    Variant("another INI file", lambda t: "[Section]\nkey=value\n", refused("", "describes no object")),
    Variant("one object of unknown type", lambda t: "[2000]\nParameterName=x\nAccessType=rw\n",
            refused("[2000]", "describes no object")),
]  # fmt: skip

VARIANTS = [*ENCODINGS, *SYNTAX, *OBJECTS, *VALUES, *FILES]
