"""What a file holds, before anybody says what it means: named columns and numbers."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from schwung.errors import InputError
from schwung.motion import Array


@dataclass(frozen=True, eq=False)
class Column:
    """One column (n,); `time_s` (n,) where the file gives this column a time base of its own."""

    name: str
    values: Array
    unit: str = ""
    aliases: tuple[str, ...] = ()
    time_s: Array | None = None
    first_line: int | None = None  # line of the file that holds the first sample, for messages


@dataclass(frozen=True, eq=False)
class Table:
    """The columns of one file, and its single numbers (MAT scalars) by name."""

    path: Path
    columns: tuple[Column, ...]
    numbers: Mapping[str, float] = field(default_factory=dict)
    created: str | None = None  # ISO 8601, where the file says when it was recorded
    described: str = ""  # what kind of file it is

    def column(self, wanted: str, option: str) -> Column:
        """The column that is meant by a name or a number.

        Names first, exactly, then regardless of case, then by what stands behind the last dot; numbers count from
        0. `data[:,2]` (from 0, as in Python) and `data(:,3)` (from 1, as in MATLAB) are one column of a matrix.
        Raises InputError, naming what there is, for none and for several.
        """
        place = f"{self.path}: {option} {wanted}"
        name = _matrix_column(wanted.strip())
        for same in (_exactly, _regardless_of_case, _last_part):
            found = [column for column in self.columns if same(column, name)]
            if len(found) == 1:
                return found[0]
            if found:
                numbers = ", ".join(str(self.columns.index(column)) for column in found)
                raise InputError(place, "is the name of several columns", f"Give a number: {numbers}.")
        if re.fullmatch(r"\d+", name):
            if int(name) < len(self.columns):
                return self.columns[int(name)]
            raise InputError(place, f"there are {len(self.columns)} columns", "They count from 0.")
        raise InputError(place, "there is no such column", self._suggestion(name))

    def number(self, wanted: str, option: str) -> float:
        """A number as written, or the name of a single number in the file. Raises InputError for neither."""
        try:
            value = float(wanted)
        except ValueError:
            if wanted not in self.numbers:
                there = ", ".join(sorted(self.numbers)) or "none"
                raise InputError(f"{self.path}: {option} {wanted}", "is neither a number nor one in the file",
                                 f"Single numbers in the file: {there}.") from None  # fmt: skip
            value = self.numbers[wanted]
        if not np.isfinite(value) or value == 0:
            raise InputError(
                f"{self.path}: {option} {wanted}", f"is {value:g}", "Give a factor other than 0."
            )
        return value

    def _suggestion(self, name: str) -> str:
        names = [column.name for column in self.columns]
        close = difflib.get_close_matches(name.lower(), [each.lower() for each in names], n=1)
        meant = next((each for each in names if close and each.lower() == close[0]), None)
        listed = ", ".join(names[:20]) + (", …" if len(names) > 20 else "")
        return f"Did you mean {meant}? There are: {listed}." if meant else f"There are: {listed}."


def _exactly(column: Column, name: str) -> bool:
    return name == column.name or name in column.aliases


def _regardless_of_case(column: Column, name: str) -> bool:
    return name.lower() in (each.lower() for each in (column.name, bare_name(column.name), *column.aliases))


def _last_part(column: Column, name: str) -> bool:
    return name.lower() in (each.rpartition(".")[2].lower() for each in (column.name, *column.aliases))


def bare_name(name: str) -> str:
    """A column's name without the unit in brackets behind it."""
    return re.sub(r"\s*[\[(][^\[\]()]*[\])]\s*$", "", name) or name


def _matrix_column(wanted: str) -> str:
    """One spelling for a column (or row) of a matrix, counting from 0."""
    python = re.fullmatch(r"(.+?)\[\s*:\s*,\s*(\d+)\s*\]", wanted)
    if python:
        return f"{python[1]}[:,{int(python[2])}]"
    matlab = re.fullmatch(r"(.+?)\(\s*:\s*,\s*([1-9]\d*)\s*\)", wanted)
    if matlab:
        return f"{matlab[1]}[:,{int(matlab[2]) - 1}]"
    row = re.fullmatch(r"(.+?)(?:\[\s*(\d+)\s*,\s*:\s*\]|\(\s*([1-9]\d*)\s*,\s*:\s*\))", wanted)
    if row:
        return f"{row[1]}[{int(row[2]) if row[2] else int(row[3]) - 1},:]"
    return wanted
