"""Text files: CSV of any separator and decimal mark, with or without header, and the exports of TwinCAT Scope."""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array
from schwung.session.imports.stamps import read_stamps
from schwung.session.imports.table import Column, Table
from schwung.session.imports.twincat import is_scope_header, scope_table
from schwung.session.imports.units import is_unit

#: In this order: a decimal comma is as frequent in its lines as any separator, so the comma comes late.
_SEPARATORS = (";", "\t", ",", " ")
_PROBED_LINES = 20
_COMMENT = re.compile(r"^\s*[#%]+\s?")
_END_MARK = "EOF"
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(\.\d{3})+(,\d*)?")
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Layout:
    """How a text file is written: separator, decimal mark, number of columns, line of the first sample (from 0)."""

    separator: str
    decimal_comma: bool
    columns: int
    first_line: int


def read_text(path: Path) -> Table:
    """Read a text file of samples. Raises InputError, with line and column, for what is not a table of numbers."""
    lines = _decoded(path).splitlines()
    while lines and (not lines[-1].strip(" \t;,") or lines[-1].strip(' \t;,"') == _END_MARK):
        lines.pop()
    layout = _layout(lines, path)
    header = [_cells(line, layout.separator) for line in lines[: layout.first_line]]
    if is_scope_header(header):
        body = _Body(path, lines, layout)
        return scope_table(path, header, body.column, layout.columns, layout.first_line + 1)
    names, units = _names(lines[: layout.first_line], layout)
    values = _numbers(path, lines, layout)
    columns = tuple(
        Column(names[k], _without_end(values[:, k]), units[k], (), None, layout.first_line + 1)
        for k in range(layout.columns)
        if np.any(np.isfinite(values[:, k])) or names[k] != f"column {k}"
    )
    return Table(path, columns, described="CSV")


def _decoded(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(path), f"cannot be read: {reason}", "Check the path.") from None
    if data.startswith(b"\x1f\x8b"):
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error):
            raise InputError(str(path), "is a damaged gzip file", "Copy it again.") from None
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    zeros = [
        data[k:4096:2].count(0) for k in (0, 1)
    ]  # UTF-16 without its mark: every other byte of digits is 0
    if max(zeros) > 0.4 * min(len(data) / 2, 2048) and min(zeros) == 0:
        return data.decode("utf-16-le" if zeros[1] else "utf-16-be", errors="replace")
    if b"\0" in data[:4096]:
        raise InputError(
            str(path), "is neither text nor a MAT, MDF or Parquet file", "Export it as one of them."
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    return [cell.strip() for cell in line.split(separator)]


def _pointed(cell: str, decimal_comma: bool) -> str:
    """A number with a point for its decimals, as Python reads it: 1.234,5 is one thousand and more."""
    if not decimal_comma:
        return cell
    return (cell.replace(".", "") if _THOUSANDS.fullmatch(cell) else cell).replace(",", ".")


def _is_number(cell: str, decimal_comma: bool) -> bool:
    try:
        float(_pointed(cell, decimal_comma))
    except ValueError:
        return False
    return True


def _numbers_in(cells: Sequence[str], decimal_comma: bool) -> int:
    return sum(_is_number(cell, decimal_comma) for cell in cells if cell)


def _is_sample(cells: Sequence[str], decimal_comma: bool, with_text: bool) -> bool:
    """Whether a line is one of samples: numbers throughout, or, with text among them, two and half at the least."""
    filled = sum(bool(cell) for cell in cells)
    numbers = _numbers_in(cells, decimal_comma)
    return numbers >= max(2, filled / 2) if with_text else 0 < numbers == filled


def _layout(lines: Sequence[str], path: Path) -> Layout:
    probed = [line for line in lines[-3 * _PROBED_LINES :] if line.strip()][-_PROBED_LINES:]
    for with_text in (False, True):
        for separator in _SEPARATORS:
            rows = [_cells(line, separator) for line in probed]
            quoted = any('"' in line for line in probed)
            comma = (separator != "," or quoted) and any(
                _DECIMAL_COMMA.fullmatch(cell) for row in rows for cell in row
            )
            samples = [row for row in rows if len(row) > 1 and _is_sample(row, comma, with_text)]
            if not samples or len(samples) < len(rows) / 2:
                continue  # half may be header, or hold the cell to complain about
            first = _first_line(lines, separator, comma, with_text)
            top = [_cells(line, separator) for line in lines[first : first + _PROBED_LINES]]
            count = max(len(row) for row in (*samples, *top))  # slow channels of a Scope export end early
            return Layout(separator, comma, count, first)
    if probed and all(_is_number(line.strip(), False) for line in probed):  # a single column
        return Layout(";", False, 1, _first_line(lines, ";", False, False))
    shown = probed[-1].strip()[:60] if probed else "nothing"
    raise InputError(
        str(path),
        f'its last lines are not columns of numbers ("{shown}")',
        "Give columns separated by semicolon, tab, comma or blank, one sample per line.",
    )


def _first_line(lines: Sequence[str], separator: str, decimal_comma: bool, with_text: bool) -> int:
    """The first line of samples; there is one, the layout was found from it."""
    return next(
        index
        for index, line in enumerate(lines)
        if _is_sample(_cells(line, separator), decimal_comma, with_text)
    )


def _names(header: Sequence[str], layout: Layout) -> tuple[list[str], list[str]]:
    """Names and units of the columns, from the lines right above the samples; comment marks are ignored."""
    rows = [_cells(_COMMENT.sub("", line), layout.separator) for line in header if line.strip()]
    rows = [row for row in rows if len(row) in (layout.columns, layout.columns - 1)][-3:]
    rows = [row + [""] * (layout.columns - len(row)) for row in rows]
    units = [""] * layout.columns
    if len(rows) > 1 and any(rows[-1]) and all(_is_unit_cell(cell) for cell in rows[-1]):
        units = [cell.strip("[]()") for cell in rows.pop()]
    names = [name.strip() for name in (rows[-1] if rows else units)]
    if len(rows) > 1 and len(set(filter(None, names))) < sum(map(bool, names)):
        names = _grouped(names, rows[-2])
    return [name or f"column {k}" for k, name in enumerate(names)], units


def _is_unit_cell(cell: str) -> bool:
    """Whether a cell in the line above the samples is a unit: in brackets, or one that is known."""
    bracketed = re.fullmatch(r"[\[(][^\s\[\]()]{0,8}[\])]", cell) is not None
    return not cell or bracketed or is_unit(cell)


def _grouped(names: Sequence[str], above: Sequence[str]) -> list[str]:
    """Names that come several times, with what stands above them in one cell over several columns: Axis 1 Position."""
    if not 0 < sum(map(bool, above)) < len(above):
        return list(names)
    group, full = "", []
    for name, head in zip(names, above, strict=True):
        group = head.strip() or group
        full.append(f"{group} {name}" if group and names.count(name) > 1 else name)
    return full


def _numbers(path: Path, lines: Sequence[str], layout: Layout) -> Array:
    """All samples (n, columns), NaN where a cell is empty. The fast way first; the slow one names the bad cell."""
    body = lines[layout.first_line :]
    thousands = layout.decimal_comma and any("." in line for line in body[:_PROBED_LINES])
    if '"' not in body[0] and layout.columns > 1 and not thousands:
        text = (line.replace(",", ".") for line in body) if layout.decimal_comma else iter(body)
        delimiter = None if layout.separator == " " else layout.separator
        try:
            values = np.loadtxt(text, delimiter=delimiter, ndmin=2, comments=None)
        except ValueError:
            pass
        else:
            if values.shape[1] == layout.columns:
                return np.asarray(values, dtype=np.float64)
    read = _Body(path, lines, layout)
    none = np.full(len(read), np.nan)

    def column(k: int) -> Array:
        if not read.is_text(k):
            return read.column(k)
        stamps = read_stamps(read.cells(k))
        return none if stamps is None else stamps

    return np.column_stack([column(k) for k in range(layout.columns)])


def _without_end(values: Array) -> Array:
    """A column without the empty cells below its last sample."""
    filled = np.flatnonzero(~np.isnan(values))
    return values[: filled[-1] + 1] if filled.size else values[:0]


class _Body:
    """The samples of a text file, cell by cell."""

    def __init__(self, path: Path, lines: Sequence[str], layout: Layout) -> None:
        self._path, self._layout = path, layout
        self._rows = [
            (number, _cells(line, layout.separator))
            for number, line in enumerate(lines[layout.first_line :], layout.first_line + 1)
            if line.strip()
        ]

    def __len__(self) -> int:
        return len(self._rows)

    def is_text(self, k: int) -> bool:
        """Whether column k holds text (a state, a date) as far as its first and last cells say."""
        ends = [cells[k] for _, cells in (self._rows[0], self._rows[-1]) if k < len(cells) and cells[k]]
        return bool(ends) and not _numbers_in(ends, self._layout.decimal_comma)

    def cells(self, k: int) -> list[str]:
        """The cells of column k as they are written."""
        return [cells[k].strip('"') if k < len(cells) else "" for _, cells in self._rows]

    def column(self, k: int, base: bool = False) -> Array:
        """Column k (n,), NaN where a cell is empty; with `base` whole numbers count from the first (file times).

        Raises InputError with line and column for a cell that is no number.
        """
        comma = self._layout.decimal_comma
        origin: int | None = None
        values = np.full(len(self._rows), np.nan)
        for row, (number, cells) in enumerate(self._rows):
            cell = cells[k] if k < len(cells) else ""
            if not cell:
                continue
            try:
                if base and cell.isdigit():  # 18 digits do not fit a float
                    origin = int(cell) if origin is None else origin
                    values[row] = int(cell) - origin
                else:
                    values[row] = float(_pointed(cell, comma))
            except ValueError:
                raise InputError(f"{self._path}: line {number}, column {k}", f'"{cell}" is not a number',
                                 "Correct that cell, or cut the file before it.") from None  # fmt: skip
        return values
