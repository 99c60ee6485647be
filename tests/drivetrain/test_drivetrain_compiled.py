"""Compiled code on disk goes out of date with any file that it may have taken code from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from schwung.drivetrain import compiled


def test_the_stamp_covers_every_file_of_compiled_code() -> None:
    room = Path(compiled.__file__).parent
    users = {
        file.name for file in room.glob("*.py") if "drivetrain.compiled import" in file.read_text("utf-8")
    }
    assert users == set(compiled._FILES)


def test_the_stamp_is_part_of_what_numba_compares() -> None:
    @compiled.compiled
    def double(x: float) -> float:
        return 2 * x

    assert double(1.5) == 3.0
    dispatcher: Any = double
    assert compiled._STAMP in dispatcher._cache._cache_file._source_stamp
