"""How values are spelt: what is read is what was written, sums with the node id are worked out, the rest is refused."""

from __future__ import annotations

import math
import struct

import pytest
from eds_corpus import OWN_EDS
from hypothesis import given
from hypothesis import strategies as st

from schwung.fieldbus.eds import find_parameter, integer_range, read_eds
from schwung.fieldbus.eds.notation import Value, parse_integer, read_value, write_value
from schwung.fieldbus.eds.types import TYPE_CODES

_INTEGERS = [name for name in TYPE_CODES if integer_range(name) is not None]


@given(st.data(), st.sampled_from(_INTEGERS))
def test_an_integer_is_read_as_it_was_written(data: st.DataObject, kind: str) -> None:
    low, high = integer_range(kind) or (0, 0)
    number = data.draw(st.integers(low, high))
    for text in (write_value(Value(number), kind), f"{number:#x}", f" {number:#X} ", str(number)):
        assert text is not None
        assert read_value(text, kind, 5).value == Value(number)
        assert read_value(text, kind, 5).problem == ""
    outside = data.draw(st.sampled_from((high + 1, low - 1)))
    spelled = read_value(str(outside), kind, 5)
    assert spelled.problem
    assert spelled.remedy


@given(st.integers(1, 127), st.integers(0, 0xC0000700))
def test_a_value_relative_to_the_node_stays_so(node: int, offset: int) -> None:
    value = read_value(f"$NODEID+0x{offset:X}", "UNSIGNED32", node).value
    assert value == Value(offset + node, offset)
    assert write_value(value, "UNSIGNED32") == f"$NODEID+0x{offset:X}"


_SUM = st.recursive(
    st.one_of(st.just("$NODEID"), st.integers(0, 0x7FF).map(str), st.integers(0, 0x7FF).map(hex)),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*|"), inner).map(" ".join), inner.map(lambda text: f"({text})")
    ),
    max_leaves=6,
)


@given(_SUM, st.integers(1, 127))
def test_a_sum_is_worked_out_as_python_does(text: str, node: int) -> None:
    true = eval(text.replace("$NODEID", str(node)))
    value = read_value(text, "INTEGER64", node).value
    if len(text) <= 40:
        assert value is not None
        assert value.raw == true


@pytest.mark.parametrize(
    "text",
    ["$NODEID+", "()", "$NODEID $NODEID", "((((((1", "$NODEID+0x", "1+*2", "$NODEID/2", "$NODEID" * 50],
)
def test_nonsense_means_nothing(text: str) -> None:
    spelled = read_value(text, "UNSIGNED32", 5)
    assert spelled.value is None
    assert spelled.problem
    assert spelled.remedy


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_a_real_is_read_from_its_bits_and_from_decimals(number: float) -> None:
    text = write_value(Value(number), "REAL32")
    assert text == f"0x{struct.pack('>f', number).hex().upper()}"
    for spelt in (text, repr(number)):
        value = read_value(spelt, "REAL32", 5).value
        assert value is not None
        assert isinstance(value.raw, float)
        assert math.isclose(value.raw, number, rel_tol=1e-7)


@given(st.binary(min_size=1, max_size=40))
def test_bytes_are_read_as_they_were_written(data: bytes) -> None:
    text = write_value(Value(data), "OCTET_STRING")
    assert text is not None
    assert read_value(text, "OCTET_STRING", 5).value == Value(data)
    assert read_value(f"0x{text}", "DOMAIN", 5).value == Value(data)


@given(st.text(max_size=40))
def test_a_text_is_written_only_where_it_can_be_read_again(text: str) -> None:
    written = write_value(Value(text), "VISIBLE_STRING")
    if written:
        assert read_value(written, "VISIBLE_STRING", 5).value == Value(text)
        assert written.isascii()


@pytest.mark.parametrize(
    "text", ["", "1_000", "1e3", "0b1", "0o7", "٣", "+-1", "0x", "0x1G", "h", "FFh", "1 2", "9" * 41]
)
def test_what_is_no_integer(text: str) -> None:
    assert parse_integer(text) is None


@pytest.mark.parametrize(
    ("text", "number"), [("0X1f", 31), ("1Fh", 31), ("0FFH", 255), ("-0x10", -16), ("+7", 7), ("007", 7)]
)
def test_integers_in_several_notations(text: str, number: int) -> None:
    assert parse_integer(text) == number


def test_an_array_has_only_the_elements_that_its_file_describes() -> None:
    file = read_eds(OWN_EDS, 5)
    last = file.find(0x2300, 64)
    assert last is not None
    assert find_parameter(file.dictionary, 0x2300, 64) == last
    for index, subindex in ((0x2300, 65), (0x2300, 255), (0x6041, 1), (0x2999, 0)):
        assert find_parameter(file.dictionary, index, subindex) is None
        assert file.find(index, subindex) is None
