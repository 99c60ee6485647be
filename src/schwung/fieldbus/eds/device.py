"""What a file says about itself and the device, beside its objects; and whether its lists of objects are right."""

from __future__ import annotations

from collections.abc import Mapping

from schwung.fieldbus.eds.lines import Section
from schwung.fieldbus.eds.model import Description, Object
from schwung.fieldbus.eds.notation import parse_integer, shorten
from schwung.fieldbus.eds.repair import Repair

FILE_INFO = (
    "FileName", "FileVersion", "FileRevision", "EDSVersion", "Description", "CreationTime", "CreationDate",
    "CreatedBy", "ModificationTime", "ModificationDate", "ModifiedBy", "LastEDS",
)  # fmt: skip
DEVICE_NAMES = ("VendorName", "ProductName", "OrderCode")
DEVICE_NUMBERS = (
    "VendorNumber", "ProductNumber", "RevisionNumber", "BaudRate_10", "BaudRate_20", "BaudRate_50", "BaudRate_125",
    "BaudRate_250", "BaudRate_500", "BaudRate_800", "BaudRate_1000", "SimpleBootUpMaster", "SimpleBootUpSlave",
    "Granularity", "DynamicChannelsSupported", "GroupMessaging", "NrOfRXPDO", "NrOfTXPDO", "LSS_Supported",
)  # fmt: skip
#: Section name in lower case, and which objects are listed there (CiA 306-1 4.6.2).
LISTS = {
    "mandatoryobjects": "MandatoryObjects",
    "optionalobjects": "OptionalObjects",
    "manufacturerobjects": "ManufacturerObjects",
}
_MOST_LINES = 10_000


def list_of(index: int) -> str:
    """The list (lower case) in which an object belongs."""
    if index in (0x1000, 0x1001, 0x1018):
        return "mandatoryobjects"
    return "manufacturerobjects" if 0x2000 <= index < 0x6000 else "optionalobjects"


def describe(repair: Repair) -> Description:
    """The description of a whole file."""
    objects = repair.objects()
    _check_lists(repair, objects)
    node_id, bit_rate = _commissioning(repair)
    return Description(
        objects, _texts(repair.plain("fileinfo"), FILE_INFO), _device_info(repair), _dummies(repair),
        _comments(repair), node_id, bit_rate,
    )  # fmt: skip


def _texts(section: Section | None, keys: tuple[str, ...]) -> dict[str, str]:
    if section is None:
        return {}
    return {key: section.text(key) for key in keys if section.text(key)}


def _device_info(repair: Repair) -> dict[str, str]:
    section = repair.plain("deviceinfo")
    if section is None:
        return {}
    found = _texts(section, DEVICE_NAMES)
    for key in DEVICE_NUMBERS:
        number = _number(repair, section, key)
        if number is not None:
            found[key] = str(number) if number < 0x10000 else f"0x{number:08X}"
    return found


def _number(repair: Repair, section: Section, key: str, highest: int = 0xFFFFFFFF) -> int | None:
    """A number of a section; None, with a warning, where it is none."""
    text = section.text(key)
    if not text:
        return None
    number = {"true": 1, "false": 0}.get(text.lower(), parse_integer(text))
    if number is not None and 0 <= number <= highest:
        return number
    repair.warn(section.line_of(key), section, f'{key} "{shorten(text)}" is no such number', "Correct it.")
    return None


def _commissioning(repair: Repair) -> tuple[int | None, int | None]:
    """Node id and bit rate; the standard itself spells the section with one m."""
    section = repair.plain("devicecomissioning", "devicecommissioning")
    if section is None:
        return None, None
    node = _number(repair, section, "NodeID", 127)
    rate = _number(repair, section, "Baudrate", 1000)  # kbit/s
    return node or None, rate * 1000 if rate else None


def _dummies(repair: Repair) -> frozenset[int]:
    section = repair.plain("dummyusage")
    if section is None:
        return frozenset()
    numbers = {code: _number(repair, section, f"Dummy{code:04d}", 1) for code in range(1, 8)}
    return frozenset(code for code, used in numbers.items() if used)


def _comments(repair: Repair) -> tuple[str, ...]:
    section = repair.plain("comments")
    if section is None:
        return ()
    lines = _number(repair, section, "Lines") or 0
    return tuple(section.text(f"Line{number}") for number in range(1, min(lines, _MOST_LINES) + 1))


def _check_lists(repair: Repair, objects: Mapping[int, Object]) -> None:
    listed: dict[int, tuple[Section, int]] = {}
    for name, proper in LISTS.items():
        section = repair.plain(name)
        if section is None:
            if any(list_of(index) == name for index in objects):
                repair.warn(0, proper, "is missing: the objects are taken as they come", f"Add [{proper}].")
            continue
        entries = {key: entry for key, entry in section.entries.items() if key.isdecimal()}
        for entry in entries.values():
            index = parse_integer(entry.value)
            if index is None or not 0 <= index <= 0xFFFF:
                repair.warn(
                    entry.line, section, f'"{shorten(entry.value)}" is no index', "Write for instance 0x6041."
                )
            else:
                listed.setdefault(index, (section, entry.line))
        told = section.text("SupportedObjects")
        if parse_integer(told) != len(entries):
            repair.warn(
                section.line_of("SupportedObjects"), section,
                f'SupportedObjects is "{shorten(told)}", but {len(entries)} are listed', f"Write {len(entries)}.",
            )  # fmt: skip
    _compare(repair, objects, listed)


def _compare(
    repair: Repair, objects: Mapping[int, Object], listed: Mapping[int, tuple[Section, int]]
) -> None:
    known = {*objects, *(index for index, _ in repair.unusable)}
    lacking = [
        index for index in listed if index not in known and index >= 0x1000 and not repair.mentions(index)
    ]
    if lacking:
        section, line = listed[lacking[0]]
        more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
        repair.warn(
            line, section, f"0x{lacking[0]:04X}{more} is listed, but not described",
            "Is the file cut short? Take the complete one, or delete the entry.",
        )  # fmt: skip
    if not listed:
        return
    for index in sorted(set(objects) - set(listed)):
        proper = LISTS[list_of(index)]
        repair.warn(
            objects[index].line, f"{index:04X}", f"is described, but not listed in [{proper}]; it is taken",
            f"Add it to [{proper}].",
        )  # fmt: skip
