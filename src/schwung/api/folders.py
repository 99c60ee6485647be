"""Where commands write: looked at early, made late, so that a refused command leaves nothing behind."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path

from schwung.errors import InputError


def planned_folder(out: Path | None, *, beside_session: bool = False) -> Path:
    """The folder that a command will write to; nothing is made yet.

    Raises InputError where it holds a session already (unless what is written may lie beside one), or where it
    cannot be made or written.
    """
    folder = out or Path(f"schwung-{datetime.now().astimezone():%Y%m%d-%H%M%S}")
    if not beside_session and (folder / "session.h5").exists():
        raise InputError(str(folder), "holds a session already", "Choose another --out.")
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise InputError(str(folder), f"cannot be made: {there} is a file", "Choose another --out.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(str(folder), f"cannot be written: no permission in {there}", "Choose another --out.")
    return folder


def make_folder(folder: Path) -> None:
    """Make a planned folder. Raises InputError where the system refuses."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(str(folder), f"cannot be made: {reason}", "Choose another --out.") from error


def output_folder(out: Path | None) -> Path:
    """The folder for what a command writes, made now. Raises InputError as the two above do."""
    folder = planned_folder(out)
    make_folder(folder)
    return folder
