"""The bench shows what the EDS declares, and nothing else: types, access, defaults, mappability, by what is on the bus.

What the EDS declares is read by the tool's own loader here, what is shown by requests of our own: neither is the bench.
"""

from __future__ import annotations

import random
import struct

import canopen
import pytest
from conformance_rooms import NODE, CanopenRoom

from schwung.errors import SdoError
from schwung.fieldbus import eds
from schwung.fieldbus.drive import Parameter, ParameterValue

FILLED = (0x608F, 0x6092, 0x6083, 0x6084, 0x6085)  # 1 a turn, or a ramp of hours, would hold the axis, too
SAMPLE = 60  # objects that are looked at in a large dictionary
MAPPED_BITS = {
    "INTEGER8": 8,
    "UNSIGNED8": 8,
    "INTEGER16": 16,
    "UNSIGNED16": 16,
    "INTEGER32": 32,
    "UNSIGNED32": 32,
}


def _variables(room: CanopenRoom) -> dict[tuple[int, int], object]:
    """Every variable of the EDS, or a sample of them, as canopen has it after the tool's repair."""
    found = {}
    for index, item in _declared(room).indices.items():
        parts = item.subindices if hasattr(item, "subindices") else {0: item}
        found |= {(index, subindex): part for subindex, part in parts.items() if index >= 0x1000}
    keys = sorted(found)
    chosen = keys if len(keys) <= SAMPLE else random.Random(room.case.id).sample(keys, SAMPLE)
    secret = [key for key in keys if found[key].access_type.lower() == "wo"]  # there are few
    return {key: found[key] for key in dict.fromkeys(chosen + secret)}


def _declared(room: CanopenRoom) -> canopen.ObjectDictionary:
    return eds.load_dictionary(room.case.eds or room.profile.eds_path, NODE)


def _read(room: CanopenRoom, index: int, subindex: int, type_name: str) -> bytes:
    return room.drive._sdo.upload(Parameter(index, subindex, type_name))


def test_every_object_of_the_eds_is_there_with_its_type_and_access(canopen_room: CanopenRoom) -> None:
    for (index, subindex), variable in _variables(canopen_room).items():
        type_name = eds.TYPE_NAMES.get(variable.data_type)  # type: ignore[attr-defined]  # canopen's
        if type_name is None:
            continue
        access = variable.access_type.lower()  # type: ignore[attr-defined]
        place = f"{index:04X}:{subindex:02X} {access} {type_name}"
        if access == "wo":
            with pytest.raises(SdoError, match="0x06010001"):
                _read(canopen_room, index, subindex, type_name)
            continue
        if index == 0x1003 and subindex:  # no error has happened yet (7.5.2.14)
            with pytest.raises(SdoError, match="0x08000024"):
                _read(canopen_room, index, subindex, type_name)
            continue
        data = _read(canopen_room, index, subindex, type_name)
        size = eds.byte_size(type_name)
        assert size is None or len(data) == size, place
        if access in ("ro", "const") and size is not None:
            with pytest.raises(SdoError, match="0x06010002"):
                canopen_room.drive._sdo.write(ParameterValue(Parameter(index, subindex, type_name), 0))


def test_what_the_eds_does_not_declare_is_refused(canopen_room: CanopenRoom) -> None:
    declared = set(_declared(canopen_room).indices)
    absent = [
        index
        for index in (0x1006, 0x1016, 0x2F00, 0x6007, 0x6065, 0x6084, 0x60B2, 0x6FFF)
        if index not in declared
    ]
    for index in absent:
        with pytest.raises(SdoError, match="0x06020000"):
            _read(canopen_room, index, 0, "UNSIGNED32")
    with pytest.raises(SdoError, match="0x06090011"):
        _read(canopen_room, 0x1018, 0x2A, "UNSIGNED32")


def test_defaults_are_those_of_the_eds_but_for_what_would_hold_the_axis(canopen_room: CanopenRoom) -> None:
    """Of the objects of CiA 402 that the set-up may fill, 0 is the only value that is replaced."""
    entries = canopen_room.bench.servo.dictionary.entries
    for (index, subindex), variable in _variables(canopen_room).items():
        default = variable.default  # type: ignore[attr-defined]
        if index < 0x1018 or not isinstance(default, int) or default == 0 or index in FILLED:
            continue
        assert entries[index << 8 | subindex].default == default, f"{index:04X}:{subindex:02X}"


def test_only_what_is_mappable_can_be_mapped(canopen_room: CanopenRoom) -> None:
    mapping = 0x1A00
    entries = canopen_room.bench.servo.dictionary.entries
    first = entries.get(mapping << 8 | 1)
    if first is None or not first.writable:
        with pytest.raises(SdoError, match=r"0x0601000[12]|0x06020000"):
            canopen_room.drive._sdo.write(ParameterValue(Parameter(mapping, 1, "UNSIGNED32"), 0x60410010))
        return
    communication = canopen_room.drive.parameter(0x1800, 1)
    before = [
        canopen_room.drive.read(canopen_room.drive.parameter(*key))
        for key in ((0x1800, 1), (mapping, 0), (mapping, 1))
    ]
    canopen_room.drive._sdo.write(ParameterValue(communication, int(before[0].raw) | 1 << 31))
    canopen_room.drive._sdo.write(ParameterValue(before[1].parameter, 0))
    tried = 0
    for (index, subindex), variable in _variables(canopen_room).items():
        type_name = eds.TYPE_NAMES.get(variable.data_type, "")  # type: ignore[attr-defined]
        bits = MAPPED_BITS.get(type_name)
        if bits is None:
            continue
        entry = ParameterValue(before[2].parameter, index << 16 | subindex << 8 | bits)
        access = variable.access_type.lower()  # type: ignore[attr-defined]
        if variable.pdo_mappable and access in ("ro", "const", "rw", "rwr"):  # type: ignore[attr-defined]
            canopen_room.drive._sdo.write(entry)
        else:
            with pytest.raises(SdoError, match="0x06040041"):
                canopen_room.drive._sdo.write(entry)
        tried += 1
    canopen_room.drive._sdo.write(ParameterValue(before[2].parameter, 0))
    canopen_room.drive.write(before)
    assert tried > 10


def test_a_domain_or_string_can_be_as_long_as_it_likes(canopen_room: CanopenRoom) -> None:
    names = [k for k, e in canopen_room.bench.servo.dictionary.entries.items() if k == 0x100800]
    for k in names:
        text = _read(canopen_room, k >> 8, k & 0xFF, "VISIBLE_STRING")
        assert text == canopen_room.bench.servo.dictionary.values[k]
    assert (
        struct.unpack("<I", _read(canopen_room, 0x1018, 1, "UNSIGNED32"))[0]
        == canopen_room.drive.identity.vendor_id
    )


def test_a_unit_is_what_the_bench_makes_of_it(canopen_room: CanopenRoom) -> None:
    ours, theirs = canopen_room.drive.resolution(), canopen_room.bench.servo.operation.units
    assert ours.position_rad == pytest.approx(abs(theirs.position_rad), rel=1e-12)
    q = canopen_room.profile.quantities
    if q.speed is not None:
        assert ours.speed_rad_s == pytest.approx(abs(theirs.speed_rad_s), rel=1e-12)
    if q.torque is not None:
        assert ours.torque_nm == pytest.approx(theirs.torque_nm, rel=1e-12)
    if q.torque_added is not None:
        assert ours.torque_added_nm == pytest.approx(theirs.torque_added_nm, rel=1e-12)
