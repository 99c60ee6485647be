"""A session on the command line: its file's name goes into what is said about it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from schwung.errors import InputError


@contextmanager
def in_file(path: Path) -> Iterator[None]:
    """Errors about a session name its file."""
    try:
        yield
    except InputError as error:
        if error.place != "session":
            raise
        raise InputError(str(path), error.problem, error.remedy) from error
