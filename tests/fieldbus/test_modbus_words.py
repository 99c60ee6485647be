"""Words of registers and values: as manufacturers' manuals print them, and there and back for every type."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schwung.errors import InputError
from schwung.fieldbus.modbus.words import WordOrder, decode, encode, word_count

RANGES = {
    "INTEGER16": (-(1 << 15), (1 << 15) - 1),
    "UNSIGNED16": (0, (1 << 16) - 1),
    "INTEGER32": (-(1 << 31), (1 << 31) - 1),
    "UNSIGNED32": (0, (1 << 32) - 1),
    "INTEGER64": (-(1 << 63), (1 << 63) - 1),
    "UNSIGNED64": (0, (1 << 64) - 1),
}
orders = st.sampled_from(["high_first", "low_first"])


@pytest.mark.parametrize(
    ("words", "type_name", "order", "value"),
    [
        ((0x0000, 0x00C8), "UNSIGNED16", "high_first", 200),  # Lexium 32, CTRL1_KPp at 4614 and 4615
        ((0x0BB8, 0x0000), "INTEGER32", "low_first", 3000),  # ASDA-A2, written to 0112H and 0113H
        ((0xFFFF, 0xFFFE), "INTEGER16", "high_first", -2),
        ((0x0000, 0xFFFE), "INTEGER16", "high_first", -2),  # not every drive extends the sign
        ((0x4049, 0x0FDB), "REAL32", "high_first", pytest.approx(math.pi)),
        ((0, 0, 1, 2), "INTEGER64", "high_first", 65538),
        ((2, 1, 0, 0), "INTEGER64", "low_first", 65538),
    ],
)
def test_words_are_read_as_the_manuals_print_them(
    words: tuple[int, ...], type_name: str, order: WordOrder, value: float
) -> None:
    assert decode(words, type_name, order) == value


def test_words_are_written_as_the_manuals_print_them() -> None:
    assert encode(200, "UNSIGNED16", "high_first", 2) == (0x0000, 0x00C8)
    assert encode(3000, "INTEGER32", "low_first", 2) == (0x0BB8, 0x0000)
    assert encode(-2, "INTEGER16", "high_first", 2) == (0xFFFF, 0xFFFE)
    assert encode(-2, "INTEGER16", "high_first") == (0xFFFE,)


@given(st.sampled_from(sorted(RANGES)), orders, st.integers(1, 2), st.data())
def test_every_value_comes_back(type_name: str, order: WordOrder, at_least: int, data: st.DataObject) -> None:
    value = data.draw(st.integers(*RANGES[type_name]))
    words = encode(value, type_name, order, at_least)
    assert len(words) == word_count(type_name, at_least)
    assert all(0 <= word <= 0xFFFF for word in words)
    assert decode(words, type_name, order) == value


@given(st.sampled_from(sorted(RANGES)), orders, st.booleans())
def test_what_does_not_fit_is_refused(type_name: str, order: WordOrder, above: bool) -> None:
    low, high = RANGES[type_name]
    with pytest.raises(InputError, match=f"does not fit {type_name}"):
        encode(high + 1 if above else low - 1, type_name, order)


@pytest.mark.parametrize("raw", ["7", 1.5, True, b"\x00"])
def test_what_is_no_number_of_that_type_is_refused(raw: object) -> None:
    with pytest.raises(InputError, match="INTEGER32"):
        encode(raw, "INTEGER32", "high_first")  # type: ignore[arg-type]  # that is the point


def test_a_type_that_registers_do_not_hold_is_refused() -> None:
    with pytest.raises(InputError, match="VISIBLE_STRING"):
        word_count("VISIBLE_STRING")
