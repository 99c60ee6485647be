"""The drive's trace buffer over Modbus: armed, waited for, read out window by window, decoded."""

from __future__ import annotations

import contextlib
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from schwung.errors import DriveError, InputError, RegisterError
from schwung.fieldbus.drive import ParameterValue, Progress
from schwung.fieldbus.modbus.registers import Registers
from schwung.fieldbus.modbus.words import WordOrder, word_count
from schwung.fieldbus.profile import ObjectRef, Trace, TraceColumn, TracedQuantity
from schwung.fieldbus.tracing import Columns, TraceRequest, column_scale, trace_settings
from schwung.fieldbus.units import Scales
from schwung.motion import Array

State = Literal["idle", "armed", "running", "full"]

#: numpy's names, high byte first: as a word is sent.
_TYPES = {
    "INTEGER16": ">i2", "UNSIGNED16": ">u2", "INTEGER32": ">i4", "UNSIGNED32": ">u4",
    "INTEGER64": ">i8", "UNSIGNED64": ">u8", "REAL32": ">f4", "REAL64": ">f8",
}  # fmt: skip


_WINDOW_ATTEMPTS = 3


class TraceBuffer:
    """One drive's recorder, as [trace] of its profile describes it. Raises InputError for one that cannot be read."""

    def __init__(self, registers: Registers, trace: Trace) -> None:
        self._registers, self._trace = registers, trace
        unknown = next((c.type for c in trace.columns if c.type not in _TYPES), None)
        if unknown is not None:
            raise InputError(
                "profile, [trace]", f'no column can be of type "{unknown}"', f"Use {', '.join(_TYPES)}."
            )
        if trace.trigger != "motion_start":
            raise InputError(
                "profile, [trace]",
                "a trace that does not start with the motion cannot be aligned with it",
                "Choose another trigger.",
            )
        widths = [word_count(column.type) for column in trace.columns]
        self._row_words = sum(widths)
        chunk = registers.profile.modbus.chunk
        self._window = min(trace.window or chunk, chunk) // self._row_words * self._row_words
        if trace.layout == "rows" and self._window == 0:
            raise InputError(
                "profile, [trace]",
                f"a row of {self._row_words} registers does not fit the window",
                "Widen it.",
            )

    def settings(self, request: TraceRequest) -> list[ParameterValue]:
        """What must be in the drive for such a trace."""
        return [
            ParameterValue(self._registers.at(ref), value)
            for ref, value in trace_settings(self._trace, request)
        ]

    def parameters(self) -> list[ObjectRef]:
        """What playing changes besides: where the window stands, and whether the trace is armed."""
        cursor = self._trace.cursor
        if cursor is not None and self._registers.lookup_integer(cursor.index) is None:
            cursor = None  # it takes a position and shows none
        return [self._trace.control.object, *([cursor] if cursor is not None else [])]

    def arm(self) -> None:
        """Make it wait for the motion. Raises RegisterError where the drive refuses."""
        self._registers.put(self._trace.control.object, self._trace.control.arm)

    def stop(self) -> None:
        """End it, where it can be ended; what was recorded stays. Never raises."""
        if self._trace.control.stop is not None:
            with contextlib.suppress(DriveError):
                self._registers.put(self._trace.control.object, self._trace.control.stop)

    def state(self) -> State:
        """How far it is. Raises RegisterError."""
        status = self._trace.status
        value = self._registers.integer(status.object) & status.mask
        known: tuple[tuple[int | None, State], ...] = (
            (status.full, "full"),
            (status.running, "running"),
            (status.armed, "armed"),
        )
        return next((name for code, name in known if code is not None and code == value), "idle")

    def read(self, rows: int, scales: Scales, progress: Progress | None = None) -> Columns:
        """The first `rows` rows, SI, by quantity; a column of unknown unit is left out. Raises RegisterError."""
        trace, order = self._trace, self._registers.profile.modbus.word_order
        if trace.data is not None:
            words = self._rows(trace.data, rows, progress).reshape(rows, self._row_words)
            raw, at = [], 0
            for column in trace.columns:
                width = word_count(column.type)
                raw.append(_values(words[:, at : at + width], column.type, order))
                at += width
        else:
            raw = [
                _values(self._straight(c.data.index, rows * word_count(c.type)), c.type, order)
                for c in trace.columns
                if c.data is not None
            ]
        columns: dict[TracedQuantity, Array] = {}
        for column, values in zip(trace.columns, raw, strict=True):
            scale = _scale(column, scales)
            if math.isfinite(scale):
                columns[column.quantity] = values * scale
        return columns

    def _rows(self, data: ObjectRef, rows: int, progress: Progress | None) -> NDArray[np.uint16]:
        """All words of the rows: the window is moved over them, or they simply lie one after another."""
        cursor = self._trace.cursor
        if cursor is None:
            return self._straight(data.index, rows * self._row_words)
        held = np.zeros(rows * self._row_words, dtype=np.uint16)
        step = self._window // self._row_words
        for first in range(0, rows, step):
            count = min(step, rows - first) * self._row_words
            at = first * self._row_words
            held[at : at + count] = self._at_cursor(cursor, first, data, count)
            if progress is not None:
                progress(min(first + step, rows), rows)
        return held

    def _at_cursor(self, cursor: ObjectRef, first: int, data: ObjectRef, count: int) -> tuple[int, ...]:
        """The window, put at a row and read. Raises RegisterError.

        In some drives reading moves it on: where an answer was lost, it is put there again and asked where it stands
        before the next try, so that no row is skipped or read twice.
        """
        registers, tries = self._registers, 0
        while True:
            tries += 1
            try:
                registers.put(cursor, first)  # a position, which starts nothing: it may be written again
                if tries > 1:
                    self._require_at(cursor, first)
                return registers.link.read(data.index, count, again=False)
            except RegisterError as error:
                if error.code is not None or tries == _WINDOW_ATTEMPTS:
                    raise

    def _require_at(self, cursor: ObjectRef, first: int) -> None:
        try:
            stands = self._registers.integer(cursor)
        except RegisterError as error:
            if error.code is None:
                raise
            return  # it takes a position and shows none
        if stands != first:
            raise RegisterError(
                self._registers.at(cursor).label,
                f"stands at row {stands}, not {first}",
                "Look for another master on the line.",
            )

    def _straight(self, address: int, count: int) -> NDArray[np.uint16]:
        chunk = self._registers.profile.modbus.chunk
        held = np.zeros(count, dtype=np.uint16)
        for first in range(0, count, chunk):
            size = min(chunk, count - first)
            held[first : first + size] = self._registers.link.read(address + first, size)
        return held


def _values(words: NDArray[np.uint16], type_name: str, order: WordOrder) -> Array:
    """Words of one column, (rows, width), as numbers, (rows,)."""
    width = word_count(type_name)
    ordered = words.reshape(-1, width)
    if order == "low_first":
        ordered = ordered[:, ::-1]
    data = np.ascontiguousarray(ordered, dtype=">u2").tobytes()
    return np.frombuffer(data, _TYPES[type_name]).astype(float)


def _scale(column: TraceColumn, scales: Scales) -> float:
    return column.scale if column.scale is not None else column_scale(column.quantity, scales)
