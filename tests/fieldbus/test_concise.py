"""The concise DCF of object 1F22: its bytes, its order, and what is refused."""

from __future__ import annotations

import struct

import dcf
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schwung.errors import InputError
from schwung.fieldbus.concise import ConciseEntry, read_concise, untyped_parameter, write_concise
from schwung.fieldbus.drive import ParameterValue
from schwung.fieldbus.eds import read_eds
from schwung.fieldbus.profile import load_canopen_profile

EDS = read_eds(load_canopen_profile("schwung-bench").eds_path, 5)


def _value(index: int, subindex: int, raw: int) -> ParameterValue:
    return ParameterValue(EDS.parameter(index, subindex), raw)


def test_the_bytes_are_those_of_dcfgen() -> None:
    values = [
        _value(0x6065, 0, 123456),
        _value(0x6060, 0, -3),
        _value(0x607D, 1, -2097152),
        _value(0x2301, 3, 64),
    ]
    types = {0x6065: 0x07, 0x6060: 0x02, 0x607D: 0x04, 0x2301: 0x05}
    expected = struct.pack("<L", len(values)) + b"".join(
        dcf.DataType(types[v.parameter.index]).concise_value(v.parameter.index, v.parameter.subindex, v.raw)
        for v in values
    )
    assert write_concise(values, EDS.find) == expected


def test_a_pdo_is_switched_off_remapped_and_switched_on() -> None:
    """CiA 301 7.5.2.36, whatever the drive held before."""
    values = [
        _value(0x1A00, 0, 2), _value(0x1A00, 1, 0x60410010), _value(0x1A00, 2, 0x60640020),
        _value(0x1800, 1, 0x185), _value(0x1800, 2, 1),
    ]  # fmt: skip
    made = read_concise(write_concise(values, EDS.find), "x")
    told = [(e.index, e.subindex, int.from_bytes(e.data, "little")) for e in made]
    assert told == [
        (0x1800, 1, 0x80000185), (0x1A00, 0, 0), (0x1A00, 1, 0x60410010), (0x1A00, 2, 0x60640020),
        (0x1800, 2, 1), (0x1A00, 0, 2), (0x1800, 1, 0x185),
    ]  # fmt: skip


def test_a_pdo_that_is_off_stays_off() -> None:
    made = read_concise(write_concise([_value(0x1801, 1, 0xC0000285)], EDS.find), "x")
    assert [int.from_bytes(e.data, "little") for e in made] == [0xC0000285]


def _downloads(*values: ParameterValue) -> list[tuple[int, int, int]]:
    made = read_concise(write_concise(values, EDS.find), "x")
    return [(e.index, e.subindex, int.from_bytes(e.data, "little")) for e in made]


def test_a_pdo_whose_identifier_is_not_given_keeps_it() -> None:
    """0 as identifier would be that of NMT commands."""
    assert _downloads(_value(0x1800, 2, 1), _value(0x1A00, 0, 1), _value(0x1A00, 1, 0x60410010)) == [
        (0x1800, 2, 1), (0x1A00, 0, 0), (0x1A00, 1, 0x60410010), (0x1A00, 0, 1),
    ]  # fmt: skip
    assert _downloads(_value(0x1800, 1, 0x185), _value(0x1A00, 1, 0x60410010)) == [
        (0x1A00, 1, 0x60410010), (0x1800, 1, 0x80000185), (0x1800, 1, 0x185),
    ]  # fmt: skip
    assert _downloads(_value(0x1019, 0, 240)) == [(0x1019, 0, 240)]


WRITABLE = [
    ParameterValue(EDS.parameter_of(v), v.default.raw if v.default is not None else 0)
    for v in EDS.description.variables()
    if v.writable and v.readable and 0x1000 <= v.index < 0x1C00
]


@given(st.lists(st.sampled_from(WRITABLE), unique_by=lambda v: (v.parameter.index, v.parameter.subindex)))
def test_nothing_is_downloaded_but_what_was_given(values: list[ParameterValue]) -> None:
    """Each object is left at its value, in a drive that starts from anything."""
    left = {(index, subindex): raw for index, subindex, raw in _downloads(*values)}
    assert left.keys() == {(v.parameter.index, v.parameter.subindex) for v in values}
    for value in values:
        assert left[value.parameter.index, value.parameter.subindex] == value.raw


def test_the_counter_of_sync_is_set_while_its_period_is_0() -> None:
    made = read_concise(write_concise([_value(0x1006, 0, 1000), _value(0x1019, 0, 240)], EDS.find), "x")
    assert [(e.index, int.from_bytes(e.data, "little")) for e in made] == [
        (0x1006, 0),
        (0x1019, 240),
        (0x1006, 1000),
    ]


@given(
    st.lists(st.tuples(st.integers(0x1000, 0xFFFF), st.integers(0, 255), st.binary(max_size=20)), max_size=20)
)
def test_what_is_read_is_what_stands_there(entries: list[tuple[int, int, bytes]]) -> None:
    content = struct.pack("<I", len(entries)) + b"".join(
        struct.pack("<HBI", index, subindex, len(data)) + data for index, subindex, data in entries
    )
    assert read_concise(content, "x") == [ConciseEntry(*entry) for entry in entries]
    for cut in range(len(content)):
        with pytest.raises(InputError):
            read_concise(content[:cut], "x")
    with pytest.raises(InputError, match="goes on behind"):
        read_concise(content + b"\0", "x")


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_refused(content: bytes) -> None:
    try:
        entries = read_concise(content, "x")
    except InputError as refusal:
        entries = []
        told = str(refusal)
        assert told.startswith("x")
    assert all(untyped_parameter(entry).type for entry in entries)


def test_an_entry_of_no_object_is_refused_with_its_number() -> None:
    with pytest.raises(InputError, match=r"entry 1 of 1: 0x0005 is no object"):
        read_concise(struct.pack("<IHBIB", 1, 5, 0, 1, 7), "x")
