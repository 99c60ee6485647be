"""Holding registers: parameters of one or more words at addresses, with hooks for what lives in the drive."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from schwung_sim.errors import BenchError

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE, ACKNOWLEDGE, BUSY = 1, 2, 3, 4, 5, 6

_FORMATS = {
    "INTEGER16": "h", "UNSIGNED16": "H", "INTEGER32": "i", "UNSIGNED32": "I",
    "INTEGER64": "q", "UNSIGNED64": "Q", "REAL32": "f", "REAL64": "d",
}  # fmt: skip


class RefusalError(Exception):
    """The drive answers with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(code)


@dataclass
class Cell:
    """One parameter: where, how wide, what it holds; hooks replace or follow the plain memory."""

    address: int
    code: str  # of struct, one value
    words: int
    value: float = 0
    read: Callable[[], float] | None = None
    write: Callable[[Any], None] | None = None
    read_only: bool = False

    def encode(self, high_first: bool) -> list[int]:
        """The cell's words in the order of their addresses."""
        value = self.read() if self.read is not None else self.value
        data = struct.pack(f">{self.code}", value if self.code in "fd" else int(value))
        data = (b"\xff" if value < 0 else b"\x00") * (2 * self.words - len(data)) + data
        words = list(struct.unpack(f">{self.words}H", data))
        return words if high_first else words[::-1]

    def decode(self, words: list[int], high_first: bool) -> float:
        """The value of words; raises RefusalError where it is wider than the type."""
        ordered = words if high_first else words[::-1]
        data, size = struct.pack(f">{len(ordered)}H", *ordered), struct.calcsize(self.code)
        value: float = struct.unpack(f">{self.code}", data[-size:])[0]
        extension = b"\xff" if value < 0 else b"\x00"
        if data[:-size].strip(b"\x00") and data[:-size].strip(extension):
            raise RefusalError(ILLEGAL_VALUE)
        return value


class RegisterMap:
    """All parameters of a drive, and at most one window: registers that are read one by one, made when asked for."""

    def __init__(self, at_least: int, high_first: bool) -> None:
        self.at_least, self.high_first = at_least, high_first
        self.cells: dict[int, Cell] = {}
        self._at: dict[int, Cell] = {}
        self.window: range = range(0)
        self.read_window: Callable[[], list[int]] = list
        self.window_was_read: Callable[[int], None] = lambda _: None

    def add(self, ref: str) -> Cell:
        """The parameter that a profile writes as "@7706:INTEGER32"; the same one when it is named again."""
        address_text, _, kind = ref.removeprefix("@").partition(":")
        if not (ref.startswith("@") and address_text.isdigit() and kind in _FORMATS):
            raise BenchError(f'register "{ref}"', "cannot be read", 'Write it like "@7706:INTEGER32".')
        return self.add_at(int(address_text), kind)

    def add_at(self, address: int, kind: str) -> Cell:
        """The parameter of that type at an address. Raises BenchError where it overlaps another."""
        code = _FORMATS[kind]
        words = max(struct.calcsize(code) // 2, self.at_least)
        known = self.cells.get(address)
        if known is not None and known.code == code:
            return known
        cell = Cell(address, code, words)
        for at in range(address, address + words):
            if at in self._at or at in self.window:
                raise BenchError(f"register {address}", f"overlaps another at {at}", "Correct the profile.")
            self._at[at] = cell
        self.cells[address] = cell
        return cell

    def load(self, values: Mapping[int, float]) -> None:
        """Set what cells hold, by address, without their hooks."""
        for address, value in values.items():
            self.cells[address].value = value

    def read(self, address: int, count: int) -> list[int]:
        """Words at addresses. Raises RefusalError where a parameter is not there, or only a part of it is asked for."""
        if address in self.window and address + count - 1 in self.window:
            first = address - self.window.start
            words = self.read_window()[first : first + count]
            self.window_was_read(count)
            return words
        return [word for cell in self._covering(address, count) for word in cell.encode(self.high_first)]

    def write(self, address: int, words: list[int]) -> None:
        """Write parameters, in the order of their addresses. Raises RefusalError."""
        cells = self._covering(address, len(words))
        values = []
        for cell in cells:
            if cell.read_only:
                raise RefusalError(ILLEGAL_ADDRESS)
            first = cell.address - address
            values.append(cell.decode(words[first : first + cell.words], self.high_first))
        for cell, value in zip(cells, values, strict=True):
            if cell.write is not None:
                cell.write(value)
            cell.value = value

    def _covering(self, address: int, count: int) -> list[Cell]:
        cells, at = [], address
        while at < address + count:
            cell = self.cells.get(at)
            if cell is None or at + cell.words > address + count:
                raise RefusalError(ILLEGAL_ADDRESS)
            cells.append(cell)
            at += cell.words
        return cells
